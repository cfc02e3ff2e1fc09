"""A solver that no tolerance is frozen for is judged all the same: by classes, on every figure that a value judges."""

from pathlib import Path

import pytest

from shellbench.bench.catalogue.reference import Tolerance
from shellbench.bench.judge.classes import BLUNT, CLASSES, LOOSEST, grades, judged_by_class
from shellbench.bench.judge.compare import rows
from shellbench.bench.judge.expected import Scope
from shellbench.bench.judge.gate import Verdict, gate
from shellbench.bench.judge.lock import write_lock
from shellbench.bench.judge.row import Row
from shellbench.bench.judge.verdicts import as_text
from shellbench.bench.plugins.registry import find_solver
from shellbench.bench.store.conformance import note_conformance
from shellbench.bench.store.store import Store
from shellbench.errors import InputError
from tests.bench.conftest import forget, tolerances_of
from tests.bench.running import run
from tests.bench.test_gate import scaled


@pytest.fixture
def third_party(full: Store) -> Store:
    """The runs of the toys, of which no tolerance is frozen for `toy-noisy`, which is checked."""
    tolerances_of("toy-noisy").unlink()
    forget()
    write_lock()
    note_conformance(full, find_solver("toy-noisy"), "shell", {}, ())
    return full


def judged(store: Store, *suites: str) -> Verdict:
    return gate(store, None, Scope(suites, ("toy-noisy",)))


def figure(error: float, uncertainty: float = 0.0, reference: float = 2.0, **more: object) -> Row:
    """Return a row of a third-party solver's answer to the plate."""
    about = {"case": "square_plate", "suite": None, "solver": "mine", "settings": {}, "seed": None, "quantity": "q"}
    value = reference * (1 + error)
    found = {"value": value, "reference": reference, "relative_error": error, "absolute_error": value - reference}
    return Row.model_validate(
        about
        | {"primary": True, "at": None, "status": "ok", "unit": "m", "reference_uncertainty": uncertainty}
        | found
        | more
    )


@pytest.mark.parametrize("suites", [(), ("toys",)])
def test_a_third_party_solver_that_is_right_has_a_class(third_party: Store, suites: tuple[str, ...]) -> None:
    verdict = judged(third_party, *suites)
    assert verdict.good()
    (grade,) = verdict.grades
    assert (grade.solver, grade.held, grade.cases) == ("toy-noisy", CLASSES[0], 1)
    assert "class: toy-noisy holds class 0.0001" in as_text(verdict, "none")


@pytest.mark.parametrize(("error", "held"), [(5e-4, 1e-3), (5e-3, 1e-2), (5e-2, None)])
def test_its_worst_figure_decides(third_party: Store, error: float, held: float | None) -> None:
    scaled(third_party, "toy-noisy", 1 + error)
    verdict = judged(third_party)
    assert verdict.grades[0].held == held
    assert verdict.good() == (held is not None)


def test_who_declines_everything_is_not_judged(toys: Path, store: Store) -> None:
    run(store, "strip", solvers=("toy",))
    with pytest.raises(InputError, match="of solver 'falling': it declines every requested case"):
        gate(store, None, Scope(("toys",), ("falling",)))


def test_it_owes_an_answer_to_every_case_of_a_suite_that_is_asked(third_party: Store) -> None:
    """No record is red, and no silence."""
    for record in third_party.read().records:
        if record.identity.solver == "toy-noisy":
            (third_party.folder / f"{record.run_id}.json").unlink()
    verdict = judged(third_party, "toys")
    assert {finding.colour for finding in verdict.accuracy} == {"red"}
    assert verdict.grades[0].held is None


def test_ours_are_not_judged_by_class(full: Store) -> None:
    assert gate(full, None, Scope()).grades == ()
    assert {row.tolerance for row in rows(full) if row.gated} != {LOOSEST}


def test_an_error_within_the_uncertainty_is_held_against_nobody() -> None:
    blunt = figure(0.05, uncertainty=0.05 * 2.0 / BLUNT * 1.01)
    assert judged_by_class(blunt).passed
    assert not judged_by_class(figure(0.05)).passed


def test_an_error_near_zero_is_held_against_the_largest_value_of_its_unit() -> None:
    """The plate's largest known displacement is .4875 m: 1e-2 of it is 4.9 mm."""
    near_zero = {"relative_error": None, "tolerance_is_absolute": True, "reference": 0.0}
    assert judged_by_class(figure(0.0, **near_zero | {"value": 4e-3, "absolute_error": 4e-3})).passed
    assert not judged_by_class(figure(0.0, **near_zero | {"value": 6e-3, "absolute_error": 6e-3})).passed


def test_what_it_declines_is_said_and_not_counted() -> None:
    good, declined = figure(1e-5), figure(0.0, status="declined", value=None, relative_error=None, case="scordelis_lo")
    (grade,) = grades([good, declined], ["mine"], {"mine": ""})
    assert grade.held == CLASSES[0]
    assert str(grade).endswith("it declines scordelis_lo")
    (grade,) = grades([declined], ["mine"], {"mine": ""})
    assert grade.held is None


OPEN = Tolerance(relative=1e-3, open_finding="known to be off")


@pytest.mark.parametrize(
    ("error", "case", "passed"),
    [
        (5e-2, "square_plate", None),  # an expected failure
        (5e-4, "square_plate", False),  # it passes, and so is open no more
        (-2.0, "square_plate", False),  # the other sign: another mistake than the one that is known
        (5e-2, "square_plate@swapped", None),
        (5e-4, "square_plate@swapped", True),  # what is open of a case may be right when it is asked otherwise
        (-2.0, "square_plate@swapped", False),
    ],
)
def test_an_open_finding_explains_an_error_but_no_answer_that_is_worse_than_none(error, case, passed) -> None:
    assert figure(error, case=case).judged(OPEN).passed is passed
