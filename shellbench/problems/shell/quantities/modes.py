"""Modes as quantities: frequencies of small vibrations, and load factors at which a shell buckles.

A case asks for one of the two and for nothing else. Its states are its modes: the mark of a state is the number of the
mode, and the displacement there is the mode's shape, whose largest magnitude is about 1 m. Modes are numbered from 1 by
their values; a value that occurs twice has two numbers. Free rigid motions are no modes.

Vibration:  (K + G(S)) u = omega^2 M u, f = omega / 2 pi, about the linear answer to the case's loads with stresses S;
            without loads about the shell at rest.
Buckling:   K u = -lambda G(S) u, lambda > 0. All loads and moved supports of the case grow by lambda, S with them.
"""

from __future__ import annotations

from typing import Any, ClassVar, Literal

from pydantic import Field

from shellbench.problems.shell.field import DisplacementField
from shellbench.problems.shell.quantities.quantity import ShellQuantity

LARGEST_NUMBER = 100  # of a mode


class ModeQuantity(ShellQuantity):
    """The value of a mode of small vibration or of buckling.

    Attributes
    ----------
    number
        Number of the mode, from 1, by increasing value. Rigid motions do not count.
    """

    series: ClassVar[Literal["motion", "path", ""]] = ""
    of_field: ClassVar[bool] = False
    powers: ClassVar[tuple[int, int]] = (0, 0)
    number: int = Field(1, ge=1, le=LARGEST_NUMBER, strict=True)

    @property
    def mark(self) -> float | None:
        """The number of the mode."""
        return float(self.number)

    def check_path(self, shell: Any) -> None:
        """Raise ValueError if a case can't be asked for modes, or also asks for something else."""
        if not shell.linear:
            raise ValueError(f"quantity '{self.name}' needs the theory kirchhoff-love-linear")
        other = next((q for q in shell.quantities if q.kind not in (self.kind, "derivative")), None)
        if other is not None:
            raise ValueError(
                f"quantity '{other.name}' is of kind '{other.kind}', but a case that asks for a quantity of kind"
                f" '{self.kind}' asks for no other kind"
            )
        if self.at != type(self).model_fields["at"].default:
            raise ValueError(f"quantity '{self.name}' has a 'number', and no 'at'")
        if shell.prescribed:
            raise ValueError(f"quantity '{self.name}' needs a shell that can move, but its whole surface is prescribed")

    def check_motion(self, shell: Any, constant: bool) -> None:
        """Raise ValueError: a case in motion has no modes here."""
        raise ValueError(f"quantity '{self.name}' belongs to a case without [dynamics]")

    def measure(self, solution: DisplacementField) -> float:
        """Return the value of the mode."""
        known = getattr(solution, "mode_values", {})
        if self.number not in known:
            raise ValueError(f"the solution has no mode {self.number}")
        return float(known[self.number])


class Frequency(ModeQuantity):
    """The frequency of a mode of small vibration about the state that the case's loads lead to, or about rest, Hz."""

    kind: Literal["frequency"]
    unit: str = "Hz"

    def check_path(self, shell: Any) -> None:
        """Raise ValueError if the shell has no mass, or as `ModeQuantity` does."""
        super().check_path(shell)
        density = shell.material.areal_density
        if density <= 0:
            raise ValueError(
                f"quantity '{self.name}' is a frequency and needs a mass: field 'material.areal_density' is"
                f" {density:g}, and must be positive"
            )


class BucklingLoad(ModeQuantity):
    """The factor by which all loads and moved supports grow together until the shell buckles in a mode."""

    kind: Literal["buckling_load"]
    unit: str = ""

    def check_path(self, shell: Any) -> None:
        """Raise ValueError if nothing loads the shell, if it may turn freely, or as `ModeQuantity` does."""
        super().check_path(shell)
        if not shell.loads and not any(support.motion is not None for support in shell.supports):
            raise ValueError(f"quantity '{self.name}' is a buckling load, but nothing loads the shell")
        turns = next((name for name in shell.remove_rigid_motions if name.startswith("rotation")), None)
        if turns is not None:
            raise ValueError(
                f"quantity '{self.name}' is a buckling load, but nothing holds the shell against {turns}:"
                " dead loads on a shell that may turn freely have none"
            )


def why_too_few(asked: int, positive: int, nearest: float | None) -> str:
    """Return the reason that a shell has fewer buckling loads than the case asks for, in one sentence.

    Parameters
    ----------
    asked, positive
        The number of load factors, and how many of them are above zero.
    nearest
        The negative factor that is nearest to zero; None if it is not known.
    """
    if positive:
        return f"the load buckles the shell in {positive} modes on this mesh, and {asked} are asked for"
    turned = "" if nearest is None else f", the nearest is {nearest:.6g}"
    return f"the load cannot buckle the shell: all factors are negative{turned}"
