"""Neural fields whose weights are kept in shorter formats: all of them, at rest, on paths and in motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from shellbench.bench.catalogue.catalog import named_case
from shellbench.problem import NumberFormat
from shellbench.problems.shortened import EXPONENT_BYTES
from shellbench.solvers.ndf.field.weights import rounded_tensors
from shellbench.solvers.ndf.linear.solution import NdfSolution, PathSolution
from shellbench.solvers.ndf.motion.motion_solution import MotionSolution
from shellbench.solvers.ndf.published.published_motion_solution import TrainedMotion
from shellbench.solvers.ndf.ritz_solver import RitzSettings, RitzSolver
from tests.solvers.ndf import trainings
from tests.solvers.ndf.shells import inner_points
from tests.solvers.ndf.test_motion import PIN, moving
from tests.solvers.ndf.test_motion import solve as solve_motion
from tests.solvers.ndf.test_published_motion import MOVED, few
from tests.solvers.ndf.test_solution import solve as solve_path
from tests.solvers.ndf.test_solution import strip

UNIT = {"float32": 2.0**-24, "float16": 2.0**-11}  # unit roundoff (IEEE 754-2008)
SUBNORMAL = (
    2.0**-39
)  # of the largest number of a tensor: what smaller ones may err by, see `shellbench.problems.shell.solution`
SIZE = {"float32": 4, "float16": 2}
SHORT: tuple[NumberFormat, ...] = ("float32", "float16")


@pytest.fixture(scope="module")
def roof() -> NdfSolution:
    found = RitzSolver().solve(named_case("scordelis_lo"), RitzSettings(neurons=40, largest_gap=1.0))
    assert isinstance(found, NdfSolution)
    return found


@pytest.fixture(scope="module")
def sheared() -> PathSolution:
    return solve_path(strip({"kind": "edge", "on": ["xi1_max"], "vector": ["t", 0, "4*t"]}))


@pytest.fixture(scope="module")
def swung() -> MotionSolution:
    return solve_motion(moving(springs=[PIN]), 36)


@pytest.fixture(scope="module")
def trained() -> TrainedMotion:
    found = trainings.trained(MOVED, few(iterations=3, dtype="float64"))
    assert isinstance(found, TrainedMotion)
    return found


def tensors_of(solution: Any) -> Mapping[str, Tensor]:
    if isinstance(solution, TrainedMotion):
        return dict(enumerate(solution.field.siren.tensors))  # type: ignore[arg-type]
    if isinstance(solution, PathSolution):
        states = {f"output.{k}": s.field.output for k, s in enumerate(solution.states)}
        return {**solution.states[-1].tensors(), **states}
    return dict(solution.tensors())


@pytest.mark.sampled(5)
@pytest.mark.parametrize("format", SHORT)
@pytest.mark.parametrize("name", ["roof", "sheared", "swung", "trained"])
def test_every_weight_is_rounded(name: str, format: NumberFormat, request: pytest.FixtureRequest) -> None:
    solution = request.getfixturevalue(name)
    short, _ = solution.rounded(format)
    exact, found = tensors_of(solution), tensors_of(short)
    for key in exact:
        error = (found[key] - exact[key]).abs()
        assert bool((error <= UNIT[format] * exact[key].abs() + SUBNORMAL * exact[key].abs().max()).all())
        assert found[key].dtype == exact[key].dtype
        if key != "times" and bool((exact[key] != 0).any()):
            assert bool((error > 0).any()), key


@pytest.mark.parametrize("format", SHORT)
@pytest.mark.parametrize("name", ["roof", "sheared", "swung", "trained"])
def test_bytes_are_those_of_what_storage_counts(
    name: str, format: NumberFormat, request: pytest.FixtureRequest
) -> None:
    solution = request.getfixturevalue(name)
    _, taken = solution.rounded(format)
    times = solution.course.times.nbytes if name == "swung" else 0
    numbers = (solution.storage_bytes - times) // 8
    exponents = taken - times - SIZE[format] * numbers
    tensors = len(tensors_of(solution)) + (len(solution.marks) - 1 if name == "sheared" else 0)
    assert 0 < exponents <= EXPONENT_BYTES * tensors


@pytest.mark.parametrize("name", ["roof", "sheared", "swung", "trained"])
def test_double_precision_changes_nothing(name: str, request: pytest.FixtureRequest) -> None:
    solution = request.getfixturevalue(name)
    same, taken = solution.rounded("float64")
    assert same is solution  # so that nothing is measured again
    assert taken == solution.storage_bytes


@pytest.mark.parametrize("name", ["roof", "sheared", "swung", "trained"])
def test_differences_shrink_as_the_unit_roundoff(name: str, request: pytest.FixtureRequest) -> None:
    solution = request.getfixturevalue(name)
    points = inner_points(solution.case)
    exact = solution.displacement(points)
    single, half = (np.abs(solution.rounded(format)[0].displacement(points) - exact).max() for format in SHORT)
    assert 2.0**13 / 30 < half / single < 2.0**13 * 30  # of a first-order effect of weights that err at random


def test_earlier_states_of_a_path_are_rounded_too(sheared: PathSolution) -> None:
    short, _ = sheared.rounded("float16")
    points = inner_points(sheared.case)
    assert short.marks == sheared.marks
    for mark in sheared.marks:
        gap = np.abs(short.displacement(points, at=mark) - sheared.displacement(points, at=mark)).max()
        assert 0 < gap < 0.1 * np.abs(sheared.displacement(points, at=mark)).max()
    assert len({id(state.field.features) for state in short.states}) == 1


@pytest.mark.parametrize("at", [0.05, 0.123])
def test_motions_between_their_steps_are_rounded(swung: MotionSolution, at: float) -> None:
    short, _ = swung.rounded("float32")
    points = inner_points(swung.case)
    for ask in ("displacement", "velocity"):
        exact, found = getattr(swung, ask)(points, at=at), getattr(short, ask)(points, at=at)
        assert 0 < np.abs(found - exact).max() < 1e-3 * np.abs(exact).max()


def test_energies_of_a_rounded_field_are_its_own(roof: NdfSolution) -> None:
    (_, half) = (roof.rounded(format)[0] for format in SHORT)
    assert sum(half.energies()) != pytest.approx(sum(roof.energies()), rel=1e-6)
    assert sum(roof.rounded("float32")[0].energies()) == pytest.approx(sum(roof.energies()), rel=1e-3)


def test_energies_that_were_not_integrated_are_when_they_are_asked_for(roof: NdfSolution) -> None:
    asked = replace(roof, membrane=float("nan"), bending=float("nan")).energies()
    assert asked == pytest.approx(roof.energies(), rel=1e-10)


def test_weights_that_are_short_enough_stay() -> None:
    single = torch.linspace(0, 1, 5, dtype=torch.float32)
    for format in ("float64", "float32"):
        (same,), taken = rounded_tensors([single], format)  # type: ignore[arg-type]
        assert same is single
        assert taken == 20
    (half,), taken = rounded_tensors([single / 3], "float16")
    assert half.dtype == torch.float32
    assert taken == 10 + EXPONENT_BYTES
