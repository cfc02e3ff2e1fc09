"""What the page needs for its views: the library that draws them, the scripts, and the hashes that let them in."""

from __future__ import annotations

import base64
import hashlib
from dataclasses import dataclass
from importlib.resources import files

from plotly.offline import get_plotlyjs

from shellbench.report.view_data import packed_bytes

SORTING = ("sort.js",)
VIEWING = ("view_field.js", "view_plot.js", "view_controls.js", "view.js")


@dataclass(frozen=True)
class Scripts:
    """Scripts of the page.

    Attributes
    ----------
    inline
        As they stand in the page.
    library
        Plotly, compressed, as base64; empty if there is nothing to view.
    hashes
        Sources for the content security policy: these scripts and no others run.
    """

    inline: tuple[str, ...]
    library: str
    hashes: tuple[str, ...]


def scripts(viewing: bool) -> Scripts:
    """Return the scripts of a page that has views, or none."""
    inline = tuple(_template(name) for name in (SORTING + VIEWING if viewing else SORTING))
    library = str(get_plotlyjs()) if viewing else ""
    run = (*inline, library) if viewing else inline
    return Scripts(
        inline=inline,
        library=packed_bytes(library.encode()) if viewing else "",
        hashes=tuple(f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'" for text in run),
    )


def _template(name: str) -> str:
    return (files("shellbench.report") / "templates" / name).read_text(encoding="utf-8")
