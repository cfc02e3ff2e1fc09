"""The elasticity of orthotropic shells, by the directions of their material (`question.orthotropic`)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.question.orthotropic import OrthotropicMaterial

Array = NDArray[np.float64]


def orthotropic_elasticity(
    base: Array, normal: Array, contravariant_metric: Array, material: OrthotropicMaterial
) -> Array:
    """Return A and D over their scales, H (n, 2, 3, 3), on the components 11, 22, 12 of the coordinates.

    With d1 and d2 the material's directions and d^a their contravariant components, E11 = d1^a d1^b eps_ab, E22
    likewise and 2 E12 = 2 d1^a d2^b eps_ab; H = T^T M T for the matrix T of these three.
    """
    line = base[:, 0 if material.along == "xi1" else 1]
    line = line / np.linalg.norm(line, axis=-1, keepdims=True)
    angle = np.radians(material.angle)
    first = np.cos(angle) * line + np.sin(angle) * np.cross(normal, line)
    second = np.cross(normal, first)
    (p, q), (r, s) = (np.einsum("nab,nbi,ni->an", contravariant_metric, base, d) for d in (first, second))
    turn = np.stack([p * p, q * q, 2 * p * q, r * r, s * s, 2 * r * s, 2 * p * r, 2 * q * s, 2 * (p * s + q * r)])
    turn = turn.T.reshape(-1, 3, 3)
    scales = material.membrane_stiffness, material.bending_stiffness
    parts = [np.swapaxes(turn, 1, 2) @ (m / k) @ turn for m, k in zip(material.stiffnesses, scales, strict=True)]
    return np.stack(parts, axis=1)
