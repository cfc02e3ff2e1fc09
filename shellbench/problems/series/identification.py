"""Parameters of a shell from measured values: least squares by Gauss and Newton with the solver's own derivatives.

With data y_i, the quantities Q_i(p) of the shell with parameters p, and residuals r_i = Q_i / y_i - 1, an iteration is

    log p <- log p - (J^T J)^-1 J^T r,    J = d r / d log p.

If each datum has a relative error of standard deviation s, that of log p is the root of the diagonal of s^2 (J^T J)^-1.
The data come from derivations, never from a solver.
"""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from shellbench.errors import SolveFailure
from shellbench.problem import Progress, ProgressCallback, Quantity, Step
from shellbench.problems.series.edited_answer import EditedAnswer
from shellbench.problems.series.shell_table import SeriesCase
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.parameters import changed, parameters_of
from shellbench.problems.solving import FreshSolver
from shellbench.protocol.schema import Finite, Model, Positive, one_sentence

Array = NDArray[np.float64]

THEORIES = ("kirchhoff-love-linear-identified", "kirchhoff-love-nonlinear-identified")
MOST_ITERATIONS = 20
SETTLED = 1e-9  # change of log p that ends the iterations
FARTHEST = 0.7  # largest step of log p: farther, the linear model says nothing


class Datum(Model):
    """A measured value of a quantity of the shell."""

    quantity: dict[str, Any] = Field(description="table of the quantity, as in a case of kind `shell`; without a name")
    value: Finite = Field(description="measured value, in the quantity's unit; not zero")


class Identified(Quantity):
    """A parameter that is found, or its predicted scatter under noise of the data."""

    kind: Literal["identified", "scatter"]
    parameter: str = Field(description="its name, as in a derivative of a shell's quantity")

    def measure(self, solution: Any) -> float:
        """Return the parameter, or the standard deviation by which it would scatter, in its unit."""
        values: float = solution.found(self.parameter)[self.kind == "scatter"]
        return values


class IdentificationCase(SeriesCase):
    """A shell some parameters of which are unknown, and measured values.

    Attributes
    ----------
    unknowns
        Unknown parameters by name, and the values from which the search starts.
    measured
        Measured values.
    noise
        Relative standard deviation of each datum, for the predicted scatter.
    quantities
        What is asked; exactly one is primary.
    """

    kind: Literal["identification"]
    theory: Literal["kirchhoff-love-linear-identified", "kirchhoff-love-nonlinear-identified"]
    unknowns: Annotated[dict[str, Positive], Field(min_length=1)]
    measured: Annotated[tuple[Datum, ...], Field(min_length=1)]
    noise: Positive = Field(0.01, lt=1)
    quantities: Annotated[tuple[Identified, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _can_be_found(self) -> Self:
        known = parameters_of(self.start)
        for name in (*self.unknowns, *(q.parameter for q in self.quantities)):
            if name not in known:
                raise ValueError(f"'{name}' is no parameter of the shell; known are {', '.join(known)}")
        if asked := next((q.parameter for q in self.quantities if q.parameter not in self.unknowns), None):
            raise ValueError(f"'{asked}' is asked for, but is not among the unknowns {list(self.unknowns)}")
        if len(self.measured) < len(self.unknowns):
            raise ValueError(f"{len(self.measured)} data can't determine {len(self.unknowns)} unknowns")
        if any(datum.value == 0 for datum in self.measured):
            raise ValueError("a datum is zero: residuals are relative")
        self.shell_with(list(self.unknowns.values()))
        return self

    @cached_property
    def start(self) -> Case:
        """The shell of the file."""
        asked = [{**d.quantity, "name": f"datum_{n}", "primary": n == 1} for n, d in enumerate(self.measured, start=1)]
        return self.shell_case(self.shell, f"{self.base}_shell", asked, "of the shell")

    def shell_with(self, values: Sequence[float]) -> Case:
        """Return the shell with values of the unknowns; ValueError in one sentence if there is none."""
        found, known = self.start, parameters_of(self.start)
        for name, value in zip(self.unknowns, values, strict=True):
            found = changed(found, known[name], float(value))
        try:
            return Case.model_validate(found.data() | {"name": self.start.name})
        except ValidationError as error:
            raise ValueError(f"with {list(self.unknowns)} = {list(values)}: {one_sentence(error)}") from None


@dataclass(frozen=True, kw_only=True)
class IdentifiedAnswer(EditedAnswer):
    """Found parameters: values (2, n), the unknowns in the order of the case and their predicted scatter."""

    problem: ClassVar[Any] = IdentificationCase
    case: Any

    def found(self, parameter: str) -> tuple[float, float]:
        """Return a parameter and its predicted standard deviation."""
        value, scatter = self.values[:, list(self.case.unknowns).index(parameter)]
        return float(value), float(scatter)


class IdentifyingSolver(FreshSolver):
    """A solver that finds parameters by solving shells. A subclass gives `shell` and `values`."""

    def declines(self, case: Any) -> str | None:
        """Return the reason that the solver declines a problem, as one clause, or None if it takes it."""
        if not isinstance(case, IdentificationCase):
            return "it solves problems of kind 'identification' only"
        return self.refuses(case.start)

    @abstractmethod
    def refuses(self, shell: Case) -> str | None:
        """Return the reason that it declines a shell, as one clause, or None."""

    @abstractmethod
    def values(
        self, case: IdentificationCase, logarithms: Array, settings: Any
    ) -> tuple[Array, Array, dict[str, int], Any]:
        """Return the data's quantities (m,), their derivatives by log p (m, n), numbers of solves, and a solution."""

    def load(self, path: Any) -> IdentifiedAnswer:
        """Read the file of an answer."""
        return IdentifiedAnswer.load(path)

    def answer(self, case: IdentificationCase, settings: Any, progress: ProgressCallback) -> IdentifiedAnswer:
        """Find the parameters; SolveFailure if the iterations do not settle."""
        began, counts, steps = time.perf_counter(), dict[str, int](), list[Step]()
        measured, x = np.array([d.value for d in case.measured]), np.log(list(case.unknowns.values()))
        for number in range(MOST_ITERATIONS):
            q, slopes, solves, solution = self.values(case, x, settings)
            counts = {name: counts.get(name, 0) + count for name, count in solves.items()}
            residual, jacobian = q / measured - 1, slopes / measured[:, None]
            step = np.linalg.lstsq(jacobian, -residual, rcond=None)[0]
            steps.append(Step(number, time.perf_counter() - began, float(residual @ residual / 2), len(x)))
            progress(Progress(number + 1, None, f"residual {np.abs(residual).max():.1e}"))
            if np.abs(step).max() <= SETTLED:
                break
            x = x + step * min(1.0, FARTHEST / np.abs(step).max())
        else:
            raise SolveFailure(f"the search did not settle in {MOST_ITERATIONS} iterations")
        scatter = case.noise * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
        known = solution.uncertainty
        error = np.abs(np.linalg.pinv(jacobian)) @ [known.get(f"datum_{n + 1}", 0.0) / abs(y) for n, y in enumerate(q)]
        unsure = dict(zip(case.unknowns, error * np.exp(x), strict=True))
        return IdentifiedAnswer(
            case=case,
            values=np.array([np.exp(x), np.exp(x) * scatter]),
            unknowns=len(x),
            history=tuple(steps),
            diagnostics={"iterations": len(steps), **counts},
            uncertainty={q.name: float(unsure[q.parameter]) for q in case.quantities if q.kind == "identified"},
            unsettled=getattr(solution, "unsettled", None),
        )
