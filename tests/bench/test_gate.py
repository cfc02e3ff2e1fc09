"""The gates are green for good records alone, and say what they looked at."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from shellbench import catalog
from shellbench.bench.baseline import DEVIATIONS, REPEATS, Baseline, BaselineValue, read_baseline, write_baseline
from shellbench.bench.gate import Scope, Verdict, gate, move_baseline
from shellbench.bench.store import Store
from shellbench.bench.verdicts import as_text, changes
from shellbench.errors import InputError, ShellbenchError
from tests.bench import strip
from tests.bench.running import run
from tests.bench.test_compare import edit

pytestmark = pytest.mark.usefixtures("toys")
GATED = 2 + 3  # toy: centre and membrane; toy-noisy: centre for three seeds


def colours(verdict: Verdict) -> list[str]:
    return [finding.colour for finding in verdict.accuracy]


def damage(store: Store, solver: str, change: dict[str, object]) -> None:
    """Change what the records of a solver say."""
    for record in store.read().records:
        if record.identity.solver == solver:
            path = store.folder / f"{record.run_id}.json"
            path.write_text(json.dumps(json.loads(path.read_text()) | change), encoding="utf-8")


def scaled(store: Store, solver: str, factor: float) -> None:
    """Scale the values in the records of a solver."""
    for record in store.read().records:
        if record.identity.solver == solver:
            values = {name: {"value": m.value * factor} for name, m in record.values.items()}
            path = store.folder / f"{record.run_id}.json"
            path.write_text(json.dumps(json.loads(path.read_text()) | {"values": values}), encoding="utf-8")


def test_all_good_records_are_green(full: Store) -> None:
    verdict = gate(full, None, Scope())
    assert colours(verdict) == ["green"] * GATED
    assert verdict.good()


def test_missing_records_are_red_each(store: Store) -> None:
    verdict = gate(store, None, Scope())
    assert colours(verdict) == ["red"] * GATED
    assert not verdict.good()
    assert {f.sentence for f in verdict.accuracy} == {"no record"}


def test_one_missing_seed_is_red(full: Store) -> None:
    lost = next(r for r in full.read().records if r.identity.seed == 1)
    (full.folder / f"{lost.run_id}.json").unlink()
    red = [f.row for f in gate(full, None, Scope()).accuracy if f.colour == "red"]
    assert [(row.solver, row.seed, row.status) for row in red] == [("toy-noisy", 1, "missing")]


def test_a_run_with_other_settings_does_not_answer_for_the_default(store: Store) -> None:
    run(store, "strip", solvers=("toy",), settings={"toy": {"factor": 1.0000000001}})
    assert colours(gate(store, None, Scope(solvers=("toy",)))) == ["red", "red"]


def test_a_stale_record_is_red_and_says_why(full: Store, plugin: Path) -> None:
    edit(plugin / "toy_shells" / "strip.py", "24", "24.0")
    sentences = {f.sentence for f in gate(full, None, Scope(solvers=("toy",))).accuracy}
    assert sentences == {"no record that counts: the solver has changed since"}


def test_a_case_that_has_changed_is_red_and_says_so(full: Store) -> None:
    edit(catalog.data_folder("cases") / "strip.toml", "thickness = 0.1", "thickness = 0.2")
    sentences = {f.sentence for f in gate(full, None, Scope(solvers=("toy",))).accuracy}
    assert sentences == {"no record that counts: the case has changed since"}


def test_a_declined_case_is_red_and_says_so(store: Store, plugin: Path) -> None:
    edit(plugin / "toy_shells" / "solver.py", 'case.surface.kind == "plane"', "False")
    findings = gate(store, None, Scope(solvers=("toy",))).accuracy
    assert {(f.row.status, f.sentence) for f in findings} == {
        ("declined", "the solver declines the case: it solves planes only")
    }


@pytest.mark.parametrize(
    "change",
    [
        {"status": "failed", "reason": "it broke"},
        {"status": "timeout", "reason": "stopped after 1 s"},
        {"values": {}},
        {"values": {"centre": {"value": 1e300}, "membrane": {"value": 1.0}}},
        {"values": {"centre": {"value": "NaN"}, "membrane": {"value": "Infinity"}}},
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
    case = catalog.data_folder("cases") / "strip.toml"
    edit(case, "absolute = true", 'absolute = true\nopen_finding = { toy = "membrane locking" }')
    verdict = gate(full, None, Scope(solvers=("toy",)))
    assert colours(verdict) == ["green", "red"]
    assert "open finding" in verdict.accuracy[1].sentence
    edit(catalog.data_folder("references") / "strip.toml", "value = 0.0\n", "value = 1.0\n")
    verdict = gate(full, None, Scope(solvers=("toy",)))
    assert colours(verdict) == ["green", "expected failure"]
    assert verdict.good()
    assert "membrane locking" in as_text(verdict, "baseline")


def test_narrowing_is_said_and_narrows(full: Store) -> None:
    verdict = gate(full, None, Scope(("toys",), ("toy-noisy",), (2,)))
    assert [(f.row.solver, f.row.seed) for f in verdict.accuracy] == [("toy-noisy", 2)]
    text = as_text(verdict, "baseline.json")
    assert "narrowed to suites toys only, solvers toy-noisy only, seeds 2 only" in text
    assert "no baseline baseline.json" in text


def test_alike_rows_are_said_once(store: Store) -> None:
    text = as_text(gate(store, None, Scope()), "baseline")
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
    edit(catalog.data_folder("cases") / "strip.toml", "toy = 1e-9", "toy = 1e-3")
    baseline = move_baseline(full, None, Scope())
    scaled(full, "toy", 1 + change)
    verdict = gate(full, baseline, Scope(solvers=("toy",)))
    assert [f.colour for f in verdict.regression if f.row.primary] == [colour]
    assert {f.colour for f in verdict.accuracy} == {"green"}
    assert verdict.good() == (colour == "green")


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
    edit(catalog.data_folder("cases") / "strip.toml", "toy = 1e-9", "toy = 1e-3")
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


@pytest.mark.parametrize("text", ["", "[]", '{"values": []}', '{"schema_version": 9, "values": [], "costs": []}'])
def test_a_malformed_baseline_is_refused_in_one_sentence(tmp_path: Path, text: str) -> None:
    path = tmp_path / "baseline.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_baseline(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


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
    from shellbench.bench.compare import rows
    from shellbench.bench.gate import missing_rows

    assert missing_rows(store, rows(store)) == []
    run(store, suites=("toys",))
    found = rows(store)
    assert missing_rows(store, found) == []
    (lost, *_) = [row for row in found if row.tolerance is not None]
    for path in store.folder.glob(f"{lost.run_id}*"):
        path.unlink()
    left = [row for row in rows(store) if row.solver == lost.solver and row.seed == lost.seed]
    missing = missing_rows(store, [*rows(store), *([] if left else [lost])])
    assert {(row.case, row.solver, row.status) for row in missing} == {(lost.case, lost.solver, "missing")}
