"""Solutions: the interface of an answer to a problem, and its history."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Protocol

from shellbench.protocol.history import Phase

NumberFormat = Literal["float64", "float32", "float16"]
FIELDS = ("membrane_strain", "bending_strain", "membrane_energy_density", "bending_energy_density")
"""Names that a shell solution's `evaluate` knows.

Strains are (..., 3): covariant components 11, 22, 12 in the surface's coordinates, eps = (a - abar)/2 without
unit and kappa = bbar - b in 1/m, both times the coordinates' own units; densities are (...), J per square metre
of reference area.
"""


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
        Potential energy of the step's own discretisation, J. For a step in time: the kinetic energy and those of
        strains and springs, less the work done by loads and supports since rest, which is the energy lost or gained.
    unknowns
        Free parameters or degrees of freedom at this step.
    at
        Time, s, or load factor.
    gap
        Quadrature gap of this step, |C_train/C_fine - 1|; None where it was not measured.
    quantities
        The case's quantities at this step, by name, in SI; may be empty. For a step of a path: its displacement
        quantities at the state of this step, whatever their own state is.
    phase
        "path": one equilibrium state of the final discretisation on the path from rest, in order, which gives the
        load-displacement curve; "critical": the first state at which the shell can buckle, which is kept; "time": one
        step of a motion, in order; "solve": all other steps.
    iterations
        Number of iterations of this step; None if it has no meaning.
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
    """A report of a running solve: the current step, the number of steps if it is known, and a message."""

    step: int
    total: int | None
    message: str


ProgressCallback = Callable[[Progress], None]


class Solution(Protocol):
    """An answer to a problem, and its history.

    One attribute is optional: `unsettled`, the reason why the answer has not settled, as one clause, such as "centre_z
    still moves by 2e-3 when features of other kinds join". If it is None or missing, the answer has settled. An answer
    also has not settled if the stated uncertainty of its headline is more than a hundredth of it.
    """

    @property
    def case(self) -> Any:
        """The solved problem."""
        ...

    @property
    def history(self) -> tuple[Step, ...]:
        """The history of the solution, in order."""
        ...

    @property
    def parameters(self) -> int:
        """Number of free parameters (degrees of freedom, weights), solved for or trained."""
        ...

    @property
    def storage_bytes(self) -> int:
        """Bytes of the stored answer, without the problem."""
        ...

    @property
    def diagnostics(self) -> Mapping[str, Any]:
        """Data about the solve by name, such as ``residual`` or ``energy_gap``; JSON values only."""
        ...

    @property
    def uncertainty(self) -> Mapping[str, float]:
        """The solver's own estimate of its error by quantity, in the quantity's unit; may be empty."""
        ...

    @property
    def extrapolated(self) -> Mapping[str, float]:
        """Values extrapolated from the history by quantity; they are shown with the answer and never replace it."""
        ...

    def save(self, path: Path) -> Path:
        """Write the solution (safetensors or npz, never a pickle); return the file with its suffix."""
        ...
