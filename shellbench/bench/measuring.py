"""What a record says of a solution.

Each part is measured by itself: what can't be measured, such as a quantity at a state that a failed solve did not
reach, costs nothing of the rest.
"""

from __future__ import annotations

import errno
import traceback
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from shellbench.account import MOST, HistoryStep, finite
from shellbench.bench.kinds import find_kind
from shellbench.bench.record import Measured
from shellbench.errors import InputError
from shellbench.model import one_sentence
from shellbench.problem import Problem, Solution

FIELDS = "fields.npz"
SOLUTION = "solution"
UNREACHED = (InputError, ValueError)  # how a solution and its measuring say that a state was not reached

Part = Callable[[], dict[str, Any]]


def measured(solution: Solution, case: Problem, folder: Path) -> tuple[dict[str, Any], str | None]:
    """Measure a solution, and put its arrays and itself into the folder.

    Returns
    -------
    tuple
        Fields of a record, and why it is not whole, in one sentence; None if it is.
    """
    kind = find_kind(case.kind)
    values, lost = values_of(solution, case)
    result: dict[str, Any] = {"values": values}
    why = without_values(lost) if lost else None
    numbers = {name: found.value for name, found in values.items()}
    accounts = {name: partial(account, solution, case, numbers) for name, account in kind.accounts.items()}

    def measure(*parts: Part) -> None:
        nonlocal why
        for part in parts:
            try:
                result.update(part())
            except Exception as error:
                pass_on_full_disk(error)
                why = why or f"the solution can't be measured: {said(error)}"
                traceback.print_exc()

    measure(partial(cost, solution), partial(course, solution), partial(kept, solution, case, folder))
    if "fields_file" in result:  # else there is no finite state of which anything could be said
        measure(*(partial(_field, name, account) for name, account in accounts.items()))
    for name, study in kind.studies.items():  # they stand beside the answer: one that fails is left out
        try:
            result[name] = tuple(study(solution, case, numbers))
        except Exception as error:
            pass_on_full_disk(error)
            traceback.print_exc()
    return result, why


def _field(name: str, account: Callable[[], Any]) -> dict[str, Any]:
    return {name: tuple(account())}


def values_of(solution: Solution, case: Problem) -> tuple[dict[str, Measured], dict[str, str]]:
    """Return the finite values of the case's quantities, and of the others why there is none (empty: not finite)."""
    values: dict[str, Measured] = {}
    lost: dict[str, str] = {}
    for quantity in case.quantities:
        name = quantity.name
        try:
            value = finite(quantity.measure(solution))
            if value is None:
                lost[name] = ""
                continue
            values[name] = Measured(
                value=value,
                uncertainty=finite(solution.uncertainty.get(name)),
                extrapolated=finite(solution.extrapolated.get(name)),
            )
        except Exception as error:
            pass_on_full_disk(error)
            lost[name] = said(error)
            if not isinstance(error, UNREACHED):
                traceback.print_exc()
    return values, lost


def without_values(lost: Mapping[str, str]) -> str:
    """Say which quantities have no value, and why the first of them that has a reason has none."""
    why = next(filter(None, lost.values()), "")
    return f"the solution has no finite value for {', '.join(lost)}" + (f": {why}" if why else "")


def cost(solution: Solution) -> dict[str, Any]:
    """Return what the solution takes, and what the solver says of it."""
    return {
        "parameters": int(solution.parameters),
        "storage_bytes": int(solution.storage_bytes),
        "diagnostics": json_only(dict(solution.diagnostics)),
    }


def course(solution: Solution) -> dict[str, Any]:
    """Return how the solution came about."""
    return {"history": history_of(solution)}


def kept(solution: Solution, case: Problem, folder: Path) -> dict[str, Any]:
    """Keep arrays of the solution, and itself; nothing if it has no finite state yet."""
    if not write_fields(solution, case, folder / FIELDS):
        return {}
    return {"fields_file": FIELDS, "solution_file": solution.save(folder / SOLUTION).name}


def write_fields(solution: Solution, case: Problem, path: Path) -> bool:
    """Write the arrays that the kind of problem keeps as npz; return whether there are any."""
    arrays = find_kind(case.kind).keep(solution, case)
    if arrays is None:
        return False
    np.savez_compressed(path, **arrays)  # type: ignore[arg-type] # its stub takes them for its own options
    return True


def history_of(solution: Solution) -> tuple[HistoryStep, ...]:
    """Return the history as a record keeps it; a step whose energy is not finite ends it."""
    kept: list[HistoryStep] = []
    for step in solution.history:
        if finite(step.energy) is None:
            break
        kept.append(
            HistoryStep(
                iteration=int(step.iteration),
                seconds=float(step.seconds),
                energy=float(step.energy),
                unknowns=int(step.unknowns),
                at=float(step.at),
                gap=finite(step.gap),
                quantities={k: float(v) for k, v in step.quantities.items() if finite(v) is not None},
                phase=step.phase,
                iterations=None if step.iterations is None else int(step.iterations),
            )
        )
    return tuple(kept)


def json_only(data: Any) -> Any:
    """Return diagnostics as JSON data: arrays as lists, what is no figure that a record keeps as None."""
    match data:
        case Mapping():
            return {str(key): json_only(value) for key, value in data.items()}
        case list() | tuple() | set():
            return [json_only(value) for value in data]
        case np.ndarray() | np.generic():
            return json_only(data.tolist())
        case float():
            return finite(data)
        case int():
            return data if abs(data) <= MOST else finite(data)
        case None | str():
            return data
        case _:
            return str(data)


def said(error: Exception) -> str:
    """Return what an error says, in one line; those that are not meant for a reader with their kind."""
    words = one_sentence(error) if isinstance(error, ValidationError) else " ".join(str(error).split())
    if words and isinstance(error, UNREACHED):
        return words
    return f"{type(error).__name__}: {words}" if words else type(error).__name__


def pass_on_full_disk(error: Exception) -> None:
    """Raise the error again if it says that the disk is full: that is no fault of the solver."""
    if isinstance(error, OSError) and error.errno in {errno.ENOSPC, errno.EDQUOT}:
        raise error
