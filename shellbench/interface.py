"""The Python interface: `run` and `table`, for notebooks and scripts.

It takes and finds what the command line takes and finds, in the same store:

>>> import shellbench
>>> found = shellbench.run("scordelis_lo", solvers=["fem"])  # doctest: +SKIP
>>> found[found["primary"]][["solver", "value", "relative_error", "seconds"]]  # doctest: +SKIP
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, Literal

import pandas as pd
from rich.console import Console

from shellbench.bench import environment, local
from shellbench.bench.compare import as_json, rows_and_notes
from shellbench.bench.display import Silent, display
from shellbench.bench.execute import execute
from shellbench.bench.plan import Request, make_plan
from shellbench.bench.row import Row
from shellbench.bench.store import Store

STORE = "reports/runs"  # as on the command line


def run(
    *cases: str | Path,
    suites: Sequence[str] = (),
    solvers: Sequence[str] = (),
    settings: Mapping[str, Mapping[str, Any]] | None = None,
    seeds: Sequence[int] = (),
    device: Literal["cpu", "cuda"] = "cpu",
    store: str | Path = STORE,
    force: bool = False,
    jobs: int | None = None,
    threads: int | None = None,
    timeout: float | None = None,
    quiet: bool = False,
) -> pd.DataFrame:
    """Solve cases as ``shellbench run`` does, each run in a process of its own, and return their table.

    Parameters
    ----------
    cases
        Names of cases or paths to case files.
    suites, solvers, seeds
        As ``--suite``, ``--solver`` and ``--seed``.
    settings
        By solver: ``{"fem": {"tolerance": 1e-6}}``.
    store
        Folder of the records. What has a record already is not solved again, unless `force` is given.
    jobs, threads, timeout
        Runs at a time, threads of each, and seconds after which one is stopped.
    quiet
        Whether to print no line for each run that has ended.

    Returns
    -------
    pandas.DataFrame
        As `table` returns it, of these cases, suites and solvers. A run that failed has a row, whose `status` says so.

    Raises
    ------
    InputError
        If a name is unknown or a file malformed, a setting does not fit, or every solver declines.
    """
    where, named = Store(Path(store)), tuple(map(str, cases))
    request = Request(named, tuple(suites), tuple(solvers), settings or {}, tuple(seeds), device, threads)
    each = threads or environment.threads()
    runs = local.LocalProcesses(jobs or max(1, environment.cores() // each), each, timeout)
    with closing(runs) as executor:
        plan = make_plan(request, where.read(), force, executor.expect)
        _warn(*plan.notes, *(f"{one.case} {one.solver}: not applicable: {one.reason}" for one in plan.declined))
        if quiet:
            execute(plan.tasks, where, Silent(), executor)
        else:
            with display(Console(), len(plan.tasks)) as observer:
                execute(plan.tasks, where, observer, executor)
    rows, notes = rows_and_notes(where, suites, named)
    _warn(*notes)
    return _frame([row for row in rows if not solvers or row.solver in solvers])


def table(*cases: str | Path, suites: Sequence[str] = (), store: str | Path = STORE) -> pd.DataFrame:
    """Return what was run: a line for each figure of each run, with the columns of ``shellbench table --format json``.

    Raises
    ------
    InputError
        If a case or suite is unknown.
    """
    rows, notes = rows_and_notes(Store(Path(store)), suites, tuple(map(str, cases)))
    _warn(*notes)
    return _frame(rows)


def _frame(rows: Sequence[Row]) -> pd.DataFrame:
    columns = [name for field in Row.model_fields for name in ((field, "variant") if field == "case" else (field,))]
    return pd.DataFrame(json.loads(as_json(rows)), columns=columns)


def _warn(*sentences: str) -> None:
    for sentence in sentences:
        warnings.warn(sentence, stacklevel=3)
