"""Films: the frames of a motion as one GIF, solvers side by side in one view and one range of colours."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from shellbench.report.data.exhibit import style
from shellbench.report.data.notation import plain
from shellbench.report.figures.shells import BAR, HIGHEST, LOWEST, Shell, aspect, colour_bar, draw_deformed

SECONDS = 2.4  # that it lasts, once: shown twice it stops within five seconds, as WCAG 2.2.2 asks of what starts itself
ACROSS = 2.6  # inches of one solver's column
COLOURS = 256  # of its palette
CELLS = 30  # facets a side


def film(columns: Sequence[Sequence[Shell | None]], words: Sequence[str], names: Sequence[str], repeat: int) -> bytes:
    """Return a GIF: for each frame a row of shells, a column for each solver; None is a shell that was not reached.

    Parameters
    ----------
    columns
        For each solver its shells, frame by frame.
    words
        For each frame, such as "t = 0.1 s".
    names
        Of the columns.
    repeat
        How often it is shown; without end if 0.
    """
    from PIL import Image

    shells = [shell for column in columns for shell in column if shell is not None]
    height = float(np.clip(ACROSS * aspect(shells), LOWEST, 1.4 * HIGHEST)) + BAR
    images = []
    with style():
        figure = Figure(figsize=(ACROSS * len(columns), height), layout="constrained")
        canvas: Any = FigureCanvasAgg(figure)  # its methods have no types
        grid = figure.subplots(1, len(columns), squeeze=False)[0]
        colour_bar(figure, list(grid), *shells, shrink=0.7, aspect=34)
        for number, word in enumerate(words):
            for axes, column, name in zip(grid, columns, names, strict=True):
                _draw(axes, column[number], shells, f"{name}, {word}" if name else word)
            canvas.draw()
            figure.set_layout_engine(None)  # once for all frames: they stand still
            images.append(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB"))
    chosen = np.concatenate([np.asarray(images[place]) for place in (0, len(images) // 2, -1)])
    palette = Image.fromarray(chosen).quantize(COLOURS, Image.Quantize.MAXCOVERAGE)
    shown = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    pause = round(1000 * SECONDS / len(shown))
    again: dict[str, Any] = {} if repeat == 1 else {"loop": max(0, repeat - 1)}
    buffer = BytesIO()
    shown[0].save(buffer, "GIF", save_all=True, append_images=shown[1:], duration=pause, optimize=True, **again)
    return buffer.getvalue()


def _draw(axes: Any, shell: Shell | None, among: Sequence[Shell], title: str) -> None:
    axes.clear()
    axes.set_axis_off()
    axes.set_title(plain(title), fontsize=7.5, loc="left")
    if shell is None:
        axes.text(0.5, 0.5, "not reached", transform=axes.transAxes, ha="center", va="center", color="#666666")
    else:
        draw_deformed(axes, shell, among, CELLS)
