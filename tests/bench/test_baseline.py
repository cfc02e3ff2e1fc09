"""The baseline where a known value is zero, and where a figure has no mark."""

from pathlib import Path

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.reference import KnownValue, KnownValues
from shellbench.bench.judge.baseline import (
    REPEATS,
    Baseline,
    BaselineValue,
    make_baseline,
    read_baseline,
    regression_finding,
)
from shellbench.bench.judge.compare import with_known_values
from shellbench.bench.judge.row import Row
from shellbench.errors import InputError


def row_of(case_name: str, quantity_name: str, value: float | None, known: float | None, solver: str = "fem") -> Row:
    """Return a gated row of a good run."""
    case = catalog.named_case(case_name)
    quantity = case.quantity(quantity_name)
    row = Row(
        case=case_name,
        suite="nonlinear",
        solver=solver,
        settings={},
        seed=None,
        quantity=quantity_name,
        primary=quantity.primary,
        at=quantity.mark,
        value=value,
        status="ok",
        unit=quantity.unit,
        run_id="r",
    )
    judge = KnownValue(
        quantity=quantity_name,
        role="judge",
        value=known or 0.0,
        uncertainty=0.0,
        theory=case.theory,
        origin="formula",
        source="series",
    )
    allowed = catalog.tolerance(case_name, quantity_name, solver)
    assert allowed is not None
    return with_known_values(row, KnownValues(values=(judge,)), case, quantity).judged(allowed)


def remembered(*rows: Row) -> Baseline:
    return make_baseline(rows, [])


@pytest.mark.parametrize(("value", "holds"), [(0.0, True), (9e-7, True), (-9e-7, True), (2e-6, False)])
def test_what_must_be_zero_is_held_to_an_absolute_tolerance(value: float, holds: bool) -> None:
    row = row_of("rigid_rotation", "strain_energy_180", value, 0.0)
    assert row.tolerance_is_absolute
    assert (row.relative_error, row.absolute_error, row.tolerance) == (None, value, 1e-6)
    assert row.passed is holds
    assert holds or "2e-06" in str(row.reason)


def test_a_nonlinear_quantity_is_held_to_a_relative_tolerance() -> None:
    row = row_of("rolled_plate", "bending_energy_90", 1.0 + 2e-6, 1.0)
    assert row.relative_error == pytest.approx(2e-6)
    assert row.passed is False
    assert row_of("rolled_plate", "bending_energy_90", 1.0 + 5e-7, 1.0).passed


def test_rounding_around_zero_is_no_regression() -> None:
    """Use rounding errors of zero, which differ by orders of magnitude between processors."""
    old = remembered(row_of("rigid_rotation", "strain_energy_180", 8e-10, 0.0))
    for value, colour in ((3e-8, "green"), (0.0, "green"), (2e-6, "red")):
        finding = regression_finding(old, row_of("rigid_rotation", "strain_energy_180", value, 0.0))
        assert finding is not None
        assert finding.colour == colour
        assert "J" in finding.sentence


def test_a_baseline_of_exactly_zero_can_be_compared() -> None:
    old = remembered(row_of("rigid_rotation", "strain_energy_180", 0.0, 0.0))
    finding = regression_finding(old, row_of("rigid_rotation", "strain_energy_180", 1e-9, 0.0))
    assert finding is not None
    assert finding.colour == "green"


def test_a_limit_point_is_remembered_without_a_mark() -> None:
    old = remembered(row_of("hinged_roof_thick", "limit_load", 2225.0, 2225.0))
    (value,) = old.values
    assert isinstance(value, BaselineValue)
    assert value.at is None
    again = Baseline.model_validate_json(old.model_dump_json())
    for change, colour in ((0.5 * REPEATS, "green"), (2 * REPEATS, "red")):
        finding = regression_finding(again, row_of("hinged_roof_thick", "limit_load", 2225.0 * (1 + change), 2225.0))
        assert finding is not None
        assert finding.colour == colour


def test_figures_of_several_loads_are_remembered_apart() -> None:
    rows = [
        row_of("rolled_plate", f"bending_energy_{d}", v, v) for d, v in ((45, 1.0), (90, 4.0), (135, 9.0), (180, 16.0))
    ]
    old = remembered(*rows)
    assert {(v.at, v.mean) for v in old.values} == {(0.25, 1.0), (0.5, 4.0), (0.75, 9.0), (1.0, 16.0)}
    assert [old.value(row).mean for row in rows] == [1.0, 4.0, 9.0, 16.0]  # type: ignore[union-attr]


def test_what_values_differ_by_between_processors_is_no_regression() -> None:
    here, there = (row_of("square_plate", "centre_deflection", value, 0.4874823) for value in (0.48748, 0.48749))
    narrow, wide = make_baseline([here], []), make_baseline([here], [], like=[here, there])
    (known,) = wide.values
    assert known.spread == pytest.approx(1e-5)
    assert known.band == pytest.approx(5e-5)

    def colour(old: Baseline, value: float) -> str:
        finding = regression_finding(old, row_of("square_plate", "centre_deflection", value, 0.4874823))
        assert finding is not None
        return finding.colour

    assert (colour(narrow, 0.48749), colour(wide, 0.48749)) == ("red", "green")
    assert colour(wide, 0.48748 + 6e-5) == "red"
    assert make_baseline([here], [], wide).values[0].spread == known.spread, "measured once, it stays"


@pytest.mark.parametrize("device", ["/dev/full", "/dev/zero"])
def test_a_file_that_never_ends_is_no_baseline(device: str) -> None:
    with pytest.raises(InputError, match=f"{device}: it is no regular file, but a device"):
        read_baseline(Path(device))
