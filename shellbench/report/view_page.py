"""What the page needs for its views: the library that draws them, the scripts, and the hashes that let them in."""

from __future__ import annotations

import base64
import hashlib
import json
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

from shellbench.errors import ShellbenchError
from shellbench.report.view_data import packed_bytes

HOLDER = "(window.shellbench = window.shellbench || {}).library = "
SORTING = ("sort.js",)
LIBRARY = "plotly.js"  # beside the pages, which share it
VIEWING = ("view_field.js", "view_plot.js", "view_controls.js", "view.js")


@dataclass(frozen=True)
class Scripts:
    """Scripts of the page.

    Attributes
    ----------
    inline
        As they stand in the page.
    library
        Script that holds Plotly, compressed, as base64; empty if there is nothing to view.
    hashes
        Sources for the content security policy: these scripts run, Plotly among them, and what stands beside the page.
    """

    inline: tuple[str, ...]
    library: str
    hashes: tuple[str, ...]


@cache
def scripts(viewing: bool) -> Scripts:
    """Return the scripts of a page that has views, or none."""
    inline = tuple(_template(name) for name in (SORTING + VIEWING if viewing else SORTING))
    library = _plotly() if viewing else ""
    run = (*inline, library) if viewing else inline
    return Scripts(
        inline=inline,
        library=f"{HOLDER}{json.dumps(packed_bytes(library.encode()))};\n" if viewing else "",
        hashes=(*map(_hash, run), *(("'self'",) if viewing else ())),
    )


def _plotly() -> str:
    """Return the library from plotly's package, which is not imported: that takes longer than to read the file."""
    spec = find_spec("plotly")
    if spec is None or not spec.submodule_search_locations:
        raise ShellbenchError("plotly, which draws in three dimensions, is not installed")
    return (Path(spec.submodule_search_locations[0]) / "package_data" / "plotly.min.js").read_text(encoding="utf-8")


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _template(name: str) -> str:
    return (files("shellbench.report") / "templates" / name).read_text(encoding="utf-8")
