"""Quantities of energy: of strain, of motion, and of a path."""

from __future__ import annotations

import math
from typing import Any, ClassVar, Literal

from shellbench.problems.shell.field import DisplacementField
from shellbench.problems.shell.quantities.measure import kinetic_energy, total_energy
from shellbench.problems.shell.quantities.quantity import ShellQuantity


class EnergyQuantity(ShellQuantity):
    """Strain energy of the whole shell, or its membrane or bending part, J."""

    of_field: ClassVar[bool] = True
    powers: ClassVar[tuple[int, int]] = (1, 1)
    kind: Literal["strain_energy", "membrane_energy", "bending_energy"]
    unit: str = "J"

    def measure(self, solution: DisplacementField) -> float:
        """Return the energy, J."""
        membrane, bending = solution.energies(self.at)
        return {"membrane_energy": membrane, "bending_energy": bending}.get(self.kind, membrane + bending)


class MotionEnergy(ShellQuantity):
    """Kinetic energy of the whole shell, its total energy, or the balance of its energy, J.

    The total energy is kinetic energy, strain energy and that of the springs, less the work of the loads. The loads
    have to be constant in time; a motion from rest then keeps it at zero. The balance is stated by the solver's own
    history at each step, with the work of all loads and supports. Its value is the largest distance from zero until the
    time. It counts what damping takes. Impacts and friction take energy: cases with obstacles have neither quantity.
    """

    powers: ClassVar[tuple[int, int]] = (1, 1)
    kind: Literal["kinetic_energy", "total_energy", "energy_balance"]
    unit: str = "J"

    def check_path(self, shell: Any) -> None:
        """Raise ValueError: a static case has none."""
        raise ValueError(f"quantity '{self.name}' needs a case with [dynamics]")

    def check_motion(self, shell: Any, constant: bool) -> None:
        """Raise ValueError if the case asks for the total energy, and it is not conserved."""
        kept = constant and not shell.following and all(load.spread for load in shell.loads)
        kept = kept and not shell.dynamics.damped
        if self.kind == "total_energy" and not kept:
            raise ValueError(
                f"quantity '{self.name}' needs supports at rest, no damping, and loads that are dead, constant and"
                " spread out"
            )
        if self.kind == "energy_balance" and shell.obstacles:
            raise ValueError(f"quantity '{self.name}' has no obstacles: impacts and friction take energy")

    def measure(self, solution: DisplacementField) -> float:
        """Return the energy, J.

        Raises
        ------
        ValueError
            If the history has no step of the motion until its time.
        """
        if self.kind == "kinetic_energy":
            return kinetic_energy(solution, self.at)
        if self.kind == "total_energy":
            return total_energy(solution, self.at)
        kept = [step for step in solution.history if step.phase == "time" and step.at <= self.at * (1 + 1e-9)]
        if not kept:
            raise ValueError(f"the history has no step of the motion until {self.at:g} s")
        return max(abs(step.energy) for step in kept)


class PotentialEnergy(ShellQuantity):
    """The potential energy of a state of a path, or of a linear shell, J, as the solver's own history states it.

    It is the energy of strains and springs less the work of the loads. Dead loads work on the displacement, and a
    moment works on the angle by which the normal has turned about its axis; each with its value at that state. Moved
    supports are no loads. For a linear shell, the last step of the history counts: the state that is asked for last.
    """

    series: ClassVar[Literal["motion", "path", ""]] = ""
    powers: ClassVar[tuple[int, int]] = (1, 1)
    kind: Literal["potential_energy"]
    unit: str = "J"

    def check_path(self, shell: Any) -> None:
        """Raise ValueError if loads have no potential or do not control the path, or the state is not the last one."""
        if shell.linear and (shell.obstacles or shell.prescribed or self.at != max(shell.states)):
            raise ValueError(
                f"quantity '{self.name}' needs, in linear theory, a shell that loads or supports move without"
                " obstacles, at the last state that is asked for"
            )
        if shell.path.control != "load" or shell.following:
            raise ValueError(
                f"quantity '{self.name}' needs a path with control = 'load', and loads that do not follow the shell"
            )

    def check_motion(self, shell: Any, constant: bool) -> None:
        """Raise ValueError: a motion has a total energy instead."""
        raise ValueError(f"quantity '{self.name}' belongs to a [path], not to [dynamics]")

    def measure(self, solution: DisplacementField) -> float:
        """Return the energy, J."""
        phases = ("path", "solve") if solution.case.linear else ("path",)
        there = [step.energy for step in solution.history if step.phase in phases and math.isclose(step.at, self.at)]
        if not there:
            raise ValueError(f"the history has no state at {self.at:g}")
        return float(there[-1])
