"""Sketches of questions: a surface with supports, loads and named points, before anybody has solved it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from shellbench.protocol.sheet import Sheet
from shellbench.report.data.exhibit import style
from shellbench.report.figures.pictures import held_lines, point_forces
from shellbench.report.figures.shells import Camera, Shell, draw_reference

SHORT = 0.13  # length of the longest arrow of a spread load, in sizes of the shell
PART, LOAD = "#0072B2", "#D55E00"  # the outline of the part that is meshed, and loads
ARROW = {"arrowstyle": "-|>", "color": LOAD, "linewidth": 0.8, "mutation_scale": 6, "shrinkA": 0, "shrinkB": 0}
HALO = [withStroke(linewidth=2, foreground="white")]


def draw_sketch(sheet: Sheet, path: Path) -> None:
    """Draw a surface into a file: held edges thick, loads as arrows, the meshed part outlined, and points named."""
    sketch = sheet.sketch
    scene, x = sketch.scene, sketch.position
    camera = Camera(*scene.view, scene.up)
    held, forces = held_lines(scene, sketch.xi, x), point_forces(scene, sketch.xi, x)
    shell = Shell(sheet.name, sheet.title, "", x, np.zeros_like(x), 1.0, camera, held=held, forces=forces)
    with style():
        figure = Figure(figsize=(4.6, 3.6), layout="constrained")
        axes = figure.subplots()
        draw_reference(axes, shell)
        axes.plot(*camera.look(sketch.part)[:, :2].T, color=PART, linewidth=1.0, linestyle="--", zorder=3)
        longest = np.linalg.norm(sketch.spread[:, 1], axis=-1).max(initial=0.0)
        for point, vector in sketch.spread:
            ends = camera.look(np.array([point, point - SHORT * shell.size * vector / longest]))[:, :2]
            axes.annotate("", ends[0], xytext=ends[1], arrowprops=ARROW, zorder=4)
        for name, point in sketch.points.items():
            x1, x2, _ = camera.look(point)
            axes.plot(x1, x2, marker="o", markersize=3, color="black", zorder=5)
            axes.annotate(name, (x1, x2), (4, 4), textcoords="offset points", fontsize=7, path_effects=HALO, zorder=6)
        figure.savefig(path, metadata={"Date": None})
