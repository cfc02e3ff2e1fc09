"""Solvers: their capabilities, their settings and their answers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, Protocol

from pydantic import Field, ValidationInfo, field_validator
from pydantic_core import PydanticKnownError

from shellbench.protocol.problem import Problem
from shellbench.protocol.schema import Model
from shellbench.protocol.solution import ProgressCallback, Solution

Device = Literal["cpu", "cuda"]


class Settings(Model):
    """Settings of a solver that computes the same answer every time.

    A setting called `checkpoint`, a folder or None, is the place of an interrupted solve to continue; the bench sets
    it. Settings that can't change the answer, like this one, are declared with `exclude=True`: they are no part of a
    run's identity.
    """

    @field_validator("*", mode="before")
    @classmethod
    def _is_true_or_false(cls, value: Any, info: ValidationInfo) -> Any:
        field = cls.model_fields.get(info.field_name or "")
        if field is not None and field.annotation is bool and not isinstance(value, bool):
            raise PydanticKnownError("bool_type")
        return value


class SeededSettings(Settings):
    """Settings of a solver whose answer depends on a seed; it may run on an accelerator."""

    seed: int = Field(0, ge=0, le=2**31 - 1, strict=True, description="seed of the random numbers")
    device: Device = Field("cpu", description="where to run")


@dataclass(frozen=True)
class Capabilities:
    """The capabilities of a solver.

    Attributes
    ----------
    theories
        Theories that it solves.
    devices
        Devices that it runs on.
    label
        An honest description of the solver in one line, for tables.
    """

    theories: tuple[str, ...]
    label: str
    devices: tuple[Device, ...] = ("cpu",)


class Solver(Protocol):
    """Something that solves problems.

    Attributes
    ----------
    name
        Name on the command line and in records.
    capabilities
        Its capabilities.
    settings_type
        Its settings: a subclass of `Settings`, or of `SeededSettings` if a seed matters.
    """

    name: ClassVar[str]
    capabilities: ClassVar[Capabilities]
    settings_type: ClassVar[type[Settings]]

    def declines(self, case: Any) -> str | None:
        """Return the reason why the solver can't take this problem, as one clause, or None if it can.

        A solver that takes the problem but can't give one of its quantities has the optional method
        ``declines_quantity(case, quantity) -> str | None``, which returns the reason. The quantity is then recorded as
        declined, and all other quantities are still evaluated; see `answerable`.
        """
        ...

    def solve(
        self,
        case: Any,
        settings: Any,
        start: Solution | Path | None = None,
        progress: ProgressCallback | None = None,
    ) -> Solution:
        """Solve the problem.

        `start` is an earlier solution, or a checkpoint file of an interrupted solve, to continue. A solver that can't
        do so raises InputError, in one sentence.

        Raises
        ------
        SolveFailure
            If no trustworthy answer was reached; it carries the converged part.
        InputError
            If the settings or `start` do not match the case.
        """
        ...

    def load(self, path: Path) -> Solution:
        """Read a solution that `Solution.save` wrote."""
        ...


def declined_quantities(solver: object, case: Problem) -> dict[str, str]:
    """Return the reason for each quantity of a case that a solver declines, by name; empty if it gives all."""
    ask = getattr(solver, "declines_quantity", None)
    if ask is None:
        return {}
    return {q.name: why for q in case.quantities if (why := ask(case, q)) is not None}


def why_declined(solver: Solver, case: Problem) -> str | None:
    """Return the reason why a solver can't take a case or its headline, as one clause; None if it can."""
    return solver.declines(case) or declined_quantities(solver, case).get(case.primary.name)


def answerable(solver: Solver, case: Problem) -> tuple[Problem, dict[str, str]]:
    """Return a case without the quantities that a solver declines, and the reason for each, by name.

    A case whose headline is declined stays whole: a solver has to refuse it.
    """
    declined = declined_quantities(solver, case)
    partly = bool(declined) and case.primary.name not in declined
    return (case.without(declined) if partly else case), declined
