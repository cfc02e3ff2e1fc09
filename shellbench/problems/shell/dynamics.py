"""Dynamics: that a case is one of motion, and until when."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from shellbench.model import Model, Positive

SHORTEST, LONGEST = 1e-9, 1e9  # seconds: what is beyond is a slip of the pen


class Dynamics(Model):
    """A motion by Newton's law, from rest at t = 0.

    The areal density times the acceleration is the load less the derivative of the strain energy, and nothing damps it.

    Attributes
    ----------
    until
        Final time, s.
    states
        Times that are kept beside those that quantities ask for, s.
    """

    until: Annotated[Positive, Field(ge=SHORTEST, le=LONGEST)]
    states: tuple[Positive, ...] = ()
