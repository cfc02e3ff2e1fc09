r"""A plate rolled into an arc, and a shell turned as a rigid body: energies of prescribed displacements.

Rolled without stretch to the angle theta over its length L, a plate has eps = 0 and kappa_11 = theta / L in size
everywhere: W = 1/2 B (theta / L)^2 L b with B = E h^3 / 12 for nu = 0. A rigid motion changes neither the metric nor
the curvature: W = 0. `sampled_energy` is the second form: it sees positions of points only, of which it differentiates
the interpolating polynomials.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Chebyshev

from .estimate import Estimate
from .surface_strains import DERIVATIVES, strains

NODES = 16
"""Points a direction: the arcs of these cases turn by less than a revolution and are resolved to rounding."""


@dataclass(frozen=True)
class Plate:
    """Length along which it is rolled, width and thickness in m, Young's modulus in Pa; no Poisson's effect."""

    length: float = 1.0
    width: float = 0.5
    thickness: float = 0.01
    young: float = 1.2e7

    @property
    def bending_stiffness(self) -> float:
        """B = E h^3 / 12, N m."""
        return self.young * self.thickness**3 / 12.0


def bending_energy(plate: Plate, angle: float) -> float:
    """Bending energy (J) of the plate rolled by so many radians."""
    return 0.5 * plate.bending_stiffness * (angle / plate.length) ** 2 * plate.length * plate.width


def rolled_plate() -> dict[str, Estimate]:
    """Known values of the rolled plate at every quarter of its path."""
    plate = Plate()
    return {
        f"bending_energy_{degrees}": Estimate.exact(bending_energy(plate, np.radians(degrees)), "J")
        for degrees in (45, 90, 135, 180)
    }


def rigid_rotation() -> dict[str, Estimate]:
    """Known values of the rigid rotation: none stores anything."""
    return {f"strain_energy_{degrees}": Estimate(0.0, 0.0, "J") for degrees in (90, 180)}


Surface = Callable[[np.ndarray, np.ndarray], np.ndarray]


def _differentiation(start: float, end: float) -> tuple[np.ndarray, list[np.ndarray], np.ndarray]:
    """Nodes, matrices from values there to derivatives of order 0, 1, 2, and weights of their quadrature."""
    nodes = np.polynomial.chebyshev.chebpts1(NODES)
    x = start + (end - start) * (nodes + 1) / 2
    cardinal = [Chebyshev.fit(x, row, NODES - 1, domain=[start, end]) for row in np.eye(NODES)]
    matrices = [np.array([f.deriv(k)(x) if k else f(x) for f in cardinal]).T for k in range(3)]
    return x, matrices, np.array([f.integ(lbnd=start)(end) for f in cardinal])


def sampled_energy(
    reference: Surface, deformed: Surface, domain: tuple[tuple[float, float], tuple[float, float]], plate: Plate
) -> float:
    """Strain energy (J) between two surfaces known at points only, orthonormal in the reference, nu = 0.

    Parameters
    ----------
    reference, deformed : positions (n, n, 3) at xi1 and xi2 (n, n), both lengths of the reference
    domain : ends of xi1 and of xi2, m
    plate : thickness and Young's modulus
    """
    (one, first, weight_one), (two, second, weight_two) = (_differentiation(*ends) for ends in domain)
    grid = np.meshgrid(one, two, indexing="ij")
    bent, flat = (
        strains(np.stack([np.einsum("pi,qj,ijc->pqc", first[a], second[b], x) for a, b in DERIVATIVES], axis=2))
        for x in (deformed(*grid), reference(*grid))
    )
    change = (bent - flat) ** 2 * [1.0, 1.0, 0.5, 1.0, 1.0, 0.5]
    stretching = plate.young * plate.thickness
    density = stretching * change[..., :3].sum(-1) + plate.bending_stiffness * change[..., 3:].sum(-1)
    return float(weight_one @ density @ weight_two / 2)


SAMPLED = 1e-11
"""Uncertainty of a sampled energy relative to that of the plate rolled by 180 degrees: rounding."""


def sampled_plate() -> dict[str, Estimate]:
    """Values of the rolled plate from positions."""
    plate = Plate()
    domain = (0.0, plate.length), (0.0, plate.width)
    scale = bending_energy(plate, np.pi)
    values = {}
    for degrees in (45, 90, 135, 180):
        rate = np.radians(degrees) / plate.length

        def arc(one: np.ndarray, two: np.ndarray, rate: float = rate) -> np.ndarray:
            return np.stack([np.sin(rate * one) / rate, two, (1 - np.cos(rate * one)) / rate], -1)

        energy = sampled_energy(lambda one, two: np.stack([one, two, 0 * one], -1), arc, domain, plate)
        values[f"bending_energy_{degrees}"] = Estimate(energy, SAMPLED * scale, "J")
    return values


def sampled_rotation() -> dict[str, Estimate]:
    """Values of the rigid rotation from positions, without Poisson's effect: there is no strain for it to act on."""
    axis = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
    centre = np.array([0.5, 0.0, 0.0])
    plate = Plate(thickness=0.01, young=1e6)

    def cylinder(one: np.ndarray, two: np.ndarray) -> np.ndarray:
        return np.stack([np.cos(one), two, np.sin(one)], -1)

    def turned(one: np.ndarray, two: np.ndarray) -> np.ndarray:
        arm = cylinder(one, two) - centre
        along = (arm @ axis)[..., None] * axis
        return centre + along + np.cos(angle) * (arm - along) + np.sin(angle) * np.cross(axis, arm)

    values = {}
    for degrees in (90, 180):
        angle = np.radians(degrees)
        energy = sampled_energy(cylinder, turned, ((np.pi / 6, 5 * np.pi / 6), (0.0, 2.0)), plate)
        values[f"strain_energy_{degrees}"] = Estimate(energy, SAMPLED * plate.young * plate.thickness**3, "J")
    return values
