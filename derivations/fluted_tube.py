r"""A closed cylinder between diaphragms, pinched by two forces under a pressure of short waves.

The forces are those of `pinched_diaphragm`, the pressure is p cos(n t) sin(m pi x / L), t measured from a force, with even n and
odd m: inward under both forces. By superposition, the pressure alone answers with one double harmonic, of the amplitude w0 under the
forces, and the strain energy is

    W = W_pinched + p w0 pi R L / 4 + 2 P w0,

half the work of the pressure and, by Betti, all the work of both forces on what the pressure moves. Membrane and bending share the
last two as they share the energy of the harmonic, which meets no other one.

The first form solves three equations for the harmonic; the second one the eight boundary conditions of the harmonic around, by
Legendre polynomials along x, and takes the pinched cylinder by polynomials too.
"""

from __future__ import annotations

import numpy as np

from .cylinder import strains_of_angular_harmonic, strains_of_double_harmonic
from .estimate import Estimate
from .pinched_diaphragm import LOAD, pinched_cylinder, pinched_cylinder_diaphragm
from .pinched_free import diaphragm_by_polynomials
from .strip import Strip

AROUND, ALONG = 40, 21  # waves around, half waves along
PRESSURE = 2e-2  # Pa


def _joined(pinched: dict[str, Estimate], inward: float, share: float) -> dict[str, Estimate]:
    """Join the pinched cylinder and the harmonic's amplitude, m, with the membrane's share of its energy."""
    cylinder = pinched_cylinder()
    more = PRESSURE * inward * np.pi * cylinder.radius * cylinder.length / 4 + 2 * LOAD * inward
    added = {"strain_energy": more, "membrane_energy": share * more, "bending_energy": (1 - share) * more}
    found = {}
    for name, estimate in pinched.items():
        value = added.get(name, inward)
        found[name] = Estimate(estimate.value + value, estimate.uncertainty + 1e-9 * abs(value), estimate.unit)
    return found | {"load_deflection": found["load_displacement"]}


def fluted_tube() -> dict[str, Estimate]:
    """Known values of cases/fluted_tube.toml: double harmonics."""
    cylinder = pinched_cylinder()
    s = strains_of_double_harmonic(cylinder.radius, np.array(ALONG * np.pi / cylinder.length), np.array(AROUND))
    membrane, bending = (s.T @ part @ s for part in cylinder.elasticity())
    q = np.linalg.solve(membrane + bending, [0.0, 0.0, PRESSURE])
    return _joined(pinched_cylinder_diaphragm(), float(q[2]), float(q @ membrane @ q / (PRESSURE * q[2])))


def fluted_tube_by_polynomials(degree: int = 90) -> dict[str, Estimate]:
    """Values by Legendre polynomials along the axis."""
    cylinder = pinched_cylinder()
    strip = Strip(0.0, cylinder.length, degree)
    membrane, bending = strip.stiffnesses(strains_of_angular_harmonic(cylinder.radius, AROUND), cylinder.elasticity())
    load = strip.distributed_load(
        lambda x: np.outer(PRESSURE * np.sin(ALONG * np.pi * x / cylinder.length), [0.0, 0.0, 1.0])
    )
    q = strip.minimise(membrane + bending, load, ("V(left)", "W(left)", "V(right)", "W(right)"))
    inward = strip.basis(np.array([cylinder.length / 2]))[0, 0, 2] @ q
    return _joined(diaphragm_by_polynomials(), float(inward), float(q @ membrane @ q / (load @ q)))
