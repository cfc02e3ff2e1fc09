"""The solution along a path: one field at each mark that a case keeps, all of the same features."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from shellbench.problem import NumberFormat
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.solution import state_number
from shellbench.solvers.ndf.build import FieldSpec, build_ansatz
from shellbench.solvers.ndf.field import Ansatz
from shellbench.solvers.ndf.jets import Array
from shellbench.solvers.ndf.motion_solution import MotionSolution, read_motion
from shellbench.solvers.ndf.solution import FieldSolution, NdfSolution, read_states
from shellbench.solvers.ndf.weights import StateHeader, read, short_enough, write


@dataclass(frozen=True)
class PathSolution(FieldSolution):
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

    @property
    def case(self) -> Case:
        """The case it answers."""
        return self.states[-1].case

    @property
    def parameters(self) -> int:
        """Number of output weights that were solved for at each state, and of those that were trained."""
        return self.states[-1].parameters

    def state(self, at: float | None) -> NdfSolution:
        """Return the state at a mark, the last one if None; InputError if the case was not solved at it."""
        return self.states[state_number(self.case, self.marks, at)]

    def displacement_at(self, xi: Array, at: float | None) -> Array:
        """Return the displacement (N, 3) at points (N, 2)."""
        return self.state(at).displacement_at(xi, None)

    def field_at(self, name: str, xi: Array, at: float | None) -> Array:
        """Return strains (N, 3) or energy densities (N,) at points (N, 2)."""
        return self.state(at).field_at(name, xi, None)

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Return the membrane and the bending part of the strain energy of the whole shell, J."""
        return self.state(at).energies()

    def reaction_at(self, number: int, centre: Array, at: float | None) -> tuple[Array, Array]:
        """Return force (3,) in N and moment (3,) about `centre` in N m that a support exerts on the shell."""
        return self.state(at).reaction_at(number, centre, None)

    def tensors(self) -> dict[str, Tensor]:
        """Return the tensors of the features, which all states share, and those of all states."""
        return {
            **self.states[-1].tensors(),
            "output": torch.stack([s.field.output for s in self.states]),
            "rigid": torch.stack([s.field.rigid for s in self.states]),
        }

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
        header = self.states[-1].header.model_copy(update={**self.facts(), "states": headers})
        return write(path, header, self.tensors())


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
    states = read_states(path, header, tensors, ansatz_of)
    if not header.states:
        return replace(states[0], **header.course())
    return PathSolution(marks=tuple(s.mark for s in header.states), states=states, **header.course())
