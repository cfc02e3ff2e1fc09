"""The checks that a class needs; a solver that only looks values up can't pass them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from shellbench.bench.plugins.kinds import DEFAULT
from shellbench.bench.plugins.registry import SolverEntry
from shellbench.bench.store.conformance import note_conformance
from shellbench.bench.store.store import Store
from shellbench.testing.examination import Verdict

NONLINEAR = "kirchhoff-love-nonlinear"  # the one theory of shells in which answers do not follow the load
OF_LINEAR = ("linearity", "work")
OF_FIELD = ("continuity", "energies", "placement", *OF_LINEAR)
OF_KIND = {DEFAULT: OF_FIELD, "rope": ("placement", "energy")}
OF_OTHERS = ("determinism", "saving")
"""Of kinds of problem from elsewhere: their checks know of quantities only."""


@dataclass(frozen=True)
class Line:
    """One check's outcome; `case` is empty for a check of the solver itself.

    Attributes
    ----------
    kind
        Kind of the case's problem.
    needed
        True if a class needs this check.
    """

    check: str
    case: str
    verdict: Verdict
    kind: str = ""
    needed: bool = False


def needed_checks(kind: str, theories: Iterable[str]) -> tuple[str, ...]:
    """Return the checks that a solver of these theories must pass to get a class."""
    if kind != DEFAULT:
        return OF_KIND.get(kind, OF_OTHERS)
    linear = set(theories) - {NONLINEAR}
    return tuple(name for name in OF_FIELD if linear or name not in OF_LINEAR)


def store_results(store: Store, entry: SolverEntry, lines: Sequence[Line]) -> None:
    """Store the results of the checks, by kind of problem.

    Raises
    ------
    StoreError
        If the store can't be written.
    """
    for kind in dict.fromkeys(line.kind for line in lines if line.kind):
        of_kind = [line for line in lines if line.kind == kind]
        checks = {name: tuple(x.verdict.status for x in of_kind if x.check == name) for name in _names(of_kind)}
        note_conformance(store, entry, kind, checks, unmet_checks(of_kind))


def unmet_checks(lines: Sequence[Line]) -> tuple[str, ...]:
    """Return the reasons for which a solver gets no class, one clause for each check that failed or was not passed."""
    found = []
    for name in _names([line for line in lines if line.needed]):
        verdicts = [line.verdict for line in lines if line.check == name]
        failed = [verdict for verdict in verdicts if verdict.status == "failed"]
        if failed:
            found.append(f"its check '{name}' failed: {failed[0].words}")
        elif not any(verdict.status == "passed" for verdict in verdicts):
            found.append(f"its check '{name}' is not passed: {verdicts[0].words}")
    return tuple(found)


def _names(lines: Iterable[Line]) -> list[str]:
    return list(dict.fromkeys(line.check for line in lines))
