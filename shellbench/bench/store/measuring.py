"""Measurement of a solution for its record: values, cost, history, and fields for pictures.

Each part is measured independently. If one part can't be measured, the rest is still recorded: an example is a
quantity at a state that a failed solve did not reach.
"""

from __future__ import annotations

import errno
import math
import traceback
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from shellbench.bench.plugins.kinds import find_kind
from shellbench.bench.store.record import Measured
from shellbench.errors import InputError, without_middle
from shellbench.problem import Problem, Solution
from shellbench.protocol.history import LARGEST_COUNT, HistoryStep, finite_or_none
from shellbench.protocol.schema import LONGEST_VALUE, one_sentence

FIELDS = "fields.npz"
NOT_REACHED = "not_reached"  # of a solution's diagnostics: names of the quantities that it did not reach
SOLUTION = "solution"
DRAWS = 2.0  # one random draw underestimates the change as often as not: twice the change covers 7 of 10
UNREACHED = (InputError, ValueError)  # errors for a state that was not reached
Part = Callable[[], dict[str, Any]]


def measured(solution: Solution, case: Problem, folder: Path) -> tuple[dict[str, Any], str | None]:
    """Measure a solution, and write its arrays and the solution itself into the folder.

    Returns
    -------
    tuple
        Fields of a record, and the reason why it is incomplete, in one sentence; None if it is complete.
    """
    kind = find_kind(case.kind)
    values, lost = values_of(solution, case)
    result: dict[str, Any] = {"values": values}
    headline = next(quantity.name for quantity in case.quantities if quantity.primary)
    # A solver that names unreached quantities, and therefore has not settled, has an answer if it reached the headline.
    told = headline in values and why_unsettled(solution) is not None
    told = told and set(lost) <= set(solution.diagnostics.get(NOT_REACHED, ()))
    why = without_values(lost) if lost and not told else why_misstated(solution, case)
    numbers = {name: found.value for name, found in values.items()}
    accounts = {name: partial(account, solution, case, numbers) for name, account in kind.accounts.items()}

    def measure(*parts: Part) -> None:
        nonlocal why
        for part in parts:
            try:
                result.update(part())
            except Exception as error:
                pass_on_full_disk(error)
                why = why or f"the solution can't be measured: {error_line(error)}"
                traceback.print_exc()

    measure(partial(cost, solution), partial(course, solution), partial(keep_solution, solution, case, folder))
    if "fields_file" in result:  # otherwise there is no finite state to measure
        measure(*(partial(_field, name, account) for name, account in accounts.items()))
    for name, study in kind.studies.items():  # they are optional: a failing one is left out
        try:
            result[name] = tuple(study(solution, case, numbers))
        except Exception as error:
            pass_on_full_disk(error)
            traceback.print_exc()
    return result, why


def _field(name: str, account: Callable[[], Any]) -> dict[str, Any]:
    return {name: tuple(account())}


def values_of(solution: Solution, case: Problem) -> tuple[dict[str, Measured], dict[str, str]]:
    """Return the finite values of the case's quantities, and the reasons for missing values (empty: not finite)."""
    values: dict[str, Measured] = {}
    lost: dict[str, str] = {}
    given: Mapping[str, float] = getattr(solution, "given", {})  # by programs that give no field
    for quantity in case.quantities:
        name = quantity.name
        try:
            value = finite_or_none(given[name] if name in given else quantity.measure(solution))
            if value is None:
                lost[name] = ""
                continue
            uncertainty = finite_number(solution.uncertainty.get(name))
            extrapolated = finite_number(solution.extrapolated.get(name))
            factor = quantity.factor
            values[name] = Measured(
                value=value * factor,
                uncertainty=None if uncertainty is None else uncertainty * factor,
                extrapolated=None if extrapolated is None else extrapolated * factor,
            )
        except Exception as error:
            pass_on_full_disk(error)
            lost[name] = error_line(error)
            if not isinstance(error, UNREACHED):
                traceback.print_exc()
    return values, lost


def finite_number(value: Any) -> float | None:
    """Return a number that a solution states; None if it states none or a record can't keep it."""
    try:
        return None if isinstance(value, str | bytes) else finite_or_none(value)
    except (TypeError, ValueError):
        return None


def why_misstated(solution: Solution, case: Problem) -> str | None:
    """Describe an invalid uncertainty or extrapolated value: not finite, or negative; None if all are valid."""
    for part, least in (("uncertainty", 0.0), ("extrapolated", -math.inf)):
        for name in (quantity.name for quantity in case.quantities):
            given = getattr(solution, part).get(name)
            number = finite_number(given)
            if given is not None and (number is None or number < least):
                found = without_middle(" ".join(repr(given).split()), LONGEST_VALUE)
                allowed = "a finite number" + (" of at least 0" if least == 0 else "")
                return f"the solver states {found} as {part} of {name}, but it must be {allowed}"
    return None


def without_values(lost: Mapping[str, str]) -> str:
    """Describe the quantities without a value, with the first known reason."""
    why = next(filter(None, lost.values()), "")
    return f"the solution has no finite value for {', '.join(lost)}" + (f": {why}" if why else "")


def cost(solution: Solution) -> dict[str, Any]:
    """Return the size of the solution, and the solver's diagnostics."""
    return {
        "parameters": int(solution.parameters),
        "storage_bytes": int(solution.storage_bytes),
        "diagnostics": json_only(dict(solution.diagnostics)),
    }


def course(solution: Solution) -> dict[str, Any]:
    """Return the history of the solution."""
    return {"history": history_of(solution)}


def keep_solution(solution: Solution, case: Problem, folder: Path) -> dict[str, Any]:
    """Store arrays of the solution, and the solution itself; nothing if it has no finite state yet."""
    if not write_fields(solution, case, folder / FIELDS):
        return {}
    return {"fields_file": FIELDS, "solution_file": solution.save(folder / SOLUTION).name}


def write_fields(solution: Solution, case: Problem, path: Path) -> bool:
    """Write the arrays of the kind of problem as npz; return True if there are any."""
    arrays = find_kind(case.kind).keep(solution, case)
    if arrays is None:
        return False
    for name, array in arrays.items():
        if np.asarray(array).dtype.kind in "cO":
            raise ValueError(f"its {name} is no array of real numbers, but of {np.asarray(array).dtype}")
    np.savez_compressed(path, **arrays)  # type: ignore[arg-type] # its stub takes them for its own options
    return True


def history_of(solution: Solution) -> tuple[HistoryStep, ...]:
    """Return the history for a record; it ends before a step whose energy is not finite."""
    kept: list[HistoryStep] = []
    for step in solution.history:
        if finite_or_none(step.energy) is None:
            break
        kept.append(
            HistoryStep(
                iteration=int(step.iteration),
                seconds=float(step.seconds),
                energy=float(step.energy),
                unknowns=int(step.unknowns),
                at=float(step.at),
                gap=finite_or_none(step.gap),
                quantities={k: float(v) for k, v in step.quantities.items() if finite_or_none(v) is not None},
                phase=step.phase,
                iterations=None if step.iterations is None else int(step.iterations),
            )
        )
    return tuple(kept)


def json_only(data: Any) -> Any:
    """Return diagnostics as JSON data: arrays as lists, and None for numbers that a record can't keep."""
    match data:
        case Mapping():
            return {str(key): json_only(value) for key, value in data.items()}
        case list() | tuple() | set():
            return [json_only(value) for value in data]
        case np.ndarray() | np.generic():
            return json_only(data.tolist())
        case float():
            return finite_or_none(data)
        case int():
            return data if abs(data) <= LARGEST_COUNT else finite_or_none(data)
        case None | str():
            return data
        case _:
            return str(data)


def error_line(error: Exception) -> str:
    """Return an error's message in one line; with the error's type if the message is not meant for users."""
    words = one_sentence(error) if isinstance(error, ValidationError) else " ".join(str(error).split())
    if words and isinstance(error, UNREACHED):
        return words
    return f"{type(error).__name__}: {words}" if words else type(error).__name__


def pass_on_full_disk(error: Exception) -> None:
    """Raise the error again if the disk is full, because that is no fault of the solver."""
    if isinstance(error, OSError) and error.errno in {errno.ENOSPC, errno.EDQUOT}:
        raise error


def why_unsettled(solution: Solution) -> str | None:
    """Return the reason why a solution has not settled, as a clause; None if it has, or if none is stated."""
    why = getattr(solution, "unsettled", None)
    return None if why is None else " ".join(str(why).split()) or "its solver does not say what moves"
