"""A solver that is wrong with confidence is named, however well its values hold their tolerances."""

import math

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.calibration import ASKED_SHARE, MOST, WITHIN, calibrations, judged_figure
from shellbench.bench.judge.expected import Scope
from shellbench.bench.judge.gate import gate
from shellbench.bench.judge.lock import write_lock
from shellbench.bench.judge.row import Row
from shellbench.bench.judge.verdicts import as_text
from shellbench.bench.store.store import Store
from tests.bench import strip
from tests.bench.conftest import tolerances_of
from tests.bench.test_classes import figure, third_party  # noqa: F401 - a fixture
from tests.bench.test_compare import edit
from tests.bench.test_gate import MOVING, damage, stating

TOYS = Scope(suites=("toys",))


def stated(error: float, uncertainty: float | None, **more: object) -> Row:
    """A figure of 2 that is wrong by a relative error, and says so far."""
    return figure(error).model_copy(update={"uncertainty": uncertainty, "quantity": f"q{error:g}", **more})


def test_the_ratio_is_error_over_what_is_stated_and_what_the_known_value_doubts() -> None:
    one = judged_figure(stated(1e-3, 3e-4, reference_uncertainty=2e-4))
    assert one is not None
    assert one.ratio == pytest.approx(2e-3 / (3e-4 + 2e-4), rel=1e-6)
    assert one.scale == 2.0
    below = judged_figure(stated(-1e-3, 3e-4, reference_uncertainty=2e-4))
    assert below is not None
    assert below.ratio == pytest.approx(one.ratio)


@pytest.mark.parametrize(
    "row",
    [
        stated(1e-3, None),
        stated(1e-3, 1e-3, status="failed"),
        stated(1e-3, 1e-3, default_settings=False),
        stated(1e-3, 1e-3, dtype="float32"),
        stated(1e-3, 1e-3, reference=2.0, absolute_error=None),
    ],
)
def test_what_has_no_known_error_or_states_nothing_has_no_ratio(row: Row) -> None:
    assert judged_figure(row) is None


def test_rounding_is_no_overconfidence() -> None:
    rounding = judged_figure(stated(1e-15, 0.0))
    wrong = judged_figure(stated(1e-9, 0.0))
    assert rounding is not None
    assert wrong is not None
    assert rounding.ratio < 1 < MOST < wrong.ratio


def test_near_zero_rounding_is_that_of_the_largest_value_of_the_unit() -> None:
    largest = max(
        abs(judge.value)
        for q in catalog.named_case("square_plate").quantities
        if q.unit == "J" and (judge := catalog.known_values("square_plate").judge(q.name, "kirchhoff-love-linear"))
    )
    about = {"unit": "J", "reference": 0.0, "relative_error": None, "tolerance_is_absolute": True}
    one = judged_figure(stated(0.0, 0.0, value=1e-14 * largest, absolute_error=1e-14 * largest, **about))
    assert one is not None
    assert one.scale == largest
    assert one.ratio < 1


def test_of_a_user_s_own_zero_nothing_is_known_but_what_is_stated() -> None:
    one = judged_figure(stated(0.0, 0.0, reference=0.0, own_case=True, relative_error=None, absolute_error=1e-9))
    assert one is not None
    assert one.ratio == math.inf


def test_shares_are_those_of_the_figures_and_the_worst_is_named() -> None:
    ratios = [0.5] * 90 + [1.5] * 6 + [3.0] * 4
    rows = [stated(ratio * 1e-4, 2e-4) for ratio in ratios]
    (found,) = calibrations([*rows, stated(0.1, None)])
    assert [found.share(times) for times in (1, WITHIN, MOST)] == [0.9, 0.96, 1.0]
    assert found.silent == 1
    assert found.holds
    assert found.share(WITHIN) >= ASKED_SHARE
    assert str(found) == (
        "mine: 96 % of 100 errors are within 2 times the stated uncertainty (95 % asked);"
        " the worst is 3 times, square_plate q0.0003; it states none of 1 figure"
    )
    (found,) = calibrations([*rows, stated(6e-4, 2e-4)])
    assert not found.holds  # beyond five times once, though the share is there
    (found,) = calibrations(rows[80:])
    assert not found.holds  # the share is not there, though none is beyond five times


def test_a_solver_that_states_nothing_is_neither_good_nor_bad() -> None:
    (found,) = calibrations([stated(1e-3, None)])
    assert found.holds is None
    assert str(found) == "mine states no uncertainty of 1 figure"


def planted(store: Store, error: float = 1e-3) -> None:
    """Wrong by 1e-3, which is allowed, and sure to 1e-6."""
    edit(tolerances_of("toy"), "centre = 1e-9", "centre = 1e-2")
    write_lock()
    stating(store, "toy", 1e-6, error=error)


@pytest.mark.parametrize("error", [1e-3, -1e-3])
def test_a_planted_overconfident_solver_is_named_and_red(toys: object, full: Store, error: float) -> None:
    planted(full, error)
    verdict = gate(full, None, TOYS)
    assert {f.colour for f in verdict.accuracy} == {"green"}
    (found,) = verdict.calibration
    assert (found.colour, found.row.solver, found.row.quantity) == ("red", "toy", "centre")
    assert not verdict.good()
    text = as_text(verdict, "none")
    assert (
        "RED  strip toy centre: its error is 1e+03 times the uncertainties of answer and known value, and 5 is allowed"
        in text
    )
    assert "calibration: toy: 0 % of 1 errors are within 2 times the stated uncertainty (95 % asked)" in text
    assert "a gate fell short" in text


def test_an_answer_that_has_not_settled_is_sure_of_nothing(toys: object, full: Store) -> None:
    planted(full)
    damage(full, "toy", MOVING)
    verdict = gate(full, None, TOYS)
    assert verdict.calibration == ()
    assert {f.colour for f in verdict.accuracy if f.row.solver == "toy"} == {"red"}


def test_an_open_finding_explains_what_is_wrong_with_confidence(toys: object, full: Store) -> None:
    edit(tolerances_of("toy"), "centre = 1e-9", 'centre = { relative = 1e-9, open_finding = "too stiff" }')
    write_lock()
    stating(full, "toy", 1e-6, error=1e-3)
    verdict = gate(full, None, TOYS)
    assert [f.colour for f in verdict.calibration] == ["expected failure"]
    assert verdict.good()


def test_a_third_party_calibration_is_shown_and_judges_nothing(third_party: Store) -> None:  # noqa: F811
    stating(third_party, "toy-noisy", 1e-6, error=1e-3)
    verdict = gate(third_party, None, Scope(("toys",), ("toy-noisy",)))
    assert verdict.calibration == ()
    assert verdict.good()
    assert "calibration: toy-noisy: 0 % of 3 errors" in as_text(verdict, "none")


def test_figures_that_no_gate_judges_count_too(toys: object, full: Store) -> None:
    known = next(one for one in gate(full, None, TOYS).calibrations if one.solver == "toy")
    assert [one.row.quantity for one in known.judged] == ["centre"]
    assert known.silent == 1  # membrane
    assert known.holds
    assert known.judged[0].error == pytest.approx(0.0, abs=1e-12 * strip.CENTRE)
