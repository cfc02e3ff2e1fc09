"""A figure of the report with its caption, and how it is kept."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Literal

from matplotlib.figure import Figure

from shellbench.report.palette import style

PRINT_DPI, SCREEN_DPI = 300, 160
Format = Literal["pdf", "png", "svg"]


@dataclass(frozen=True)
class Exhibit:
    """One figure.

    Attributes
    ----------
    name
        Stem of its files.
    drawing
        Whether it is lines and letters alone, and so goes into the page as SVG.
    """

    name: str
    title: str
    caption: str
    description: str
    figure: Figure
    run_ids: tuple[str, ...]
    drawing: bool

    @property
    def inches(self) -> float:
        """Width in print."""
        return float(self.figure.get_figwidth())

    def save(self, folder: Path, for_print: bool = True) -> str:
        """Write it as PNG, drawings as SVG too, and PDF for print; return it as a data URI for the page."""
        with style():
            self.figure.draw_without_rendering()  # lays it out, once for all formats
            self.figure.set_layout_engine(None)
            if for_print:
                (folder / f"{self.name}.pdf").write_bytes(self._rendered("pdf", PRINT_DPI))
            png = self._rendered("png", SCREEN_DPI)
            (folder / f"{self.name}.png").write_bytes(png)
            if not self.drawing:
                return _data_uri("image/png", png)
            svg = self._rendered("svg", SCREEN_DPI)
            (folder / f"{self.name}.svg").write_bytes(svg)
            return _data_uri("image/svg+xml", svg)

    def _rendered(self, format: Format, dpi: int) -> bytes:
        buffer = BytesIO()
        undated = {"pdf": {"CreationDate": None}, "svg": {"Date": None}, "png": {"Software": None}}
        self.figure.savefig(buffer, format=format, dpi=dpi, metadata=undated[format])
        return buffer.getvalue()


def _data_uri(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"
