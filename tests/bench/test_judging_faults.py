"""Right values of what judges everybody: each of them is another one as soon as a single rule is wrong."""

from pathlib import Path

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.reference import KnownValue, KnownValues
from shellbench.bench.judge.calibration import judged_figure
from shellbench.bench.judge.classes import grades
from shellbench.bench.judge.compare import with_known_values
from shellbench.bench.judge.exam import is_judged
from shellbench.bench.judge.row import Row
from shellbench.bench.plugins import source
from shellbench.bench.plugins.registry import SolverEntry
from shellbench.bench.store.identity import current_source
from shellbench.testing.grading import Graded
from tests.bench.test_classes import figure

MINE = {"mine": "", "other": ""}
CENTRE = "centre_deflection"


def held(value: float, known: float, uncertainty: float | None = None) -> Row:
    """Return the row of an answer to the plate, compared with a known value."""
    plate = catalog.named_case("square_plate")
    row = figure(0.0).model_copy(update={"value": value, "relative_error": None, "absolute_error": None})
    about = {"quantity": CENTRE, "role": "judge", "theory": plate.theory, "origin": "made up", "source": "shellbench"}
    judge = KnownValue.model_validate(about | {"value": known, "uncertainty": uncertainty})
    return with_known_values(row, KnownValues(values=(judge,)), plate, plate.quantity(CENTRE))


@pytest.mark.parametrize(("value", "known", "error"), [(4, 2, 1), (1, 2, -0.5), (-4, -2, -1), (2, -2, 2), (0, 2, -1)])
def test_an_error_is_relative_to_the_known_value(value: float, known: float, error: float) -> None:
    row = held(value, known)
    assert (row.relative_error, row.absolute_error) == (pytest.approx(error), pytest.approx(value - known))


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("known", "absolute"), [(2e-9, False), (0.5e-9, True), (1e-3, False), (0.0, True)])
def test_an_error_is_absolute_where_the_known_value_is_within_its_uncertainty_of_zero(
    sign: int, known: float, absolute: bool
) -> None:
    row = held(1.0, sign * known, uncertainty=1e-9)
    assert (row.tolerance_is_absolute, row.relative_error is None) == (absolute, absolute)


def test_a_failed_run_counts_in_the_grade() -> None:
    failed = figure(0.0, status="failed", value=None, relative_error=None, absolute_error=None, case="scordelis_lo")
    (grade,) = grades([figure(1e-5), failed], ["mine"], MINE)
    assert (grade.within, grade.figures, grade.cases) == (None, 2, 2)


def test_a_grade_is_of_its_own_solver_s_rows() -> None:
    found = grades([figure(1e-5), figure(0.5, solver="other")], ["other", "mine"], MINE)
    assert [(grade.solver, grade.within, grade.figures) for grade in found] == [("mine", 1e-4, 1), ("other", None, 1)]


@pytest.mark.parametrize(("share", "within"), [(2.9, 1e-2), (3.1, None), (20.0, None)])
def test_an_error_of_three_uncertainties_says_nothing_and_one_of_more_does(share: float, within: float | None) -> None:
    """Here an uncertainty is 1 % of the known value."""
    (grade,) = grades([figure(share * 1e-2, uncertainty=2e-2)], ["mine"], MINE)
    assert grade.within == (1e-4 if within else None)  # what an uncertain value can't tell holds every class


def test_zero_holds_no_class_however_uncertain_the_known_value_is() -> None:
    (grade,) = grades([figure(-1.0, uncertainty=2.0)], ["mine"], MINE)
    assert grade.within is None


def test_a_known_value_without_uncertainty_has_none() -> None:
    one = judged_figure(figure(1e-3).model_copy(update={"uncertainty": 1e-3, "reference_uncertainty": None}))
    assert one is not None
    assert one.ratio == pytest.approx(2.0)


def test_what_only_the_literature_says_judges_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    plate = catalog.named_case("square_plate")
    assert is_judged(plate)
    quoted = tuple(v.model_copy(update={"role": "literature"}) for v in catalog.known_values(plate.name).values)
    monkeypatch.setattr(catalog, "known_values", lambda _: KnownValues(values=quoted))
    assert not is_judged(plate)


def test_a_grade_that_was_not_given_is_data_too() -> None:
    data = Graded("mine", ("quick",), "why there is none").as_data()
    assert (data["grade"], data["exam"]["worst"], data["exam"]["why"]) == (None, None, "why there is none")


@pytest.mark.parametrize("module", ["shellbench.bench.run.worker", "shellbench.problems.shell.quantities.measure"])
def test_the_source_of_a_solver_counts_what_measures_it(
    module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also of a plug-in, which imports none of it."""
    (tmp_path / "elsewhere.py").write_text("SOLVER = 1\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    entry = SolverEntry("mine", "elsewhere:SOLVER", "mine", "1.0")
    before = current_source(entry)
    changed = tmp_path / "changed.py"
    where = source.locate(module)
    assert where is not None
    changed.write_text(where.read_text(encoding="utf-8") + "\nCHANGED = True\n", encoding="utf-8")
    monkeypatch.setattr(source, "_DIGESTS", {})
    locate = source.locate
    monkeypatch.setattr(source, "locate", lambda name: changed if name == module else locate(name))
    assert current_source(entry) != before
