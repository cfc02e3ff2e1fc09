"""How figures look: one style for print, and for each solver its own colour and marker everywhere."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, cast

from shellbench.bench import catalog
from shellbench.bench.suite import Study

OKABE_ITO = ("#E69F00", "#56B4E9", "#000000", "#CC79A7", "#009E73", "#D55E00", "#0072B2")
"""Colours that the colour-blind can tell apart (Okabe & Ito 2008); its yellow is too pale for lines on white."""
FURTHER = ("#882255", "#332288")
"""Two more for when these are taken, from the muted scheme of Tol (2021): in CIELAB, of normal and of colour-blind eyes
(Machado et al. 2009), farther from all others than the nearest two of Okabe & Ito are from each other."""
COLOURS = (*OKABE_ITO, *FURTHER)
MARKERS = ("P", "v", "X", "D", "^", "s", "o", "*", "<")
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
    alphabetical order, the next place that is least in use.
    """
    wanted = set(solvers)
    places: dict[str, int] = {}
    for solver in (*declared_solvers(), *sorted(wanted)):
        if solver in places:
            continue
        place = int(hashlib.sha256(solver.encode()).hexdigest(), 16) % len(OKABE_ITO)
        taken = Counter(places.values())
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


def declared_solvers() -> tuple[str, ...]:
    """Return the solvers of the suites, those of comparisons before those of studies, those of engines last."""
    found = map(catalog.find_suite, catalog.suite_names())
    suites = sorted(found, key=lambda suite: (suite.study is not None, suite.study == LAST))
    return tuple(dict.fromkeys(run.solver for suite in suites for run in suite.runs))
