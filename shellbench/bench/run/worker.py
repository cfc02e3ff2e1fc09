"""One run in a process of its own: solve, measure, and leave a record in the run's folder.

Every failure gives a record with one sentence; values that had converged before it are measured too.
"""

from __future__ import annotations

import errno
import math
import sys
import time
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import psutil
from pydantic import ValidationError

from shellbench.bench.plugins.kinds import kind_name, problem_of
from shellbench.bench.plugins.registry import SolverEntry, find_solver, load_solver
from shellbench.bench.store.identity import current_source
from shellbench.bench.store.measuring import DRAWS, error_line, measured, pass_on_full_disk, values_of, why_unsettled
from shellbench.bench.store.record import NOT_SETTLED, Measured, Record, Status, document, readable, shortened
from shellbench.bench.store.settled import why_uncertain, with_drifts
from shellbench.bench.store.task import Task
from shellbench.errors import InputError, SolveFailure
from shellbench.problem import Problem, Progress, Settings, Solution, Solver, answerable
from shellbench.protocol.history import finite_or_none

RECORD = "record.json"
REFUSED = "refused.txt"
DISK_FULL = "disk_full"
CHECKPOINT = "checkpoint"  # the setting, see `shellbench.problem.Settings`
CHECKPOINTS = "checkpoints"  # folder in the store
PAUSE = 0.1  # seconds between two progress messages

Tell = Callable[[Progress], None]


def work(folder: Path, tell: Tell) -> None:
    """Run the task of a folder and write its record there, or the reason why the input was refused.

    A full disk leaves the empty file `DISK_FULL`, or nothing: it is no fault of the solver.
    """
    task = Task.read(folder)
    try:
        record = run(task, folder, rate_limited(tell))
        (folder / RECORD).write_bytes(document(readable(record)))
    except InputError as error:
        (folder / REFUSED).write_text(str(error), encoding="utf-8")
    except OSError as error:
        if error.errno not in {errno.ENOSPC, errno.EDQUOT}:
            raise
        (folder / RECORD).unlink(missing_ok=True)
        (folder / DISK_FULL).touch()


def run(task: Task, folder: Path, tell: Tell) -> Record:
    """Solve and measure; see `work`."""
    case = problem_of(task.case)
    idle = psutil.Process().memory_info().rss
    start = time.perf_counter()
    solution: Solution | None = None
    reason: str | None = None
    declined: dict[str, str] = {}
    try:
        solver = load_solver(SolverEntry(task.identity.solver, task.target, "", ""))
        settings = solver.settings_type.model_validate(with_checkpoints(task, solver, folder))
        start = time.perf_counter()
        earlier = {} if task.start is None else {"start": Path(task.start)}
        case, declined = answerable(solver, case)
        solution = solver.solve(case, settings, progress=tell, **earlier)
    except SolveFailure as failure:
        reason, solution = str(failure), failure.partial
    except InputError:
        raise
    except MemoryError:
        reason = "the solve ran out of memory"
        traceback.print_exc()
    except (OverflowError, FloatingPointError) as error:
        reason = f"the solve left the range of its numbers: {' '.join(str(error).split())}"
        traceback.print_exc()
    except Exception as error:
        pass_on_full_disk(error)
        reason = f"the solver stopped unexpectedly: {error_line(error)}"
        traceback.print_exc()
    if solution is None and reason is None:
        reason = "the solver returned None, which is no solution"
    seconds = time.perf_counter() - start
    if solution is not None and solution.history:  # for a solve that continued a checkpoint, its whole time
        seconds = max(seconds, finite_or_none(solution.history[-1].seconds) or 0.0)
    result: dict[str, Any] = {
        "seconds": seconds,
        "declined": {name: shortened(why) for name, why in declined.items()},
        "idle_memory_bytes": idle,
        "peak_memory_bytes": peak_memory(idle),
    }
    if solution is not None:
        found, why_not_whole = measured(solution, case, folder)
        result |= found
        reason = reason or why_not_whole
    if reason is None and result.get("values"):
        try:
            result["values"] = with_data_errors(solver, settings, case, result["values"], tell)
        except (InputError, SolveFailure) as error:
            reason = f"how far the answer moves with its data is not known: {error_line(error)}"
    drifting: str | None = None
    if reason is None and solution is not None and result.get("values"):
        try:
            result["values"], drifting = with_drifts(case, solution, result["values"])
        except (InputError, ValueError, NotImplementedError) as error:
            drifting = f"how far values without a limit drift is not known: {error_line(error)}"
    if reason is None and not same_source(task):
        reason = "the source of the solver, or of what measures it, was changed while it ran"
    status: Status = "ok" if reason is None else "failed"
    if reason is None and solution is not None:
        values = result.get("values", {})
        uncertain = why_uncertain(problem_of(task.case), task.identity.solver, task.own_case, values)
        said_of_it = why_unsettled(solution), case.undecided, drifting, uncertain
        reason = "; ".join(filter(None, said_of_it)) or None
        status = NOT_SETTLED if reason else "ok"
    try:
        return task.record(status=status, reason=reason, **result)
    except ValidationError as error:
        reason = reason or f"what the solver left can't be recorded: {error_line(error)}"
        return task.record(status="failed", reason=reason, seconds=seconds)


def with_data_errors(
    solver: Solver, settings: Settings, case: Problem, values: Mapping[str, Measured], tell: Tell
) -> dict[str, Measured]:
    """Solve with equivalent data, and add the changes of the values to their data errors and uncertainties.

    Values are unchanged if the question's data are exact.
    """
    other = case.asked_as_well()
    if other is None:
        return dict(values)
    found, _ = values_of(solver.solve(other, settings, progress=tell), other)
    result = {}
    for name, one in values.items():
        moved = DRAWS * abs(found[name].value - one.value) if name in found else None
        total = None if moved is None or one.uncertainty is None else one.uncertainty + moved
        result[name] = one.model_copy(update={"data_error": moved, "uncertainty": total})
    return result


def same_source(task: Task) -> bool:
    """Return True if the source is still that of the plan."""
    name = task.identity.solver
    try:
        # for built-in solvers only the module counts; the search for their registration would take most of the time
        entry = SolverEntry(name, task.target, "", "")
        return current_source(entry if entry.own else find_solver(name), kind_name(task.case)) == task.identity.source
    except (InputError, OSError, SyntaxError):
        return False


def with_checkpoints(task: Task, solver: Solver, folder: Path) -> dict[str, Any]:
    """Return the settings of a task; checkpoints are kept in the store by default."""
    given = dict(task.settings)
    if CHECKPOINT in solver.settings_type.model_fields:
        given.setdefault(CHECKPOINT, str(folder.parent / CHECKPOINTS))
    return given


def peak_memory(idle: int) -> int | None:
    """Return the largest resident memory of this process, or of a program it called; bytes, None if not known.

    The kernel updates the peak only from time to time, so it may be less than the idle measurement.
    """
    try:
        import resource
    except ImportError:
        return None
    peak = max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return max(idle, int(peak if sys.platform == "darwin" else peak * 1024))


def rate_limited(tell: Tell) -> Tell:
    """Return a callback that passes on progress with a limited rate."""
    last = -math.inf

    def told(progress: Progress) -> None:
        nonlocal last
        now = time.perf_counter()
        if now - last >= PAUSE:
            last = now
            tell(progress)

    return told
