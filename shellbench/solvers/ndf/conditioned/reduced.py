"""The energy of a linear shell as a function of its material, and its least within the span of a few solved fields.

The energy density is W = 1/2 (D H eps eps + B H kappa kappa), with H = nu G + (1 - nu) S (Kairanda et al., eqs. (17)
to (19)), G = a^ab a^cd and S the symmetric rest. So the stiffness of any field is exactly

    K(material) = D nu K_1 + D (1 - nu) K_2 + B nu K_3 + B (1 - nu) K_4,

with four matrices that know nothing of the material. Integrated once, they give the energy of any material.

Within the span of n fields that were solved for at n materials, the best field of another material follows from an
n x n system: the reduced basis method (Hesthaven, Rozza & Stamm 2016, chapter 3). It is Ritz's method on few functions,
so that its energy can only be too high, and its derivative by the material is exact: K u' = -K' u.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.conditioned.case import Material
from shellbench.problems.conditioned.quantities import Parameter
from shellbench.solvers.ndf.field.combinations import DEPENDENT

Array = NDArray[np.float64]
ENERGY_PARTS = 4  # trace and rest of the membrane's energy, then of the bending's


def stiffnesses(material: Material) -> Array:
    """Return the factors (4,) of the parts: D nu, D (1 - nu), B nu, B (1 - nu)."""
    h, young, nu = material
    membrane = young * h / (1 - nu**2)
    bending = membrane * h**2 / 12
    return np.array([membrane * nu, membrane * (1 - nu), bending * nu, bending * (1 - nu)])


def stiffness_rates(material: Material, by: Parameter) -> Array:
    """Return the derivatives (4,) of the factors: by log h, by log E, or by nu."""
    h, young, nu = material
    if by == "youngs_modulus":
        return stiffnesses(material)
    if by == "thickness":
        return np.asarray(stiffnesses(material) * np.array([1, 1, 3, 3]))
    # nu / (1 - nu^2) has the derivative (1 + nu^2) / (1 - nu^2)^2; (1 - nu) / (1 - nu^2) = 1 / (1 + nu).
    membrane = young * h * np.array([(1 + nu**2) / (1 - nu**2) ** 2, -1 / (1 + nu) ** 2])
    return np.concatenate([membrane, membrane * h**2 / 12])


@dataclass(frozen=True)
class Reduced:
    """The energy 1/2 c K(material) c - f c of c, the coefficients of n fields.

    Attributes
    ----------
    parts, coarse
        (4, n, n): the four matrices on the fine quadrature, by which c is found, and on that of the solves.
    load
        (n,): work of the loads on each field, J.
    asked
        (n,): the asked displacement of each field, m.
    span
        (n, m): orthonormal combinations of the fields.
    """

    parts: Array
    coarse: Array
    load: Array
    asked: Array
    span: Array

    @classmethod
    def from_fields(cls, parts: Array, coarse: Array, load: Array, asked: Array, middle: Material) -> Reduced:
        """Choose combinations that are orthonormal in the energy of one material; what is rounding is left out."""
        gram = np.tensordot(stiffnesses(middle), parts, 1)
        unit = 1 / np.sqrt(gram.diagonal())
        values, vectors = np.linalg.eigh(gram * unit[:, None] * unit)
        kept = values > DEPENDENT * values[-1]
        return cls(parts, coarse, load, asked, unit[:, None] * vectors[:, kept] / np.sqrt(values[kept]))

    def without_last(self, number: int, middle: Material) -> Reduced:
        """Return the same of all fields but the last ones."""
        n = len(self.load) - number
        return Reduced.from_fields(self.parts[:, :n, :n], self.coarse[:, :n, :n], self.load[:n], self.asked[:n], middle)

    def _matrix(self, factors: Array) -> Array:
        return np.asarray(self.span.T @ np.tensordot(factors, self.parts, 1) @ self.span)

    def coefficients(self, material: Material) -> Array:
        """Return the c (n,) of least energy."""
        return np.asarray(self.span @ np.linalg.solve(self._matrix(stiffnesses(material)), self.span.T @ self.load))

    def rates(self, material: Material, by: Parameter) -> Array:
        """Return the derivative of c (n,) by the material: K c' = -K' c."""
        change = np.tensordot(stiffness_rates(material, by), self.parts, 1) @ self.coefficients(material)
        return np.asarray(-self.span @ np.linalg.solve(self._matrix(stiffnesses(material)), self.span.T @ change))

    def value(self, material: Material) -> float:
        """Return the asked displacement, m."""
        return float(self.asked @ self.coefficients(material))

    def sensitivity(self, material: Material, by: Parameter) -> float:
        """Return the derivative of its logarithm."""
        return float(self.asked @ self.rates(material, by)) / self.value(material)

    def energy(self, material: Material) -> float:
        """Return the least potential energy, J: minus half the work of the loads."""
        return -0.5 * float(self.load @ self.coefficients(material))

    def gap(self, material: Material) -> float:
        """Return the quadrature gap: how far the stiffness of the answer differs on the coarser quadrature."""
        c, factors = self.coefficients(material), stiffnesses(material)
        fine, coarse = (float(c @ np.tensordot(factors, one, 1) @ c) for one in (self.parts, self.coarse))
        return abs(coarse / fine - 1)

    def arrays(self) -> Mapping[str, Array]:
        """Return all arrays by name."""
        return {name: getattr(self, name) for name in ("parts", "coarse", "load", "asked", "span")}
