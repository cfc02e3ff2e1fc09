"""Deformed shapes along a path, side by side in one frame and one range of colours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from matplotlib.figure import Figure

from shellbench.report.shells import Shell, colour_bar, draw_deformed, plain

MOST_SHOWN = 6  # states
MOST_IN_A_ROW, MANY_IN_A_ROW = 4, 3  # states that fill one row only, and several
WIDTH, WIDEST = 6.9, 2.6  # inches of all panels, and of one
LOWEST, HIGHEST = 0.9, 2.4  # inches a panel
MARGIN = 0.75  # inches for the colour bar

T = TypeVar("T")


def spread(states: Sequence[T], most: int = MOST_SHOWN) -> list[T]:
    """Return so many of the states at most, the last one among them, evenly spread."""
    if len(states) <= most:
        return list(states)
    kept = np.unique(np.round(np.linspace(0, len(states), most + 1)[1:]).astype(int) - 1)
    return [states[i] for i in kept]


def states_figure(states: Sequence[tuple[str, Shell]]) -> Figure:
    """Draw the shell at each state, under the words of its mark."""
    shells = [shell for _, shell in states]
    columns = len(states) if len(states) <= MOST_IN_A_ROW else MANY_IN_A_ROW
    width = min(WIDEST, WIDTH / columns)
    rows = -(-len(states) // columns)
    height = float(np.clip(width * aspect(shells), LOWEST, HIGHEST)) + 0.25
    figure = Figure(figsize=(max(3.4, width * columns), height * rows + MARGIN), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False)
    for axes in panels.flat[len(states) :]:
        axes.set_axis_off()
    for axes, (words, shell) in zip(panels.flat, states, strict=False):
        draw_deformed(axes, shell, shells)
        axes.set_title(plain(words), loc="left", fontsize=8.0)
    colour_bar(figure, list(panels.flat), *shells, shrink=0.5, aspect=34)
    return figure


def aspect(shells: Sequence[Shell]) -> float:
    """Return height over width of what the camera sees."""
    seen = np.concatenate([s.camera.look(grid).reshape(-1, 3) for s in shells for grid in (s.position, s.deformed)])
    width, height, _ = np.ptp(seen, axis=0)
    return float(height / width) if width > 0 else 1.0
