"""The Python interface, for notebooks and scripts: `run` and `table`; `case`, `solve` and `picture`.

It takes the same arguments as the command line, and uses the same store:

>>> import shellbench
>>> found = shellbench.run("scordelis_lo", solvers=["fem"])  # doctest: +SKIP
>>> found[found["primary"]][["solver", "value", "relative_error", "seconds"]]  # doctest: +SKIP

`solve` runs in the current process and keeps no record. It returns the answer itself, a continuous field:

>>> roof = shellbench.solve(shellbench.case("scordelis_lo"), "fem")  # doctest: +SKIP
>>> roof.displacement([[0.0, 25.0]])  # doctest: +SKIP
>>> shellbench.picture(roof)  # doctest: +SKIP
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import pandas as pd
from pydantic import ValidationError
from rich.console import Console

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.compare import as_json, rows_and_notes
from shellbench.bench.judge.row import Row
from shellbench.bench.plugins.registry import find_solver, load_solver, name_of
from shellbench.bench.run import local
from shellbench.bench.run.display import Silent, display
from shellbench.bench.run.execute import execute
from shellbench.bench.run.plan import Request, make_plan
from shellbench.bench.stated.answers import read_sources
from shellbench.bench.stated.judging import Author, judge_answers
from shellbench.bench.store import environment
from shellbench.bench.store.store import Store
from shellbench.errors import InputError
from shellbench.problem import Problem, Solution, answerable, why_declined
from shellbench.protocol.schema import one_sentence
from shellbench.report.sections import stated

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STORE = "reports/runs"  # as on the command line


def run(
    *cases: str | Path,
    suites: Sequence[str] = (),
    solvers: Sequence[str | Path] = (),
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
        See ``--suite``, ``--solver`` (names, or files of commands) and ``--seed``.
    settings
        By solver: ``{"fem": {"tolerance": 1e-6}}``.
    store
        Folder of the records. Runs with a valid record are not solved again, unless `force` is given.
    jobs, threads, timeout
        Runs at a time, threads of each, and seconds after which one is stopped.
    quiet
        True to print no line for each ended run.

    Returns
    -------
    pandas.DataFrame
        The table of these cases, suites and solvers; see `table`. A failed run has a row with its `status`.

    Raises
    ------
    InputError
        If a name is unknown, a file malformed or a setting invalid, or if every solver declines.
    """
    where, named, names = Store(Path(store)), tuple(map(str, cases)), tuple(map(name_of, solvers))
    request = Request(named, tuple(suites), names, settings or {}, tuple(seeds), device, threads)
    each = threads or environment.threads()
    runs = local.LocalProcesses(jobs or max(1, environment.cores() // each), each, timeout)
    with closing(runs) as executor:
        plan = make_plan(request, where.read(), force, executor.expect)
        _warn(*plan.notes, *(f"{one.case} {one.solver}: not applicable: {one.reason}" for one in plan.declined))
        since = None if force else plan.seen
        if quiet:
            execute(plan.tasks, where, Silent(), executor, since)
        else:
            with display(Console(), len(plan.tasks)) as observer:
                execute(plan.tasks, where, observer, executor, since)
    rows, notes = rows_and_notes(where, suites, named)
    _warn(*notes)
    return _frame([row for row in rows if not names or row.solver in names])


def table(*cases: str | Path, suites: Sequence[str] = (), store: str | Path = STORE) -> pd.DataFrame:
    """Return a line for each value of each run, with the columns of ``shellbench table --format json``.

    Raises
    ------
    InputError
        If a case or suite is unknown.
    """
    rows, notes = rows_and_notes(Store(Path(store)), suites, tuple(map(str, cases)))
    _warn(*notes)
    return _frame(rows)


def judge(
    results: str | Path | pd.DataFrame | Sequence[str | Path | pd.DataFrame],
    case: str | None = None,
    *,
    units: str | None = None,
    theory: str | None = None,
) -> pd.DataFrame:
    """Return the table of ``shellbench judge``: values of any program beside known values, and their limit.

    Parameters
    ----------
    results
        Paths of answers.csv or of nodal results, or tables with the columns of answers.csv; one, or one for each mesh.
    case, units, theory
        See ``--case``, ``--units`` and ``--theory``.

    Raises
    ------
    InputError
        In one sentence with file, line and field.
    """
    listed = [results] if isinstance(results, str | Path | pd.DataFrame) else list(results)
    sources = [one if isinstance(one, pd.DataFrame) else Path(one) for one in listed]
    found = judge_answers(read_sources(sources, case, units), Author(), theory)
    _warn(*found.warnings)
    return stated.table(found.judged).data


def case(name: str | Path) -> Problem:
    """Return a case by its name, or by the path to its file.

    Raises
    ------
    InputError
        If the name is unknown or the file malformed.
    """
    return catalog.find_case(str(name))


def solve(case: str | Path | Problem, solver: str = "fem", **settings: Any) -> Solution:
    """Solve a case in the current process, and return the answer; nothing is recorded.

    Raises
    ------
    InputError
        If a name is unknown, a setting is invalid, or the solver declines the case.
    SolveFailure
        If the solver reached no trustworthy answer.
    """
    asked = case if isinstance(case, Problem) else catalog.find_case(str(case))
    found = load_solver(find_solver(solver))
    try:
        chosen = found.settings_type.model_validate(settings)
    except ValidationError as error:
        raise InputError(f"settings of '{solver}': {one_sentence(error, settings)}") from None
    if (why := why_declined(found, asked)) is not None:
        raise InputError(f"{solver} can't take {asked.name}: {why}")
    return found.solve(answerable(found, asked)[0], chosen)


@dataclass(frozen=True)
class Picture:
    """A figure with its HTML for notebooks."""

    figure: Figure

    def _repr_png_(self) -> bytes:
        written = BytesIO()
        self.figure.savefig(written, format="png", dpi=110)
        return written.getvalue()


def picture(solution: Solution) -> Picture:
    """Return the picture of an answer as in the report: the deformed shell, coloured by its displacement.

    Raises
    ------
    InputError
        If this kind of problem can't be drawn, or the answer has no finite field.
    """
    from shellbench.report.data.exhibit import style
    from shellbench.report.figures.pictures import shell_of
    from shellbench.report.figures.shells import shell_figure

    found = shell_of(solution)
    if found is None:
        raise InputError(f"nothing can be drawn of {solution.case.name}")
    with style():
        return Picture(shell_figure(found))


def _frame(rows: Sequence[Row]) -> pd.DataFrame:
    columns = [name for field in Row.model_fields for name in ((field, "variant") if field == "case" else (field,))]
    return pd.DataFrame(json.loads(as_json(rows)), columns=columns)


def _warn(*sentences: str) -> None:
    for sentence in sentences:
        warnings.warn(sentence, stacklevel=3)
