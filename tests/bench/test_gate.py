"""The gates are green for good records alone, and say what they looked at."""

from pathlib import Path
from typing import Any

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.baseline import DEVIATIONS, REPEATS, Baseline, BaselineValue, read_baseline, write_baseline
from shellbench.bench.judge.compare import rows
from shellbench.bench.judge.expected import Scope
from shellbench.bench.judge.gate import Verdict, gate, missing_rows, move_baseline
from shellbench.bench.judge.lock import write_lock
from shellbench.bench.judge.verdicts import as_text, changes
from shellbench.bench.run.plan import Request, make_plan
from shellbench.bench.store.planned import FOLDER, note_planned
from shellbench.bench.store.store import Store
from shellbench.errors import InputError, ShellbenchError
from tests.bench import strip
from tests.bench.conftest import tolerances_of
from tests.bench.running import changed, run
from tests.bench.test_compare import edit

pytestmark = pytest.mark.usefixtures("toys")
GATED = 2 + 3  # toy: centre and membrane; toy-noisy: centre for three seeds


def colours(verdict: Verdict) -> list[str]:
    return [finding.colour for finding in verdict.accuracy]


def damage(store: Store, solver: str, change: dict[str, object]) -> None:
    """Change what the records of a solver say."""
    for record in store.read().records:
        if record.identity.solver == solver:
            changed(store, record, **change)


def scaled(store: Store, solver: str, factor: float) -> None:
    """Scale the values in the records of a solver."""
    for record in store.read().records:
        if record.identity.solver == solver:
            values = {name: {"value": m.value * factor} for name, m in record.values.items()}
            changed(store, record, values=values)


def test_all_good_records_are_green(full: Store) -> None:
    verdict = gate(full, None, Scope())
    assert colours(verdict) == ["green"] * GATED
    assert verdict.good()


def test_a_gated_quantity_that_is_declined_is_red(full: Store) -> None:
    for record in full.read().records:
        values = {name: m for name, m in record.values.items() if name != "centre"}
        changed(full, record, values=values, declined={"centre": "it knows no centre"})
    verdict = gate(full, None, Scope())
    found = {f.row.quantity: (f.colour, f.row.status, f.row.reason) for f in verdict.accuracy}
    assert found["centre"] == ("red", "declined", "the solver declines the quantity: it knows no centre")
    assert found["membrane"][0] == "green"


TOYS = Scope(suites=("toys",))


def widen() -> None:
    """Allow a toy more, and move the lock."""
    edit(tolerances_of("toy"), "centre = 1e-9", "centre = 1e-3")
    write_lock()


@pytest.fixture
def halved(toys: Path, store: Store) -> Store:
    """A store with one run, which no gate judges."""
    run(store, "strip", solvers=("toy",), settings={"toy": {"factor": 0.5}})
    return store


def test_missing_records_of_a_named_suite_are_red_each(halved: Store) -> None:
    verdict = gate(halved, None, TOYS)
    assert colours(verdict) == ["red"] * GATED
    assert not verdict.good()
    assert {f.sentence for f in verdict.accuracy} == {"no record"}


@pytest.mark.parametrize("scope", [Scope(), TOYS])
def test_a_store_without_runs_is_bad_input(store: Store, scope: Scope) -> None:
    with pytest.raises(InputError, match="is not there"):
        gate(store, None, scope)
    store.folder.mkdir()
    with pytest.raises(InputError, match="is empty"):
        gate(store, None, scope)


def test_without_a_suite_what_was_run_is_judged(store: Store) -> None:
    run(store, "strip", solvers=("toy-noisy",), seeds=(1, 7))
    verdict = gate(store, None, Scope())
    assert [(f.row.solver, f.row.seed, f.colour) for f in verdict.accuracy] == [
        ("toy-noisy", 1, "green"),
        ("toy-noisy", 7, "green"),
    ]
    assert "Left out: 4 other runs of suite 'toys'" in verdict.beyond  # seed 7 is none that it declares


@pytest.mark.parametrize(
    "scope",
    [
        Scope(solvers=("toy-noisy",)),
        Scope(solvers=("toy", "toy-noisy")),
        Scope(solvers=("falling",)),
        Scope(solvers=("toy-noisy",), seeds=(3,)),
    ],
    ids=lambda scope: scope.narrowed,
)
def test_a_gate_that_judges_nothing_of_what_is_named_is_not_green(store: Store, scope: Scope) -> None:
    run(store, "strip", solvers=("toy",))
    with pytest.raises(InputError, match="nothing was judged"):
        gate(store, None, scope)


def test_a_store_of_runs_that_no_gate_judges_is_not_green(halved: Store) -> None:
    with pytest.raises(InputError, match="nothing was judged"):
        gate(halved, None, Scope())


def planned(store: Store, *cases: str, **more: Any) -> None:
    """Plan runs and make none, as if they had been killed."""
    note_planned(make_plan(Request(cases=cases, **more), store.read()).tasks, store)


def test_what_was_planned_and_did_not_end_is_red_until_it_has(store: Store) -> None:
    planned(store, suites=("toys",))
    red = gate(store, None, Scope()).accuracy
    assert {f.colour for f in red} == {"red"}
    assert {(f.row.solver, f.row.label, f.row.seed) for f in red} == {
        ("toy", "", None),
        ("toy", "halved", None),
        ("toy-noisy", "", 0),
        ("toy-noisy", "", 1),
        ("toy-noisy", "", 2),
    }
    assert {(row.status, row.passed) for row in rows(store)} == {("missing", False)}
    run(store, "strip", solvers=("toy",))
    left = gate(store, None, Scope()).accuracy
    assert {(f.row.solver, f.row.label, f.colour) for f in left} == {
        ("toy", "", "green"),
        ("toy", "halved", "red"),
        ("toy-noisy", "", "red"),
    }
    assert len(gate(store, None, TOYS).accuracy) == GATED + 1
    run(store, suites=("toys",))
    assert {f.colour for f in gate(store, None, Scope()).accuracy} == {"green"}


def test_an_own_case_that_was_planned_and_did_not_end_is_red(store: Store, own_case: Path) -> None:
    planned(store, str(own_case), solvers=("toy",))
    (finding,) = gate(store, None, Scope()).accuracy
    assert (finding.row.case, finding.row.own_case, finding.colour) == ("own_strip", True, "red")
    run(store, str(own_case), solvers=("toy",))
    with pytest.raises(InputError, match="nothing was judged: no value is known; `\\[\\[known"):
        gate(store, None, Scope())


def test_runs_that_end_leave_no_plan(store: Store) -> None:
    run(store, "strip", solvers=("toy",), settings={"toy": {"behaviour": "crash"}}, apart=True)
    run(store, "strip", solvers=("toy",), settings={"toy": {"behaviour": "refuse"}}, apart=True)
    assert not (store.folder / FOLDER).exists()


def test_a_plan_that_can_not_be_read_is_said_and_does_no_harm(full: Store) -> None:
    (full.folder / FOLDER).mkdir()
    (full.folder / FOLDER / "x.json").write_text("{", encoding="utf-8")
    verdict = gate(full, None, Scope())
    assert verdict.good()
    assert any("x.json" in words for words in verdict.warnings)


def test_cases_narrow(full: Store, own_case: Path) -> None:
    assert len(gate(full, None, Scope(cases=("strip",))).accuracy) == GATED
    with pytest.raises(InputError, match="own_strip"):
        gate(full, None, Scope(cases=("strip", str(own_case))))
    with pytest.raises(InputError, match="unknown case"):
        gate(full, None, Scope(cases=("nowhere",)))
    with pytest.raises(InputError, match="not in suite"):
        gate(full, None, Scope(cases=(str(own_case),), suites=("toys",)))


def test_regression_counts_when_asked_only(full: Store) -> None:
    widen()
    baseline = move_baseline(full, None, Scope())
    scaled(full, "toy", 1 + 2 * REPEATS)
    verdict = gate(full, baseline, Scope())
    assert verdict.good()
    assert not verdict.good(regression=True)
    text = as_text(verdict, "baseline")
    assert "RED" not in text
    assert "regression (reported only): 1 changed" in text
    assert "every gate holds" in text
    assert "RED  strip toy centre: changed by" in as_text(verdict, "baseline", regression=True)


def test_one_missing_seed_is_red(full: Store) -> None:
    lost = next(r for r in full.read().records if r.identity.seed == 1)
    (full.folder / f"{lost.run_id}.json").unlink()
    red = [f.row for f in gate(full, None, TOYS).accuracy if f.colour == "red"]
    assert [(row.solver, row.seed, row.status) for row in red] == [("toy-noisy", 1, "missing")]


def test_a_run_with_other_settings_does_not_answer_for_the_default(store: Store) -> None:
    run(store, "strip", solvers=("toy",), settings={"toy": {"factor": 1.0000000001}})
    assert colours(gate(store, None, Scope(("toys",), ("toy",)))) == ["red", "red"]


def test_a_stale_record_is_red_and_says_why(full: Store, plugin: Path) -> None:
    edit(plugin / "toy_shells" / "strip.py", "24", "24.0")
    sentences = {f.sentence for f in gate(full, None, Scope(solvers=("toy",))).accuracy}
    assert sentences == {"no record that counts: the solver has changed since"}


def test_a_case_that_has_changed_is_red_and_says_so(full: Store) -> None:
    edit(catalog.data_folder("cases") / "strip.toml", "thickness = 0.1", "thickness = 0.2")
    sentences = {f.sentence for f in gate(full, None, Scope(solvers=("toy",))).accuracy}
    assert sentences == {"no record that counts: the case has changed since"}


def test_a_declined_case_is_red_and_says_so(store: Store, plugin: Path) -> None:
    store.folder.mkdir()
    (store.folder / "no_record.json").write_text("{", encoding="utf-8")
    edit(plugin / "toy_shells" / "solver.py", 'case.surface.kind == "plane"', "False")
    findings = gate(store, None, Scope(("toys",), ("toy",))).accuracy
    assert {(f.row.status, f.sentence) for f in findings} == {
        ("declined", "the solver declines the case: it solves planes only")
    }


def test_a_record_edited_to_pass_is_red(full: Store) -> None:
    """An edited record does not count, so its gated values have no record."""
    changed(full, next(r for r in full.read().records if r.identity.solver == "toy"), status="failed", reason="no")
    for record in full.read().records:
        path = full.folder / f"{record.run_id}.json"
        path.write_text(path.read_text(encoding="utf-8").replace('"status": "failed"', '"status": "ok"'))
    verdict = gate(full, None, Scope(suites=("toys",)))
    assert not verdict.good()
    assert {f.row.status for f in verdict.accuracy if f.row.solver == "toy"} == {"missing"}
    assert any("damaged" in sentence for sentence in verdict.warnings)


@pytest.mark.parametrize(
    "change",
    [
        {"status": "failed", "reason": "it broke"},
        {"status": "timeout", "reason": "stopped after 1 s"},
        {"values": {}},
        {"values": {"centre": {"value": 1e99}, "membrane": {"value": 1.0}}},
    ],
)
def test_bad_records_are_red(full: Store, change: dict[str, object]) -> None:
    damage(full, "toy", change)
    toy = [f.colour for f in gate(full, None, Scope()).accuracy if f.row.solver == "toy"]
    assert toy == ["red", "red"]


def test_a_tolerance_without_a_known_value_is_red(full: Store) -> None:
    (catalog.data_folder("references") / "strip.toml").unlink()
    catalog.known_values.cache_clear()
    assert set(colours(gate(full, None, Scope()))) == {"red"}


def test_expected_failures_are_not_red_but_unexpected_passes_are(full: Store) -> None:
    edit(tolerances_of("toy"), "absolute = 1e-12", 'absolute = 1e-12, open_finding = "membrane locking"')
    verdict = gate(full, None, Scope(solvers=("toy",)))
    assert colours(verdict) == ["green", "red"]
    assert "open finding" in verdict.accuracy[1].sentence
    edit(catalog.data_folder("references") / "strip.toml", "value = 0.0\n", "value = 1.0\n")
    write_lock()
    verdict = gate(full, None, Scope(solvers=("toy",)))
    assert colours(verdict) == ["green", "expected failure"]
    assert verdict.good()
    assert "membrane locking" in as_text(verdict, "baseline")


def stating(store: Store, solver: str, uncertainty: float | None, error: float = 0.0) -> None:
    """Have a solver be wrong by a relative error, and state a relative uncertainty of it."""
    stated = None if uncertainty is None else uncertainty * strip.CENTRE
    centre = {"value": strip.CENTRE * (1 + error), "uncertainty": stated}
    for record in store.read().records:
        if record.identity.solver == solver:
            changed(store, record, values=record.model_dump()["values"] | {"centre": centre})


@pytest.mark.parametrize(("uncertainty", "colour"), [(0.9e-3, "green"), (1.1e-3, "red"), (None, "green")])
def test_an_answer_that_is_less_sure_than_its_tolerance_has_not_passed(
    full: Store, uncertainty: float | None, colour: str
) -> None:
    widen()
    stating(full, "toy", uncertainty)
    (found,) = (f for f in gate(full, None, TOYS).accuracy if f.row.solver == "toy" and f.row.quantity == "centre")
    assert found.colour == colour
    assert ("it is uncertain by 0.0011, and 0.001 is allowed" in found.sentence) == (colour == "red")


MOVING: dict[str, object] = {"status": "not settled", "reason": "centre still moves by 2e-3"}


def test_what_has_not_settled_is_red_however_right_it_is(full: Store) -> None:
    damage(full, "toy", MOVING)
    verdict = gate(full, None, TOYS)
    moving = [finding for finding in verdict.accuracy if finding.row.solver == "toy"]
    assert [finding.colour for finding in moving] == ["red", "red"]
    assert {finding.sentence for finding in moving} == {"it has not settled: centre still moves by 2e-3"}
    (row,) = (finding.row for finding in moving if finding.row.quantity == "centre")
    assert (row.status, row.passed, row.value, row.uncertainty) == ("not settled", False, strip.CENTRE, 1e-12)
    assert not verdict.good()


def test_an_open_finding_may_expect_an_answer_that_has_not_settled(full: Store) -> None:
    edit(tolerances_of("toy"), "centre = 1e-9", 'centre = { relative = 1e-9, open_finding = "too soft" }')
    write_lock()
    scaled(full, "toy", 1 + 1e-10)  # within the tolerance: it is no unexpected pass either
    damage(full, "toy", MOVING)
    found = {f.row.quantity: f.colour for f in gate(full, None, TOYS).accuracy if f.row.solver == "toy"}
    assert found == {"centre": "expected failure", "membrane": "red"}


def test_narrowing_is_said_and_narrows(full: Store) -> None:
    verdict = gate(full, None, Scope(("toys",), ("toy-noisy",), (2,)))
    assert [(f.row.solver, f.row.seed) for f in verdict.accuracy] == [("toy-noisy", 2)]
    text = as_text(verdict, "baseline.json")
    assert "narrowed to suites toys only, solvers toy-noisy only, seeds 2 only" in text
    assert "no baseline baseline.json" in text


def test_alike_rows_are_said_once(halved: Store) -> None:
    text = as_text(gate(halved, None, TOYS), "baseline")
    assert "  RED  strip toy-noisy seed 0, 1, 2 centre: no record\n" in text


def test_unknown_names_are_refused(store: Store) -> None:
    with pytest.raises(InputError, match="unknown solver"):
        gate(store, None, Scope(solvers=("nobody",)))
    with pytest.raises(InputError, match="unknown suite"):
        gate(store, None, Scope(suites=("nothing",)))


def test_the_baseline_remembers_and_repeats(full: Store, tmp_path: Path) -> None:
    baseline = move_baseline(full, None, Scope())
    write_baseline(baseline, tmp_path / "new" / "baseline.json")
    assert read_baseline(tmp_path / "new" / "baseline.json") == baseline
    verdict = gate(full, baseline, Scope())
    assert {f.colour for f in verdict.regression} == {"green"}
    assert len(verdict.regression) == GATED
    assert verdict.good()


@pytest.mark.parametrize(("change", "colour"), [(0.5 * REPEATS, "green"), (2 * REPEATS, "red")])
def test_a_deterministic_value_must_repeat(full: Store, change: float, colour: str) -> None:
    widen()
    baseline = move_baseline(full, None, Scope())
    scaled(full, "toy", 1 + change)
    verdict = gate(full, baseline, Scope(solvers=("toy",)))
    assert [f.colour for f in verdict.regression if f.row.primary] == [colour]
    assert {f.colour for f in verdict.accuracy} == {"green"}
    assert verdict.good(regression=True) == (colour == "green")


def test_a_seeded_value_must_stay_within_its_spread() -> None:
    value = BaselineValue(case="strip", solver="s", quantity="q", at=1.0, values={"0": 0.9, "1": 1.0, "2": 1.1})
    assert value.mean == pytest.approx(1.0)
    assert value.band == pytest.approx(DEVIATIONS * 0.1)
    agreed = value.model_copy(update={"values": {"0": 1.0, "1": 1.0}})
    assert agreed.band == REPEATS


def test_a_bad_answer_is_not_remembered(full: Store) -> None:
    scaled(full, "toy", 2.0)
    with pytest.raises(ShellbenchError, match="the baseline is not moved, for 1 of 5 gated rows are red"):
        move_baseline(full, None, Scope())


def test_moving_the_baseline_of_one_solver_leaves_the_others(full: Store) -> None:
    old = move_baseline(full, None, Scope())
    widen()
    scaled(full, "toy", 1 + 1e-5)
    new = move_baseline(full, old, Scope(solvers=("toy",)))
    assert [v for v in new.values if v.solver == "toy-noisy"] == [v for v in old.values if v.solver == "toy-noisy"]
    assert "changed  strip toy centre" in changes(old, new)
    assert "1 of 3 values change" in changes(old, new)
    assert len(new.costs) == len(old.costs) == 2


def test_cost_counts_when_asked_only_and_on_like_hardware_only(full: Store) -> None:
    baseline = move_baseline(full, None, Scope())
    damage(full, "toy", {"seconds": 1000.0})
    verdict = gate(full, baseline, Scope())
    assert verdict.good()
    assert not verdict.good(cost=True)
    assert len(verdict.cost) == 2  # the quickest of three seeds counts
    elsewhere = baseline.model_copy(
        update={"costs": tuple(cost.model_copy(update={"processor": "another"}) for cost in baseline.costs)}
    )
    verdict = gate(full, elsewhere, Scope())
    assert {f.colour for f in verdict.cost} == {"not compared"}
    assert verdict.good(cost=True)


def test_no_baseline_is_no_error(tmp_path: Path) -> None:
    assert read_baseline(tmp_path / "none.json") is None
    assert Baseline(values=(), costs=()).values == ()


def test_expected_energy_is_the_work_of_the_load() -> None:
    """The strip's own figures agree: W = 1/2 int q w dx, by a fine midpoint sum."""
    n = 4000
    x = [(i + 0.5) * strip.LENGTH / n for i in range(n)]
    w = [strip.LOAD * s * (strip.LENGTH**3 - 2 * strip.LENGTH * s**2 + s**3) / (24 * strip.STIFFNESS) for s in x]
    assert sum(w) * strip.LENGTH / n * strip.LOAD / 2 == pytest.approx(strip.ENERGY, rel=1e-6)


def test_what_is_missing_of_a_begun_suite_is_shown(toys, store):
    run(store, suites=("toys",))
    found = rows(store)
    assert missing_rows(store, found) == []
    assert missing_rows(store, found, ("toys",)) == []
    (lost, *_) = [row for row in found if row.tolerance is not None]
    for path in store.folder.glob(f"{lost.run_id}*"):
        path.unlink()
    left = [row for row in rows(store) if row.solver == lost.solver and row.seed == lost.seed]
    missing = missing_rows(store, [*rows(store), *([] if left else [lost])], ("toys",))
    assert {(row.case, row.solver, row.status) for row in missing} == {(lost.case, lost.solver, "missing")}
