"""The generalised-alpha method's constants, and states in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scheme:
    """The generalised-alpha method's constants for a spectral radius at infinite frequency, 0 <= rho <= 1.

    It is of second order and unconditionally stable on linear problems. A smaller rho damps the frequencies that a step
    does not resolve more strongly.
    """

    spectral_radius: float

    @property
    def alpha_m(self) -> float:
        """Weight of the acceleration at the beginning of the step."""
        return (2 * self.spectral_radius - 1) / (self.spectral_radius + 1)

    @property
    def alpha_f(self) -> float:
        """Weight of the displacement at the beginning of the step."""
        return self.spectral_radius / (self.spectral_radius + 1)

    @property
    def gamma(self) -> float:
        """Newmark's gamma."""
        return 0.5 - self.alpha_m + self.alpha_f

    @property
    def beta(self) -> float:
        """Newmark's beta."""
        return (1 - self.alpha_m + self.alpha_f) ** 2 / 4


@dataclass(frozen=True)
class Instant:
    """A state of motion.

    Attributes
    ----------
    t
        Time, s.
    q, v, a
        (nodes, 12) scaled degrees of freedom, and their rates.
    reaction
        (nodes, 12) forces of the supports, at the time within the step before at which they are balanced.
    length
        Of the step before, s.
    iterations
        Newton iterations of the step that led here.
    supplied
        Work of the supports, loads and moving obstacles since rest, less what damping took, J.
    lost
        Energy that impacts and friction have taken since rest, J.
    touch
        (n, 3) contact forces in the step before, N; None without obstacles.
    impulse
        (nodes, 12) change of the velocity by contact in a step: v is the velocity before an impulse.
    """

    t: float
    q: Array
    v: Array
    a: Array
    reaction: Array
    length: float = 0.0
    iterations: int = 0
    supplied: float = 0.0
    lost: float = 0.0
    touch: Array | None = None
    impulse: Array | None = None

    @property
    def velocity(self) -> Array:
        """(nodes, 12) the velocity; in lasting contact, that in the middle of the impulse."""
        return self.v if self.impulse is None else self.v + self.impulse / 2
