"""Series: what a record keeps of a motion, against free fall in closed form; of a path its torques."""

from pathlib import Path

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.run.worker import run
from shellbench.bench.store.measuring import measured
from shellbench.bench.store.record import Record
from shellbench.bench.store.task import case_data
from shellbench.errors import InputError
from shellbench.problem import Step
from shellbench.problems.shell.case import Case, build_case
from shellbench.problems.shell.records import self_intersection
from shellbench.problems.shell.records.sampling import PICTURE
from shellbench.problems.shell.records.series import CURVE_TIMES, FRAMES, asked_series, frames, mark_reached, series_of
from tests.bench import spring
from tests.bench.falling import REASON, STEPS, FallSolution
from tests.bench.running import task_of
from tests.bench.spring import SpringSolution

G, RHO = 9.8, 0.144
SINGLE = 1e-6  # relative: rounding of single precision


@pytest.fixture(autouse=True)
def no_crossings(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compare no triangles: a plate that falls does not pass through itself, and each state would take its time."""
    monkeypatch.setattr(self_intersection, "crossings", lambda points, triangles: ())


@pytest.fixture(scope="module")
def fall() -> Case:
    return catalog.named_case("free_fall")


def record_of(case: Case, solver: str, folder: Path) -> Record:
    """Run one of the falling solvers, as the worker does."""
    return run(task_of(case, f"tests.bench.falling:{solver}"), folder, lambda progress: None)


def test_the_series_of_free_fall_are_its_closed_form(fall: Case) -> None:
    found = {one.name: one for one in series_of(FallSolution(fall), fall)}
    t = np.array(found["fall"].marks)
    assert len(t) == CURVE_TIMES
    assert (t[0], t[-1]) == (0.0, 1.0)
    assert np.ptp(np.diff(t)) < 1e-12
    assert found["fall"].values == pytest.approx(G * t**2 / 2, abs=1e-12)
    assert found["centre_z"].values == pytest.approx(-G * t**2 / 2, abs=1e-12)
    assert found["kinetic_energy"].values == pytest.approx(RHO / 2 * (G * t) ** 2, abs=1e-12)
    assert found["total_energy"].values == pytest.approx(0 * t, abs=1e-12)
    assert found["fall"].quantities == ("fall_500ms", "fall_1000ms")
    assert (found["fall"].unit, found["kinetic_energy"].unit) == ("m", "J")
    assert found["bending_energy"].quantities == ()  # kept, though the case does not ask for it
    assert set(found["bending_energy"].values) == {0.0}


def test_the_field_is_asked_for_once_a_time(fall: Case) -> None:
    solution = FallSolution(fall)
    series_of(solution, fall)
    velocities = [at for what, at in solution.asked if what == "velocity"]
    assert len(velocities) == len(set(velocities)) == CURVE_TIMES
    assert (
        sum(what == "displacement" for what, _ in solution.asked) == 2 * CURVE_TIMES
    )  # at the middle, and for the mass


@pytest.mark.parametrize("name", ["pendulum_strip", "napkin_plane", "napkin_soft_pin", "napkin_moving_corners"])
def test_each_quantity_in_motion_belongs_to_one_series(name: str) -> None:
    case = catalog.named_case(name)
    series = asked_series(case)
    listed = [quantity for one in series for quantity in one.quantities]
    assert sorted(listed) == sorted({q.name for q in case.quantities if q.kind != "largest_displacement"})
    for one in series:
        assert not one.name.endswith("ms")
        measured = [case.quantity(q) for q in one.quantities]
        assert len({q.at for q in measured}) == len(measured)  # the same thing at different times
        assert {q.kind for q in measured} <= {one.quantity.kind}
    assert {"kinetic_energy", "membrane_energy", "bending_energy"} <= {one.name for one in series}


def test_the_total_energy_is_kept_only_where_it_is_one() -> None:
    still, moved = map(catalog.named_case, ("napkin_plane", "napkin_moving_corners"))
    assert "total_energy" in {one.name for one in asked_series(still)}
    assert "total_energy" not in {one.name for one in asked_series(moved)}  # work is done at the corners


def test_two_things_of_one_name_are_two_series(fall: Case) -> None:
    data = case_data(fall)
    data.pop("name")
    other = {**data["quantities"][0], "name": "fall_250ms", "at": 0.25, "direction": [1, 0, 0], "primary": False}
    case = build_case({**data, "quantities": [*data["quantities"], other]}, "falls", "falls.toml")
    series = {one.name: one.quantities for one in asked_series(case)}
    assert series["fall"] == ("fall_500ms", "fall_1000ms")
    assert series["fall_250ms"] == ("fall_250ms",)


def test_frames_are_uniform_and_hold_the_asked_times(fall: Case) -> None:
    marks = frames(FallSolution(fall), fall)
    assert marks == tuple(sorted(set(marks)))
    assert set(fall.states) <= set(marks)
    uniform = np.linspace(0, 1, FRAMES)[1:]
    assert np.abs(np.subtract.outer(uniform, marks)).min(axis=1).max() < 1e-12


def test_a_whole_motion_is_measured_at_its_times(fall: Case, tmp_path: Path) -> None:
    found, why = measured(FallSolution(fall), fall, tmp_path)
    assert why is None
    values = {name: m.value for name, m in found["values"].items()}
    assert values["fall_500ms"] == pytest.approx(G / 8)
    assert values["fall_1000ms"] == pytest.approx(G / 2)
    assert values["kinetic_energy_500ms"] == pytest.approx(RHO / 2 * (G / 2) ** 2)
    assert [state.at for state in found["energies"]] == [0.5, 1.0]
    assert [step.phase for step in found["history"]] == ["solve", *["time"] * STEPS]
    with np.load(tmp_path / "fields.npz") as fields:
        assert fields["displacements"].shape == (len(fields["marks"]), PICTURE, PICTURE, 3)
        for t, field in zip(fields["marks"], fields["displacements"], strict=True):
            assert np.allclose(field, [0, 0, -G * t**2 / 2], rtol=SINGLE)
        assert np.all(fields["displacement"][..., 2] == -G / 2)


def test_a_motion_that_failed_keeps_all_up_to_its_last_time(fall: Case, tmp_path: Path) -> None:
    record = record_of(fall, "StoppingSolver", tmp_path)
    end = 29 / STEPS
    assert (record.status, record.reason) == ("failed", REASON)
    assert set(record.values) == {q.name for q in fall.quantities if q.at == 0.5}
    assert record.history[-1].at == pytest.approx(end)
    (series,) = [one for one in record.series if one.name == "fall"]
    assert series.marks[-1] == pytest.approx(end)
    assert series.values == pytest.approx(G * np.array(series.marks) ** 2 / 2, abs=1e-12)
    assert len(series.marks) == np.sum(np.linspace(0, 1, CURVE_TIMES) < end) + 1
    with np.load(tmp_path / str(record.fields_file)) as fields:
        assert fields["marks"][-1] == pytest.approx(end)
        assert np.allclose(fields["displacement"], [0, 0, -G * end**2 / 2])
    assert Record.model_validate_json(record.model_dump_json()) == record


def test_a_motion_that_failed_at_once_keeps_rest(fall: Case) -> None:
    solution = FallSolution(fall, upto=0.0)
    solution.history = (*solution.history[:1], Step(1, 0.2, 0.0, 3, at=0.0, phase="time"))
    assert mark_reached(solution, fall) == 0.0
    assert {one.marks for one in series_of(solution, fall)} == {(0.0,)}


def test_records_of_before_have_no_series(fall: Case, tmp_path: Path) -> None:
    data = record_of(fall, "FallingSolver", tmp_path).model_dump(mode="json")
    assert len(data.pop("series")) > 4
    assert Record.model_validate(data).series == ()


class TwistedSleeve(SpringSolution):
    """A sleeve whose torque is the square of its twist, known at the states that it keeps."""

    def __init__(self, case: Case) -> None:
        self.case = case
        known = {"torque_50mrad": 0.03**2}
        self.history = (
            Step(0, 0.1, -1.0, 10),
            Step(1, 0.2, -1.0, 10, at=0.03, phase="path", quantities=known),
            Step(2, 0.2, -1.0, 10, at=0.05, phase="path"),
            Step(3, 0.3, -1.0, 10, at=0.07, phase="path"),  # neither kept nor known
            Step(4, 0.3, -1.0, 10, at=0.075, phase="critical"),
        )

    def reaction(self, support, centre=(0.0, 0.0, 0.0), at=None):
        if at not in {*self.case.states, 0.075}:
            raise InputError("not kept")
        return np.zeros(3), np.array([0.0, at**2, 0.0])


def test_the_torque_of_a_path_is_a_series_of_its_known_states() -> None:
    case = catalog.named_case("sleeve_twist")
    (series,) = series_of(TwistedSleeve(case), case)
    assert series.name == "torque"
    assert series.marks == tuple(sorted({0.03, 0.075, *case.states}))
    assert series.values == pytest.approx(np.square(series.marks))


@pytest.mark.parametrize("case", [spring.loaded_case(), spring.snapping_case()])
def test_a_path_without_forces_has_no_series(case: Case) -> None:
    assert series_of(SpringSolution(case), case) == ()
    assert frames(SpringSolution(case), case) == case.states
