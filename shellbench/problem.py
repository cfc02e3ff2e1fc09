"""Solver and Solution: the two protocols that everything else stands on.

A solver turns a case into a solution; a solution is a continuous displacement field that can be asked
anywhere. Comparison, records and reports are written against these protocols and know no solver by name.
Solvers are found through the entry-point group ``shellbench.solvers``; our own register there like anyone's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from shellbench.model import Model
from shellbench.problems.shell.case import Case, Theory

Array = NDArray[np.float64]
Device = Literal["cpu", "cuda"]
NumberFormat = Literal["float64", "float32", "float16"]
Phase = Literal["solve", "path", "critical", "time"]

FIELDS = ("membrane_strain", "bending_strain", "membrane_energy_density", "bending_energy_density")
"""Names that `Solution.evaluate` knows.

Strains are (..., 3): covariant components 11, 22, 12 in the surface's coordinates, eps = (a - abar)/2 without
unit and kappa = bbar - b in 1/m, both times the coordinates' own units; densities are (...), J per square metre
of reference area.
"""


class Settings(Model):
    """Settings of a solver that computes the same answer every time.

    A setting called `checkpoint`, a folder or None, says where an interrupted solve is kept to go on from; the
    bench gives one. Settings that can't change the answer, like that one, are declared with `exclude=True`:
    they are no part of a run's identity.
    """


class SeededSettings(Settings):
    """Settings of a solver whose answer depends on a seed; it may run on an accelerator."""

    seed: int = Field(0, ge=0, le=2**31 - 1, strict=True, description="seed of the random numbers")
    device: Device = Field("cpu", description="where to run")


@dataclass(frozen=True)
class Capabilities:
    """What a solver can do.

    Attributes
    ----------
    theories
        Theories that it solves.
    devices
        Where it runs.
    label
        One line for tables: what the solver is, honestly.
    """

    theories: tuple[Theory, ...]
    label: str
    devices: tuple[Device, ...] = ("cpu",)


@dataclass(frozen=True)
class Step:
    """One entry of a solution's history: a refinement, an iteration, or a load step.

    Attributes
    ----------
    iteration
        Number of the step, from 0.
    seconds
        Wall time since the start of the solve.
    energy
        Potential energy of the step's own discretisation, J; of a step in time the kinetic energy and those of strains
        and springs, less the work done by loads and supports since rest: what has been lost or gained.
    unknowns
        Free parameters or degrees of freedom at this step.
    at
        Time, s, or load factor.
    gap
        Quadrature gap of this step, |C_train/C_fine - 1|; None where it was not measured.
    quantities
        The case's quantities at this step, by name, in SI; may be empty. Of a step of a path, its displacement
        quantities at the state of this step, whatever state they are asked for.
    phase
        "path": one equilibrium state of the final discretisation on its way from rest, in order: the
        load-displacement curve; "critical": the first state at which the shell can buckle, which is kept; "time": one
        step of a motion, in order; "solve": anything else.
    iterations
        Iterations that this step took; None where that says nothing.
    """

    iteration: int
    seconds: float
    energy: float
    unknowns: int
    at: float = 1.0
    gap: float | None = None
    quantities: Mapping[str, float] = field(default_factory=dict)
    phase: Phase = "solve"
    iterations: int | None = None


@dataclass(frozen=True)
class Progress:
    """What a running solve tells: the step it is at, of how many if it knows, and a word on it."""

    step: int
    total: int | None
    message: str


ProgressCallback = Callable[[Progress], None]


class Solution(Protocol):
    """A continuous displacement field and how it came about."""

    @property
    def case(self) -> Case:
        """The case it answers."""
        ...

    @property
    def history(self) -> tuple[Step, ...]:
        """How it came about, in order."""
        ...

    @property
    def parameters(self) -> int:
        """Number of free parameters (degrees of freedom, weights) that were solved for or trained."""
        ...

    @property
    def storage_bytes(self) -> int:
        """Bytes needed to keep what `displacement` needs, beside the case."""
        ...

    @property
    def diagnostics(self) -> Mapping[str, Any]:
        """Figures about the solve by name, such as ``residual`` or ``energy_gap``; JSON values only."""
        ...

    @property
    def uncertainty(self) -> Mapping[str, float]:
        """The solver's own estimate of its error by quantity, in the quantity's unit; may be empty."""
        ...

    @property
    def extrapolated(self) -> Mapping[str, float]:
        """Values extrapolated from the history by quantity; they stand beside the answer and never replace it."""
        ...

    def displacement(
        self, points: ArrayLike, at: float | None = None, material: Mapping[str, float] | None = None
    ) -> Array:
        """Return the displacement (..., 3) in metres at any points (..., 2), angles in radians.

        `at` is the time, s, or the load factor (the last one if None); a motion answers at any time that it has
        reached. `material` chooses one, for fields that are conditioned on materials; others refuse it by
        InputError, in one sentence.
        """
        ...

    def velocity(self, points: ArrayLike, at: float | None = None) -> Array:
        """Return the velocity (..., 3) in m/s at points (..., 2) and a time; zero in a static case."""
        ...

    def evaluate(self, name: str, points: ArrayLike, at: float | None = None) -> Array:
        """Return one of `FIELDS` at points (..., 2); KeyError for an unknown name."""
        ...

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Return the membrane and the bending part of the strain energy of the whole shell, J."""
        ...

    def reaction(
        self, support: str, centre: ArrayLike = (0.0, 0.0, 0.0), at: float | None = None
    ) -> tuple[Array, Array]:
        """Return force (3,) in N and moment (3,) about `centre` in N m that a support exerts on the shell."""
        ...

    def rounded(self, format: NumberFormat) -> tuple[Solution, int]:
        """Return the solution with all numbers that `displacement` needs rounded to a format, and the bytes it takes.

        What is asked of the rounded solution is computed in double precision. Each array may be kept with a power of
        two as its scale (see `shellbench.problems.rounding`). Plug-ins may lack this method; no precision is studied
        then.
        """
        ...

    def save(self, path: Path) -> Path:
        """Write the solution (safetensors or npz, never a pickle); return the file with its suffix."""
        ...


class Solver(Protocol):
    """Something that solves cases.

    Attributes
    ----------
    name
        Name on the command line and in records.
    capabilities
        What it can do.
    settings_type
        Its settings: a subclass of `Settings`, or of `SeededSettings` if a seed matters.
    """

    name: ClassVar[str]
    capabilities: ClassVar[Capabilities]
    settings_type: ClassVar[type[Settings]]

    def declines(self, case: Case) -> str | None:
        """Return why the solver can't take this case, as one clause, or None if it can."""
        ...

    def solve(
        self,
        case: Case,
        settings: Any,
        start: Solution | Path | None = None,
        progress: ProgressCallback | None = None,
    ) -> Solution:
        """Solve the case.

        `start` is an earlier solution, or a checkpoint file of an interrupted solve, to go on from; a solver that can't
        refuses it by InputError, in one sentence.

        Raises
        ------
        SolveFailure
            If no trustworthy answer was reached; what had converged comes with it.
        InputError
            If the settings or `start` do not fit the case.
        """
        ...

    def load(self, path: Path) -> Solution:
        """Read a solution that `Solution.save` wrote."""
        ...
