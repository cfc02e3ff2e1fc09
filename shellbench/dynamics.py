"""Dynamics: that a case is one of motion, and until when."""

from __future__ import annotations

from shellbench.model import Model, Positive


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

    until: Positive
    states: tuple[Positive, ...] = ()
