"""Tolerances made tighter by one rule, from what a solver answered.

    python -m shellbench.bench.tighten SOLVER STORE            what the rule says
    python -m shellbench.bench.tighten SOLVER STORE --write    make that the solver's tolerances

What a figure is allowed becomes `MARGIN` times the largest error of it in the store, or `SURE` times the largest
uncertainty that is stated of it, if that is more, rounded up to 1, 2 or 5 times a power of ten: over the case, all
variants that suites ask of the solver, and all seeds. It is never less than `KNOWN` times the known value's own
uncertainty, nor than what the solver aims at, nor than `LEAST`, and never more than it was. A figure stays as it is if
a variant has no record that counts, or has failed, and if it was asked once alone. Open findings stay, and count for
nothing.

A record says what its solver aims at as `tolerance` of its diagnostics: there it ends. Rounding may decide on which
mesh, so that an answer may be as unsure as that on another machine, however sure it is on this one.
"""

from __future__ import annotations

import math
import re
import sys
from collections import defaultdict
from collections.abc import Iterable, Mapping
from pathlib import Path

from shellbench.bench import catalog
from shellbench.bench.classes import scale_of
from shellbench.bench.compare import rows
from shellbench.bench.plan import Request, make_plan
from shellbench.bench.record import Record
from shellbench.bench.reference import FOLDER
from shellbench.bench.row import Row
from shellbench.bench.store import Contents, Store
from shellbench.errors import InputError
from shellbench.problem import VARIANT

MARGIN = 10.0  # an error may be small by chance, where others of its kind are not
SURE = 3.0  # what is stated is no chance: other machines, and code to come, may add a little
ROUNDING = 1e-9
KNOWN = 10.0  # the known value has to be ten times surer than what it judges
STEPS = (1.0, 2.0, 5.0, 10.0)  # of a decade
LEAST = 1e-8  # of the known value, or of the largest in its unit: thin shells lose as much to rounding
TABLE = re.compile(r"\[(?P<case>\w+)\]")
LINE = re.compile(r"(?P<before>(?P<name>\w+) = (\{ (relative|absolute) = )?)[0-9][0-9.e+-]*(?P<after>.*)", re.DOTALL)

Figure = tuple[str, str]  # case as declared, quantity


def tightened(
    found: Iterable[Row], asked: Mapping[str, set[str]], aims: Mapping[str, float] | None = None
) -> dict[Figure, float]:
    """Return what the rule allows of each figure that it makes tighter, as its tolerance is: relative or absolute.

    Parameters
    ----------
    found
        Rows of one solver.
    asked
        By name of a case as declared: the names of it and its variants that have to be there.
    aims
        By run: the relative uncertainty at which the solver ends.
    """
    aims = aims or {}
    by_figure: dict[Figure, list[Row]] = defaultdict(list)
    for row in found:
        if row.tolerance is not None and row.default_settings and not row.own_case and row.status != "declined":
            by_figure[row.base, row.quantity].append(row)
    result = {}
    for (case, quantity), of_figure in by_figure.items():
        judging = [row for row in of_figure if row.open_finding is None]
        ways = {(row.case, row.seed) for row in judging}
        if len(ways) < 2 or not asked.get(case, set()) <= {row.case for row in of_figure}:
            continue
        frozen = judging[0].tolerance
        assert frozen is not None
        allowed = max(_allowed(row, aims.get(row.run_id or "", 0.0)) for row in judging)
        if allowed < frozen:
            result[case, quantity] = allowed
    return result


def _allowed(row: Row, aim: float) -> float:
    """Return what the rule allows for one row; infinite if it is none to learn from."""
    if row.status != "ok" or row.judged_error is None or row.reference is None or not math.isfinite(row.judged_error):
        return math.inf
    size = 1.0 if row.tolerance_is_absolute else abs(row.reference)
    worst = max(MARGIN * abs(row.judged_error), SURE * (row.uncertainty or 0.0) / size)
    known = KNOWN * (row.reference_uncertainty or 0.0) / size
    least = max(LEAST, aim) * (scale_of(row.case, row.unit) or 1.0 if row.tolerance_is_absolute else 1.0)
    needed = max(worst, known, least)
    decade = 10.0 ** math.floor(math.log10(needed))
    return next(float(f"{step * decade:.0e}") for step in STEPS if step * decade >= needed * (1 - ROUNDING))


def rewritten(text: str, allowed: Mapping[Figure, float]) -> str:
    """Return the text of a file of tolerances with other numbers; comments and open findings stay."""
    case, lines = "", []
    for line in text.splitlines(keepends=True):
        if table := TABLE.match(line):
            case = table["case"]
        found = LINE.match(line)
        if found and (size := allowed.get((case, found["name"]))) is not None:
            line = f"{found['before']}{_short(size)}{found['after']}"
        lines.append(line)
    return "".join(lines)


def _short(size: float) -> str:
    return re.sub(r"e-0*", "e-", f"{size:.0e}")


def asked_of(solver: str) -> dict[str, set[str]]:
    """Return by name of a case as declared: it and its variants that suites ask of a solver and that it takes."""
    suites = tuple(
        name
        for name in catalog.suite_names()
        if any(run.solver == solver and not run.settings for run in catalog.find_suite(name).runs)
    )
    asked: dict[str, set[str]] = defaultdict(set)
    for task in make_plan(Request(suites=suites, solvers=(solver,)), Contents(())).tasks:
        if task.identity.settings == task.defaults:
            asked[task.case_name.partition(VARIANT)[0]].add(task.case_name)
    return asked


def aims_of(records: Iterable[Record]) -> dict[str, float]:
    """Return by run the relative uncertainty at which its solver ends, where it says so."""
    found = ((record.run_id, (record.diagnostics or {}).get("tolerance")) for record in records)
    return {run_id: float(aim) for run_id, aim in found if isinstance(aim, float)}


def main(arguments: list[str]) -> int:
    """Say what the rule makes of the records of a store, and write it with ``--write``; return the exit code."""
    names, write = [a for a in arguments if a != "--write"], "--write" in arguments
    if len(names) != 2:
        print("usage: python -m shellbench.bench.tighten SOLVER STORE [--write]", file=sys.stderr)
        return 2
    solver, store = names
    path = catalog.data_folder("references") / FOLDER / f"{solver}.toml"
    try:
        if solver not in catalog.tolerances():
            raise InputError(f"solver '{solver}' has no frozen tolerances: there is no {path}")
        of_solver = [row for row in rows(Store(Path(store))) if row.solver == solver]
        allowed = tightened(of_solver, asked_of(solver), aims_of(Store(Path(store)).read().records))
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    frozen = catalog.tolerances()[solver]
    for (case, quantity), size in sorted(allowed.items()):
        print(f"{case} {quantity}: {frozen[case][quantity]} becomes {size:g}")
    print(f"{len(allowed)} figures of {len({case for case, _ in allowed})} cases become tighter")
    if write:
        path.write_text(rewritten(path.read_text(encoding="utf-8"), allowed), encoding="utf-8")
        print(f"written: {path}; `python -m shellbench.bench.lock --write` moves the lock")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
