"""Records of paths: a whole path is stored completely, a broken one up to its last state."""

import errno
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shellbench.bench.run import worker
from shellbench.bench.run.worker import RECORD, run, work
from shellbench.bench.store.measuring import FIELDS, measured, values_of, without_values, write_fields
from shellbench.bench.store.record import LARGEST_RECORD, LONGEST_REASON, Record, read_document
from shellbench.bench.store.store import Store
from shellbench.errors import SolveFailure
from shellbench.problem import Capabilities, Settings, Step
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.records import self_intersection
from shellbench.problems.shell.records.sampling import PICTURE, RESOLUTIONS, energies_of_states, resolution_study
from shellbench.protocol.history import HistoryStep, ResolutionStep
from tests.bench import spring
from tests.bench.running import task_of
from tests.bench.spring import END, FIRST, REASON, SECOND, SpringSolution

FINE = 1e-4  # relative: a spline through sixty states
SINGLE = 1e-6  # relative: rounding of single precision


def broken_run(case: Case, folder: Path) -> Record:
    """Run a solver that fails half way, as the worker does."""
    return run(task_of(case, "tests.bench.spring:BreakingSolver"), folder, lambda progress: None)


def test_a_whole_path_is_measured_at_its_marks(tmp_path: Path) -> None:
    case = spring.loaded_case()
    found, why = measured(SpringSolution(case), case, tmp_path)
    assert why is None
    assert {name: m.value for name, m in found["values"].items()} == {
        "half": 0.25,
        "full": 1.0,
        "bending": 0.5,
        "energy": 3.0,
    }
    assert [(e.at, e.membrane, e.bending) for e in found["energies"]] == [
        (0.25, 0.0625, 0.125),
        (0.5, 0.25, 0.5),
        (1.0, 1.0, 2.0),
    ]
    assert found["diagnostics"] == {"reached": 1.0, "bad": None}


def test_turning_points_and_loads_come_from_the_path(tmp_path: Path) -> None:
    case = spring.snapping_case()
    found, why = measured(SpringSolution(case), case, tmp_path)
    assert why is None
    values = {name: m.value for name, m in found["values"].items()}
    assert values["limit"] == pytest.approx(100 * spring.load_at(FIRST), rel=FINE)
    assert values["limit_rise"] == pytest.approx(FIRST, rel=FINE)
    assert values["valley"] == pytest.approx(100 * spring.load_at(SECOND), rel=FINE)
    assert values["load_15"] == pytest.approx(100 * spring.load_at(15.0), rel=FINE)
    assert values["rise"] == END


def test_the_history_tells_states_of_the_path_from_solves(tmp_path: Path) -> None:
    case = spring.loaded_case()
    found, _ = measured(SpringSolution(case), case, tmp_path)
    first, *states = found["history"]
    assert (first.phase, first.iterations, first.quantities) == ("solve", None, {"full": 0.9})
    assert {step.phase for step in states} == {"path"}
    assert [step.iterations for step in states[:3]] == [2, 3, 2]
    assert states[-1].at == 1.0
    assert states[29].quantities == {"half": 0.25, "full": 0.25}  # at this state, whatever they are asked for
    assert all(isinstance(step.iterations, int) for step in states)


def test_a_broken_path_keeps_what_it_reached_and_says_why(tmp_path: Path) -> None:
    record = broken_run(spring.loaded_case(), tmp_path)
    assert (record.status, record.reason) == ("failed", REASON)
    assert {name: m.value for name, m in record.values.items()} == {"half": 0.25, "bending": 0.5}
    path = [step for step in record.history if step.phase == "path"]
    assert len(path) == 30
    assert path[-1].at == 0.5
    assert [state.at for state in record.energies] == [0.25, 0.5]
    assert record.parameters == 1
    with np.load(tmp_path / str(record.fields_file)) as fields:
        assert list(fields["marks"]) == [0.25, 0.5]
    assert (tmp_path / str(record.solution_file)).is_file()


def test_a_quantity_that_is_declined_is_named_with_its_reason_and_costs_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(worker, "same_source", lambda task: True)
    record = run(task_of(spring.loaded_case(), "tests.bench.spring:DecliningSolver"), tmp_path, lambda progress: None)
    assert (record.status, record.reason) == ("ok", None)
    assert record.declined == dict.fromkeys(("bending", "energy"), "springs have one energy")
    assert {name: m.value for name, m in record.values.items()} == {"half": 0.25, "full": 1.0}
    assert Record.model_validate_json(record.model_dump_json()) == record


def test_a_path_that_broke_behind_its_first_limit_point_keeps_it(tmp_path: Path) -> None:
    record = broken_run(spring.snapping_case(), tmp_path)
    assert record.status == "failed"
    assert set(record.values) == {"limit", "limit_rise", "load_15"}
    assert record.values["limit"].value == pytest.approx(100 * spring.load_at(FIRST), rel=FINE)


def test_a_record_of_a_broken_path_survives_json(tmp_path: Path) -> None:
    record = broken_run(spring.loaded_case(), tmp_path)
    assert Record.model_validate_json(record.model_dump_json()) == record


def test_older_records_can_be_read() -> None:
    step = HistoryStep.model_validate({"iteration": 0, "seconds": 1.0, "energy": -1.0, "unknowns": 4})
    assert (step.phase, step.iterations, step.at) == ("solve", None, 1.0)
    seen = {"points": 10, "probe_difference": 0.0, "interpolation_difference": 1e-3, "largest_displacement": 1.0}
    assert ResolutionStep.model_validate(seen).interpolation_rms is None


def test_a_record_from_before_frame_rates_and_precision_can_be_read(tmp_path: Path) -> None:
    data = broken_run(spring.loaded_case(), tmp_path).model_dump(mode="json")
    assert data.pop("frame_rates") == data.pop("precision") == []
    record = Record.model_validate(data)
    assert (record.frame_rates, record.precision) == ((), ())


def test_an_unfinished_answer_is_no_good_answer(tmp_path: Path) -> None:
    """A solver that stops early without saying so fails all the same."""
    case = spring.loaded_case()
    found, why = measured(SpringSolution(case, 0.5), case, tmp_path)
    assert set(found["values"]) == {"half", "bending"}
    assert why == "the solution has no finite value for full, energy: loaded: solved at 0.5, not at 1"


def test_a_value_that_is_not_finite_is_left_out_and_named() -> None:
    case = spring.loaded_case()
    values, lost = values_of(SpringSolution(case, spoilt=0.5), case)
    assert set(values) == {"full", "energy"}
    assert lost == {"half": "", "bending": ""}
    assert without_values(lost) == "the solution has no finite value for half, bending"


def test_a_bug_in_one_quantity_costs_no_other(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = spring.loaded_case()
    solution = SpringSolution(case)

    def broken(at: float | None = None) -> tuple[float, float]:
        raise ZeroDivisionError("a bug")

    solution.energies = broken  # type: ignore[method-assign]
    found, why = measured(solution, case, tmp_path)
    assert set(found["values"]) == {"half", "full"}
    assert "ZeroDivisionError: a bug" in str(why)
    assert "Traceback" in capsys.readouterr().err
    assert found["fields_file"] == FIELDS


def test_what_is_named_as_not_reached_is_missing_unless_the_answer_has_not_settled(tmp_path: Path) -> None:
    case = spring.loaded_case()
    solution = SpringSolution(case)
    solution.energies = lambda at=None: (float("nan"),) * 2  # type: ignore[method-assign]
    solution.diagnostics = {"not_reached": ["bending", "energy"]}
    _, why = measured(solution, case, tmp_path)
    assert "no finite value for bending, energy" in str(why)
    solution.unsettled = "the path ended"  # type: ignore[attr-defined]
    _, why = measured(solution, case, tmp_path)
    assert why is None


def test_states_of_a_path_are_sampled_at_their_marks(tmp_path: Path) -> None:
    case = spring.snapping_case()
    path = tmp_path / "fields.npz"
    assert write_fields(SpringSolution(case), case, path)
    with np.load(path) as fields:
        assert list(fields["marks"]) == [FIRST, 15.0, SECOND, END]
        assert fields["displacements"].shape == (4, PICTURE, PICTURE, 3)
        assert fields["displacements"].dtype == np.float32
        for mark, state in zip(fields["marks"], fields["displacements"], strict=True):
            assert state[..., 2] == pytest.approx(mark, rel=SINGLE)
        assert fields["displacement"].dtype == np.float64  # others are compared with it


def test_states_that_were_not_reached_or_are_not_finite_are_left_out(tmp_path: Path) -> None:
    case = spring.snapping_case()
    early = SpringSolution(case, SECOND, spoilt=15.0)
    write_fields(early, case, tmp_path / "fields.npz")
    with np.load(tmp_path / "fields.npz") as fields:
        assert list(fields["marks"]) == [FIRST, SECOND]
    assert [state.at for state in energies_of_states(early, case)] == [FIRST, SECOND]


def test_a_path_that_reached_nothing_leaves_no_fields(tmp_path: Path) -> None:
    case = spring.loaded_case()
    nothing = SpringSolution(case, 0.0)
    assert not write_fields(nothing, case, tmp_path / "fields.npz")
    found, why = measured(nothing, case, tmp_path)
    assert found["values"] == {}
    assert "fields_file" not in found
    assert math.isfinite(found["parameters"])
    assert "not at" in str(why)


def test_a_history_ends_where_its_energy_is_not_finite(tmp_path: Path) -> None:
    case = spring.loaded_case()
    solution = SpringSolution(case)
    bad = solution.history[5].__class__(**{**vars(solution.history[5]), "energy": math.nan})
    solution.history = (*solution.history[:5], bad, *solution.history[6:])
    found, _ = measured(solution, case, tmp_path)
    assert len(found["history"]) == 5


class Told(SpringSolution):
    """A spring that knows its energy densities, or goes wrong when it is asked for them."""

    wrong: Exception | None = None

    def evaluate(self, name: str, points: Any, at: float | None = None) -> Any:
        if self.wrong:
            raise self.wrong
        return np.full(np.shape(points)[:-1], {"membrane_energy_density": 0.5, "bending_energy_density": 2.0}[name])


def test_energy_densities_are_kept_in_single_precision(tmp_path: Path) -> None:
    case = spring.loaded_case()
    assert write_fields(Told(case), case, tmp_path / "fields.npz")
    with np.load(tmp_path / "fields.npz") as fields:
        for name, value in (("membrane", 0.5), ("bending", 2.0)):
            density = fields[f"{name}_energy_density"]
            assert (density.shape, density.dtype) == ((PICTURE, PICTURE), np.float32)
            assert np.all(density == value)


@pytest.mark.parametrize("wrong", [ZeroDivisionError("a bug"), NotImplementedError()])
def test_densities_that_can_not_be_told_cost_nothing_else(wrong: Exception, tmp_path: Path) -> None:
    case = spring.loaded_case()
    solution = Told(case)
    solution.wrong = wrong
    found, why = measured(solution, case, tmp_path)
    assert why is None
    assert found["resolution"]
    with np.load(tmp_path / FIELDS) as fields:
        assert {"probes", "displacement"} < set(fields)
        assert not any("density" in name for name in fields)


def test_a_full_disk_is_passed_on(tmp_path: Path) -> None:
    case = spring.loaded_case()
    solution = Told(case)
    solution.wrong = OSError(errno.ENOSPC, "No space left on device")
    with pytest.raises(OSError, match="No space left"):
        measured(solution, case, tmp_path)


def test_a_solution_without_densities_keeps_the_rest(tmp_path: Path) -> None:
    case = spring.loaded_case()
    write_fields(SpringSolution(case), case, tmp_path / "fields.npz")
    with np.load(tmp_path / "fields.npz") as fields:
        assert not any("density" in name for name in fields)
        assert list(fields["probe_marks"]) == [0.25, 0.5, 1.0]


class Shaped(SpringSolution):
    """A displacement that is a function of both coordinates on the unit square."""

    def __init__(self, case: Case, function: Any) -> None:
        super().__init__(case)
        self.function = function

    def displacement(self, points: Any, at: float | None = None, parameters: object = None) -> Any:
        xi = np.asarray(points, dtype=float)
        return self.function(xi[..., 0], xi[..., 1])[..., None] * np.array([0.0, 0.0, 1.0])


def test_a_bilinear_field_loses_nothing_on_any_grid() -> None:
    case = spring.loaded_case()
    for step in resolution_study(Shaped(case, lambda x, y: 1 + 2 * x - y + 3 * x * y), case):
        assert step.interpolation_difference <= 1e-14
        assert step.interpolation_rms is not None
        assert step.interpolation_rms <= 1e-14
        assert step.probe_difference == 0.0


def test_a_quadratic_field_loses_its_parabola_over_each_cell() -> None:
    case = spring.loaded_case()
    x = np.linspace(0, 1, max(RESOLUTIONS))
    for step in resolution_study(Shaped(case, lambda x, y: x**2), case):
        share = x * (step.points - 1) % 1.0
        gaps = share * (1 - share) / (step.points - 1) ** 2  # chord less parabola
        assert step.interpolation_difference == pytest.approx(gaps.max(), rel=1e-6, abs=1e-14)
        assert step.interpolation_rms == pytest.approx(np.sqrt(np.mean(gaps**2)), rel=1e-6, abs=1e-14)
        assert step.interpolation_rms <= step.interpolation_difference


def test_a_study_that_goes_wrong_costs_no_other(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = spring.loaded_case()
    solution: Any = SpringSolution(case)

    def rounded(format: str) -> tuple[object, int]:
        raise ZeroDivisionError("a bug")

    solution.rounded = rounded
    found, why = measured(solution, case, tmp_path)
    assert why is None  # the answer counts, whatever becomes of a study beside it
    assert "precision" not in found
    assert set(found["values"]) == {"half", "full", "bending", "energy"}
    assert len(found["resolution"]) == len(RESOLUTIONS)
    assert found["fields_file"] == FIELDS
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.parametrize("answer", [None, NotImplementedError], ids=["stub", "not implemented"])
def test_a_plug_in_that_only_inherits_rounding_has_a_whole_record(tmp_path: Path, answer: Any) -> None:
    case = spring.loaded_case()
    solution: Any = SpringSolution(case)

    def rounded(format: str) -> None:
        if answer is not None:
            raise answer

    solution.rounded = rounded
    found, why = measured(solution, case, tmp_path)
    assert why is None
    assert not found.get("precision")
    assert len(found["resolution"]) == len(RESOLUTIONS)


def test_a_plug_in_without_rounding_has_a_whole_record(tmp_path: Path) -> None:
    case = spring.loaded_case()
    found, why = measured(SpringSolution(case), case, tmp_path)
    assert why is None
    assert found["precision"] == ()
    assert found["frame_rates"] == ()


def nested(depth: int) -> list[Any]:
    return [nested(depth - 1)] if depth else []


FOLDS = "the field folds where its bending energy does not look"
HOSTILE: dict[str, dict[str, Any]] = {
    "not finite at a probe": {"displacement": lambda points, at=None, material=None: lost_at_a_probe(points)},
    "huge": {"displacement": lambda points, at=None, material=None: np.full((*np.shape(points)[:-1], 3), 1e200)},
    "diagnostics are nested": {"diagnostics": {"deep": nested(250)}},
    "diagnostics have many digits": {"diagnostics": {"count": 10**5000, "ratio": 1e300}},
    "diagnostics have half a character": {"diagnostics": {"word": "\ud800"}},
    "diagnostics take too much": {"diagnostics": {"word": "x" * (LARGEST_RECORD + 1)}},
    "parameters are negative": {"parameters": -1},
    "bytes have many digits": {"storage_bytes": 10**30},
    "seconds are no number": {"history": (Step(0, math.nan, -1.0, 4),)},
    "an uncertainty is infinite": {"uncertainty": {"full": math.inf, "half": 1e200}},
    "an uncertainty is text": {"uncertainty": {"full": "small"}},
    "a gap is infinite": {"history": (Step(0, 1.0, -1.0, 4, gap=math.inf, quantities={"full": 1e300}),)},
    "the file has no name": {"save": lambda path: Path("/")},
}


def lost_at_a_probe(points: Any) -> Any:
    """A field that is finite on the grid of pictures, and not at one of the probes."""
    xi = np.asarray(points, dtype=float)
    rise = np.where(np.all(np.isclose(xi, (0.37, 0.81)), axis=-1), math.nan, 1.0)
    return rise[..., None] * np.array([0.0, 0.0, 1.0])


class HostileSolver:
    """Leaves a solution with something that no record can keep, and fails or not."""

    name = "hostile"
    capabilities = Capabilities(theories=("kirchhoff-love-nonlinear",), label="")
    settings_type = Settings
    kind = ""
    reason: str | None = None

    def declines(self, case: Case) -> None:
        return None

    def load(self, path: Path) -> Any:
        raise NotImplementedError

    def solve(self, case: Case, settings: Any, start: Any = None, progress: Any = None) -> Any:
        solution = SpringSolution(case)
        for name, value in HOSTILE.get(self.kind, {}).items():
            setattr(solution, name, value)
        if self.reason is not None:
            raise SolveFailure(self.reason, solution)
        return solution


def left_by(case: Case, folder: Path) -> Record:
    """Work as a process of the bench does, and read what it has left."""
    folder.mkdir()
    task_of(case, "tests.bench.test_measuring:HostileSolver").write(folder)
    work(folder, lambda progress: None)
    return read_document((folder / RECORD).read_bytes())


@pytest.mark.sampled(6)
@pytest.mark.parametrize("kind", HOSTILE)
def test_no_record_is_written_that_can_not_be_read(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whatever a solver leaves; and what it says of itself stays the reason."""
    monkeypatch.setattr(HostileSolver, "kind", kind)
    monkeypatch.setattr(self_intersection, "crossings", lambda points, triangles: ())  # a block has none
    case = spring.loaded_case()
    assert left_by(case, tmp_path / "kept").status == "failed"  # its source is not that of the task
    monkeypatch.setattr(HostileSolver, "reason", FOLDS)
    record = left_by(case, tmp_path / "failed")
    assert (record.status, record.reason) == ("failed", FOLDS)
    store = Store(tmp_path / "runs")
    partial = store.begin(record.run_id)
    assert store.commit(partial, record).reason == FOLDS
    monkeypatch.setattr("shellbench.bench.store.store.catalog.case_names", lambda: [case.name])
    contents = store.read()
    assert contents.damaged == ()
    assert contents.records[0].reason == FOLDS


@pytest.mark.parametrize(
    "given", [-1e-9, math.nan, math.inf, "small", 1j, np.complex128(1), None.__class__, [1.0]], ids=repr
)
def test_an_uncertainty_that_is_none_fails_its_run(given: Any, tmp_path: Path) -> None:
    case = spring.loaded_case()
    solution: Any = SpringSolution(case)
    solution.uncertainty = {"full": given}
    found, why = measured(solution, case, tmp_path)
    assert why is not None
    assert re.fullmatch(
        r"the solver states .{1,60} as uncertainty of full, but it must be a finite number of at least 0", why
    )
    assert set(found["values"]) == {"half", "full", "bending", "energy"}


@pytest.mark.filterwarnings("ignore::numpy.exceptions.ComplexWarning")
def test_a_complex_displacement_fails_its_run(tmp_path: Path) -> None:
    case = spring.loaded_case()
    solution: Any = SpringSolution(case)
    real = solution.displacement
    solution.displacement = lambda points, at=None, material=None: real(points, at=at) * (1 + 0j)
    _, why = measured(solution, case, tmp_path)
    assert why is not None
    assert re.search("no real number|no array of real numbers, but of complex128", why)


def test_a_field_that_is_not_finite_at_a_probe_is_no_good_answer(tmp_path: Path) -> None:
    case = spring.loaded_case()
    solution: Any = SpringSolution(case)
    solution.displacement = lambda points, at=None, material=None: lost_at_a_probe(points)
    found, why = measured(solution, case, tmp_path)
    assert why == "the solution can't be measured: its displacement is not finite at the point (0.37, 0.81)"
    assert (found["fields_file"], found["solution_file"]) == (FIELDS, "solution.txt")


@pytest.mark.parametrize("reason", ["x" * 1_000_000, "half a character: \ud800"])
def test_a_reason_is_kept_as_far_as_a_record_can(reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(HostileSolver, "reason", reason)
    record = left_by(spring.loaded_case(), tmp_path / "failed")
    assert record.values
    assert str(record.reason)[:15] == reason[:15]
    assert len(str(record.reason)) <= LONGEST_REASON
