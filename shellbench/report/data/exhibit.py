"""Figures: one style for print, for each solver its own colour and marker everywhere, and how they are kept."""

from __future__ import annotations

import base64
import hashlib
import multiprocessing
import re
import signal
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast
from urllib.parse import quote

import numpy as np

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.suite import Study
from shellbench.bench.store.environment import cores
from shellbench.errors import ShellbenchError

if TYPE_CHECKING:  # a table of text draws nothing
    from matplotlib.figure import Figure


OKABE_ITO = ("#E69F00", "#56B4E9", "#000000", "#CC79A7", "#009E73", "#D55E00", "#0072B2")
"""Colours that the colour-blind can tell apart (Okabe & Ito 2008); its yellow is too pale for lines on white."""
FURTHER = ("#882255", "#332288", "#9600FF", "#4B2D00", "#9678FF", "#E1004B", "#D2B469", "#2D003C")
"""More for when these are taken; the first two are of the muted scheme of Tol (2021). In CIELAB, of normal and of
colour-blind eyes (Machado et al. 2009), each is farther from all others than the nearest two of Okabe & Ito are."""
COLOURS = (*OKABE_ITO, *FURTHER)
MARKERS = ("P", "v", "X", "D", "^", "s", "o", "*", "<", ">", "p", "h", "d", "H", "8")
LAST: Study = "engines"  # its solvers came after the others, whose colours stay what they were
Dashes = str | tuple[float, tuple[float, ...]]
DASHES: tuple[Dashes, ...] = ("-", (0, (4, 1.5)), (0, (1, 1.2)), (0, (5, 1.5, 1, 1.5)))

STYLE: dict[str, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "mathtext.fontset": "dejavusans",
    "font.size": 8.0,
    "axes.titlesize": 8.5,
    "axes.labelsize": 8.0,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "legend.fontsize": 7.5,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.linewidth": 0.4,
    "grid.color": "#D9D9D9",
    "lines.linewidth": 1.3,
    "lines.markersize": 3.8,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.frameon": False,
    "figure.dpi": 100.0,
    "savefig.facecolor": "white",
    "pdf.fonttype": 42,  # TrueType: text in the PDF stays text
    "svg.fonttype": "path",
    "svg.hashsalt": "shellbench",  # the same figure is the same file
}
PRINT_DPI, SCREEN_DPI = 300, 160
PALETTE = 256  # colours of a picture, chosen for it: a quarter of the bytes, and hardly a difference to be seen
FARTHEST = 15  # of 255: how far a colour may be from the palette; farther, and bands are seen
ROUNDED = 8  # of 255: half the bytes, and no difference to be seen
COORDINATES = re.compile(rb'(?<= [dxy]=")[^"]*')
REMARKS_AND_INDENTS = re.compile(rb"<!--.*?-->\s*|(?<=\n)\s+", re.DOTALL)
LONG = re.compile(rb"-?\d+\.\d{3,}")
IN_LINKS = " !$()*+,-./:;=?@[]_~{}|'"  # characters that need no escape in a link that holds mark-up
Format = Literal["pdf", "png", "svg"]
_save: list[Callable[[int], str]] = []  # what a forked process does; it is there when it begins


@dataclass(frozen=True)
class Ink:
    """Colour and marker of a solver, and the dashes of its lines."""

    colour: str
    marker: str
    dashes: Dashes = "-"


@contextmanager
def style() -> Iterator[None]:
    """Draw in the style of the report; matplotlib's settings are restored afterwards."""
    import matplotlib as mpl  # here, for tables of text ask for colours' names only

    with mpl.rc_context(cast(Any, STYLE)):
        yield


def inks(solvers: Iterable[str]) -> Mapping[str, Ink]:
    """Return the colour and marker of each solver.

    A solver's place in the palette follows from its name, so that it looks the same in every report. Of names that fall
    on one place, those that the suites declare choose first, whether they are drawn or not; the others take, in
    alphabetical order, the next place that is least in use. What no suite joins, not by others either, is never in one
    figure: solvers of ropes take no colour from those of shells.
    """
    wanted = set(solvers)
    places: dict[str, int] = {}
    company = {solver: number for number, solvers in enumerate(companies()) for solver in solvers}
    for solver in (*declared_solvers(), *sorted(wanted)):
        if solver in places:
            continue
        place = int(hashlib.sha256(solver.encode()).hexdigest(), 16) % len(OKABE_ITO)
        taken: Counter[int] = Counter()
        for other, there in places.items():
            # Who is in no suite keeps away from all, and from others like him first.
            if solver not in company:
                taken[there] += 1 if other in company else len(company) + 1
            elif company.get(other) == company[solver]:
                taken[there] += 1
        ring = ((place + i) % len(OKABE_ITO) for i in range(len(OKABE_ITO)))
        places[solver] = min((*ring, *range(len(OKABE_ITO), len(COLOURS))), key=taken.__getitem__)
    return {solver: Ink(COLOURS[places[solver]], MARKERS[places[solver]]) for solver in sorted(wanted)}


def dashes_of(solutions: Iterable[str]) -> dict[str, Dashes]:
    """Return the dashes of solutions by name: those of one solver have different ones."""
    seen: Counter[str] = Counter()
    found: dict[str, Dashes] = {}
    for name in solutions:
        solver = name.partition(", ")[0]
        found[name] = DASHES[seen[solver] % len(DASHES)]
        seen[solver] += 1
    return found


def companies() -> list[set[str]]:
    """Return the sets of solvers that suites join, directly or by others."""
    found: list[set[str]] = []
    for name in catalog.suite_names():
        joined = {run.solver for run in catalog.find_suite(name).runs}
        apart = [each for each in found if not each & joined]
        found = [*apart, joined.union(*(each for each in found if each & joined))]
    return found


def declared_solvers() -> tuple[str, ...]:
    """Return the solvers of the suites, those of comparisons before those of studies, and those of engines.

    Last come peers that are only swept: each run of theirs has a label.
    """
    found = map(catalog.find_suite, catalog.suite_names())
    suites = sorted(found, key=lambda suite: (suite.study is not None, suite.study == LAST))
    runs = [run for suite in suites for run in suite.runs]
    compared = {run.solver for run in runs if not run.label}
    return tuple(dict.fromkeys(run.solver for run in sorted(runs, key=lambda run: run.solver not in compared)))


@dataclass(frozen=True)
class Exhibit:
    """One figure.

    Attributes
    ----------
    name
        Stem of its files.
    drawing
        Whether it is lines and letters alone, and so goes into the page as SVG.
    film
        Makes a GIF that the page shows instead; the figure is what print has of it.
    """

    name: str
    title: str
    caption: str
    description: str
    figure: Figure
    run_ids: tuple[str, ...]
    drawing: bool = True
    film: Callable[[], bytes] | None = None

    @property
    def file(self) -> str:
        """Name of the file that a text shows."""
        return f"{self.name}.{'gif' if self.film else 'svg' if self.drawing else 'png'}"

    @property
    def inches(self) -> float:
        """Width in print."""
        return float(self.figure.get_figwidth())

    def save(self, folder: Path, for_print: bool = True) -> str:
        """Write pictures as PNG, drawings as SVG, films as GIF too, for print as PNG and PDF; return a data URI."""
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
            if self.film:
                (folder / self.file).write_bytes(moving := self.film())
                return data_uri("image/gif", moving)
            if not self.drawing:
                return data_uri("image/png", png)
            svg = shrink_svg(self._rendered("svg", SCREEN_DPI))
            (folder / f"{self.name}.svg").write_bytes(svg)
            return svg_uri(svg)

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
    _save[:] = [lambda number: exhibits[number].save(folder, for_print)]
    deaf = (signal.SIGINT, signal.SIG_IGN)  # an interrupt from the terminal is for who has forked
    try:
        with ProcessPoolExecutor(jobs, multiprocessing.get_context("fork"), signal.signal, deaf) as pool:
            uris = list(pool.map(_save_one, range(len(exhibits))))
    except BrokenProcessPool:
        raise ShellbenchError("a process that draws figures was killed: out of memory, perhaps") from None
    finally:
        _save.clear()
    return {exhibit.name: uri for exhibit, uri in zip(exhibits, uris, strict=True)}


def _save_one(number: int) -> str:
    return _save[0](number)


def few_colours(png: bytes) -> bytes:
    """Return a PNG of fewer colours: a palette of its own, or if that is too far from some, all of them rounded."""
    from PIL import Image

    image = Image.open(BytesIO(png)).convert("RGB")
    reduced = image.quantize(PALETTE, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    if np.abs(np.asarray(reduced.convert("RGB"), dtype=int) - np.asarray(image, dtype=int)).max() > FARTHEST:
        reduced = image.point(lambda value: min((value + ROUNDED // 2) // ROUNDED * ROUNDED, 255))
    buffer = BytesIO()
    reduced.save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def shrink_svg(svg: bytes) -> bytes:
    """Return an SVG that draws the same in fewer bytes: in hundredths of a point, without remarks and indents."""
    return REMARKS_AND_INDENTS.sub(b"", COORDINATES.sub(lambda found: LONG.sub(_hundredths, found[0]), svg))


def _hundredths(number: re.Match[bytes]) -> bytes:
    return f"{round(float(number[0]), 2) + 0.0:.2f}".rstrip("0").rstrip(".").encode()  # + 0.0: there is no -0


def svg_uri(svg: bytes) -> str:
    """Return a drawing as a link that holds it, as text, which is shorter than base64; with apostrophes for quotes."""
    if b"'" in svg:
        return data_uri("image/svg+xml", svg)
    return "data:image/svg+xml," + quote(svg.replace(b'"', b"'").replace(b"\n", b" "), safe=IN_LINKS)


def data_uri(kind: str, data: bytes) -> str:
    """Return data as a link that holds it."""
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"
