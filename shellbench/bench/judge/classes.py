"""Classes of accuracy, by which third-party solvers, which have no frozen tolerances, are judged.

Every value with a known value counts, not only the values that are gated for built-in solvers. The loosest class is the
gate. The solver's grade is the tightest class that all values reach. It requires that the solver has passed the checks
of conformance (`shellbench.bench.store.conformance`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.reference import Tolerance
from shellbench.bench.judge.row import Row
from shellbench.bench.plugins.registry import SolverEntry, given_as, solver_entries
from shellbench.problem import VARIANT, Problem

CLASSES = (1e-4, 1e-3, 1e-2)  # relative errors, the tightest first
LOOSEST = CLASSES[-1]
BLUNT = 3.0  # an error within this many uncertainties of the known value does not count
BLUNTEST = 0.99  # relative: the answer zero must get no class, however uncertain the known value is
OWN = "shellbench"  # the distribution of the built-in solvers
MOST_NAMED = 8  # number of declined cases that a sentence lists


@dataclass(frozen=True)
class Grade:
    """The accuracy class of a third-party solver.

    Attributes
    ----------
    solver
        Its name.
    within
        The tightest class that all its values reach; None if they miss even the loosest.
    figures, cases
        Numbers of judged values and cases, variants included.
    worst
        The row that is farthest from its known value, by classes; None if every value is missing.
    declined
        Cases that the solver declines.
    lacking
        Names of quantities that it declines in cases that it answers.
    on
        " on displacements" if it declines other quantities, and only displacements were judged.
    unchecked
        Reason why the solver is not checked, as a clause; empty if it is checked. An unchecked solver gets no class.
    """

    solver: str
    within: float | None
    figures: int
    cases: int
    worst: Row | None
    declined: tuple[str, ...]
    unchecked: str = ""
    lacking: tuple[str, ...] = ()
    on: str = ""

    @property
    def held(self) -> float | None:
        """The solver's class; None if it reaches none, or is not checked."""
        return None if self.unchecked else self.within

    def __str__(self) -> str:
        what = f"{self.figures} figures of {self.cases} {'case' if self.cases == 1 else 'cases'}"
        held = f"class {self.held:g}{self.on} in all {what}" if self.held else "no class"
        words = f"{self.solver} holds {held}"
        if self.unchecked:
            within = f", though its {what} are within {self.within:g}" if self.within else ""
            why = f"{self.unchecked} (`shellbench check-solver {given_as(self.solver)}` makes the checks)"
            words = f"{self.solver} is not checked and holds no class{within}: {why}"
        if self.worst is not None and self.worst.judged_error is not None:
            unit = f" {self.worst.unit}" if self.worst.tolerance_is_absolute else ""
            words += f"; its worst is {self.worst.case} {self.worst.quantity}, {self.worst.judged_error:+.1e}{unit}"
        for declined in (self.lacking, self.declined):
            few = len(declined) <= MOST_NAMED
            words += f"; it declines {', '.join(declined) if few else f'{len(declined)} others'}" if declined else ""
        return words


def third_party_solvers(named: Iterable[str]) -> set[str]:
    """Return the solvers without tolerances that are judged by class: those of other distributions, and named ones."""
    frozen = catalog.tolerances().keys()
    others = {name for name, entry in solver_entries().items() if _is_foreign(entry)}
    return (others | set(named)) - frozen


def _is_foreign(entry: SolverEntry) -> bool:
    return entry.distribution != OWN


def judged_by_class(row: Row) -> Row:
    """Return a third-party solver's row with its verdict; unchanged if no known value judges it."""
    allowed = _allowed(row, LOOSEST)
    return row if allowed is None else row.judged(allowed)


def _allowed(row: Row, size: float) -> Tolerance | None:
    """Return the largest error of a class, relative to the known value; near zero, to the largest one of its unit."""
    if row.reference is None:
        return None
    blunt = BLUNT * (row.reference_uncertainty or 0.0)
    if not row.tolerance_is_absolute:
        return Tolerance(relative=min(max(size, blunt / abs(row.reference)), BLUNTEST))
    scale = scale_of(row.case, row.unit)
    return Tolerance(absolute=max(size * scale, blunt)) if scale else None


def scale_of(name: str, unit: str) -> float:
    """Return the largest known value of a case in a unit, as the scale of errors of values near zero.

    The scale is 1 for values without a unit.
    """
    if not unit:
        return 1.0
    case = catalog.named_case(name.partition(VARIANT)[0])
    judges = (catalog.known_values(name).judge(q.name, case.theory) for q in case.quantities if q.unit == unit)
    return max((abs(judge.value) for judge in judges if judge), default=0.0)


def judged_quantities(case: Problem) -> list[str]:
    """Return the names of the quantities that known values judge."""
    known = catalog.known_values(case.name)
    return [q.name for q in case.quantities if known.judge(q.name, case.theory)]


def grades(rows: Sequence[Row], solvers: Iterable[str], unchecked: Mapping[str, str]) -> list[Grade]:
    """Return the grades of third-party solvers, from all their judged rows.

    Parameters
    ----------
    unchecked
        By solver: the reason why it is not checked, as a clause; empty if it is checked.
    """
    return [_grade(name, [row for row in rows if row.solver == name], unchecked[name]) for name in sorted(solvers)]


def _grade(solver: str, rows: Sequence[Row], unchecked: str) -> Grade:
    judged = [row for row in rows if row.status != "declined"]
    answered, declined = {row.case for row in judged}, [row for row in rows if row.status == "declined"]
    missed = {size: [row for row in judged if not _holds(row, size)] for size in CLASSES}
    lacking = tuple(dict.fromkeys(row.quantity for row in declined if row.case in answered))
    within = next((size for size in CLASSES if judged and not missed[size]), None)
    return Grade(
        solver=solver,
        within=within,
        figures=len(judged),
        cases=len(answered),
        worst=max((row for row in judged if row.judged_error is not None), key=_distance, default=None),
        declined=tuple(dict.fromkeys(row.case for row in declined if row.case not in answered)),
        unchecked=unchecked,
        lacking=lacking,
        on=" on displacements" if lacking and {row.unit for row in judged} <= {"m", "mm"} else "",
    )


def class_of(row: Row, sizes: Sequence[float] = CLASSES) -> float | None:
    """Return the first class that a row's value reaches, tightest first; None if it reaches none."""
    return next((size for size in sizes if _holds(row, size)), None)


def _holds(row: Row, size: float) -> bool:
    allowed = _allowed(row, size)
    return allowed is not None and row.held_to(allowed).why_short(allowed.largest) is None


def _distance(row: Row) -> float:
    """Return the error in units of the loosest class."""
    allowed = _allowed(row, LOOSEST)
    return abs(row.judged_error or 0.0) / allowed.largest if allowed else 0.0
