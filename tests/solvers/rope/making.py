"""Chains and schemes of tests."""

import numpy as np

from shellbench.bench.catalogue import catalog
from shellbench.problems.rope.solving import Watch
from shellbench.solvers.rope.solver import PrintedSettings, RopeSettings, follow_rope, scheme_of
from shellbench.solvers.rope.stepping import Chains, Moving, Stepper


def scheme(*, printed=False, **settings):
    """Return a scheme; what is not given is as in `rope-exact`, or `rope-printed`."""
    return scheme_of((PrintedSettings if printed else RopeSettings)(**settings), printed=printed)


def stepper(chosen, lengths, masses, gravity, step=1.0):
    """Return steps of chains whose roots stand at the origin."""
    still = (np.zeros(3), np.zeros(3), np.zeros(3))
    return Stepper(Chains(lengths, masses, gravity, lambda _: still), chosen, step)


def hanging(angle, lengths):
    """Return a chain at rest at an angle, degrees, from straight down toward x."""
    along = np.array([np.sin(np.radians(angle)), 0.0, -np.cos(np.radians(angle))])
    places = np.cumsum(lengths)[:, None, None] * along
    return Moving(0.0, places, np.zeros_like(places))


def last(name, rate, **changes):
    """Return the last state of a case with so many steps a second."""
    return followed_last(catalog.named_case(name), rate, **changes)


def followed_last(case, rate, **changes):
    """Return the last state of a motion with so many steps a second."""
    return follow_rope(case, scheme(**changes), rate, Watch(case, "", lambda _: None))[-1]
