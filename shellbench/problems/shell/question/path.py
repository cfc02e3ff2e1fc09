"""Paths: the load of a static case from rest, and the states that are kept.

Dynamics: the motion of a case, and its final time.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from shellbench.protocol.schema import Finite, Model, Name, Positive


class Path(Model):
    """Path of the load factor t from rest, where t = 0, and the states that are kept.

    Attributes
    ----------
    control
        "load": t is prescribed and grows to `until`. "displacement": the displacement quantity grows to `until`, and
        t follows from equilibrium. "arc_length": the path is followed through turning points of both, until the
        displacement quantity first reaches `until`.
    quantity
        Name of that displacement quantity.
    until
        End of the path: a load factor, or a displacement in metres.
    after_buckling
        Under load control, at a state that is no minimum of the energy: "stop" there, or "follow" the shell to a stable
        state and go on from it. A path that stops ends there if critical points are asked for, and fails otherwise.
    states
        Marks of further states to keep, beside those of the quantities: load factors, or values of the displacement
        quantity at its first passage.
    """

    control: Literal["load", "displacement", "arc_length"] = "load"
    quantity: Name | None = None
    until: Positive = 1.0
    after_buckling: Literal["stop", "follow"] = "stop"
    states: tuple[Positive, ...] = ()

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        if (self.control == "load") != (self.quantity is None):
            raise ValueError("a path names its displacement quantity if, and only if, its control is not 'load'")
        if self.after_buckling == "follow" and self.control != "load":
            raise ValueError("after_buckling = 'follow' belongs to a path with control = 'load'")
        if any(state > self.until for state in self.states):
            raise ValueError(f"the path ends at {self.until:g}, but a state beyond it is to be kept")
        return self


SHORTEST, LONGEST = 1e-9, 1e9  # seconds: a time outside is taken as a mistake in the file


class Dynamics(Model):
    """A motion by Newton's law, from rest at t = 0.

    The areal density times the acceleration is the load less the derivative of the strain energy, and less Rayleigh's
    damping. Its power per reference area is alpha rho |v|^2 + beta (A de . de + D dk . dk), of the velocity and of the
    rates de and dk of the strains and changes of curvature: a rigid turn does not feel beta. A small vibration of
    frequency w about rest decays as exp(-(alpha + beta w^2) t / 2). Springs are not damped.

    Attributes
    ----------
    until
        Final time, s.
    states
        Further times to keep, beside those of the quantities, s.
    mass_damping
        Rayleigh's alpha, 1/s: the damping force per mass and velocity.
    stiffness_damping
        Rayleigh's beta, s: the stress by a rate of strain, over that by the same strain (Kelvin and Voigt).
    """

    until: Annotated[Finite, Field(ge=SHORTEST, le=LONGEST)]
    states: tuple[Positive, ...] = ()
    mass_damping: Annotated[Finite, Field(ge=0)] = 0.0
    stiffness_damping: Annotated[Finite, Field(ge=0)] = 0.0

    @property
    def damped(self) -> bool:
        """True if the motion is damped."""
        return self.mass_damping > 0 or self.stiffness_damping > 0
