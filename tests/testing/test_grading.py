"""The grade that `check-solver` prints is the gate's own."""

import io
import json
import time
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.exam import is_judged, questions, suites_for
from shellbench.bench.judge.expected import Scope
from shellbench.bench.judge.gate import gate
from shellbench.bench.plugins.registry import find_solver
from shellbench.bench.store.conformance import note_conformance
from shellbench.bench.store.store import Store
from shellbench.errors import InputError
from shellbench.testing import suite
from shellbench.testing.grading import EventBuffer, ExamOptions, Graded, start_exam
from tests.bench.conftest import full, made_once, own_case, plugin, store, toys  # noqa: F401 - fixtures
from tests.bench.test_classes import third_party  # noqa: F401 - a fixture
from tests.bench.test_gate import scaled
from tests.patience import GUARD


def held(store: Store, solver: str = "toy-noisy", **more: object) -> Graded:  # noqa: F811
    with start_exam(solver, (), ("toys",), ExamOptions(("toys",), store.folder, jobs=1), 60.0) as grade:
        return grade(Console(file=io.StringIO()))


@pytest.mark.parametrize("error", [0.0, 5e-4, 5e-3, 5e-2])
def test_it_is_the_grade_of_the_gate(third_party: Store, error: float) -> None:  # noqa: F811
    scaled(third_party, "toy-noisy", 1 + error)
    (by_gate,) = gate(third_party, None, Scope(("toys",), ("toy-noisy",), (0,))).grades
    found = held(third_party)
    assert found.sitting is not None
    assert found.sitting.records == 0  # what has a record is not solved again
    assert (found.held, found.sitting.grade.figures) == (by_gate.held, by_gate.figures)
    assert found.fell_short == (by_gate.held is None)
    first = next(found.lines())
    assert first.startswith("no grade" if by_gate.held is None else f"grade {by_gate.held:g} ")
    assert found.as_data()["grade"] == by_gate.held


def test_what_is_missed_is_named(third_party: Store) -> None:  # noqa: F811
    scaled(third_party, "toy-noisy", 1.05)
    found = held(third_party)
    assert found.sitting is not None
    assert len(found.as_data()["exam"]["missed"]) == len(found.sitting.missed) > 0
    assert any("misses strip" in line and "0.01 is allowed" in line for line in found.lines())


def test_ours_is_graded_too_and_its_class_is_no_verdict(full: Store) -> None:  # noqa: F811
    note_conformance(full, find_solver("toy"), "shell", {}, ())
    assert held(full, "toy").held == 1e-4
    scaled(full, "toy", 1.05)
    found = held(full, "toy")
    assert found.held is None
    assert not found.fell_short  # a tolerance is frozen for it, and the gate holds it to that


def test_who_declines_everything_has_no_grade(toys: Path, store: Store, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    found = held(store, "falling")
    assert (found.held, found.as_data()["grade"], found.judged_nothing) == (None, None, True)
    assert next(found.lines()) == "no grade (suite toys): it declines every case that was asked"
    monkeypatch.setattr(suite, "examine", lambda *_: iter(()))
    out = io.StringIO()
    exam = ExamOptions(("toys",), store.folder, 1)
    assert suite.check_solver("falling", as_json=True, console=Console(file=out, width=500), exam=exam) == 2
    assert json.loads(out.getvalue())["grade"] is None


def test_settings_that_differ_are_not_graded(toys: Path, store: Store, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    monkeypatch.setattr(suite, "examine", lambda *_: iter(()))
    out = io.StringIO()
    console, exam = Console(file=out, width=500), ExamOptions(("toys",), store.folder, 1)
    assert suite.check_solver("toy", settings=["toy.factor=2.0"], console=console, exam=exam) == 0
    assert "no grade (suite toys): grades are of default settings" in out.getvalue()
    assert not store.folder.exists()


def test_a_case_of_ones_own_is_judged_by_nothing(own_case: Path, toys: Path) -> None:  # noqa: F811
    renamed = own_case.with_name("strip.toml")
    renamed.write_text(
        own_case.read_text(encoding="utf-8").replace("thickness = 0.1", "thickness = 0.2"), encoding="utf-8"
    )
    assert not is_judged(catalog.find_case(str(renamed)))
    assert is_judged(catalog.named_case("strip"))


def test_an_unknown_suite_is_bad_input(toys: Path) -> None:  # noqa: F811
    with pytest.raises(InputError, match="unknown suite"):
        questions(("tiys",))
    with pytest.raises(InputError, match="unknown suite"):
        suite.check_solver("toy", exam=ExamOptions(("tiys",), toys / "runs"))  # before any check


def test_who_leaves_before_the_grade_stops_the_exam(toys: Path, store: Store) -> None:  # noqa: F811
    with (
        pytest.raises(InputError, match="refused"),
        start_exam("toy", (), ("toys",), ExamOptions(("toys",), store.folder, jobs=1), 60.0),
    ):
        raise InputError("settings are refused")  # as a check may
    assert not store.read().records  # its one job was taken by the checks


def test_with_two_jobs_the_exam_goes_on_before_somebody_looks(toys: Path, store: Store) -> None:  # noqa: F811
    out = Console(file=io.StringIO())
    with start_exam("toy", (), ("toys",), ExamOptions(("toys",), store.folder, jobs=2), 60.0) as grade:
        last = time.monotonic() + GUARD
        while not store.read().records:  # by the job that the checks leave
            assert time.monotonic() < last
            time.sleep(0.1)
        found = grade(out)
    assert found.sitting is not None
    assert found.sitting.grade.within is not None
    assert found.sitting.records == len(store.read().records)


def test_runs_are_shown_in_order_when_somebody_looks() -> None:
    seen: list[str] = []

    class Looking:
        def started(self, task: str) -> None:
            seen.append(f"began {task}")

        def progressed(self, task: str, progress: str) -> None:
            seen.append(f"{task} {progress}")

        def ended(self, outcome: str) -> None:
            seen.append(f"ended {outcome}")

    later: Any = EventBuffer()
    later.started("one")
    later.progressed("one", "half")
    assert seen == []
    later.show(Looking())
    later.ended("one")
    assert seen == ["began one", "one half", "ended one"]


def test_the_quick_exam_is_part_of_the_whole_and_of_many_kinds() -> None:
    shells = ("kirchhoff-love-linear", "kirchhoff-love-nonlinear")
    quick, whole = (questions(suites_for(shells, quick=short)) for short in (True, False))
    assert {case.name for case in quick} <= {case.name for case in whole}
    assert len(whole) > 90
    asked = {q.kind for case in quick for q in case.quantities}
    assert asked >= {"displacement", "torque", "membrane_energy", "bending_energy", "strain_energy", "field_error"}
    assert {load.kind for case in quick for load in case.loads} >= {"area", "point", "pressure"} - {"gravity"}  # type: ignore[attr-defined]
    assert {case.surface.kind for case in quick} == {"plane", "cylinder", "expression"}  # type: ignore[attr-defined]
    assert {case.theory for case in quick} == {"kirchhoff-love-linear", "kirchhoff-love-nonlinear"}
    assert any("@" in case.name for case in quick)


def test_a_solver_is_graded_by_the_suites_of_its_kind() -> None:
    assert suites_for(("rigid-links",), quick=False) == suites_for(("rigid-links",), quick=True) == ("rope",)
    assert "rope" not in suites_for(("kirchhoff-love-linear",), quick=False)
    assert set(suites_for(("rigid-links", "kirchhoff-love-linear"), quick=True)) == {"quick", "rope"}
