"""Frame rates: what straight lines between frames add, against motions of the first and second degree."""

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.records.sampling import MOST_FRAMES, RATES, frame_rate_study, interpolate_frames
from shellbench.problems.shell.records.series import mark_reached
from tests.bench import spring
from tests.bench.falling import FallSolution
from tests.bench.spring import SpringSolution

G = 9.8
ROUNDING = 1e-14  # of displacements of some metres


@pytest.fixture(scope="module")
def fall() -> Case:
    return catalog.named_case("free_fall")


class Gliding(FallSolution):
    """It moves at a constant velocity, another one at each point."""

    def displacement(self, points, at=None, material=None):  # type: ignore[no-untyped-def]
        xi = np.asarray(points, dtype=float)
        return self._time("displacement", at) * np.stack([xi[..., 0], xi[..., 1], 1 + xi[..., 0]], axis=-1)


class Remembering(FallSolution):
    """It is a millimetre higher wherever it was asked for an earlier time before."""

    def displacement(self, points, at=None, material=None):  # type: ignore[no-untyped-def]
        before = self.asked[-1][1] if self.asked else np.inf
        field = super().displacement(points, at)
        return field + (1e-3 if before < self.asked[-1][1] else 0.0) * np.array([0, 0, 1.0])


def test_rates_are_those_of_even_instants_from_both_ends(fall: Case) -> None:
    steps = frame_rate_study(FallSolution(fall), fall)
    assert [step.frames for step in steps] == [rate + 1 for rate in RATES]  # of one second
    assert [step.frames_per_second for step in steps] == pytest.approx(RATES)
    assert [step.largest_displacement for step in steps] == pytest.approx([G / 2] * len(RATES))


def test_a_uniform_motion_loses_nothing(fall: Case) -> None:
    for step in frame_rate_study(Gliding(fall), fall):
        assert step.interpolation_difference <= ROUNDING
        assert step.interpolation_rms <= ROUNDING


def test_an_accelerated_motion_loses_an_eighth_of_acceleration_times_step_squared(fall: Case) -> None:
    steps = frame_rate_study(FallSolution(fall), fall)
    instants = 2 * (steps[-1].frames - 1) + 1  # at which the motion itself is asked, twice the finest rate
    for step in steps:
        dt = 1 / step.frames_per_second
        assert step.interpolation_difference == pytest.approx(G * dt**2 / 8, rel=1e-9)
        inner = (instants - 1) // (step.frames - 1)
        share = np.arange(inner) / inner
        squares = (G * dt**2 / 2 * share * (1 - share)) ** 2  # a parabola over its chord, at rest nothing at the end
        mean = squares.sum() * (step.frames - 1) / instants
        assert step.interpolation_rms == pytest.approx(np.sqrt(mean), rel=1e-9)
        assert step.interpolation_rms <= step.interpolation_difference


def test_what_is_asked_before_must_not_matter(fall: Case) -> None:
    assert {step.probe_difference for step in frame_rate_study(FallSolution(fall), fall)} == {0.0}
    for step in frame_rate_study(Remembering(fall), fall):
        assert step.probe_difference == pytest.approx(1e-3)


def test_a_motion_that_ended_early_is_seen_as_far_as_it_came(fall: Case) -> None:
    solution = FallSolution(fall, 0.5)
    end = mark_reached(solution, fall)
    *_, finest = frame_rate_study(solution, fall)
    assert finest.largest_displacement == pytest.approx(G / 2 * end**2)
    assert finest.frames == round(240 * end) + 1


def test_a_motion_that_is_not_finite_everywhere_is_not_studied(fall: Case) -> None:
    class Broken(FallSolution):
        def displacement(self, points, at=None, material=None):  # type: ignore[no-untyped-def]
            field = super().displacement(points, at)
            return np.where(self.asked[-1][1] > 0.9, np.nan, field)

    assert frame_rate_study(Broken(fall), fall) == ()


def test_a_long_motion_is_not_asked_for_more_frames(fall: Case) -> None:
    assert fall.dynamics is not None
    longer = fall.model_copy(update={"dynamics": fall.dynamics.model_copy(update={"until": 10.0})})
    solution = FallSolution(longer)
    steps = frame_rate_study(solution, longer)
    assert [step.frames for step in steps] == [151, 301, 601]
    assert max(step.frames for step in steps) <= MOST_FRAMES


def test_a_static_case_has_no_frames() -> None:
    case = spring.loaded_case()
    assert frame_rate_study(SpringSolution(case), case) == ()


def test_lines_join_frames() -> None:
    frames = np.array([[0.0, 1.0], [2.0, 1.0], [2.0, 5.0]])
    places = np.array([0.0, 0.25, 1.0, 1.5, 2.0])
    joined = interpolate_frames(frames, places)
    assert joined == pytest.approx(np.array([[0, 1], [0.5, 1], [2, 1], [2, 3], [2, 5]]), abs=1e-12)
