"""Comparison of fields with another solver's between the points of the cases. It is shown, and judges nothing.

An exam has the same points each time, and a solver may know them. Fields are therefore compared at points drawn from
the checksum of the saved answer, which no solver can know before it has answered. Theories are not compared with each
other: the other solver solves the same case.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from shellbench.bench.plugins.registry import SolverEntry, find_solver
from shellbench.bench.plugins.subject import NoAnswer, Respondent
from shellbench.bench.store.current import CurrentRun
from shellbench.bench.store.record import ANSWERED
from shellbench.bench.store.store import Store
from shellbench.bench.store.task import case_data
from shellbench.problems.shell.case import Case
from shellbench.testing.examination import scattered
from shellbench.testing.subject import load_in, solve_in

YARDSTICK = "fem"
CASES = 3  # number of drawn answers: each costs a solve of the other solver
POINTS = 200


@dataclass(frozen=True)
class Difference:
    """Difference between two fields of a case.

    Attributes
    ----------
    largest
        Relative to the other solver's largest displacement at the points; None if there is no answer.
    at
        Surface coordinates of the point of the largest difference.
    why
        Reason why there is no answer, as a clause.
    """

    case: str
    largest: float | None
    at: tuple[float, ...] = ()
    why: str = ""

    def __str__(self) -> str:
        if self.largest is None:
            return f"{self.case}: {self.why}"
        place = ", ".join(f"{part:.4g}" for part in self.at)
        return f"{self.case}: differs by {self.largest:.1e} of the largest displacement, most at xi = ({place})"


@dataclass(frozen=True)
class Between:
    """Comparisons of fields with those of another solver."""

    yardstick: str
    found: tuple[Difference, ...]

    def lines(self) -> Iterator[str]:
        """Yield the printed lines."""
        yield f"beside {self.yardstick}, at {POINTS} points that no case asks for (shown, and judges nothing):"
        yield from (f"  {one}" for one in self.found)

    def as_data(self) -> dict[str, Any]:
        """Return it as JSON data."""
        return {"yardstick": self.yardstick, "cases": [vars(one) | {"at": list(one.at)} for one in self.found]}


Start = Callable[[SolverEntry], Respondent]


def between_points(entry: SolverEntry, answers: Sequence[CurrentRun], folder: Path, start: Start) -> Between | None:
    """Compare the fields of some saved answers with another solver's, at points drawn from their checksums.

    Parameters
    ----------
    answers
        Runs with solutions in the store at `folder`.
    start
        Starts a solver's process.

    Returns
    -------
    Between
        None if no answer is a field at rest, or the solver is the other one.
    """
    store = Store(folder)
    kept: dict[str, tuple[Case, Path]] = {}
    for run in answers:
        case, record, name = run.case, run.record, run.record.solution_file
        whole = name is not None and name in record.checksums and store.check(record, name) is None
        path = store.file(name)
        if not isinstance(case, Case) or case.dynamics is not None or case.modal:  # no field at rest
            continue
        if record.status in ANSWERED and whole and name and path:
            kept[record.checksums[name]] = (case, path)
    if not kept or entry.name == YARDSTICK:
        return None
    drawn = np.random.default_rng(_seed("".join(sorted(kept)))).permutation(sorted(kept))
    with contextlib.ExitStack() as stack:
        try:
            other, mine = start(find_solver(YARDSTICK)), start(entry)
            stack.callback(other.stop)
            stack.callback(mine.stop)
            taken = [one for one in map(str, drawn) if not _declines(other, kept[one][0])][:CASES]
            found = tuple(_difference(mine, other, *kept[one], _seed(one)) for one in taken)
        except NoAnswer as trouble:
            found = (Difference("", None, why=str(trouble)),)
    return Between(YARDSTICK, found) if found else None


def _seed(checksum: str) -> int:
    return int(hashlib.sha256(checksum.encode()).hexdigest()[:8], 16)


def _declines(other: Respondent, case: Case) -> bool:
    ((kind, reason, _),) = other.call("declines", [{**case_data(case), "name": case.name}])
    return kind != "ok" or reason is not None


def _difference(mine: Respondent, other: Respondent, case: Case, path: Path, seed: int) -> Difference:
    points = scattered(case, POINTS, seed)
    try:
        expected = solve_in(other, case.name, case, {}).displacement(points)
        found = load_in(mine, case.name, case, path).displacement(points)
        size = float(np.linalg.norm(expected, axis=-1).max())
        apart = np.linalg.norm(found - expected, axis=-1) / size
    except (NoAnswer, ValueError) as trouble:
        return Difference(case.name, None, why=f"can't be compared: {trouble}")
    at = int(np.argmax(np.where(np.isnan(apart), np.inf, apart)))
    return Difference(case.name, float(apart[at]), tuple(map(float, points[at])))
