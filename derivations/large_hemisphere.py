r"""Hemisphere with a hole of 18 degrees at large displacement: a quarter of it by splines, from positions.

Radius 10, thickness .04, Young's modulus 6.825e7, Poisson's ratio .3; four radial forces of 400 at the free equator,
outward and inward in turn (Sze, Liu & Lo 2004). Each force is spread along the equator as a Gaussian of standard
deviation .1: a point force has a part in the surface once the equator has turned, and under that part the displacement
of a Kirchhoff-Love shell is infinite, if only as the logarithm of the mesh. The spans at both forces are halved until
they resolve the Gaussian.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sparse

from .estimate import Estimate
from .hemisphere import OBLIQUE, POISSON, RADIUS, THICKNESS, TOP, YOUNG, sphere
from .patch import Mesh, breaks, converged
from .spline_path import load_control
from .spline_shell import Ends, Shell
from .surface_strains import Array

FORCE, SPREAD = 400.0, 0.1
FACTORS = 0.05, 0.1, 0.25, 0.5, 0.75, 1.0
FREE: Ends = ("free", "free")


class Resting(Shell):
    """A quarter that is not held along z but at its last corner, xi1 = 90 degrees at the hole."""

    @cached_property
    def reduction(self) -> sparse.csr_array:
        """Matrix from the free to all coefficients: the last one is the height of the corner."""
        return sparse.csr_array(super().reduction[:, :-1])


def line_load(angle: Array) -> Array:
    """Force per length of the equator: half of the outward force is on this side of its plane of symmetry."""
    return FORCE / (np.sqrt(2 * np.pi) * SPREAD) * np.exp(-((RADIUS * angle / SPREAD) ** 2) / 2)


def pulled_quarter(mesh: Mesh) -> Shell:
    """A quarter between the planes y = 0, of the outward force, and x = 0, of the inward one."""
    one = breaks(0.0, np.pi / 2, mesh.spans[0], (True, True), mesh.halvings)
    two = breaks(0.0, TOP, mesh.spans[1], (True,), mesh.halvings)
    splines = mesh.splines(one, two)
    ends: list[tuple[Ends, Ends]] = [(("even", "zero"), FREE), (("zero", "even"), FREE), (("even", "even"), FREE)]
    # Gauss's rule of the spans along the equator: a force at each of its points.
    angles, weights = (values.ravel() for values in splines[0].gauss)
    outward, inward = (RADIUS * weights * line_load(a) for a in (angles, angles - np.pi / 2))
    forces = tuple((float(a), 0.0, (float(p), -float(q), 0.0)) for a, p, q in zip(angles, outward, inward, strict=True))
    return Resting(sphere, splines, ends, YOUNG, POISSON, THICKNESS, forces=forces)


def _pulled(mesh: Mesh) -> dict[str, float]:
    shell = pulled_quarter(mesh)
    *_, state = load_control(shell, FACTORS)
    membrane, bending = shell.energies(state.free)
    theta, latitude, direction = OBLIQUE
    return {
        "U_A": float(shell.row(0.0, 0.0, (1.0, 0.0, 0.0)) @ state.free),
        "V_B": float(shell.row(np.pi / 2, 0.0, (0.0, -1.0, 0.0)) @ state.free),
        "oblique_displacement": float(shell.row(theta, latitude, direction) @ state.free),
        "strain_energy": membrane + bending,
        "membrane_energy": membrane,
        "bending_energy": bending,
    }


def hemisphere_hole_nonlinear() -> dict[str, Estimate]:
    """Known values; the uncertainty is the change from fewer spans."""
    return converged(_pulled, Mesh((36, 30), 5, 4), Mesh((28, 24), 5, 4))
