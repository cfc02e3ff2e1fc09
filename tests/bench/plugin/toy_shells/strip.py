"""A simply supported strip under a uniform load (Timoshenko & Woinowsky-Krieger, eq. (6) at nu = 0)."""

from __future__ import annotations

import numpy as np


def deflection(x: np.ndarray, load: float, stiffness: float, length: float) -> np.ndarray:
    """Return w = q x (L^3 - 2 L x^2 + x^3) / (24 B)."""
    return load * x * (length**3 - 2 * length * x**2 + x**3) / (24 * stiffness)


def curvature(x: np.ndarray, load: float, stiffness: float, length: float) -> np.ndarray:
    """Return -w''."""
    return load * x * (length - x) / (2 * stiffness)


def energy(load: float, stiffness: float, length: float, width: float) -> float:
    """Return the bending energy q^2 L^5 / (240 B) of so wide a strip."""
    return load**2 * length**5 * width / (240 * stiffness)
