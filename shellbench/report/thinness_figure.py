"""The figure of the thinness study: error, bending share, unknowns and seconds against thickness over length."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from shellbench.report.palette import DASHES, Ink, style

SIZE = (7.2, 5.0)  # inches
KNOWN = "#999999"
UNCERTAIN = "#BBBBBB"
SPREAD = 0.012  # decades between the marks of two solutions, so that bars do not hide each other
Panel = tuple[str, str, tuple[str, str, str], float]
PANELS: tuple[Panel, ...] = (
    ("error", "relative error (%)", ("mean_size", "least_size", "largest_size"), 100.0),
    ("share", "bending energy in strain energy (%)", ("share", "least_share", "largest_share"), 100.0),
    ("unknowns", "unknowns", ("unknowns", "unknowns", "unknowns"), 1.0),
    ("seconds", "wall time (s)", ("seconds", "seconds", "seconds"), 1.0),
)


def thinness_figure(data: pd.DataFrame, inks: Mapping[str, Ink]) -> Figure:
    """Draw the table of one shell (see `shellbench.report.thinness.thinness_table`), thinner to the right.

    Parameters
    ----------
    data
        A line for each thickness and solution.
    inks
        Colour and marker by name of solver; variants of a solver differ in their dashes.
    """
    with style():
        figure = Figure(figsize=SIZE, layout="constrained")
        panels = figure.subplots(2, 2, sharex=True).ravel()
        names = list(dict.fromkeys(data["solution"]))
        for axes, (name, label, columns, factor) in zip(panels, PANELS, strict=True):
            axes.set_xscale("log")
            axes.set_yscale("linear" if name == "share" else "log")
            for place, solution in enumerate(names):
                lines = data[data["solution"] == solution]
                shift = 10 ** (SPREAD * (place - (len(names) - 1) / 2))
                _curve(axes, lines, columns, factor, shift, inks[lines["solver"].iloc[0]], _dashes(solution, names))
            axes.set_ylabel(label)
        _known(panels[0], panels[1], data)
        for axes in panels[2:]:
            axes.set_xlabel("thickness over length h/L")
        panels[0].invert_xaxis()
        entries = {name: _entry(inks[name.partition(", ")[0]], _dashes(name, names)) for name in names}
        if data["known_share"].notna().any():
            entries["known share"] = Line2D([], [], color=KNOWN, linewidth=3)
        if data["known_doubt"].notna().any():
            entries["uncertainty of the known value"] = Line2D([], [], color=UNCERTAIN, alpha=0.6, linewidth=6)
        figure.legend(
            entries.values(),
            [name.replace("$", r"\$") for name in entries],
            loc="outside lower center",
            ncols=min(4, len(entries)),
        )
    return figure


def _curve(
    axes: Axes, lines: pd.DataFrame, columns: tuple[str, str, str], factor: float, shift: float, ink: Ink, dashes: Any
) -> None:
    """Draw a solution with bars over its seeds, its marks open where a run failed."""
    seen = lines[lines[columns[0]].notna()]
    if axes.get_yscale() == "log":
        seen = seen[seen[columns[0]] > 0]
    x = seen["ratio"].to_numpy(dtype=float) * shift
    middle, low, high = (factor * seen[name].to_numpy(dtype=float) for name in columns)
    axes.plot(x, middle, color=ink.colour, linestyle=dashes)
    bars = np.vstack([middle - low, high - middle])
    if np.any(bars > 0):
        axes.errorbar(x, middle, bars, color=ink.colour, linestyle="none", linewidth=0.8, capsize=2)
    failed = (seen["good"] < seen["runs"]).to_numpy(dtype=bool)
    for which, face in ((~failed, ink.colour), (failed, "white")):
        axes.plot(x[which], middle[which], linestyle="none", marker=ink.marker, color=ink.colour, markerfacecolor=face)


def _known(errors: Axes, shares: Axes, data: pd.DataFrame) -> None:
    """Draw what is known of the answer: the uncertainty of its value, and its share of bending energy."""
    known = data.drop_duplicates("ratio")
    doubt = known[known["known_doubt"].fillna(0) > 0]
    if len(doubt):
        bottom = min(errors.get_ylim()[0], 50 * doubt["known_doubt"].min())
        upper = 100 * doubt["known_doubt"].to_numpy(dtype=float)
        errors.fill_between(
            doubt["ratio"].to_numpy(dtype=float), bottom, upper, color=UNCERTAIN, alpha=0.35, linewidth=0
        )
        errors.set_ylim(bottom=bottom)
    share = known[known["known_share"].notna()]
    shares.plot(share["ratio"], 100 * share["known_share"], color=KNOWN, linewidth=3, zorder=0)


def _dashes(solution: str, solutions: list[str]) -> Any:
    """Return the dashes of a solution: the variants of one solver have different ones."""
    solver = solution.partition(", ")[0]
    alike = [name for name in solutions if name.partition(", ")[0] == solver]
    return DASHES[alike.index(solution) % len(DASHES)]


def _entry(ink: Ink, dashes: Any) -> Line2D:
    return Line2D([], [], color=ink.colour, marker=ink.marker, linestyle=dashes)
