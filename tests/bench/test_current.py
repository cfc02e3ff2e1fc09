"""Validity of records: today's case and solver would make them again, and records of absent solvers are kept."""

from importlib.metadata import version
from pathlib import Path

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.baseline import Baseline
from shellbench.bench.judge.compare import rows, rows_and_notes
from shellbench.bench.judge.expected import Scope
from shellbench.bench.judge.gate import gate, move_baseline
from shellbench.bench.store.current import current_runs
from shellbench.bench.store.export import stored_run
from shellbench.bench.store.store import Contents, Store
from shellbench.errors import InputError, PluginError, ShellbenchError
from tests.bench.running import changed, run, run_here
from tests.bench.test_compare import edit

pytestmark = pytest.mark.usefixtures("toys")
QUANTITIES = 3


def uninstall(plugin: Path) -> None:
    edit(plugin / "toy_shells-1.0.dist-info" / "entry_points.txt", "toy = toy_shells.solver:ExactSolver\n", "")


def remove_source(plugin: Path) -> None:
    entry = "toy = toy_shells.solver:ExactSolver"
    edit(plugin / "toy_shells-1.0.dist-info" / "entry_points.txt", entry, "toy = toy_shells.gone:ExactSolver")


def test_records_of_a_kind_that_does_not_answer_are_left_out(recorded: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    def dead(data: object) -> None:
        raise PluginError("problems of kind 'spring' can't be used: its process died")

    contents = recorded.read()
    own = contents.records[0].model_copy(update={"own_case": True})
    monkeypatch.setattr("shellbench.bench.store.current.problem_of", dead)
    found = current_runs(Contents((own,)))
    assert not found.runs
    assert [reason for _, reason in found.stale.values()] == ["its case can't be read any more"]


@pytest.mark.parametrize("leave", [uninstall, remove_source])
def test_records_of_an_absent_solver_are_shown_with_a_note(recorded: Store, plugin: Path, leave) -> None:
    before = rows(recorded)
    leave(plugin)
    found, notes = rows_and_notes(recorded, ("toys",))
    assert found == before
    assert len(found) == QUANTITIES
    assert notes == ("solver 'toy' is not installed: 1 stored run is shown as recorded, and no gate takes them",)


@pytest.mark.parametrize("leave", [uninstall, remove_source])
def test_no_gate_takes_the_record_of_an_absent_solver(recorded: Store, plugin: Path, leave) -> None:
    scope = Scope(suites=("toys",))
    gated = [f for f in gate(recorded, None, scope).accuracy if f.row.solver == "toy"]
    assert {f.colour for f in gated} == {"green"}
    leave(plugin)
    findings = [f for f in gate(recorded, None, scope).accuracy if f.row.solver == "toy"]
    assert len(findings) == len(gated)
    assert {(f.colour, f.row.status) for f in findings} == {("red", "missing")}
    assert all("toy" in f.sentence for f in findings)  # says which solver, in one sentence
    assert not any("\n" in f.sentence for f in findings)


def test_no_baseline_remembers_an_absent_solver(recorded: Store, plugin: Path) -> None:
    uninstall(plugin)
    with pytest.raises(ShellbenchError, match="not moved"):
        move_baseline(recorded, Baseline(values=(), costs=()), Scope(suites=("toys",)))
    with pytest.raises(InputError, match="unknown solver 'toy'"):
        gate(recorded, None, Scope(solvers=("toy",)))


def test_a_changed_solver_is_left_out_while_it_is_there(recorded: Store, plugin: Path) -> None:
    edit(plugin / "toy_shells" / "strip.py", "24", "25")
    found, notes = rows_and_notes(recorded, ("toys",))
    assert found == []
    assert notes == ("1 stored run is left out: the solver has changed since",)


def test_the_record_of_an_absent_solver_answers_for_todays_case_only(recorded: Store, plugin: Path) -> None:
    uninstall(plugin)
    edit(catalog.data_folder("cases") / "strip.toml", "thickness = 0.1", "thickness = 0.2")
    found, notes = rows_and_notes(recorded, ("toys",))
    assert found == []
    assert notes == ("1 stored run is left out: the case has changed since",)


def test_of_two_sources_of_an_absent_solver_the_newest_counts(recorded: Store, plugin: Path) -> None:
    edit(plugin / "toy_shells" / "strip.py", "24", "25")
    run(recorded, "strip", solvers=("toy",))
    newest = recorded.read().records[-1]
    uninstall(plugin)
    runs = current_runs(recorded.read()).runs
    assert [r.record.run_id for r in runs] == [newest.run_id]
    assert not runs[0].installed


def test_what_asks_for_installed_solvers_finds_no_other(recorded: Store, plugin: Path) -> None:
    found = current_runs(recorded.read())
    assert found.find("strip", "toy", {}, 0) is not None
    uninstall(plugin)
    found = current_runs(recorded.read())
    assert found.find("strip", "toy", {}, 0) is None
    assert found.find("strip", "toy", {}, 0, installed=False) is not None


def made_by(store: Store, engine: str) -> None:
    """Have the only record of a store say that an engine has made it."""
    (record,) = store.read().records
    settings = {**record.identity.settings, "engine": engine}
    identity = record.identity.model_copy(update={"settings": settings})
    changed(store, record, identity=identity, defaults={**record.defaults, "engine": engine})


def test_a_record_of_another_version_of_its_engine_is_left_out(recorded: Store) -> None:
    made_by(recorded, "psutil 0.1")
    found, notes = rows_and_notes(recorded, ("toys",))
    assert found == []
    changed = f"its engine has changed since: psutil 0.1, now {version('psutil')}"
    assert notes == (f"1 stored run is left out: {changed}",)
    findings = [f for f in gate(recorded, None, Scope(suites=("toys",))).accuracy if f.row.solver == "toy"]
    assert {(f.colour, f.row.status) for f in findings} == {("red", "missing")}
    assert any(changed in f.sentence for f in findings)


def test_a_record_of_todays_engine_counts(recorded: Store) -> None:
    before = [row.value for row in rows(recorded)]
    made_by(recorded, f"psutil {version('psutil')}")
    found, notes = rows_and_notes(recorded, ("toys",))
    assert [row.value for row in found] == before
    assert notes == ()
    assert current_runs(recorded.read()).find("strip", "toy", {}, 0) is not None


def test_a_record_of_an_absent_engine_is_shown_and_no_gate_takes_it(recorded: Store) -> None:
    before = [row.value for row in rows(recorded)]
    made_by(recorded, "no-such-engine 1.0")
    found, notes = rows_and_notes(recorded, ("toys",))
    assert [row.value for row in found] == before
    assert notes == (
        "no-such-engine, the engine of solver 'toy', is not installed: 1 stored run is shown as recorded, and no gate "
        "takes them",
    )
    findings = [f for f in gate(recorded, None, Scope(suites=("toys",))).accuracy if f.row.solver == "toy"]
    assert {(f.colour, f.row.status) for f in findings} == {("red", "missing")}


@pytest.mark.usefixtures("toys")
def test_the_newest_record_is_the_last_whatever_the_clock_said(store: Store) -> None:
    """A record stamped with a time to come does not beat what is made after it; so for tables and exports."""
    (early,) = run_here(store, "strip", solver="toy")
    changed(store, early, created="2999-01-01T00:00:00+00:00")
    (fresh,) = run_here(store, "strip", solver="toy", force=True)
    assert [run.record.run_id for run in current_runs(store.read()).runs] == [fresh.run_id]
    for seed in (0, 1):
        (noisy,) = run_here(store, "strip", solver="toy-noisy", seeds=(seed,))
        if seed == 0:
            changed(store, noisy, created="2999-01-01T00:00:00+00:00")
    assert stored_run(store, "strip", "toy-noisy", None).record.identity.seed == 1


def test_of_two_sources_the_last_made_counts_whatever_the_clock_said(recorded: Store, plugin: Path) -> None:
    (old,) = recorded.read().records
    changed(recorded, old, created="2999-01-01T00:00:00+00:00")
    edit(plugin / "toy_shells" / "strip.py", "24", "25")
    (new,) = run_here(recorded, "strip", solver="toy")
    uninstall(plugin)
    assert [run.record.run_id for run in current_runs(recorded.read()).runs] == [new.run_id]
