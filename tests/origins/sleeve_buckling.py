r"""Critical twist and critical compression of the clamped sleeve.

Before buckling the sleeve stays axisymmetric; its exact state is found by Newton's method in functions of y alone. It
is unstable as soon as the second variation is negative for some perturbation q(y) exp(i n theta). Per wave number n the
smallest eigenvalue of K v = mu K0 v, with K0 the second variation at rest, falls from 1 at rest to 0 where the sleeve
buckles.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import brentq

from .sleeve import Array, Matrix, Rims, Sleeve, State

LoadPath = Callable[[float], Rims]

NEWTON_STEPS = 40
SMALL = 1e-12
"""A Newton step that promises less than this fraction of the energy ends the iteration."""


def twisting(twist: float) -> Rims:
    """Rims turned, and held axially."""
    return Rims(twist=twist)


def compressing(shortening: float) -> Rims:
    """Rims moved toward each other, and not turned."""
    return Rims(shortening=shortening)


def axisymmetric(sleeve: Sleeve, rims: Rims) -> State:
    """Return the axisymmetric equilibrium that belongs to small loads, by Newton's method from rest.

    Raises
    ------
    ArithmeticError : Newton's method does not converge
    """
    q = np.zeros(sleeve.size)
    for _ in range(NEWTON_STEPS):
        state = sleeve.state(q, rims)
        step = np.linalg.solve(state.second_variation(), -state.residual)
        q = q + step
        if abs(step @ state.residual) <= SMALL**2 * state.energy:
            return sleeve.state(q, rims)
    raise ArithmeticError("no axisymmetric equilibrium found")


def softest(state: State, number: int, at_rest: Matrix) -> tuple[float, Matrix]:
    """Smallest mu of K v = mu K0 v for perturbations of a wave number, and its v.

    `at_rest` is K0, the second variation of the undeformed sleeve for the same perturbations.
    """
    stiffness = state.second_variation(state.sleeve.waves(number))
    values, vectors = eigh(stiffness, at_rest, subset_by_index=[0, 0])
    return float(values[0]), vectors[:, 0]


def stiffness_at_rest(sleeve: Sleeve, number: int) -> Matrix:
    """Second variation of the undeformed sleeve for perturbations of a wave number."""
    return sleeve.state(np.zeros(sleeve.size), Rims()).second_variation(sleeve.waves(number))


@dataclass(frozen=True)
class Buckling:
    """Where an axisymmetric state turns unstable: wave number, load parameter, state and mode."""

    number: int
    load: float
    state: State
    mode: Matrix


def buckling(sleeve: Sleeve, path: LoadPath, number: int, loads: Sequence[float]) -> Buckling | None:
    """Return the first change of stability for a wave number between ascending loads, None if there is none."""
    at_rest = stiffness_at_rest(sleeve, number)

    def smallest(load: float) -> float:
        return softest(axisymmetric(sleeve, path(load)), number, at_rest)[0]

    for low, high in pairwise(loads):
        if smallest(high) < 0:
            load = float(brentq(smallest, low, high, xtol=1e-9 * high, rtol=1e-12))
            state = axisymmetric(sleeve, path(load))
            return Buckling(number, load, state, softest(state, number, at_rest)[1])
    return None


def spectrum(sleeve: Sleeve, path: LoadPath, numbers: Sequence[int], loads: Sequence[float]) -> list[Buckling]:
    """First changes of stability for several wave numbers, the first of all first."""
    found = [buckling(sleeve, path, number, loads) for number in numbers]
    return sorted((b for b in found if b is not None), key=lambda b: b.load)


def mode_as_state(mode: Matrix, functions: int) -> Array:
    """Real part of a mode exp(i n theta), as coefficients of 1, cos n theta, sin n theta, (3 * 3 * functions,)."""
    m = mode.reshape(3, functions)
    return np.stack([0 * m.real, m.real, -m.imag], axis=1).ravel()
