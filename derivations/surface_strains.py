r"""Strains of a surface from its first and second derivatives, and their variations.

Of the five vectors x,1 x,2 x,11 x,22 x,12, in any parameters: a_ab = x,a . x,b, b_ab = x,ab . n and
n = x,1 cross x,2 / abs. A strain is the difference of `strains` between the deformed and the reference surface.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DERIVATIVES = ((1, 0), (0, 1), (2, 0), (0, 2), (1, 1))
"""Orders along xi1 and xi2 of the five vectors."""


def strains(x: Array) -> Array:
    """Return (a11, a22, 2 a12) / 2 and -(b11, b22, 2 b12) of vectors x (..., 5, 3), as (..., 6)."""
    return _strains(x)[0]


def _strains(x: Array) -> tuple[Array, Array, Array]:
    a1, a2 = x[..., 0, :], x[..., 1, :]
    c = np.cross(a1, a2)
    area = np.linalg.norm(c, axis=-1)
    n = c / area[..., None]
    b = np.einsum("...kc,...c->...k", x[..., 2:, :], n) * [1, 1, 2]
    a = np.stack([np.sum(a1 * a1, -1) / 2, np.sum(a2 * a2, -1) / 2, np.sum(a1 * a2, -1)], -1)
    return np.concatenate([a, -b], -1), n, area


def _cross_matrix(v: Array) -> Array:
    """[v] with [v] w = v cross w."""
    zero = np.zeros_like(v[..., 0])
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    return np.stack([np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)], -2)


def first_variation(x: Array) -> tuple[Array, Array]:
    """Return the strains (..., 6) and their derivative by the five vectors, (..., 6, 5, 3).

    With c = x,1 cross x,2 and n = c / abs(c): dn = (1 - n n) dc / abs(c).
    """
    values, n, area = _strains(x)
    gradient = np.zeros((*x.shape[:-2], 6, 5, 3))
    a1, a2 = x[..., 0, :], x[..., 1, :]
    gradient[..., 0, 0, :] = a1
    gradient[..., 1, 1, :] = a2
    gradient[..., 2, 0, :] = a2
    gradient[..., 2, 1, :] = a1
    for k, factor in enumerate((1.0, 1.0, 2.0)):
        second = x[..., 2 + k, :]
        across = (second - np.sum(second * n, -1, keepdims=True) * n) / area[..., None]
        gradient[..., 3 + k, 0, :] = -factor * np.cross(a2, across)
        gradient[..., 3 + k, 1, :] = -factor * np.cross(across, a1)
        gradient[..., 3 + k, 2 + k, :] = -factor * n
    return values, gradient


def second_variation(x: Array, stress: Array) -> Array:
    """Return the second derivative of stress . strains by the five vectors, (..., 5, 3, 5, 3).

    The normal's second variation is d2n = (1 - n n) d2c / J - [(n.dc') P dc + (n.dc) P dc' + (dc.P dc') n] / J^2.
    """
    _, n, area = _strains(x)
    shape = x.shape[:-2]
    hessian = np.zeros((*shape, 5, 3, 5, 3))
    eye = np.eye(3)
    for k, m, s in ((0, 0, 0), (1, 1, 1), (0, 1, 2), (1, 0, 2)):
        hessian[..., k, :, m, :] += stress[..., s, None, None] * eye
    weights = -stress[..., 3:] * [1.0, 1.0, 2.0]
    vector = np.einsum("...k,...kc->...c", weights, x[..., 2:, :])
    projector = eye - n[..., :, None] * n[..., None, :]
    along = np.sum(vector * n, -1)
    across = np.einsum("...ij,...j->...i", projector, vector)
    outer = across[..., :, None] * n[..., None, :]
    by_c = -(outer + np.swapaxes(outer, -1, -2) + along[..., None, None] * projector) / (area**2)[..., None, None]
    c_by = [-_cross_matrix(x[..., 1, :]), _cross_matrix(x[..., 0, :])]
    for k in range(2):
        for m in range(2):
            hessian[..., k, :, m, :] += np.swapaxes(c_by[k], -1, -2) @ by_c @ c_by[m]
        mixed = projector @ c_by[k] / area[..., None, None]
        for s in range(3):
            block = weights[..., s, None, None] * mixed
            hessian[..., 2 + s, :, k, :] += block
            hessian[..., k, :, 2 + s, :] += np.swapaxes(block, -1, -2)
    lever = _cross_matrix(across / area[..., None])  # (dx,1 cross dx,2') . m = -dx,1 . [m] dx,2'
    hessian[..., 0, :, 1, :] -= lever
    hessian[..., 1, :, 0, :] += lever
    return hessian
