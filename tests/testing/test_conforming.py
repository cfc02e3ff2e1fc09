"""A class needs more than right values: a solver that looks them up holds none, and is found out."""

import importlib
import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.expected import Scope
from shellbench.bench.judge.gate import Verdict, gate
from shellbench.bench.judge.lock import write_lock
from shellbench.bench.judge.verdicts import as_text
from shellbench.bench.plugins.registry import SolverEntry, find_solver
from shellbench.bench.store.conformance import FOLDER, note_conformance, read_conformance
from shellbench.bench.store.current import current_runs
from shellbench.bench.store.pack import read_pack, write_pack
from shellbench.bench.store.store import Store
from shellbench.problem import Problem
from shellbench.testing import suite
from shellbench.testing.between import POINTS, between_points
from shellbench.testing.conforming import OF_FIELD, Line, needed_checks, store_results, unmet_checks
from shellbench.testing.examination import Verdict as Outcome
from shellbench.testing.grading import ExamOptions
from shellbench.testing.suite import CheckOptions, examine
from tests.bench.conftest import forget, full, made_once, own_case, plugin, store, tolerances_of, toys  # noqa: F401
from tests.bench.running import run
from tests.bench.test_classes import third_party  # noqa: F401 - a fixture
from tests.bench.test_known_in_files import known
from tests.testing.test_suite import InProcess

SHELL = "shell"
ROOT = Path(__file__).parents[2]


@pytest.fixture
def cheated(toys: Path, plugin: Path, store: Store) -> Store:  # noqa: F811
    """The run of a solver that reads the known values."""
    (points,) = plugin.glob("*.dist-info/entry_points.txt")
    points.write_text(points.read_text(encoding="utf-8") + "cheat = tests.testing.cheat:CheatSolver\n", "utf-8")
    run(store, "strip", solvers=("cheat",))
    return store


def judged(store: Store, solver: str) -> Verdict:  # noqa: F811
    return gate(store, None, Scope((), (solver,)))


def test_a_cheat_has_right_values_and_no_class(cheated: Store) -> None:
    verdict = judged(cheated, "cheat")
    (grade,) = verdict.grades
    assert {finding.colour for finding in verdict.accuracy} == {"green"}
    assert (grade.within, grade.held) == (1e-4, None)
    assert not verdict.good()
    said = "class: cheat is not checked and holds no class, though its 1 figures of 1 case are within 0.0001: no checks"
    assert said in as_text(verdict, "none")
    assert "a gate fell short" in as_text(verdict, "none")


def checked(entry: SolverEntry, case: Problem) -> list[Line]:
    return list(examine(entry, CheckOptions((case,), checks=OF_FIELD), start=lambda: InProcess(entry)))


def test_check_solver_finds_the_cheat_out() -> None:
    lines = checked(SolverEntry("cheat", "tests.testing.cheat:CheatSolver", "", ""), catalog.named_case("square_plate"))
    assert {line.check for line in lines if line.needed} == set(OF_FIELD)
    by_check = {line.check: line.verdict.status for line in lines}
    assert (by_check["continuity"], by_check["energies"], by_check["work"]) == ("not shown", "failed", "failed")


def test_the_gate_says_which_check_is_not_passed(cheated: Store) -> None:
    store_results(cheated, entry := find_solver("cheat"), checked(entry, catalog.named_case("strip")))
    (grade,) = judged(cheated, "cheat").grades
    assert (grade.held, grade.unchecked.partition(":")[0]) == (None, "its check 'continuity' is not passed")


def test_its_field_between_the_points_is_shown_beside_another(cheated: Store) -> None:
    answers = current_runs(cheated.read()).runs
    between = between_points(find_solver("cheat"), answers, cheated.folder, InProcess)
    assert between is not None
    (one,) = between.found
    assert (one.case, one.largest) == ("strip", 1.0)  # it is zero there
    assert one.at
    assert str(POINTS) in next(between.lines())


def test_a_right_field_is_near_the_other_one_at_points_of_its_own(full: Store) -> None:  # noqa: F811
    runs = [r for r in current_runs(full.read()).runs if r.record.identity.solver == "toy-noisy"]
    one, other = (between_points(find_solver("toy-noisy"), [r], full.folder, InProcess) for r in runs[:2])
    assert one is not None
    assert other is not None
    assert 0 < one.found[0].largest < 1e-3
    assert not np.allclose(one.found[0].at, other.found[0].at)


def lines_of(**status: str) -> list[Line]:
    return [
        Line(check, "strip", Outcome(status.get(check, "passed"), "so it is"), SHELL, check in OF_FIELD)  # type: ignore[arg-type]
        for check in (*OF_FIELD, "storage")
    ]


@pytest.mark.parametrize("check", OF_FIELD)
@pytest.mark.parametrize("status", ["failed", "not shown", "not applicable"])
def test_each_check_of_a_field_is_needed(check: str, status: str) -> None:
    (why,) = unmet_checks(lines_of(**{check: status}))
    assert f"'{check}'" in why
    assert unmet_checks([*lines_of(**{check: status}), *lines_of()]) == ((why,) if status == "failed" else ())


def test_what_is_no_check_of_a_field_is_not_needed() -> None:
    assert unmet_checks(lines_of(storage="failed")) == ()
    assert needed_checks(SHELL, ["kirchhoff-love-linear"]) == OF_FIELD
    assert set(needed_checks(SHELL, ["kirchhoff-love-nonlinear"])) == {"continuity", "energies", "placement"}


def test_it_counts_for_the_source_that_was_checked_only(third_party: Store) -> None:  # noqa: F811
    assert judged(third_party, "toy-noisy").good()
    (path,) = (third_party.folder / FOLDER).glob("*.json")
    whole = path.read_text(encoding="utf-8")
    source = json.loads(whole)["source"]
    path.write_text(whole.replace(source, "0" * 64), encoding="utf-8")  # not as it was sealed
    verdict = judged(third_party, "toy-noisy")
    assert not verdict.good()
    assert any(str(path) in words for words in verdict.warnings)
    path.write_text(whole.replace('"lacking": []', '"lacking": ["x"]'), encoding="utf-8")
    assert read_conformance(third_party).found == ()


def test_a_case_of_ones_own_is_judged_by_its_file_and_not_by_class(toys: Path, store: Store, own_case: Path) -> None:  # noqa: F811
    tolerances_of("toy-noisy").unlink()
    forget()
    write_lock()
    path = known(own_case)
    run(store, path, solvers=("toy-noisy",))
    verdict = gate(store, None, Scope(cases=(path,)))
    assert verdict.grades == ()
    assert verdict.good()


def test_a_changed_solver_is_not_checked_any_more(third_party: Store, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    with monkeypatch.context() as patch:
        patch.setattr("shellbench.bench.store.conformance.current_source", lambda *_: "0" * 64)
        note_conformance(third_party, find_solver("toy-noisy"), SHELL, {}, ())
    (grade,) = judged(third_party, "toy-noisy").grades
    assert grade.unchecked == "its source has changed since it was checked"


def test_a_pack_takes_it_along(third_party: Store, tmp_path: Path) -> None:  # noqa: F811
    manifest, notes = write_pack(third_party, "toy-noisy", tmp_path / "one.zip")
    assert [one.solver for one in manifest.conformance] == ["toy-noisy"]
    assert not any("not checked" in words for words in notes)
    assert read_pack(tmp_path / "one.zip").unchecked == ""
    for path in (third_party.folder / FOLDER).iterdir():
        path.unlink()
    manifest, notes = write_pack(third_party, "toy-noisy", tmp_path / "two.zip")
    assert manifest.conformance == ()
    assert any(words.startswith("not checked: no checks are known of it") for words in notes)
    assert read_pack(tmp_path / "two.zip").unchecked


def test_the_command_keeps_what_it_finds(third_party: Store, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    for path in (third_party.folder / FOLDER).iterdir():
        path.unlink()
    found = lines_of()
    monkeypatch.setattr(suite, "examine", lambda *_: iter(found))
    exam = ExamOptions(None, third_party.folder, 1, grade=False)
    out = Console(file=io.StringIO())
    assert suite.check_solver("toy-noisy", console=out, exam=exam, settings=["toy-noisy.noise=0.0"]) == 0
    assert read_conformance(third_party).found == ()  # these are no default settings
    assert suite.check_solver("toy-noisy", console=out, exam=exam) == 0
    assert judged(third_party, "toy-noisy").good()
    found[:] = lines_of(work="failed")
    assert suite.check_solver("toy-noisy", console=out, exam=exam) == 1
    assert not judged(third_party, "toy-noisy").good()


@pytest.mark.parametrize("lost", [False, True])
def test_a_solver_of_flat_plates_is_asked_for_its_plate_elsewhere(lost: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """It declines the turned plate. One that does not know where its plate begins fails."""
    monkeypatch.syspath_prepend(str(ROOT / "examples/solver_template/src"))
    case, entry = (
        catalog.named_case("square_plate"),
        SolverEntry("plate", "plate_series.solver:PlateSeriesSolver", "", ""),
    )
    if lost:
        reading = importlib.import_module("plate_series.reading").plate_of
        solution = importlib.import_module("plate_series.solution")
        solver = importlib.import_module("plate_series.solver")
        for module in (solution, solver):
            if hasattr(module, "plate_of"):
                monkeypatch.setattr(module, "plate_of", lambda case: replace(reading(case), lower=(0.0, 0.0)))
    lines = examine(entry, CheckOptions((case,), checks=("placement",)), start=lambda: InProcess(entry))
    (verdict,) = [line.verdict for line in lines if line.check == "placement"]
    assert verdict.status == ("failed" if lost else "passed")
    assert "along its plane" in verdict.words
