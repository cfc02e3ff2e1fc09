"""Draw garments whose bones are rope chains, as docs/clothing.md shows them: `python docs/garment_runs.py cape_run`.

Four rows as in figures 15 and 16 of Jin et al.: ropes, neural skinning, neural shape, and the simulated cloth of the
same motion. Columns are evenly spaced frames of the first clip that is held out. `--film FOLDER` writes every fourth
frame as a PNG of its own.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

from shellbench.bench.catalogue import catalog
from shellbench.problems.skinning.case import SkinningCase
from shellbench.solvers.skinning.forward import bone_skin
from shellbench.solvers.skinning.solution import Skinned
from shellbench.solvers.skinning.solver import ShapeSolver

Array = NDArray[np.float64]
ROWS = "rope chains", "neural skinning", "neural shape", "simulated cloth"
COLUMNS = 6
CLOTH, ROPE, SPRING, BODY = "#56B4E9", "#009E73", "#CC79A7", "#999999"  # Okabe and Ito
VIEWS = {"cape_run": (10.0, 60.0), "skirt_run": (10.0, 40.0)}
AROUND = np.linspace(0.0, 2 * np.pi, 13)


def capsule(axis: Array, radius: float) -> tuple[Array, Array, Array]:
    """Return the grid of a capsule's surface about an axis (2, 3)."""
    along = axis[1] - axis[0]
    length = np.linalg.norm(along)
    unit = along / length
    side = np.cross(unit, [0.0, 1.0, 0.0] if abs(unit[1]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    bow = np.linspace(0.0, np.pi / 2, 5)
    out = radius * np.concatenate([np.sin(bow), np.sin(bow)[::-1]])
    up = np.concatenate([-radius * np.cos(bow), length + radius * np.cos(bow)[::-1]])
    ring = np.cos(AROUND)[:, None] * side + np.sin(AROUND)[:, None] * np.cross(unit, side)
    grid = axis[0] + up[:, None, None] * unit + out[:, None, None] * ring
    return grid[..., 0], grid[..., 1], grid[..., 2]


def draw(ax: plt.Axes, case: SkinningCase, axes: Array, mesh: Array | None, bones: Array | None) -> None:
    """Draw the body, and a mesh (rows, columns, 3) or bones (nodes, chains, 3)."""
    for axis, part in zip(axes, case.body, strict=True):
        ax.plot_surface(*capsule(axis, part.radius), color=BODY, linewidth=0, alpha=0.9)
    if mesh is not None:
        whole = np.concatenate([mesh, mesh[:, :1]], axis=1) if case.cape.closed else mesh
        ax.plot_surface(*np.moveaxis(whole, -1, 0), color=CLOTH, rstride=1, cstride=1, linewidth=0)
    if bones is not None:
        whole = np.concatenate([bones, bones[:, :1]], axis=1) if case.cape.closed else bones
        for chain in range(bones.shape[1]):
            ax.plot(*bones[:, chain].T, color=ROPE, linewidth=1.2, marker=".", markersize=2, zorder=10)
        for row in whole[1:]:
            ax.plot(*row.T, color=SPRING, linewidth=0.4, zorder=9)
    extent = case.cape.length
    ax.set(xlim=(-0.6 * extent, 0.6 * extent), ylim=(-0.6 * extent, 0.6 * extent), zlim=(-1.1 * extent, 0.1 * extent))
    ax.set_box_aspect((1, 1, 1), zoom=1.5)
    ax.view_init(*VIEWS.get(case.name, VIEWS["cape_run"]))
    ax.set_axis_off()


def main(name: str, film: Path | None) -> None:
    """Train, and draw the strip and the film."""
    case = catalog.named_case(name)
    made = ShapeSolver().solve(case)
    first = Skinned(
        case, "skin-network", bone_skin, {n: a for n, a in made.arrays.items() if not n.startswith("shape_")}
    )
    for row, one in (("neural skinning", first), ("neural shape", made)):
        print(row, {q.name: float(f"{q.measure(one):.3g}") for q in case.quantities})
    held = case.held_out[: case.cape.frames]
    frames = len(held)
    clips = made.clips
    # in the axes of the world, but held at the neck
    turns = clips.motion.rotations.reshape(-1, 3, 3)[held]
    axes = np.einsum("nij,ncej->ncei", turns, clips.axes[held])
    rows = [
        np.einsum("nij,nrcj->nrci", turns, each[:frames])
        for each in (made.bones, first.meshes, made.meshes, clips.meshes[held])
    ]
    figure, panels = plt.subplots(4, COLUMNS, figsize=(2.2 * COLUMNS, 9.5), subplot_kw={"projection": "3d"})
    for column, frame in enumerate(np.linspace(20, frames - 1, COLUMNS).astype(int)):
        for row, places in enumerate(rows):
            ax = panels[row, column]
            draw(ax, case, axes[frame], places[frame] if row else None, None if row else places[frame])
            if not column:
                ax.text2D(0.02, 0.98, ROWS[row], transform=ax.transAxes, fontsize=9, va="top")
        panels[0, column].set_title(f"{frame / 60:.1f} s", fontsize=9)
    figure.subplots_adjust(0, 0, 1, 0.97, 0, 0)
    figure.savefig(Path(__file__).parent / "figures" / f"{name}.png", dpi=90)
    if film is None:
        return
    film.mkdir(parents=True, exist_ok=True)
    for frame in range(0, frames, 4):
        figure, panels = plt.subplots(1, 4, figsize=(10, 3), subplot_kw={"projection": "3d"})
        for row, (ax, places) in enumerate(zip(panels, rows, strict=True)):
            draw(ax, case, axes[frame], places[frame] if row else None, None if row else places[frame])
        figure.subplots_adjust(0, 0, 1, 1, 0, 0)
        figure.savefig(film / f"{name}_{frame:03}.png", dpi=70)
        plt.close(figure)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[3]) if sys.argv[2:3] == ["--film"] else None)
