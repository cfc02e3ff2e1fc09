"""One rule makes tolerances tighter, from what was answered; it makes none wider, and forgets no variant."""

from __future__ import annotations

import pytest

from shellbench.bench.compare import rows
from shellbench.bench.row import Row
from shellbench.bench.store import Store
from shellbench.bench.tighten import main, rewritten, tightened
from tests.bench.conftest import forget, tolerances_of
from tests.bench.test_compare import edit


def row(**changes: object) -> Row:
    """Return the row of an answer that is 2e-7 off and sure to 1e-6, and allowed 1e-3."""
    known: dict[str, object] = {
        "case": "roof",
        "suite": "shells",
        "solver": "fem",
        "settings": {},
        "seed": None,
        "quantity": "sag",
        "primary": True,
        "at": None,
        "value": 2.0 * (1 + 2e-7),
        "reference": 2.0,
        "reference_uncertainty": 1e-12,
        "relative_error": 2e-7,
        "absolute_error": 4e-7,
        "uncertainty": 2e-6,
        "tolerance": 1e-3,
        "status": "ok",
    }
    return Row(**(known | changes))


def allowed(*found: Row, asked: tuple[str, ...] = ("roof",)) -> float | None:
    again = found[0].model_copy(update={"case": "roof@axes"})  # one question alone teaches nothing
    return tightened([*found, again], {"roof": set(asked)}).get(("roof", "sag"))


def test_the_larger_of_ten_errors_and_three_uncertainties_is_rounded_up():
    assert allowed(row()) == 5e-6  # three times 1e-6, as ten times 2e-7 are less
    assert allowed(row(relative_error=-1.3e-6)) == 2e-5
    assert allowed(row(uncertainty=None)) == 2e-6


def test_the_worst_variant_and_seed_count_and_every_variant_has_to_be_there():
    worse = row(case="roof@turned", relative_error=3e-5)
    both = ("roof", "roof@turned")
    assert allowed(row(), worse, asked=both) == 5e-4
    assert allowed(row(seed=0), row(seed=1, relative_error=4e-6)) == 5e-5
    assert allowed(row(), asked=both) is None


def test_one_answer_alone_teaches_nothing():
    assert tightened([row(), row()], {"roof": {"roof"}}) == {}
    assert tightened([row(seed=0), row(seed=1)], {"roof": {"roof"}}) == {("roof", "sag"): 5e-6}


def test_none_becomes_wider():
    assert allowed(row(relative_error=9e-4)) is None
    assert allowed(row(tolerance=5e-6)) is None


@pytest.mark.parametrize(
    "change",
    [{"status": "failed"}, {"status": "not settled"}, {"relative_error": None}, {"relative_error": float("nan")}],
    ids=str,
)
def test_what_failed_teaches_nothing(change):
    assert allowed(row(), row(case="roof@turned", **change), asked=("roof", "roof@turned")) is None


def test_a_known_value_that_is_unsure_and_rounding_bound_it():
    assert allowed(row(reference_uncertainty=3e-5)) == 2e-4  # ten times 1.5e-5
    assert allowed(row(relative_error=0.0, uncertainty=0.0)) == 1e-8


def test_none_is_tighter_than_what_the_solver_aims_at():
    answers = [row(run_id="first"), row(run_id="second", case="roof@turned")]
    assert tightened(answers, {"roof": {"roof"}}, {"second": 4e-5}) == {("roof", "sag"): 5e-5}
    assert tightened(answers, {"roof": {"roof"}}, {"second": 4e-8}) == {("roof", "sag"): 5e-6}


def test_an_absolute_tolerance_stays_absolute():
    near_zero = row(reference=1e-9, relative_error=400.0, unit="", tolerance=1e-3, tolerance_is_absolute=True)
    assert allowed(near_zero) == 1e-5  # ten times 4e-7, three times 2e-6: in the unit


def test_open_findings_count_for_nothing_and_stay():
    open_variant = row(case="roof@warped", relative_error=0.2, open_finding="its mesh is coarse")
    assert allowed(row(), row(case="roof@turned"), open_variant, asked=("roof", "roof@warped")) == 5e-6
    text = "[roof]  # chosen beforehand\nsag = { relative = 1e-3, variants = { warped = 'its mesh' } }  # why\nlift = 1e-3\n"
    assert rewritten(text, {("roof", "sag"): 5e-6}) == text.replace("relative = 1e-3", "relative = 5e-6")
    assert rewritten("[dome]\nsag = 1e-3\n", {("roof", "sag"): 5e-6}) == "[dome]\nsag = 1e-3\n"


def test_the_command_says_what_it_would_do_and_does_it_when_told(full: Store, capsys: pytest.CaptureFixture[str]):
    file = tolerances_of("toy-noisy")
    edit(file, "centre = 1e-6", "centre = 1e-1")
    before = file.read_text(encoding="utf-8")
    assert main(["toy-noisy", str(full.folder)]) == 0
    assert "strip centre: 0.1 relative becomes" in capsys.readouterr().out
    assert file.read_text(encoding="utf-8") == before
    assert main(["toy-noisy", str(full.folder), "--write"]) == 0
    assert file.read_text(encoding="utf-8") != before
    forget()
    judged = [r for r in rows(full) if r.solver == "toy-noisy" and r.quantity == "centre"]
    assert len(judged) == 3
    assert all(r.passed and r.tolerance is not None and r.tolerance < 0.1 for r in judged)


def test_bad_input_is_refused_in_one_sentence(recorded: Store, capsys: pytest.CaptureFixture[str]):
    assert main(["toy"]) == 2
    assert main(["nobody", str(recorded.folder)]) == 2
    assert "solver 'nobody' has no frozen tolerances" in capsys.readouterr().err
