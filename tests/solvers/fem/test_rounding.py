"""Finite element fields whose coefficients are kept in shorter formats."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shellbench.errors import InputError
from shellbench.problem import NumberFormat
from shellbench.problems.shortened import EXPONENT_BYTES
from shellbench.solvers.fem.mechanics.solution import FemSolution
from shellbench.solvers.fem.motion.motion_solution import MotionSolution
from shellbench.solvers.fem.solver import FemSettings, FemSolver
from tests.alike import alike
from tests.solvers.fem.shells import shell
from tests.solvers.fem.test_motion_solution import POINTS, motion

UNIT: dict[NumberFormat, float] = {"float32": 2.0**-24, "float16": 2.0**-11}  # unit roundoff (IEEE 754-2008)
SIZE: dict[NumberFormat, int] = {"float32": 4, "float16": 2}
SHORT: tuple[NumberFormat, ...] = ("float32", "float16")
TIMES = np.array([0.0, 0.9, 1.7, 2.0])


@pytest.fixture(scope="module")
def solution() -> FemSolution:
    supports = [{"name": "wall", "on": ["xi1_min"], "clamped": True}, {"name": "rim", "on": ["xi2_max"]}]
    loads = [{"kind": "area", "vector": [0.3, 0, 0.1]}]
    found = FemSolver().solve(shell("hypar", supports=supports, loads=loads), FemSettings(max_unknowns=400))
    assert isinstance(found, FemSolution)
    return found


@pytest.fixture(scope="module")
def moved() -> MotionSolution:
    return motion(TIMES, np.sin, np.cos)


def spread(solution: FemSolution) -> float:
    return float(np.abs(solution.coefficients[:, :, 0]).max())


@pytest.mark.parametrize("format", SHORT)
def test_displacements_at_nodes_err_by_the_unit_roundoff(solution: FemSolution, format: NumberFormat) -> None:
    short, _ = solution.rounded(format)
    nodes = solution.mesh.node_points
    exact = solution.displacement(nodes)
    error = np.abs(short.displacement(nodes) - exact)
    assert np.all(error <= UNIT[format] * np.abs(exact) + 1e-9 * UNIT[format] * spread(solution))
    assert error.max() > 0.1 * UNIT[format] * spread(solution)  # it was rounded to no longer format


@pytest.mark.parametrize("format", SHORT)
def test_bytes_are_those_of_the_coefficients_and_the_mesh_lines(solution: FemSolution, format: NumberFormat) -> None:
    _, taken = solution.rounded(format)
    lines = sum(8 * len(line) for line in solution.mesh.lines)
    assert taken == SIZE[format] * solution.coefficients.size + EXPONENT_BYTES + lines
    assert solution.rounded("float64") == (solution, solution.storage_bytes)


def test_energies_are_those_of_the_rounded_field(solution: FemSolution) -> None:
    single, half = (solution.rounded(format)[0].energies() for format in SHORT)
    assert single == pytest.approx(solution.energies(), rel=1e-4)
    assert half != solution.energies()


@pytest.mark.parametrize("format", SHORT)
def test_a_small_field_is_rounded_as_a_large_one(solution: FemSolution, format: NumberFormat) -> None:
    scale = 2.0**-60  # nothing of it would be left in float16 without a scale
    small = replace(solution, coefficients=scale * solution.coefficients)
    points = np.array([[0.1, 0.2], [-0.7, 0.3]])
    alike(small.rounded(format)[0].displacement(points), scale * solution.rounded(format)[0].displacement(points))


@pytest.mark.parametrize("format", SHORT)
def test_motions_err_by_the_unit_roundoff_at_their_instants(moved: MotionSolution, format: NumberFormat) -> None:
    short, taken = moved.rounded(format)
    nodes = moved.mesh.node_points
    for t in TIMES:
        for ask, kept in ((short.displacement, moved.displacement), (short.velocity, moved.velocity)):
            exact = kept(nodes, at=t)
            assert np.all(np.abs(ask(nodes, at=t) - exact) <= UNIT[format] * np.abs(exact) + 1e-7 * UNIT[format])
    lines = sum(8 * len(line) for line in moved.mesh.lines)
    numbers = moved.coefficients.size + moved.rates.size
    assert taken == SIZE[format] * numbers + 2 * EXPONENT_BYTES + 8 * len(TIMES) + lines == short.storage_bytes + 4


@pytest.mark.parametrize("format", SHORT)
def test_motions_between_instants_are_rounded_too(moved: MotionSolution, format: NumberFormat) -> None:
    short, _ = moved.rounded(format)
    error = np.abs(short.displacement(POINTS, at=1.1) - moved.displacement(POINTS, at=1.1)).max()
    assert 1e-3 * UNIT[format] < error < 20 * UNIT[format]  # of displacements of some metres, with slopes
    with pytest.raises(InputError):
        short.displacement(POINTS, at=3.0)


def test_motions_are_kept_in_the_short_format(moved: MotionSolution) -> None:
    short, _ = moved.rounded("float16")
    assert short.coefficients.dtype == short.rates.dtype == np.float16
    assert moved.rounded("float64")[0] is moved
    assert short.displacement(POINTS, at=1.1).dtype == np.float64


def test_a_rounded_motion_comes_back_from_a_file(moved: MotionSolution, tmp_path: Path) -> None:
    short, _ = moved.rounded("float16")
    back = FemSolver().load(short.save(tmp_path / "short"))
    alike(back.displacement(POINTS, at=1.1), short.displacement(POINTS, at=1.1))
