"""An edited shell, solved from the earlier solution and from scratch in one process, with both costs. No mechanics.

The earlier solution goes through a file, as `run --start` takes it. Times are processor seconds of the solves, so that
other programs on the machine count little. Each solve has two times: that of the whole solve with its error estimate;
and the time to the same certified error, at which its energy is as low as that of both answers, up to the accuracy that
the case asks for.
"""

from __future__ import annotations

import tempfile
import time
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from shellbench.errors import InputError, SolveFailure
from shellbench.problem import Progress, ProgressCallback, Solution, Step
from shellbench.problems.series.edited import EditingCase
from shellbench.problems.solving import CheckedSolver, FreshSolver

THEORIES = ("kirchhoff-love-linear-edited", "kirchhoff-love-nonlinear-edited")
WAYS = ("scratch", "start")
SECONDS, REACHED, STEPS, UNKNOWNS, ENERGY = "seconds", "seconds_to_energy", "steps", "unknowns", "energy"
"""Diagnostics of every answer, each with `_scratch` and `_start` behind: whole solve and time to the same energy, s;
linear systems solved; unknowns of the largest; certified potential energy, J."""


@dataclass(frozen=True)
class Timed:
    """One solve: its answer, processor and wall seconds, and its certified potential energy, J."""

    solution: Solution
    seconds: float
    wall: float
    energy: float

    @property
    def solves(self) -> tuple[Step, ...]:
        """The steps of its history that are meshes, rungs or trainings, not states of a path."""
        return tuple(step for step in self.solution.history if step.phase == "solve")

    def reached(self, level: float) -> float | None:
        """Return the processor seconds until its energy was at most a level; None if it never was.

        Histories hold wall time; it is scaled as if other programs slowed the whole solve evenly.
        """
        if self.energy > level:
            return None
        after = next((step.seconds for step in self.solves if step.energy <= level), self.wall)
        return self.seconds * min(1.0, after / self.wall)


@dataclass(frozen=True, kw_only=True)
class EditedAnswer:
    """Answer to an edited shell: quantities (2, n), first from the earlier solution, then from scratch, m."""

    problem: ClassVar[Any] = EditingCase

    case: EditingCase
    values: NDArray[np.float64]
    unknowns: int
    history: tuple[Step, ...] = ()
    diagnostics: Mapping[str, Any] = field(default_factory=dict)
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    extrapolated: Mapping[str, float] = field(default_factory=dict)
    unsettled: str | None = None

    @property
    def parameters(self) -> int:
        """Unknowns of the answer from the earlier solution."""
        return self.unknowns

    @property
    def storage_bytes(self) -> int:
        """Bytes of the values that are kept."""
        return int(self.values.nbytes)

    @property
    def kept_values(self) -> NDArray[np.float64]:
        """All values, (2, n), m."""
        return self.values

    def value(self, name: str) -> float:
        """Return a quantity of the edited shell, solved from the earlier solution."""
        return float(self.values[0, [q.name for q in self.case.quantities].index(name)])

    def save(self, path: Path) -> Path:
        """Write the values as safetensors, the case in its header."""
        file = path.with_suffix(".safetensors")
        told = {"case": self.case.model_dump_json(exclude_unset=True), "unknowns": str(self.unknowns)}
        save_file({"values": self.values}, file, metadata=told)
        return file

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a file of `save`; InputError in one sentence if it is no such file."""
        try:
            with safe_open(path, framework="numpy") as file:
                told, values = dict(file.metadata() or {}), file.get_tensor("values")
            return cls(
                case=cls.problem.model_validate_json(told["case"]), values=values, unknowns=int(told["unknowns"])
            )
        except (OSError, SafetensorError, KeyError, ValueError, ValidationError) as error:
            raise InputError(f"{path} holds no edited answer: {' '.join(str(error).split())[:200]}") from None


class EditingSolver(FreshSolver):
    """A solver of a shell and then of its edit, by a solver of shells. A subclass gives `shells` and `energy`."""

    shells: ClassVar[type[CheckedSolver]]

    @abstractmethod
    def energy(self, solution: Solution) -> float:
        """Return the certified potential energy of a solution's last state, J."""

    def declines(self, case: Any) -> str | None:
        """Return the reason that the solver declines a problem, as one clause, or None if it takes it."""
        if not isinstance(case, EditingCase):
            return "it solves problems of kind 'editing' only"
        solver = self.shells()
        return solver.refusal(case.original) or solver.refusal(case.edited) or self.goes_on(case)

    def goes_on(self, case: EditingCase) -> str | None:
        """Return the reason that an earlier solution of the case's shell is of no use, or None if it is of use."""
        return None

    def load(self, path: Path) -> EditedAnswer:
        """Read the file of an answer."""
        return EditedAnswer.load(path)

    def answer(self, case: EditingCase, settings: Any, progress: ProgressCallback) -> EditedAnswer:
        """Solve the shell, then its edit both ways; SolveFailure if one of the solves fails."""
        with tempfile.TemporaryDirectory() as folder:
            progress(Progress(0, 3, "solving the shell as it was"))
            file = self._solved(case, "the original shell", case.original, settings).save(Path(folder) / "earlier")
            progress(Progress(1, 3, "solving the edited shell from scratch"))
            scratch = self._timed(case, settings, None)
            progress(Progress(2, 3, "solving the edited shell from the earlier solution"))
            start = self._timed(case, settings, file)
        return _answer(case, start, scratch)

    def _solved(self, case: EditingCase, which: str, shell: Any, settings: Any, start: Path | None = None) -> Any:
        try:
            return self.shells().solve(shell, settings, start)
        except SolveFailure as failure:
            raise SolveFailure(f"{which}: {failure}") from None

    def _timed(self, case: EditingCase, settings: Any, start: Path | None) -> Timed:
        which = "the edited shell" if start is None else "the edited shell from the earlier solution"
        wall, processor = time.perf_counter(), time.process_time()
        solution = self._solved(case, which, case.edited, settings, start)
        processor, wall = time.process_time() - processor, time.perf_counter() - wall
        return Timed(solution, processor, wall, self.energy(solution))


def _answer(case: EditingCase, start: Timed, scratch: Timed) -> EditedAnswer:
    names = [q.name for q in case.quantities]
    both = [
        [timed.solution.case.quantity(name).measure(timed.solution) for name in names] for timed in (start, scratch)
    ]
    lowest = min(start.energy, scratch.energy)
    level = lowest + case.accuracy * abs(lowest)
    told: dict[str, Any] = {}
    for way, timed in zip(WAYS, (scratch, start), strict=True):
        told |= {
            f"{SECONDS}_{way}": timed.seconds,
            f"{REACHED}_{way}": timed.reached(level),
            f"{STEPS}_{way}": sum(step.iterations or 0 for step in timed.solves),
            f"{UNKNOWNS}_{way}": max((step.unknowns for step in timed.solves), default=0),
            f"{ENERGY}_{way}": timed.energy,
        }
    apart = float(np.max(np.abs(np.subtract(both[0], both[1])) / np.maximum(np.abs(both[1]), np.finfo(float).tiny)))
    return EditedAnswer(
        case=case,
        values=np.array(both),
        unknowns=int(start.solution.parameters),
        history=tuple(replace(step, quantities={}) for step in start.solves),
        diagnostics={**told, "apart": apart},
        uncertainty=dict(start.solution.uncertainty),
        unsettled=getattr(start.solution, "unsettled", None),
    )
