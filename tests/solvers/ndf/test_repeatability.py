"""Answers of a field do not depend on rounding: neither on the processor's, nor on the similarity of features."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.baseline import read_baseline
from shellbench.problem import Solution
from shellbench.problems.shell.quantities.measure import measure
from shellbench.solvers.ndf.field import ansatz, mirrors
from shellbench.solvers.ndf.field.quadrature import Rule
from shellbench.solvers.ndf.linear import static
from shellbench.solvers.ndf.linear.regularised import JITTER, REFINEMENTS, IndefiniteError, RegularisedInverse
from shellbench.solvers.ndf.ritz_solver import RitzSettings, RitzSolver
from shellbench.solvers.ndf.trainer_solver import NdfSolver, TrainerSettings
from shellbench.solvers.ndf.training import at_rest
from shellbench.solvers.ndf.training.gauss_newton import GRAM_JITTER

ROUNDING = 1e-15  # relative: what another order of the same operations changes
REPEATS = 1e-7  # of the values, as the obstacle course asks
BASELINE = Path(__file__).parents[3] / "reports/baseline.json"


def band(case: str, solver: str) -> float:
    """Return the relative band of the regression gate for the headline: rounding alone must never turn it red."""
    baseline = read_baseline(BASELINE)
    assert baseline is not None
    name = catalog.named_case(case).primary.name
    (value,) = (v for v in baseline.values if (v.case, v.solver, v.quantity) == (case, solver, name))
    return value.band / abs(value.mean)


def dependent(n: int, rank: int, seed: int) -> torch.Tensor:
    """Return a Gram matrix (n, n) of which all but `rank` eigenvalues are rounding."""
    factor = torch.as_tensor(np.random.default_rng(seed).standard_normal((n, rank)))
    return factor @ factor.T


@pytest.mark.parametrize("seed", range(5))
def test_both_factorisations_give_the_same_inverse(seed: int) -> None:
    matrix = dependent(60, 40, seed)
    quick = RegularisedInverse.from_matrix(matrix, 1e-6)
    assert quick.triangular
    scaled = matrix * quick.scale[:, None] * quick.scale + 1e-6 * torch.eye(60).to(matrix)
    values, vectors = torch.linalg.eigh(scaled)
    slow = replace(quick, factor=vectors / values.sqrt(), triangular=False)
    right = torch.as_tensor(np.random.default_rng(seed + 100).standard_normal((60, 3)))
    refined = sum(1e-6**i / values ** (i + 1) for i in range(1 + REFINEMENTS))
    for inverse in (quick, slow):
        once = right * inverse.scale[:, None]
        expected = vectors @ (refined[:, None] * (vectors.T @ once))
        found = (inverse @ right) / inverse.scale[:, None]
        assert (found - expected).norm() < 1e-7 * expected.norm()
        half = inverse.half(right)
        assert torch.allclose(half.T @ half, once.T @ torch.linalg.solve(scaled, once), rtol=1e-7)


def test_refining_gives_weak_combinations_back() -> None:
    """A combination ten times as stiff as the level has its whole share but for (1/11)^4."""
    level = 1e-6
    weak = torch.tensor([[1.0, 1 - 10 * level], [1 - 10 * level, 1.0]], dtype=torch.float64)
    right = torch.tensor([[1.0], [-1.0]], dtype=torch.float64)  # an eigenvector, of 10 level
    solved = RegularisedInverse.from_matrix(weak, level) @ right
    assert torch.allclose(solved, right / (10 * level) * (1 - 11.0 ** -(1 + REFINEMENTS)), rtol=1e-6)


def test_where_cholesky_fails_the_level_stays() -> None:
    values = torch.tensor([1.0, 0.5, 1e-3, 0.0, -3e-13], dtype=torch.float64)
    rotation, _ = torch.linalg.qr(torch.as_tensor(np.random.default_rng(0).standard_normal((5, 5))))
    matrix = (rotation * values) @ rotation.T
    level = 1e-13  # less than what "rounding" left below zero
    inverse = RegularisedInverse.from_matrix(matrix, level)
    assert not inverse.triangular
    assert inverse.level == level
    assert torch.isfinite(inverse @ torch.eye(5).to(matrix)).all()
    with pytest.raises(IndefiniteError):
        RegularisedInverse.from_matrix(matrix - 1e-3 * torch.eye(5).to(matrix), level)
    with pytest.raises(IndefiniteError):
        RegularisedInverse.from_matrix(matrix * float("nan"), level)


@pytest.mark.parametrize("level", [JITTER, GRAM_JITTER])
@pytest.mark.parametrize("seed", range(3))
def test_the_least_energy_does_not_depend_on_rounding(seed: int, level: float) -> None:
    """Perturb the features by rounding: the energy that their best combination reaches stays."""
    rng = np.random.default_rng(seed)
    points = np.linspace(-1, 1, 4000)[:, None]
    features = np.sin(points * 3.5 * rng.standard_normal(300) + np.pi * rng.uniform(-1, 1, 300))
    load = np.cos(2 * points[:, 0]) + points[:, 0] ** 3
    energies = []
    for noise in range(4):
        near = features * (1 + ROUNDING * np.random.default_rng(noise).standard_normal(features.shape))
        gram, right = torch.as_tensor(near.T @ near), torch.as_tensor(near.T @ load)[:, None]
        half = RegularisedInverse.from_matrix(gram, level).half(right)
        energies.append(float(half.T @ half))
    assert np.ptp(energies) < 1e-9 * energies[0]


def perturbed(rule_of: Callable[..., Rule], seed: int) -> Callable[..., Rule]:
    """Return a maker of rules whose points are off by rounding, each by its own share."""

    def with_noise(*arguments: object) -> Rule:
        rule = rule_of(*arguments)
        noise = np.random.default_rng((seed, len(rule.points))).standard_normal(rule.points.shape)
        return replace(rule, points=rule.points * (1 + ROUNDING * noise))

    return with_noise


def ritz_answer(case: str) -> Solution:
    return RitzSolver().solve(catalog.find_case(case), RitzSettings(seed=0))


def ndf_answer(case: str) -> Solution:
    return NdfSolver().solve(catalog.find_case(case), TrainerSettings(seed=0))


@pytest.mark.parametrize(
    ("answer", "case", "repeats"),
    [
        (ritz_answer, "square_plate", REPEATS),
        pytest.param(ritz_answer, "scordelis_lo", REPEATS, marks=pytest.mark.long),
        pytest.param(ritz_answer, "pinched_cylinder_diaphragm", REPEATS, marks=pytest.mark.long),
        pytest.param(ritz_answer, "pinched_cylinder_free", REPEATS, marks=pytest.mark.long),
        # steps of training are accepted or not, and amplify what differs
        pytest.param(ndf_answer, "square_plate", band("square_plate", "ndf"), marks=pytest.mark.long),
        pytest.param(ndf_answer, "scordelis_lo", band("scordelis_lo", "ndf"), marks=pytest.mark.long),
    ],
)
def test_values_repeat_when_points_are_off_by_rounding(
    monkeypatch: pytest.MonkeyPatch, answer: Callable[[str], Solution], case: str, repeats: float
) -> None:
    primary = next(q for q in catalog.find_case(case).quantities if q.primary)
    values = [measure(answer(case), primary)]
    for module in (ansatz, mirrors, static, at_rest):
        monkeypatch.setattr(module, "area_rule", perturbed(module.area_rule, 1))
    values.append(measure(answer(case), primary))
    assert len(set(values)) > 1, "the points were not perturbed"
    assert np.ptp(values) <= repeats * abs(values[0])
