"""A figure of the report with its caption, and how it is kept."""

from __future__ import annotations

import base64
import re
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Literal

from matplotlib.figure import Figure
from PIL import Image

from shellbench.report.palette import style

PRINT_DPI, SCREEN_DPI = 300, 160
PALETTE = 256  # colours of a picture, chosen for it: a quarter of the bytes, and no difference to be seen
COORDINATES = re.compile(rb'(?<= d=")[^"]*')
LONG = re.compile(rb"-?\d+\.\d{3,}")
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
            png = png if self.drawing else few_colours(png)
            (folder / f"{self.name}.png").write_bytes(png)
            if not self.drawing:
                return data_uri("image/png", png)
            svg = short_coordinates(self._rendered("svg", SCREEN_DPI))
            (folder / f"{self.name}.svg").write_bytes(svg)
            return data_uri("image/svg+xml", svg)

    def _rendered(self, format: Format, dpi: int) -> bytes:
        buffer = BytesIO()
        undated = {"pdf": {"CreationDate": None}, "svg": {"Date": None}, "png": {"Software": None}}
        self.figure.savefig(buffer, format=format, dpi=dpi, metadata=undated[format])
        return buffer.getvalue()


def few_colours(png: bytes) -> bytes:
    """Return a PNG with a palette of its own."""
    image = (
        Image.open(BytesIO(png)).convert("RGB").quantize(PALETTE, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    )
    buffer = BytesIO()
    image.save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def short_coordinates(svg: bytes) -> bytes:
    """Return an SVG with its curves rounded to a hundredth of a point."""
    return COORDINATES.sub(lambda curve: LONG.sub(_hundredths, curve[0]), svg)


def _hundredths(number: re.Match[bytes]) -> bytes:
    return f"{round(float(number[0]), 2) + 0.0:.2f}".rstrip("0").rstrip(".").encode()  # + 0.0: there is no -0


def data_uri(kind: str, data: bytes) -> str:
    """Return data as a link that holds it."""
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"
