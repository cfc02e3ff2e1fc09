"""A figure of the report with its caption, and how it is kept."""

from __future__ import annotations

import base64
import multiprocessing
import re
import signal
import sys
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Literal
from urllib.parse import quote

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from shellbench.bench.environment import cores
from shellbench.errors import ShellbenchError
from shellbench.report.palette import style

PRINT_DPI, SCREEN_DPI = 300, 160
PALETTE = 256  # colours of a picture, chosen for it: a quarter of the bytes, and hardly a difference to be seen
FARTHEST = 15  # of 255: how far a colour may be from the palette; farther, and bands are seen
ROUNDED = 8  # of 255: half the bytes, and no difference to be seen
COORDINATES = re.compile(rb'(?<= [dxy]=")[^"]*')
STYLES = re.compile(rb'style="([^"]*)"')
REMARKS = re.compile(rb"<!--.*?-->", re.DOTALL)
INDENTS = re.compile(rb"\n\s*")
OFTEN = 3  # marks of a style from which on it is a class
LONG = re.compile(rb"-?\d+\.\d{3,}")
QUOTE, APOSTROPHE, NEWLINE, SPACE = b'"', b"'", b"\n", b" "
IN_LINKS = " !$()*+,-./:;=?@[]_~{}|'"  # characters that need no escape in a link that holds mark-up
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
    def file(self) -> str:
        """Name of the file that a text shows."""
        return f"{self.name}.{'svg' if self.drawing else 'png'}"

    @property
    def inches(self) -> float:
        """Width in print."""
        return float(self.figure.get_figwidth())

    def save(self, folder: Path, for_print: bool = True) -> str:
        """Write pictures as PNG and drawings as SVG, for print both as PNG and PDF; return a data URI for the page."""
        with style():
            if engine := self.figure.get_layout_engine():
                engine.execute(self.figure)  # once for all formats
            self.figure.set_layout_engine(None)
            if for_print:
                (folder / f"{self.name}.pdf").write_bytes(self._rendered("pdf", PRINT_DPI))
            if for_print or not self.drawing:
                png = self._rendered("png", SCREEN_DPI)
                png = png if self.drawing else few_colours(png)
                (folder / f"{self.name}.png").write_bytes(png)
            if not self.drawing:
                return data_uri("image/png", png)
            svg = lean(self._rendered("svg", SCREEN_DPI))
            (folder / f"{self.name}.svg").write_bytes(svg)
            return data_uri("image/svg+xml", svg) if APOSTROPHE in svg else text_uri("image/svg+xml", svg)

    def _rendered(self, format: Format, dpi: int) -> bytes:
        buffer = BytesIO()
        undated = {"pdf": {"CreationDate": None}, "svg": {"Date": None}, "png": {"Software": None}}
        self.figure.savefig(buffer, format=format, dpi=dpi, metadata=undated[format])
        return buffer.getvalue()


def save_all(exhibits: Sequence[Exhibit], folder: Path, for_print: bool = True) -> dict[str, str]:
    """Write figures as `Exhibit.save` does, a process a core; return them as data URIs by name.

    The processes are forked, for some figures can't be sent. Where that is not safe, they are written one by one.

    Raises
    ------
    OSError
        If they can't be written.
    ShellbenchError
        If a process was killed.
    """
    jobs = min(cores(), len(exhibits))
    if jobs < 2 or sys.platform != "linux":
        return {exhibit.name: exhibit.save(folder, for_print) for exhibit in exhibits}
    fork = multiprocessing.get_context("fork")
    try:
        with ProcessPoolExecutor(jobs, fork, _to_be_saved, (exhibits, folder, for_print)) as pool:
            uris = list(pool.map(_save, range(len(exhibits))))
    except BrokenProcessPool:
        raise ShellbenchError("a process that draws figures was killed: out of memory, perhaps") from None
    return {exhibit.name: uri for exhibit, uri in zip(exhibits, uris, strict=True)}


_work: list[tuple[Sequence[Exhibit], Path, bool]] = []  # of a forked process: what it was forked with


def _to_be_saved(exhibits: Sequence[Exhibit], folder: Path, for_print: bool) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupt from the terminal is for who has forked
    _work[:] = [(exhibits, folder, for_print)]


def _save(number: int) -> str:
    ((exhibits, folder, for_print),) = _work
    return exhibits[number].save(folder, for_print)


def few_colours(png: bytes) -> bytes:
    """Return a PNG of fewer colours: a palette of its own, or if that is too far from some, all of them rounded."""
    image = Image.open(BytesIO(png)).convert("RGB")
    colours = np.asarray(image).astype(int)
    reduced = image.quantize(PALETTE, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    palette = np.array(reduced.getpalette()).reshape(-1, 3)
    palette[np.asarray(reduced)[0, 0]] = colours[0, 0]  # the background stays what it was
    reduced.putpalette(palette.ravel().tolist())
    if np.abs(np.asarray(reduced.convert("RGB")) - colours).max() > FARTHEST:
        rounded = np.minimum((colours + ROUNDED // 2) // ROUNDED * ROUNDED, 255).astype(np.uint8)
        reduced = Image.fromarray(rounded)
    buffer = BytesIO()
    reduced.save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def lean(svg: bytes) -> bytes:
    """Return an SVG that draws the same in fewer bytes.

    Curves are rounded to a hundredth of a point, a style that many marks have is written once, as a class, and there
    are no remarks and no indents.
    """
    counted = Counter(STYLES.findall(svg))
    names = {style: b"s%d" % i for i, style in enumerate(style for style, n in counted.items() if n >= OFTEN)}
    rules = b"".join(b".%s{%s}" % (name, style) for style, name in names.items())
    named = STYLES.sub(lambda found: b'class="%s"' % names[found[1]] if found[1] in names else found[0], svg)
    rounded = COORDINATES.sub(lambda found: LONG.sub(_hundredths, found[0]), named)
    plain = INDENTS.sub(b"\n", REMARKS.sub(b"", rounded))
    return plain.replace(b"</style>", rules + b"</style>", 1) if b"</style>" in svg else svg


def _hundredths(number: re.Match[bytes]) -> bytes:
    return f"{round(float(number[0]), 2) + 0.0:.2f}".rstrip("0").rstrip(".").encode()  # + 0.0: there is no -0


def text_uri(kind: str, text: bytes) -> str:
    """Return mark-up as a link that holds it, shorter than base64 would be."""
    return f"data:{kind},{quote(text.replace(QUOTE, APOSTROPHE).replace(NEWLINE, SPACE), safe=IN_LINKS)}"


def data_uri(kind: str, data: bytes) -> str:
    """Return data as a link that holds it."""
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"
