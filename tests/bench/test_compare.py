"""Rows say what a record is worth, and to whom it is compared."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.compare import Row, as_json, row_of, rows, with_mutual_differences
from shellbench.bench.store.current import current_runs
from shellbench.bench.store.store import Store
from shellbench.errors import InputError
from shellbench.problem import Quantity
from tests.bench import strip
from tests.bench.conftest import forget, tolerances_of
from tests.bench.running import run

CONTRACT = (
    *("case", "suite", "solver", "settings", "seed", "quantity", "primary", "at", "value"),
    *("reference", "reference_uncertainty", "reference_theory", "reference_source", "literature"),
    *("relative_error", "absolute_error", "tolerance", "passed", "status"),
    *("seconds", "peak_memory_bytes", "parameters", "storage_bytes", "run_id"),
)

pytestmark = pytest.mark.usefixtures("toys")


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    forget()


def only(found: list[Row], **wanted: object) -> Row:
    matching = [row for row in found if all(getattr(row, key) == value for key, value in wanted.items())]
    assert len(matching) == 1, f"{len(matching)} rows are {wanted}"
    return matching[0]


def test_json_has_the_keys_of_the_contract(full: Store) -> None:
    objects = json.loads(as_json(rows(full)))
    assert len(objects) == 5 * 3
    assert all(set(CONTRACT) <= set(one) for one in objects)
    identities = {
        (o["case"], o["solver"], json.dumps(o["settings"]), o["seed"], o["quantity"], o["at"]) for o in objects
    }
    assert len(identities) == len(objects)
    assert {o["seed"] for o in objects if o["solver"] == "toy"} == {None}
    assert {o["seed"] for o in objects if o["solver"] == "toy-noisy"} == {0, 1, 2}
    assert {o["quantity"] for o in objects if o["primary"]} == {"centre"}


def test_errors_are_signed_and_relative_to_the_judge(store: Store) -> None:
    run(store, "strip", solvers=("toy",), settings={"toy": {"factor": 0.9}})
    row = only(rows(store), quantity="centre")
    assert row.reference == strip.CENTRE
    assert row.relative_error == pytest.approx(-0.1)
    assert row.absolute_error == pytest.approx(-0.1 * strip.CENTRE)
    assert (row.literature, row.reference_theory) == (0.00625, "kirchhoff-love-linear")


def test_a_default_run_is_judged_at_the_frozen_tolerance(recorded: Store) -> None:
    row = only(rows(recorded), quantity="centre")
    assert (row.passed, row.tolerance, row.suite, row.declared) == (True, 1e-9, "toys", True)
    edit(catalog.data_folder("references") / "strip.toml", repr(strip.CENTRE), repr(strip.CENTRE * (1 + 2e-9)))
    row = only(rows(recorded), quantity="centre")
    assert row.passed is False
    assert row.reason is not None
    assert "1e-09 is allowed" in row.reason


def test_near_zero_the_error_is_absolute(recorded: Store) -> None:
    row = only(rows(recorded), quantity="membrane")
    assert (row.relative_error, row.absolute_error, row.tolerance_is_absolute, row.passed) == (None, 0.0, True, True)


@pytest.mark.parametrize(
    ("diagnostics", "converged"),
    [
        ({}, [None, None]),
        ({"converged": False}, [False, False]),
        ({"converged": False, "not_converged": []}, [False, False]),
        ({"converged": False, "not_converged": ["energy"]}, [True, False]),
        ({"converged": True, "not_converged": []}, [True, True]),
        ({"converged": True, "not_converged": 1}, [True, True]),
    ],
)
def test_what_did_not_converge_is_named_where_a_solver_names_it(recorded, diagnostics, converged) -> None:
    (run,) = current_runs(recorded.read()).runs
    run = replace(run, record=run.record.model_copy(update={"diagnostics": diagnostics}))
    quantities = [run.case.quantity(name) for name in ("centre", "energy")]
    assert [row_of(run, quantity).converged for quantity in quantities] == converged


def test_an_ungated_quantity_has_no_verdict(recorded: Store) -> None:
    row = only(rows(recorded), quantity="energy")
    assert (row.passed, row.tolerance, row.reference, row.relative_error) == (None, None, None, None)


def test_other_settings_are_never_gated_and_an_ablation_has_its_label(full: Store) -> None:
    halved = only(rows(full), quantity="centre", default_settings=False)
    assert (halved.passed, halved.label, halved.overrides, halved.published) == (None, "halved", {"factor": 0.5}, 0.003)
    assert halved.relative_error == pytest.approx(-0.5)
    assert only(rows(full), solver="toy", quantity="centre", default_settings=True).published is None


def test_a_value_of_another_theory_does_not_judge(store: Store) -> None:
    edit(catalog.data_folder("references") / "strip.toml", 'theory = "kirchhoff-love-linear"', 'theory = "mixed"')
    run(store, "strip", solvers=("toy",))
    row = only(rows(store), quantity="centre")
    assert (row.reference, row.passed, row.literature_theory) == (None, False, "mixed")
    assert row.reason == "no known value of its theory judges it"


def test_an_open_finding_is_an_expected_failure_and_red_once_it_passes(store: Store) -> None:
    edit(tolerances_of("toy"), "centre = 1e-9", 'centre = { relative = 1e-9, open_finding = "never right" }')
    run(store, "strip", solvers=("toy",))
    row = only(rows(store), quantity="centre")
    assert (row.passed, row.reason) == (False, "it passes, but is an open finding")
    edit(catalog.data_folder("references") / "strip.toml", repr(strip.CENTRE), repr(strip.CENTRE * 1.1))
    row = only(rows(store), quantity="centre")
    assert (row.passed, row.open_finding) == (None, "never right")


def test_a_failed_run_has_its_rows_and_does_not_pass(store: Store, plugin: Path) -> None:
    edit(plugin / "toy_shells" / "solver.py", 'behaviour: Behaviour = "exact"', 'behaviour: Behaviour = "fail"')
    run(store, "strip", solvers=("toy",))
    row = only(rows(store), quantity="centre")
    assert (row.status, row.value, row.passed, row.reason) == ("failed", None, False, "the strip would not converge")


def test_reduced_precision_does_not_pass(store: Store, plugin: Path) -> None:
    edit(plugin / "toy_shells" / "solver.py", '"float32"] = "float64"', '"float32"] = "float32"')
    run(store, "strip", solvers=("toy",))
    row = only(rows(store), quantity="centre")
    assert (row.dtype, row.passed) == ("float32", False)


def test_an_own_case_is_not_judged_by_the_suites_values(recorded: Store, tmp_path: Path) -> None:
    path = tmp_path / "strip.toml"  # the same name, another thickness
    path.write_text(strip.CASE.replace("thickness = 0.1", "thickness = 0.2"), encoding="utf-8")
    run(recorded, str(path), solvers=("toy",))
    row = only(rows(recorded), quantity="centre", own_case=True)
    assert (row.own_case, row.suite, row.reference, row.passed) == (True, None, None, None)
    assert {r.own_case: r.reference for r in rows(recorded) if r.primary} == {True: None, False: strip.CENTRE}


def test_without_a_known_value_solvers_are_held_against_each_other(store: Store, own_case: Path) -> None:
    run(store, str(own_case), solvers=("toy", "toy-noisy"), settings={"toy-noisy": {"noise": 0.0}})
    run(store, str(own_case), solvers=("toy-noisy",), seeds=(0, 1))
    found = [row for row in rows(store) if row.quantity == "centre"]
    exact = only(found, solver="toy")
    assert (exact.disagreement, exact.passed) == (None, None)
    for row in found:
        if row.solver == "toy-noisy" and row.value is not None:
            assert row.disagreement_with == "toy"
            assert row.disagreement == pytest.approx((row.value - strip.CENTRE) / strip.CENTRE, abs=1e-15)


def test_over_what_is_an_error_already_solvers_are_not_held_against_each_other(store, own_case, monkeypatch) -> None:
    run(store, str(own_case), solvers=("toy", "toy-noisy"))
    assert any(row.disagreement for row in rows(store) if row.quantity == "centre")
    monkeypatch.setattr(Quantity, "is_an_error", True)
    assert not any(row.disagreement for row in rows(store))


def test_the_newest_physics_of_an_own_case_counts(store: Store, own_case: Path) -> None:
    run(store, str(own_case), solvers=("toy",))
    edit(own_case, "thickness = 0.1", "thickness = 0.2")
    run(store, str(own_case), solvers=("toy",))
    row = only(rows(store), quantity="centre")
    assert row.value == pytest.approx(strip.CENTRE / 8)
    assert [reason for _, reason in current_runs(store.read()).stale.values()] == ["the case has changed since"]


def test_a_changed_case_or_solver_makes_records_stale(recorded: Store, plugin: Path) -> None:
    case = catalog.data_folder("cases") / "strip.toml"
    edit(case, "thickness = 0.1", "thickness = 0.2")
    assert rows(recorded) == []
    assert current_runs(recorded.read()).notes == ("1 stored run is left out: the case has changed since",)
    edit(case, "thickness = 0.2", "thickness = 0.1")
    assert len(rows(recorded)) == 3
    edit(plugin / "toy_shells" / "strip.py", "24", "25")
    assert rows(recorded) == []
    assert current_runs(recorded.read()).notes == ("1 stored run is left out: the solver has changed since",)


def test_changed_tolerances_judge_old_records(recorded: Store) -> None:
    edit(tolerances_of("toy"), "centre = 1e-9", "centre = 1e-3")
    assert only(rows(recorded), quantity="centre").tolerance == 1e-3


def test_the_newest_record_counts_even_if_it_failed(recorded: Store) -> None:
    run(recorded, "strip", solvers=("toy",), force=True, apart=True, timeout=1e-3)
    assert len(recorded.read().records) == 2
    assert only(rows(recorded), quantity="centre").run_id == recorded.read().records[-1].run_id


def test_suites_narrow(store: Store, own_case: Path) -> None:
    run(store, "strip", str(own_case), solvers=("toy",))
    assert {row.case for row in rows(store)} == {"strip", "own_strip"}
    assert {row.case for row in rows(store, ("toys",))} == {"strip"}
    with pytest.raises(InputError, match="unknown suite"):
        rows(store, ("nothing",))


def test_quantities_stand_in_the_order_of_their_own_case(store: Store) -> None:
    head, *quantities = strip.CASE.split("[[quantities]]")
    turned = "[[quantities]]".join([head, *reversed(quantities)])
    (catalog.data_folder("cases") / "turned.toml").write_text(turned, encoding="utf-8")
    forget()
    run(store, "strip", "turned", solvers=("toy",))
    by_case = {name: [row.quantity for row in rows(store) if row.case == name] for name in ("strip", "turned")}
    assert by_case["strip"] == ["centre", "energy", "membrane"]  # the headline first
    assert by_case["turned"] == ["centre", "membrane", "energy"]


def answer(**given: Any) -> Row:
    """Return one answer of a case that nobody has a known value of."""
    usual = {"case": "own", "suite": None, "settings": {}, "quantity": "centre", "primary": True, "at": None}
    return Row(**{**usual, "solver": "toy", "seed": None, "value": 1.0, "status": "ok", **given})


def test_only_good_answers_to_the_same_question_are_a_yardstick() -> None:
    certain, drawn = answer(value=2.0), answer(solver="toy-noisy", seed=0, value=3.0)
    others = [
        answer(value=9.0, at=0.5),
        answer(value=9.0, quantity="energy"),
        answer(value=9.0, case="another"),
        answer(value=9.0, own_case=True),
        answer(value=9.0, status="failed"),
        answer(value=9.0, default_settings=False),
        answer(value=None),
        answer(value=9.0, solver="toy-noisy", seed=0, reference=2.5),
    ]
    found = with_mutual_differences([*others, certain, drawn])
    assert [(row.disagreement, row.disagreement_with) for row in found[-2:]] == [(None, None), (0.5, "toy")]
    held = {i for i, row in enumerate(found[:-2]) if row.disagreement is not None}
    assert held == set()  # a row of the yardstick's own solver, and one that a known value judges, are not held


def test_several_certain_answers_are_held_against_their_median() -> None:
    found = with_mutual_differences([answer(value=v, solver=name) for v, name in ((1.0, "a"), (2.0, "b"), (4.0, "c"))])
    assert [(row.disagreement, row.disagreement_with) for row in found] == [(g, "median") for g in (-0.5, 0.0, 1.0)]


@pytest.mark.parametrize("reference", [None, 1.0])
def test_each_row_is_looked_at_so_many_times_however_many_there_are(reference: float | None) -> None:
    looks = 0

    class Watched(Row):
        def __getattribute__(self, name: str) -> Any:
            nonlocal looks
            looks += name == "case"
            return super().__getattribute__(name)

    row = answer(reference=reference).model_dump()
    rows = [Watched(**{**row, "solver": "ab"[i % 2], "seed": i}) for i in range(500)]
    looks = 0
    with_mutual_differences(rows)
    assert looks < 10 * len(rows)
