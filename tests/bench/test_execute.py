"""Runs end as records, whatever the solver does."""

import contextlib
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil
import pytest

from shellbench.bench.run.display import Silent
from shellbench.bench.run.execute import execute
from shellbench.bench.run.local import LocalProcesses
from shellbench.bench.run.plan import Request, make_plan
from shellbench.bench.store.planned import FOLDER
from shellbench.bench.store.record import Record
from shellbench.bench.store.store import Store
from shellbench.disk import StoreError
from tests.bench import strip
from tests.bench.conftest import with_plugin, with_toys
from tests.bench.running import behave, run
from tests.patience import GUARD

ALLOCATED = 200e6  # bytes: what the toy allocates
ROUND_OFF = 1e-14 * strip.CENTRE

pytestmark = pytest.mark.usefixtures("toys")


@dataclass(frozen=True)
class Behaved:
    """Runs of the strip by a toy solver, by the way in which it behaved."""

    store: Store
    records: dict[str, Record]


@pytest.fixture(scope="module")
def behaved(tmp_path_factory: pytest.TempPathFactory) -> Behaved:
    """Runs that one server has made one after another: most of the time goes into starting it."""
    folder = tmp_path_factory.mktemp("behaved")
    ways = (
        "exact",
        "garble",
        "remove_folder",
        "none",
        "pipe",
        "allocate",
        "fail",
        "raise",
        "exit",
        "crash",
        "nan",
        "fail_with_partial",
        "unsettled",
    )
    with with_plugin(folder / "plugin"), with_toys(folder / "catalog"):
        store = Store(folder / "runs")
        requests = [Request(("strip",), (), ("toy",), {"toy": {"behaviour": way}}) for way in ways]
        tasks = [task for request in requests for task in make_plan(request, store.read()).tasks]
        outcomes = execute(tasks, store, Silent(), LocalProcesses(1, 1))
    return Behaved(store, {str(o.task.settings["behaviour"]): o.record for o in outcomes if o.record is not None})


def test_all_that_behaved_are_kept(behaved: Behaved) -> None:
    kept = {record.run_id: record for record in behaved.store.read().records}
    assert kept == {record.run_id: record for record in behaved.records.values()}
    assert len(kept) == 13


def test_a_good_run_leaves_a_whole_record(behaved: Behaved) -> None:
    record = behaved.records["exact"]
    assert record.status == "ok"
    assert record.values["centre"].value == pytest.approx(strip.CENTRE, rel=1e-12)
    assert record.values["energy"].value == pytest.approx(strip.ENERGY, rel=1e-12)
    assert record.values["centre"].uncertainty == 1e-12
    assert record.values["centre"].extrapolated == 1.0
    assert record.diagnostics == {"residual": 1e-12, "energy_gap": None}
    assert record.identity.seed is None


def test_fields_are_samples_of_the_solution(recorded: Store) -> None:
    (record,) = recorded.read().records
    path = recorded.file(record.fields_file)
    assert path is not None
    with np.load(path) as fields:
        assert fields["displacement"].shape == fields["position"].shape == (*fields["xi"].shape[:2], 3)
        largest = np.max(np.linalg.norm(fields["displacement"], axis=-1))
    assert largest == pytest.approx(strip.CENTRE, rel=1e-12)  # the grid has a point in the middle


def test_resolution_study_converges_at_second_order(recorded: Store) -> None:
    steps = {step.points: step for step in recorded.read().records[0].resolution}
    assert sorted(steps) == [10, 25, 50, 100, 200]
    assert all(step.probe_difference < ROUND_OFF for step in steps.values())
    between = [np.log(steps[n].interpolation_difference) for n in (25, 50, 100)]
    slope = np.polyfit(np.log([24, 49, 99]), between, 1)[0]
    assert slope == pytest.approx(-2, abs=0.15)  # bilinear interpolation of a smooth field
    bound = strip.LOAD * strip.LENGTH**2 / (8 * strip.STIFFNESS) * (strip.LENGTH / 9) ** 2 / 8
    assert 0.8 * bound < steps[10].interpolation_difference <= bound  # max|w''| h^2 / 8
    assert steps[200].interpolation_difference < ROUND_OFF


def test_history_ends_where_the_energy_is_not_finite(recorded: Store) -> None:
    assert [step.energy for step in recorded.read().records[0].history] == [-2.0]


def test_peak_memory_is_that_of_the_solve(behaved: Behaved) -> None:
    record = behaved.records["allocate"]
    assert record.peak_memory_bytes is not None
    assert record.idle_memory_bytes is not None
    taken = record.peak_memory_bytes - record.idle_memory_bytes
    assert 0.95 * ALLOCATED < taken < 1.3 * ALLOCATED
    assert record.idle_memory_bytes < psutil.Process().memory_info().rss  # its solver alone, not all that we hold


@pytest.mark.parametrize(
    ("behaviour", "said"),
    [
        ("fail", "the strip would not converge"),
        ("raise", "ZeroDivisionError: a bug in the solver"),
        ("exit", "exit status 1"),
        ("crash", "SIGSEGV"),
        ("none", "the solver returned None"),
        ("pipe", "exit status 0 and left no record"),
        ("garble", "wrote to the stream by which its server speaks"),
        ("remove_folder", "removed the folder in which it worked"),
    ],
)
def test_failures_become_records_with_one_sentence(behaved: Behaved, behaviour: str, said: str) -> None:
    record = behaved.records[behaviour]
    assert record.status == "failed"
    assert record.reason is not None
    assert said in record.reason
    assert "\n" not in record.reason
    assert not record.values


def test_an_answer_that_is_not_finite_is_a_failure(behaved: Behaved) -> None:
    record = behaved.records["nan"]
    assert record.status == "failed"
    assert record.reason == "the solution has no finite value for centre, energy"
    assert "centre" not in record.values


def test_traceback_of_a_bug_is_kept_beside_its_record(behaved: Behaved) -> None:
    record = behaved.records["raise"]
    log = (behaved.store.folder / f"{record.run_id}.log.txt").read_text(encoding="utf-8")
    assert "Traceback" in log
    assert "ZeroDivisionError" in log


def test_what_had_converged_before_a_failure_is_kept(behaved: Behaved) -> None:
    record = behaved.records["fail_with_partial"]
    assert record.status == "failed"
    assert record.reason == "the strip stopped half way"
    assert record.values["centre"].value == pytest.approx(strip.CENTRE / 2, rel=1e-12)
    assert behaved.store.file(record.solution_file) is not None


def test_an_answer_that_has_not_settled_is_recorded_with_its_reason(behaved: Behaved) -> None:
    record = behaved.records["unsettled"]
    assert (record.status, record.reason) == ("not settled", "centre still moves by 2e-3")
    assert record.values["centre"].value == pytest.approx(strip.CENTRE, rel=1e-12)
    assert record.values["centre"].uncertainty == 1e-12
    assert record.series == ()
    assert behaved.store.file(record.fields_file) is not None
    assert behaved.store.file(record.solution_file) is not None


def test_chatter_of_a_solver_goes_to_the_log(store: Store, capfd: pytest.CaptureFixture[str]) -> None:
    record = behave(store, "print")
    assert record.status == "ok"
    assert "chatter on standard output" in (store.folder / f"{record.run_id}.log.txt").read_text(encoding="utf-8")
    assert "chatter" not in "".join(capfd.readouterr())


def test_timeout_stops_that_run_only(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """The clock of the executor jumps beyond the limit once one run hangs and the other has ended."""
    happened: set[str] = set()

    class Clock(Silent):
        def progressed(self, task, progress) -> None:
            happened.add(f"{task.settings['behaviour']} goes on")

        def ended(self, outcome) -> None:
            happened.add(f"{outcome.task.settings['behaviour']} ended")

        def monotonic(self) -> float:
            return time.monotonic() + 2 * GUARD * ({"hang goes on", "exact ended"} <= happened)

    clock = Clock()
    monkeypatch.setattr("shellbench.bench.run.local.time", clock)
    plans = [
        make_plan(Request(("strip",), (), ("toy",), {"toy": {"behaviour": behaviour}}), store.read())
        for behaviour in ("hang", "exact")
    ]
    tasks = [task for plan in plans for task in plan.tasks]
    outcomes = execute(tasks, store, clock, LocalProcesses(2, 1, timeout=GUARD))
    found = {o.task.settings["behaviour"]: o.record for o in outcomes}
    assert found["exact"] is not None
    assert found["exact"].status == "ok"
    assert found["hang"] is not None
    assert (found["hang"].status, found["hang"].reason) == ("timeout", f"stopped after {GUARD:g} s")


def test_a_run_that_others_keep_from_computing_is_not_stopped(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """At each look the clock says that it has had its time twice over; of the processor it has had half of it."""

    class Clock:
        def __init__(self) -> None:
            self.looks = 0

        def monotonic(self) -> float:
            self.looks += 1
            return 2 * GUARD * self.looks

    monkeypatch.setattr("shellbench.bench.run.local.time", Clock())
    monkeypatch.setattr("shellbench.bench.plugins.process.MOST_WAITED", float("inf"))
    monkeypatch.setattr("shellbench.bench.plugins.process.COMPUTES", 0.0)
    monkeypatch.setattr("shellbench.bench.plugins.process.ServerProcess.cpu_time", lambda _: GUARD / 2)
    assert behave(store, "exact", timeout=GUARD).status == "ok"
    monkeypatch.setattr("shellbench.bench.plugins.process.ServerProcess.cpu_time", lambda _: GUARD)
    assert behave(store, "hang", timeout=GUARD).status == "timeout"


def test_no_process_outlives_its_run(store: Store) -> None:
    behave(store, "leave_child")
    behave(store, "hang", timeout=1.0)
    alive = [p.cmdline() for p in psutil.Process().children(recursive=True)]
    orphans = [p.info["cmdline"] for p in psutil.process_iter(["cmdline"]) if _is_the_child_left(p.info["cmdline"])]
    assert alive == []
    assert orphans == []


def _is_the_child_left(command: list[str] | None) -> bool:
    return bool(command) and command[-1] == "import time; time.sleep(3600)"


def test_refused_input_leaves_no_record(store: Store) -> None:
    outcome = run(store, "strip", solvers=("toy",), settings={"toy": {"behaviour": "refuse"}}, apart=True)[0]
    assert outcome.record is None
    assert outcome.refused == "setting 'behaviour' does not fit the case"
    assert store.read().records == ()


def test_good_runs_are_kept_and_failed_ones_are_tried_again(recorded: Store) -> None:
    assert run(recorded, "strip", solvers=("toy",)) == []
    for _ in range(2):
        assert behave(recorded, "fail").status == "failed"
    assert len(run(recorded, "strip", solvers=("toy",), force=True, apart=True)) == 1
    assert len(recorded.read().records) == 4


def test_full_disk_in_a_run_is_said_and_leaves_nothing(store: Store) -> None:
    with pytest.raises(StoreError, match="disk is full"):
        behave(store, "disk_full")
    assert {p.name for p in store.folder.iterdir()} == {".lock", FOLDER}  # it was planned, and did not end


def test_killed_server_costs_its_run_only(store: Store) -> None:
    class Killer(Silent):
        def progressed(self, task, progress) -> None:
            if task.settings.get("behaviour") == "hang":
                for server in psutil.Process().children():
                    server.kill()

    tasks = [
        task
        for behaviour in ("hang", "exact")
        for task in make_plan(Request(("strip",), (), ("toy",), {"toy": {"behaviour": behaviour}}), store.read()).tasks
    ]
    records = [o.record for o in execute(tasks, store, Killer(), LocalProcesses(1, 1, timeout=GUARD))]
    assert [r.status for r in records if r] == ["failed", "ok"]
    assert records[0] is not None
    assert "killed" in (records[0].reason or "")


def test_interrupt_stops_all_and_keeps_what_had_ended(store: Store) -> None:
    class Interrupter(Silent):
        def ended(self, outcome) -> None:
            raise KeyboardInterrupt

    tasks = [
        task
        for behaviour in ("exact", "hang")
        for task in make_plan(Request(("strip",), (), ("toy",), {"toy": {"behaviour": behaviour}}), store.read()).tasks
    ]
    with pytest.raises(KeyboardInterrupt):
        execute(tasks, store, Interrupter(), LocalProcesses(2, 1))
    assert [record.status for record in store.read().records] == ["ok"]
    assert list(store.folder.glob(".*.partial")) == []
    assert psutil.Process().children(recursive=True) == []


def test_what_has_ended_is_kept_where_the_next_can_not_begin(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    tasks = [
        task
        for seed in (0, 1)
        for task in make_plan(Request(("strip",), (), ("toy-noisy",), seeds=(seed,)), store.read()).tasks
    ]
    begin = Store.begin

    def full(self: Store, run_id: str) -> Path:
        if run_id == tasks[1].run_id:
            raise StoreError("the disk is full")
        return begin(self, run_id)

    monkeypatch.setattr(Store, "begin", full)
    with pytest.raises(StoreError, match="disk is full"):
        execute(tasks, store, Silent(), LocalProcesses(1, 1, timeout=GUARD))
    assert [record.run_id for record in store.read().records] == [tasks[0].run_id]
    assert psutil.Process().children(recursive=True) == []


def test_what_was_made_ready_and_is_not_needed_is_ended(store: Store) -> None:
    (task,) = make_plan(Request(("strip",), (), ("toy",)), store.read()).tasks
    with contextlib.closing(LocalProcesses(2, 1)) as executor:
        for _ in range(2):
            executor.expect(task)
        assert len(executor.idle) == 1
        assert executor.idle[0].process.poll() is None
    assert psutil.Process().children(recursive=True) == []


def test_a_process_that_was_made_ready_makes_the_run(store: Store) -> None:
    (task,) = make_plan(Request(("strip",), (), ("toy",)), store.read()).tasks
    with contextlib.closing(LocalProcesses(1, 1, timeout=GUARD)) as executor:
        executor.expect(task)
        (server,) = executor.idle
        (outcome,) = execute([task], store, Silent(), executor)
        assert server.ready
    assert outcome.record is not None
    assert outcome.record.status == "ok"
    assert psutil.Process().children(recursive=True) == []


def test_threads_of_a_run_are_limited(store: Store, plugin: Path) -> None:
    text = (plugin / "toy_shells" / "solver.py").read_text(encoding="utf-8")
    said = 'print("OMP", os.environ["OMP_NUM_THREADS"], os.environ["OMP_WAIT_POLICY"])'
    (plugin / "toy_shells" / "solver.py").write_text(text.replace('print("chatter on standard output")', said))
    record = behave(store, "print")
    assert "OMP 1 passive" in (store.folder / f"{record.run_id}.log.txt").read_text(encoding="utf-8")


def test_execution_has_no_tasks_without_a_store(store: Store) -> None:
    assert execute([], store, Silent(), LocalProcesses(1, 1)) == []
    assert not store.folder.exists() or list(store.folder.iterdir()) == [store.folder / ".lock"]


def test_source_that_changes_while_it_runs_is_a_failure(store: Store) -> None:
    record = behave(store, "edit_source")
    assert record.status == "failed"
    assert "was changed while it ran" in (record.reason or "")


def test_checkpoints_lie_in_the_store_and_are_no_part_of_the_identity(store: Store, tmp_path: Path) -> None:
    record = run(store, "strip", solvers=("toy-noisy",))[0].record
    assert record is not None
    assert record.diagnostics["checkpoint"] == str((store.folder / "checkpoints").resolve())
    assert "checkpoint" not in record.identity.settings
    settings = {"toy-noisy": {"checkpoint": str(tmp_path)}}
    assert run(store, "strip", solvers=("toy-noisy",), settings=settings) == []
    record = run(store, "strip", solvers=("toy-noisy",), settings=settings, force=True)[0].record
    assert record is not None
    assert record.diagnostics["checkpoint"] == str(tmp_path)


def test_seconds_of_a_resumed_solve_are_those_of_all_of_it(store: Store) -> None:
    record = run(store, "strip", solvers=("toy-noisy",), settings={"toy-noisy": {"behaviour": "resumed"}})[0].record
    assert record is not None
    assert record.seconds == 1000.0
