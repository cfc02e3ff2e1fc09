"""One solve for each held-out material, and derivatives by central differences of such solves."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from shellbench.errors import InputError
from shellbench.problem import Progress, ProgressCallback, Step
from shellbench.problems.series.conditioned import ASKED, ConditionedCase, Material
from shellbench.problems.series.conditioned_answer import SECONDS_BEFORE, SECONDS_EACH, ConditionedAnswer, stepped
from shellbench.problems.series.quantities import Parameter, Sensitivity, Value
from shellbench.problems.solving import CheckedSolver
from shellbench.solvers.fem.conditioned_settings import RepeatedSettings
from shellbench.solvers.fem.settings import FemSettings

NOT_ASKED = np.nan


@dataclass(frozen=True, kw_only=True)
class RepeatedSolution(ConditionedAnswer):
    """The asked displacements (n,), m, and their derivatives (n, 3), by parameter; NaN for derivatives not asked."""

    values: NDArray[np.float64]
    derivatives: NDArray[np.float64]
    unknowns: int

    @property
    def parameters(self) -> int:
        """Degrees of freedom of all materials together."""
        return self.unknowns

    @property
    def storage_bytes(self) -> int:
        """Bytes of the values that are kept, without the meshes."""
        return int(self.values.nbytes + self.derivatives.nbytes)

    def value(self, number: int) -> float:
        """Return the asked displacement, m, at a held-out material."""
        return float(self.values[number])

    def sensitivity(self, number: int, by: Parameter) -> float:
        """Return a derivative of its logarithm."""
        return float(self.derivatives[number, Material._fields.index(by)])

    def save(self, path: Path) -> Path:
        """Write the values as safetensors, the case in its header."""
        file = path.with_suffix(".safetensors")
        arrays = {"values": self.values, "derivatives": self.derivatives}
        save_file(arrays, file, metadata={"case": self.case.model_dump_json(), "unknowns": str(self.unknowns)})
        return file

    @classmethod
    def load(cls, path: Path) -> RepeatedSolution:
        """Read a file of `save`; InputError in one sentence if it is no such file."""
        try:
            with safe_open(path, framework="numpy") as file:
                told = dict(file.metadata() or {})
                values, derivatives = file.get_tensor("values"), file.get_tensor("derivatives")
            case, unknowns = ConditionedCase.model_validate_json(told["case"]), int(told["unknowns"])
        except (OSError, SafetensorError, KeyError, ValueError, ValidationError) as error:
            raise InputError(f"{path} holds no repeated solution: {' '.join(str(error).split())[:200]}") from None
        return cls(case=case, values=values, derivatives=derivatives, unknowns=unknowns)


@dataclass(frozen=True)
class _Answer:
    """The answer to one material: displacement and its uncertainty, m, degrees of freedom, seconds, energy, J."""

    value: float
    uncertainty: float | None
    unknowns: int
    seconds: float
    energy: float


def solve(
    case: ConditionedCase, settings: RepeatedSettings, shells: CheckedSolver, progress: ProgressCallback
) -> RepeatedSolution:
    """Solve for each held-out material by `shells`, and four times more for each derivative that is asked."""
    begin = time.perf_counter()
    count, answer = len(case.materials), partial(_solve, case, settings, shells)
    values, derivatives = np.full(count, NOT_ASKED), np.full((count, len(Material._fields)), NOT_ASKED)
    uncertainty: dict[str, float] = {}
    steps: list[Step] = []
    solved: list[_Answer] = []
    for number, material in enumerate(case.materials):
        progress(Progress(number, count, f"material {number}"))
        one = answer(material)
        values[number] = one.value
        solved.append(one)
        steps.append(Step(number, time.perf_counter() - begin, one.energy, one.unknowns))
        for quantity in case.quantities:
            if quantity.material != number:
                continue
            if isinstance(quantity, Value):
                spread = one.uncertainty
            else:
                found, spread = _difference(answer, material, quantity, settings.step)
                derivatives[number, Material._fields.index(quantity.by)] = found
            if spread is not None:
                uncertainty[quantity.name] = spread
    return RepeatedSolution(
        case=case,
        history=tuple(steps),
        uncertainty=uncertainty,
        diagnostics={SECONDS_BEFORE: 0.0, SECONDS_EACH: _mean(one.seconds for one in solved)},
        values=values,
        derivatives=derivatives,
        unknowns=sum(one.unknowns for one in solved),
    )


def _solve(case: ConditionedCase, settings: RepeatedSettings, shells: CheckedSolver, material: Material) -> _Answer:
    shell = case.near(material)
    start = time.perf_counter()
    found = shells.solve(shell, FemSettings(cells=settings.cells))
    value = shell.quantity(ASKED).measure(found)
    seconds = time.perf_counter() - start
    return _Answer(value, found.uncertainty.get(ASKED), found.parameters, seconds, found.history[-1].energy)


def _difference(
    answer: Callable[[Material], _Answer], material: Material, quantity: Sensitivity, width: float
) -> tuple[float, float | None]:
    """Return a difference quotient of the logarithm, and its uncertainty.

    Central differences over one and two steps give one of fourth order, (4 D(step) - D(2 step)) / 3. Its uncertainty is
    the estimated error of D(step), which the formula removes, and that of the solves.
    """
    quotients, relative = [], 0.0
    known = True
    for step in (width, 2 * width):
        below, above = (answer(stepped(material, quantity.by, way * step)) for way in (-1, 1))
        quotients.append(math.log(above.value / below.value) / (2 * step))
        for one in (below, above):
            known = known and one.uncertainty is not None
            relative = max(relative, (one.uncertainty or 0.0) / abs(one.value))
    near, far = quotients
    # A relative error u of each displacement gives an error u / step of the quotient over one step, and half of it over
    # two.
    spread = (4 / 3 + 1 / 6) * relative / width
    return (4 * near - far) / 3, abs(near - far) / 3 + spread if known else None


def _mean(numbers: Iterable[float]) -> float:
    return float(np.mean(list(numbers)))
