"""Probes: the same for all, on no grid, and evenly spread."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from shellbench.bench.catalogue import catalog
from shellbench.bench.store.measuring import write_fields
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.surface import Domain
from shellbench.problems.shell.records import sampling
from shellbench.problems.shell.records.sampling import PROBES, probe_fields, probes_of
from shellbench.problems.shell.records.series import frames
from tests.bench import spring
from tests.bench.falling import FallSolution
from tests.bench.spring import END, FIRST, SECOND, SpringSolution

PLAIN = (False, False)
UNIT = Domain((0.0, 0.0), (1.0, 1.0), PLAIN, PLAIN)


@pytest.fixture(scope="module")
def fall() -> Case:
    return catalog.named_case("free_fall")


def discrepancy(points: NDArray[Any]) -> float:
    """Largest error, over boxes from the origin to pairs of the points' own coordinates, of the share of points."""
    x, y = points[:, 0], points[:, 1]
    below = (x[:, None] < x[None]).astype(float).T @ (y[:, None] < y[None]).astype(float)
    return float(np.max(np.abs(below / len(points) - np.outer(x, y))))


def test_they_solve_the_equation_of_the_sequence() -> None:
    first, second = probes_of(UNIT, 2)
    step = (second - first) % 1.0
    p = 1 / step[0]
    assert p**3 == pytest.approx(p + 1, rel=1e-14)
    assert step[1] == pytest.approx(1 / p**2, rel=1e-14)


def test_every_cell_of_a_partition_holds_some() -> None:
    cells = np.floor(8 * probes_of(UNIT)).astype(int)
    counts = np.bincount(8 * cells[:, 0] + cells[:, 1], minlength=64)
    assert counts.sum() == PROBES
    assert 2 <= counts.min() <= counts.max() <= 6  # random points, four a cell: some cells hold none and others ten


def test_they_are_spread_better_than_random_points() -> None:
    random = [discrepancy(np.random.default_rng(seed).uniform(size=(PROBES, 2))) for seed in range(20)]
    found = discrepancy(probes_of(UNIT))
    assert found < min(random)
    assert found < 0.5 * np.median(random)


def test_the_first_ones_are_spread_as_evenly() -> None:
    random = [discrepancy(np.random.default_rng(seed).uniform(size=(64, 2))) for seed in range(20)]
    found = discrepancy(probes_of(UNIT, 64))
    assert found < min(random)
    assert found < 0.6 * np.median(random)


def test_no_regular_grid_holds_one() -> None:
    for n in range(2, 300):
        scaled = (n - 1) * probes_of(UNIT)
        assert np.min(np.max(np.abs(scaled - np.round(scaled)), axis=1)) > 1e-4


def test_they_fill_the_domain_and_leave_its_edges() -> None:
    domain = Domain((-2.0, 10.0), (1.0, 10.5), (True, False), PLAIN)
    shares = (probes_of(domain) - domain.lower) / domain.size
    assert shares == pytest.approx(probes_of(UNIT), abs=1e-12)
    assert np.all((shares > 0) & (shares < 1))


def test_two_solutions_are_asked_at_the_same_points(
    fall: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_fields(FallSolution(fall), fall, tmp_path / "one.npz")
    monkeypatch.setattr(sampling, "PICTURE", 7)
    write_fields(FallSolution(fall, reversed_inertia=True), fall, tmp_path / "other.npz")
    with np.load(tmp_path / "one.npz") as one, np.load(tmp_path / "other.npz") as other:
        assert np.array_equal(one["probes"], other["probes"])
        assert np.array_equal(one["probe_marks"], other["probe_marks"])
        assert one["xi"].shape != other["xi"].shape


def test_a_motion_is_kept_at_its_frames_in_double_precision(fall: Case) -> None:
    solution = FallSolution(fall)
    found = probe_fields(solution, fall)
    assert tuple(found["probe_marks"]) == frames(solution, fall)
    assert found["probe"].shape == (len(found["probe_marks"]), PROBES, 3)
    assert found["probe"].dtype == np.float64
    fallen = -9.8 / 2 * found["probe_marks"] ** 2
    assert found["probe"][..., 2] == pytest.approx(np.outer(fallen, np.ones(PROBES)), abs=1e-14)


def test_states_that_were_not_reached_or_are_not_finite_are_left_out() -> None:
    case = spring.snapping_case()
    found = probe_fields(SpringSolution(case, SECOND, spoilt=15.0), case)
    assert list(found["probe_marks"]) == [FIRST, SECOND]
    assert list(found["probe"][:, 0, 2]) == [FIRST, SECOND]
    nothing = probe_fields(SpringSolution(case, spoilt=END), case)
    assert END not in nothing["probe_marks"]
