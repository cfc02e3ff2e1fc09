"""Linear membrane and bending strains from the first variation of the deformed surface's metric and curvature.

The deformed surface is x + u. The first variations of its metric a_ab and curvature b_ab = a_a,b . a3 are

    delta a_ab = u,a . a_b + a_a . u,b
    delta b_ab = u,ab . a3 + x,ab . delta a3,    delta a3 = (m - (m . a3) a3) / J,
    m = u,1 x a2 + a1 x u,2,    J = |a1 x a2|

so that eps_ab = delta a_ab / 2 and kappa_ab = -delta b_ab (Kairanda et al., eqs. (15), (16), linearised). Nothing
large is subtracted from anything large: the triple product is turned over, x,ab . (m - (m . a3) a3) = p_ab . m with
p_ab the tangential part of x,ab, so that p . m = u,1 . (a2 x p) + u,2 . (p x a1).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.conditions import Material
from shellbench.solvers.fem.mesh import Derivative

Array = NDArray[np.float64]

DERIVATIVES: tuple[Derivative, ...] = ((1, 0), (0, 1), (2, 0), (0, 2), (1, 1))  # of u, that strains depend on
STRAINS: tuple[tuple[int, int], ...] = ((0, 0), (1, 1), (0, 1))  # covariant components 11, 22, 12
SECOND: tuple[Derivative, ...] = ((2, 0), (0, 2), (1, 1))  # the second derivative that goes with each of STRAINS


@dataclass(frozen=True)
class Midsurface:
    """Geometry of the reference midsurface at n points.

    Attributes
    ----------
    base
        (n, 2, 3) covariant base vectors a1, a2.
    normal
        (n, 3) unit normal a3 along a1 x a2.
    second
        (n, 3, 3) x,11, x,22, x,12.
    area
        (n,) |a1 x a2|, the area of the surface per area of the parametric rectangle.
    """

    base: Array
    normal: Array
    second: Array
    area: Array

    @classmethod
    def at(cls, x: Mapping[Derivative, Array]) -> Midsurface:
        """Make it of the derivatives (n, 3) of the position up to order 2."""
        base = np.stack([x[1, 0], x[0, 1]], axis=-2)
        product = np.cross(x[1, 0], x[0, 1])
        area = np.linalg.norm(product, axis=-1)
        return cls(base, product / area[..., None], np.stack([x[key] for key in SECOND], axis=-2), area)

    @property
    def contravariant_metric(self) -> Array:
        """a^ab (n, 2, 2)."""
        return np.asarray(np.linalg.inv(self.base @ np.swapaxes(self.base, -1, -2)), dtype=float)


def strain_operator(surface: Midsurface) -> Array:
    """Return the linear map from the derivatives of u to the strains.

    Parameters
    ----------
    surface
        Geometry at n points.

    Returns
    -------
    Array
        (n, 6, 3, 5): membrane strains eps_11, eps_22, eps_12, then bending strains kappa_11, kappa_22, kappa_12,
        by Cartesian component of u and by derivative in the order of `DERIVATIVES`.
    """
    a1, a2 = surface.base[:, 0], surface.base[:, 1]
    operator = np.zeros((len(surface.area), 6, 3, len(DERIVATIVES)))
    for row, (a, b) in enumerate(STRAINS):
        operator[:, row, :, a] += surface.base[:, b] / 2
        operator[:, row, :, b] += surface.base[:, a] / 2
    for row, key in enumerate(SECOND):
        curvature = np.sum(surface.second[:, row] * surface.normal, axis=-1, keepdims=True)
        tangential = (surface.second[:, row] - curvature * surface.normal) / surface.area[:, None]
        operator[:, 3 + row, :, 0] = -np.cross(a2, tangential)
        operator[:, 3 + row, :, 1] = -np.cross(tangential, a1)
        operator[:, 3 + row, :, DERIVATIVES.index(key)] = -surface.normal
    return operator


def elasticity(surface: Midsurface, poissons_ratio: float) -> Array:
    """Return H^{abcd} (n, 3, 3) on the components 11, 22, 12 (Kairanda et al., eq. (19)).

    The component 12 stands for itself and for 21, so that strain @ H @ strain is the full double contraction.
    """
    metric = surface.contravariant_metric
    nu = poissons_ratio
    h = np.empty((len(surface.area), 3, 3))
    for row, (a, b) in enumerate(STRAINS):
        for column, (c, d) in enumerate(STRAINS):
            times = (1 if a == b else 2) * (1 if c == d else 2)
            exchanged = metric[:, a, c] * metric[:, b, d] + metric[:, a, d] * metric[:, b, c]
            h[:, row, column] = times * (nu * metric[:, a, b] * metric[:, c, d] + (1 - nu) / 2 * exchanged)
    return h


def stress_root_operator(surface: Midsurface, material: Material) -> Array:
    """Return the operator (n, 6, 3, 5) whose squared length is twice the strain energy density.

    It is `strain_operator` times the square roots of the membrane and bending stiffness: with it a stiffness matrix
    is a product of a matrix with its own transpose, symmetric and positive semidefinite by construction.
    """
    operator = strain_operator(surface)
    root = np.swapaxes(np.linalg.cholesky(elasticity(surface, material.poissons_ratio)), -1, -2)
    flat = operator.reshape(len(operator), 2, 3, -1)
    stiffness = np.sqrt([material.membrane_stiffness, material.bending_stiffness])
    rooted = (root[:, None] @ flat) * stiffness[None, :, None, None]
    return rooted.reshape(operator.shape)
