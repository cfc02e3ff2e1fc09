"""Meshes of the roof and of the cylinder, and the study of docs/meshes.md: errors against the coarseness of the mesh.

python docs/meshes.py --write          the meshes of cases/: 60 x 60 points each
python docs/meshes.py roof_mesh        the study of one case (all: without names), as a table on standard output
python docs/meshes.py --noise          the study of noise
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.registry import find_solver, load_solver

CASES = Path(__file__).parents[1] / "cases"
POINTS, DIGITS = 60, 10
SIZES, NOISES = (20, 30, 60, 100, 200), (0.0, 1e-6, 1e-5, 1e-4)
SOLVERS = ("fem", "ndf-ritz")
Array = np.ndarray


def roof(u: Array, v: Array) -> Array:
    """The roof of Scordelis and Lo, m: u along the arc, v along the axis."""
    angle = np.radians(50 + 80 * u)
    return np.stack(np.broadcast_arrays(25 * np.cos(angle), 25 * np.sin(angle), 50 * v), axis=-1)


def cylinder(u: Array, v: Array) -> Array:
    """The closed cylinder that is pinched, m: u round it, v along its axis."""
    return np.stack(np.broadcast_arrays(300 * np.cos(2 * np.pi * u), 600 * v, 300 * np.sin(2 * np.pi * u)), axis=-1)


SHAPES: dict[str, tuple[Callable[[Array, Array], Array], bool]] = {
    "roof_mesh": (roof, False),
    "pinched_mesh": (cylinder, True),
}


def obj(shape: Callable[[Array, Array], Array], n: int, closed: bool, noise: float = 0.0, digits: int = DIGITS) -> str:
    """Return an OBJ of n x n points as quadrangles; for a closed surface the n + 1 texture vertices share the seam's points.

    `noise` is the standard deviation of every coordinate, relative to the mesh's largest extent.
    """
    u, v = np.linspace(0.0, 1.0, n + closed), np.linspace(0.0, 1.0, n)
    x = shape(u[:n, None], v[None, :])
    size = np.ptp(x.reshape(-1, 3), axis=0).max()
    x = x + noise * size * np.random.default_rng(0).standard_normal(x.shape)
    lines = [f"v {' '.join(f'{c:.{digits}g}' for c in point)}" for point in x.reshape(-1, 3)]
    lines += [f"vt {a:.{digits}g} {b:.{digits}g}" for a in u for b in v]
    for i in range(len(u) - 1):
        for j in range(n - 1):
            corners = ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1))
            lines.append("f " + " ".join(f"{a % len(x) * n + b + 1}/{a * n + b + 1}" for a, b in corners))
    return "\n".join(lines) + "\n"


def study(name: str, n: int, noise: float) -> list[str]:
    """Solve a case on another mesh, on both its fits; return a row of the table for each solver."""
    shape, closed = SHAPES[name]
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / f"{name}.obj").write_text(obj(shape, n, closed, noise))
        path = Path(folder) / f"{name}.toml"
        path.write_text((CASES / f"{name}.toml").read_text())
        case = catalog.find_case(str(path))
    fit, rows = case.surface.fit, []
    known = catalog.known_values(name).judge(case.primary.name, case.theory)
    relative = (
        fit.position_error / np.ptp(case.surface.position(case.surface.domain.grid(9, 9)).reshape(-1, 3), axis=0).max()
    )
    for solver in SOLVERS:
        found = [
            case.primary.measure(load_solver(find_solver(solver)).solve(asked))
            for asked in (case, case.asked_as_well())
        ]
        rows.append(
            f"| {name} | {n} | {noise:.0e} | {fit.first.spans[0]} x {fit.first.spans[1]} | {relative:.0e} |"
            f" {fit.curvature_error / fit.largest_curvature:.0e} | {solver} | {found[0] / known.value - 1:+.1e} | {2 * abs(found[1] / found[0] - 1):.0e} |"
        )
    return rows


def main() -> None:
    """Write the meshes, or print a table of the study."""
    names = [name for name in sys.argv[1:] if name in SHAPES] or list(SHAPES)
    if "--write" in sys.argv:
        for name in names:
            (CASES / f"{name}.obj").write_text(obj(*(SHAPES[name][0], POINTS, SHAPES[name][1])))
        return
    print(
        "| case | points a side | noise | spans | position | curvature | solver | error | surface error |\n|---|---|---|---|---|---|---|---|---|"
    )
    runs = [(POINTS, noise) for noise in NOISES] if "--noise" in sys.argv else [(n, 0.0) for n in SIZES]
    for name in names:
        for n, noise in runs:
            print("\n".join(study(name, n, noise)), flush=True)


if __name__ == "__main__":
    main()
