"""Strips of frames: a row of deformed shells for each solver, the same marks in columns, one view and one scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from shellbench.report.shells import Shell, colour_bar, draw_deformed, plain
from shellbench.report.states import aspect

WIDTH, WIDEST = 7.2, 1.9  # inches of a row, and of one frame
LOWEST, HIGHEST = 0.8, 1.9  # inches a frame
MARGIN = 0.75  # inches for the colour bar
FACETS = 48  # a side: a frame is small
MOST_FRAMES = 5  # in a row: every fifth of the time of a motion


@dataclass(frozen=True)
class Strip:
    """What one solver's row shows: a shell for each column, None where it has no state."""

    solver: str
    shells: tuple[Shell | None, ...]


def strips_figure(strips: Sequence[Strip], words: Sequence[str]) -> Figure:
    """Draw the strips below each other under the words of their columns' marks."""
    shells = [shell for strip in strips for shell in strip.shells if shell is not None]
    width = min(WIDEST, WIDTH / len(words))
    height = float(np.clip(width * aspect(shells), LOWEST, HIGHEST)) + 0.1
    size = (max(3.4, width * len(words)), height * len(strips) + MARGIN + 0.15)
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(len(strips), len(words), squeeze=False)
    for strip, panels in zip(strips, grid, strict=True):
        for place, (axes, shell) in enumerate(zip(panels, strip.shells, strict=True)):
            if shell is None:
                axes.set_axis_off()
                axes.text(0.5, 0.5, "not reached", transform=axes.transAxes, ha="center", va="center", color="#666666")
            else:
                draw_deformed(axes, shell, shells, cells=FACETS)
            if strip is strips[0]:
                axes.set_title(plain(words[place]), loc="center", fontsize=7.5)
            if not place:
                axes.annotate(
                    plain(strip.solver),
                    (0, 0.5),
                    (-4, 0),
                    xycoords="axes fraction",
                    textcoords="offset points",
                    rotation=90,
                    ha="right",
                    va="center",
                    fontsize=7.5,
                )
    colour_bar(figure, list(grid.flat), *shells, shrink=0.5, aspect=34)
    return figure
