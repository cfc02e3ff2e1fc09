r"""Critical twist and critical compression of the clamped sleeve.

Before buckling the sleeve stays axisymmetric; its exact state is found by Newton's method in functions of y alone. It
is unstable as soon as the second variation is negative for some perturbation q(y) exp(i n theta). Per wave number n the
smallest eigenvalue of K v = mu K0 v, with K0 the second variation at rest, falls from 1 at rest to 0 where the sleeve
buckles. R = 0.25 m, L = 1 m, E = 5000 Pa, nu = 0.25:

| h, m | load | waves | runners-up |
|---|---|---|---|
| 0.012 | twist | 4 | 5 (16 % later), 3 (25 %) |
| 0.012 | compression | 4 | 4 with the other symmetry in y (0.7 %), 3 (7 %), 5 (7 %) |
| 0.0012 | twist | 8 | 7 (1.8 %), 9 (4.7 %) |
| 0.0012 | compression | 13 | 13 with the other symmetry in y (5e-7), 12 (4e-4), 14 (1 %) |

Second forms: the torque before buckling is nearly that of a membrane, 2 pi R^3 G h / L a radian; the critical force of a
thin cylinder that stays a cylinder until it buckles is 2 pi E h^2 / sqrt(3 (1 - nu^2)), and the clamped rims of the
thin sleeve take 7 % off it; the critical torque of a long tube tends to 2 pi R^2 h tau,
tau = E / (3 sqrt(2) (1 - nu^2)^(3/4)) (h / R)^(3/2), two waves (S. P. Timoshenko and J. M. Gere, Theory of Elastic
Stability, ch. 11).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import brentq

from .estimate import Estimate
from .sleeve import Rims, Sleeve, State
from .sleeve_functions import Matrix
from .surface_strains import Array

LoadPath = Callable[[float], Rims]

NEWTON_STEPS = 40
SMALL = 1e-24
"""Promised change of the energy, as a fraction of it, that ends Newton's method."""
ROUNDING = 1e-9
"""Relative error of a critical load by rounding: zero is found among eigenvalues of order one."""


def twisting(twist: float) -> Rims:
    """Rims turned, and held axially."""
    return Rims(twist=twist)


def compressing(shortening: float) -> Rims:
    """Rims moved toward each other, and not turned."""
    return Rims(shortening=shortening)


def axisymmetric(sleeve: Sleeve, rims: Rims, start: Array | None = None) -> State:
    """Return an axisymmetric equilibrium by Newton's method, from given coefficients or from rest.

    Raises
    ------
    ArithmeticError : Newton's method does not converge
    """
    q = np.zeros(sleeve.size) if start is None else start
    for _ in range(NEWTON_STEPS):
        state = sleeve.state(q, rims)
        step = np.linalg.solve(state.second_variation(), -state.residual)
        q = q + step
        if abs(step @ state.residual) <= SMALL * state.energy:
            return sleeve.state(q, rims)
    raise ArithmeticError("no axisymmetric equilibrium found")


def stiffness_at_rest(sleeve: Sleeve, number: int) -> Matrix:
    """Second variation of the undeformed sleeve for perturbations of a wave number."""
    return sleeve.state(np.zeros(sleeve.size), Rims()).second_variation(sleeve.waves(number))


def softness(state: State, number: int, at_rest: Matrix, rank: int = 0) -> float:
    """Smallest mu (or that of a higher rank) of K v = mu K0 v for perturbations of a wave number.

    `at_rest` is K0, the second variation of the undeformed sleeve for the same perturbations.
    """
    stiffness = state.second_variation(state.sleeve.waves(number))
    return float(eigh(stiffness, at_rest, eigvals_only=True, subset_by_index=[rank, rank])[0])


@dataclass(frozen=True)
class Buckling:
    """Where an axisymmetric state turns unstable: wave number, load parameter (rad or m) and state."""

    number: int
    load: float
    state: State


def bucklings(
    sleeve: Sleeve, path: LoadPath, numbers: Sequence[int], loads: Sequence[float], rank: int = 0
) -> list[Buckling]:
    """Return the first change of stability of each wave number that has one by the last load, in order of load.

    The loads ascend, and each axisymmetric state is sought from the one before.

    Raises
    ------
    ValueError : the state at the first load is unstable already
    """
    states: list[State] = []
    for load in loads:
        states.append(axisymmetric(sleeve, path(load), states[-1].coefficients if states else None))
    found = []
    for number in numbers:
        at_rest = stiffness_at_rest(sleeve, number)
        unstable = [k for k, s in enumerate(states) if softness(s, number, at_rest, rank) < 0]
        if unstable and unstable[0] == 0:
            raise ValueError(f"wave number {number} is unstable at the first load")
        if unstable:
            below, high = states[unstable[0] - 1], loads[unstable[0]]

            def at(load: float, below: State = below) -> State:
                return axisymmetric(sleeve, path(load), below.coefficients)

            def margin(load: float, number: int = number, at_rest: Matrix = at_rest) -> float:
                return softness(at(load), number, at_rest, rank)

            load = float(brentq(margin, loads[unstable[0] - 1], high, xtol=1e-10 * high))
            found.append(Buckling(number, load, at(load)))
    return sorted(found, key=lambda b: b.load)


# --- estimates -----------------------------------------------------------------------------------

THICK, THIN = 0.012, 0.0012


def critical(thickness: float, path: LoadPath, numbers: Sequence[int], loads: Sequence[float], functions: int) -> State:
    """Return the state in which the sleeve buckles, the first over all wave numbers."""
    return bucklings(Sleeve(thickness, functions=functions), path, numbers, loads)[0].state


def twist_estimates(fine: State, coarse: State) -> dict[str, Estimate]:
    """Critical twist, rad, and torque, N m, of two discretisations."""
    twists, torques = ((s.rims.twist for s in (fine, coarse)), (s.torque for s in (fine, coarse)))
    return {
        "critical_twist": Estimate.between(*twists, "rad", ROUNDING * fine.rims.twist),
        "critical_torque": Estimate.between(*torques, "N m", ROUNDING * fine.torque),
    }


def compression_estimates(fine: State, coarse: State) -> dict[str, Estimate]:
    """Critical force, N, and shortening, m, of two discretisations."""
    ways, forces = ((s.rims.shortening for s in (fine, coarse)), (s.force for s in (fine, coarse)))
    return {
        "critical_force": Estimate.between(*forces, "N", ROUNDING * fine.force),
        "critical_shortening": Estimate.between(*ways, "m", ROUNDING * fine.rims.shortening),
    }


def sleeve_compression() -> dict[str, Estimate]:
    """Known values of the compressed sleeve, h = 0.012 m."""
    loads = (0.012, 0.018, 0.024, 0.0265)
    return compression_estimates(*(critical(THICK, compressing, range(9), loads, n) for n in (36, 26)))


def sleeve_compression_thin() -> dict[str, Estimate]:
    """Known values of the compressed sleeve of h = 0.0012 m: on the way, and where it buckles."""
    loads = (0.0018, 0.0023, 0.0026, 0.0027)
    values = compression_estimates(*(critical(THIN, compressing, range(21), loads, n) for n in (88, 72)))
    for millimetres in (1, 2):
        fine, coarse = (axisymmetric(Sleeve(THIN, functions=n), compressing(millimetres / 1000)) for n in (88, 72))
        values[f"force_{millimetres}mm"] = Estimate.between(fine.force, coarse.force, "N", ROUNDING * fine.force)
        values |= {f"{name}_{millimetres}mm": energy for name, energy in energy_estimates(fine, coarse).items()}
    return values


def sleeve_twist_thin() -> dict[str, Estimate]:
    """Known values of the twisted sleeve of h = 0.0012 m: on the way, and where it buckles."""
    loads = (0.003, 0.004, 0.005)
    values = twist_estimates(*(critical(THIN, twisting, range(17), loads, n) for n in (44, 34)))
    fine, coarse = (axisymmetric(Sleeve(THIN, functions=n), twisting(0.004)) for n in (44, 34))
    values["torque_4mrad"] = Estimate.between(fine.torque, coarse.torque, "N m", ROUNDING * fine.torque)
    return values | {"strain_energy_4mrad": energy_estimates(fine, coarse)["strain_energy"]}


def energy_estimates(fine: State, coarse: State) -> dict[str, Estimate]:
    """Energies, J, of two discretisations."""
    pairs = {"strain_energy": (fine.energy, coarse.energy), "bending_energy": (fine.energies[1], coarse.energies[1])}
    return {name: Estimate.between(*pair, "J", ROUNDING * pair[0]) for name, pair in pairs.items()}
