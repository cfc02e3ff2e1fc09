"""The solution along a path: one field at each mark that a case keeps, all of the same features."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike

from shellbench.errors import InputError
from shellbench.problem import NumberFormat, Step
from shellbench.problems.shell.case import Case
from shellbench.solvers.ndf.build import FieldSpec, build_ansatz
from shellbench.solvers.ndf.field import Ansatz
from shellbench.solvers.ndf.jets import Array
from shellbench.solvers.ndf.motion_solution import MotionSolution, read_motion
from shellbench.solvers.ndf.rounding import short_enough
from shellbench.solvers.ndf.solution import NdfSolution, read_solution
from shellbench.solvers.ndf.weights import StateHeader, read, write

SAME_MARK = 1e-9  # relative difference of two marks that are one


@dataclass(frozen=True)
class PathSolution:
    """Fields at increasing marks; see `shellbench.problem.Solution` for the protocol.

    Attributes
    ----------
    marks
        Load factors, or values of the path's displacement quantity.
    states
        The field at each of them; its `spec.t` is the load factor.
    """

    marks: tuple[float, ...]
    states: tuple[NdfSolution, ...]
    history: tuple[Step, ...] = ()
    diagnostics: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    uncertainty: Mapping[str, float] = dataclasses.field(default_factory=dict)
    extrapolated: Mapping[str, float] = dataclasses.field(default_factory=dict)

    @property
    def case(self) -> Case:
        """The case it answers."""
        return self.states[-1].case

    @property
    def parameters(self) -> int:
        """Number of output weights that were solved for at each state, and of those that were trained."""
        return self.states[-1].parameters

    @property
    def storage_bytes(self) -> int:
        """Bytes of the tensors of all states."""
        last = self.states[-1]
        output, rigid = last.field.output, last.field.rigid
        each = output.numel() * output.element_size() + rigid.numel() * rigid.element_size()
        return last.storage_bytes + (len(self.states) - 1) * each

    def state(self, at: float | None) -> NdfSolution:
        """Return the state at a mark, the last one if None.

        Raises
        ------
        InputError
            If the case was not solved at it.
        """
        if at is None:
            return self.states[-1]
        nearest = int(np.argmin(np.abs(np.asarray(self.marks) - at)))
        if abs(self.marks[nearest] - at) > SAME_MARK * abs(at):
            known = ", ".join(f"{mark:g}" for mark in self.marks)
            raise InputError(f"{self.case.name}: solved at {known}, not at {at:g}")
        return self.states[nearest]

    def displacement(
        self, points: ArrayLike, at: float | None = None, parameters: Mapping[str, float] | None = None
    ) -> Array:
        """Return the displacement (..., 3), metres, at points (..., 2), angles in radians."""
        return self.state(at).displacement(points)

    def velocity(self, points: ArrayLike, at: float | None = None) -> Array:
        """Return the velocity (..., 3) at points (..., 2): zero, because nothing moves."""
        return np.zeros((*np.asarray(points).shape[:-1], 3))

    def evaluate(self, name: str, points: ArrayLike, at: float | None = None) -> Array:
        """Return one of `shellbench.problem.FIELDS` at points (..., 2); KeyError for an unknown name."""
        return self.state(at).evaluate(name, points)

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Return the membrane and the bending part of the strain energy of the whole shell, J."""
        return self.state(at).energies()

    def reaction(
        self, support: str, centre: ArrayLike = (0.0, 0.0, 0.0), at: float | None = None
    ) -> tuple[Array, Array]:
        """Return force (3,) in N and moment (3,) about `centre` in N m that a support exerts on the shell."""
        return self.state(at).reaction(support, centre)

    def rounded(self, format: NumberFormat) -> tuple[PathSolution, int]:
        """Return the path with all weights rounded to a format, and the bytes it takes; see `NdfSolution.rounded`."""
        if all(short_enough(state.tensors().values(), format) for state in self.states):
            return self, self.storage_bytes
        last, bytes_taken = self.states[-1].rounded(format)
        states = [last]
        for state in self.states[-2::-1]:
            before, more = state.on_rounded(last.field.features, format)
            states.insert(0, before)
            bytes_taken += more
        return replace(self, states=tuple(states)), bytes_taken

    def save(self, path: Path) -> Path:
        """Write the solution as safetensors, all else as JSON in its header; return the file with its suffix."""
        headers = tuple(
            StateHeader(
                mark=mark, t=s.spec.t, membrane=s.membrane, bending=s.bending, point_forces=tuple(s.point_forces)
            )
            for mark, s in zip(self.marks, self.states, strict=True)
        )
        last = replace(
            self.states[-1],
            history=self.history,
            diagnostics=self.diagnostics,
            uncertainty=self.uncertainty,
            extrapolated=self.extrapolated,
        )
        header, tensors = last.header.model_copy(update={"states": headers}), last.tensors()
        tensors["output"] = torch.stack([s.field.output for s in self.states])
        tensors["rigid"] = torch.stack([s.field.rigid for s in self.states])
        return write(path, header, tensors)


def load_solution(
    path: Path, solver: str, ansatz_of: Callable[[Case, FieldSpec], Ansatz] = build_ansatz
) -> NdfSolution | PathSolution | MotionSolution:
    """Read a field at rest, on a path or in motion; `ansatz_of` builds the supports in as the recipe does.

    Raises
    ------
    InputError
        In one sentence, if the file is not a whole and consistent solution of this solver.
    """
    header, tensors = read(path, solver)
    if header.moving:
        return read_motion(path, header, tensors)
    header, states = read_solution(path, solver, ansatz_of)
    if not header.states:
        return states[0]
    last = states[-1]
    return PathSolution(
        marks=tuple(s.mark for s in header.states),
        states=tuple(replace(s, history=(), diagnostics={}, uncertainty={}, extrapolated={}) for s in states),
        history=last.history,
        diagnostics=last.diagnostics,
        uncertainty=last.uncertainty,
        extrapolated=last.extrapolated,
    )
