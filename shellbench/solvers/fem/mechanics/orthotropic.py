"""The elasticity of orthotropic shells, by the directions of their material (`question.orthotropic`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.question.orthotropic import OrthotropicMaterial, StiffeningCurve

Array = NDArray[np.float64]


def orthotropic_elasticity(
    base: Array, normal: Array, contravariant_metric: Array, material: OrthotropicMaterial
) -> Array:
    """Return A and D over their scales, H (n, 2, 3, 3), on the components 11, 22, 12 of the coordinates.

    With d1 and d2 the material's directions and d^a their contravariant components, E11 = d1^a d1^b eps_ab, E22
    likewise and 2 E12 = 2 d1^a d2^b eps_ab; H = T^T M T for the matrix T of these three.
    """
    turn = material_strains(base, normal, contravariant_metric, material)
    scales = material.membrane_stiffness, material.bending_stiffness
    parts = [np.swapaxes(turn, 1, 2) @ (m / k) @ turn for m, k in zip(material.stiffnesses, scales, strict=True)]
    return np.stack(parts, axis=1)


def material_strains(base: Array, normal: Array, contravariant_metric: Array, material: OrthotropicMaterial) -> Array:
    """Return the matrices T (n, 3, 3) of `orthotropic_elasticity`."""
    line = base[:, 0 if material.along == "xi1" else 1]
    line = line / np.linalg.norm(line, axis=-1, keepdims=True)
    angle = np.radians(material.angle)
    first = np.cos(angle) * line + np.sin(angle) * np.cross(normal, line)
    second = np.cross(normal, first)
    (p, q), (r, s) = (np.einsum("nab,nbi,ni->an", contravariant_metric, base, d) for d in (first, second))
    turn = np.stack([p * p, q * q, 2 * p * q, r * r, s * s, 2 * r * s, 2 * p * r, 2 * q * s, 2 * (p * s + q * r)])
    return turn.T.reshape(-1, 3, 3)


@dataclass(frozen=True)
class StiffeningMembrane:
    """The membrane of woven cloth at n points, with the energy of Clyde et al. 2017 (`question.orthotropic`).

    Attributes
    ----------
    material
        One with `stiffening`.
    turn
        (n, 3, 3) see `material_strains`.
    """

    material: OrthotropicMaterial
    turn: Array

    def respond(self, strains: Array) -> tuple[Array, Array, Array]:
        """Return energies (n,), stresses (n, 3) and moduli (n, 3, 3), an area, at strains (n, 3) on 11, 22, 12."""
        # With e = (E11, E22, 2 E12) = T eps: W = A12 e1 e2 + sum of c phi(s e), phi(E) = eta(E^2)/2, s = 1/2 in shear.
        e = (self.turn @ strains[..., None])[..., 0]
        coupled = self.material.stiffnesses[0][0, 1]
        energy, stress, moduli = coupled * e[:, 0] * e[:, 1], np.zeros_like(e), np.zeros_like(self.turn)
        stress[:, :2] = coupled * e[:, 1::-1]
        moduli[:, 0, 1] = moduli[:, 1, 0] = coupled
        for row, ((curve, factor, least), share) in enumerate(zip(self.material.curves, (1, 1, 0.5), strict=True)):
            strain = share * e[:, row]
            kept = np.clip(strain, least, curve.until)
            # phi = eta/2, phi' = E eta' and phi'' = eta' + 2 E^2 eta'' within the range, and their Taylor series beyond
            beyond, (eta, rate, slope) = strain - kept, eta_with_derivatives(curve, kept**2)
            second = rate + 2 * kept**2 * slope
            energy += factor * (eta / 2 + kept * rate * beyond + second * beyond**2 / 2)
            stress[:, row] += factor * share * (kept * rate + second * beyond)
            moduli[:, row, row] += factor * share**2 * second
        back = np.swapaxes(self.turn, 1, 2)
        return energy, (back @ stress[..., None])[..., 0], back @ moduli @ self.turn


def eta_with_derivatives(curve: StiffeningCurve, x: Array) -> Array:
    """Return eta(x) and its first two derivatives, (3, n), at squared strains (n,)."""
    mu, alpha, y = np.array(curve.mu), np.array(curve.alpha), x[:, None]
    eta = np.expm1(alpha * np.log1p(y)) @ (mu / alpha)
    return np.stack([eta, (1 + y) ** (alpha - 1) @ mu, (1 + y) ** (alpha - 2) @ (mu * (alpha - 1))])
