r"""The twisted or compressed sleeve by Fourier series around it and Legendre polynomials along it.

A closed cylinder of radius R and length L whose rims are turned by -+twist/2 about its axis, moved toward each other by
`shortening`, and clamped: the normal of a rim turns with it. With e_r, e_y, e_t turned by the angle theta + tau y,
tau = twist / L, a point of the deformed sleeve is

    x = p_r e_r + p_y e_y + p_t e_t,   p = (R, (1 - shortening / L) y, 0) + q(theta, y),   -L/2 <= y <= L/2,

where all three components of q vanish at the rims and q_r has no slope there: in this frame the clamp that turns is a
homogeneous condition. Of e_r,theta = e_t and e_t,theta = -e_r, so p,theta becomes p,theta + S p and p,y becomes
p,y + tau S p. Coefficients don't depend on theta, so that a state that repeats itself `fold` times around the sleeve
couples a harmonic m to m + k fold only; an axisymmetric state leaves every harmonic alone. The energy is that of
exact strains (`surface_strains`), W = 1/2 D eps.H.eps + 1/2 B kappa.H.kappa, eps = (a - abar)/2, kappa = bbar - b.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import legendre

from .sleeve_functions import Around, Matrix, along
from .surface_strains import Array, first_variation, second_variation, strains

ORDERS = ((0, 0), (1, 0), (0, 1), (2, 0), (0, 2), (1, 1))
"""Orders along theta and y of the derivatives of p."""

SPIN = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
"""S of the components (radial, axial, tangential)."""


@dataclass(frozen=True)
class Rims:
    """Relative twist of the rims, rad, and their approach, m."""

    twist: float = 0.0
    shortening: float = 0.0


@dataclass(frozen=True)
class Sleeve:
    """A clamped sleeve and the functions that describe its deformation.

    Attributes
    ----------
    thickness, radius, length, young, poisson : m, m, m, Pa, 1
    functions : polynomials of each component along the axis
    fold, harmonics : q has the wave numbers fold, 2 fold, ..., harmonics * fold, besides 0
    """

    thickness: float
    radius: float = 0.25
    length: float = 1.0
    young: float = 5000.0
    poisson: float = 0.25
    functions: int = 40
    fold: int = 1
    harmonics: int = 0

    @cached_property
    def shape(self) -> tuple[int, int, int]:
        """Components, functions of theta, functions of y."""
        return 3, 2 * self.harmonics + 1, self.functions

    @property
    def size(self) -> int:
        """Number of coefficients of q."""
        return int(np.prod(self.shape))

    @cached_property
    def angles(self) -> Array:
        """Equally spaced quadrature points around a sector, exact for products of four functions."""
        count = 4 * self.harmonics + 1
        return 2 * np.pi / self.fold * np.arange(count) / count

    @cached_property
    def gauss(self) -> tuple[Array, Array]:
        """Points y and weights; half as many again as the energy of a quadratic theory needs."""
        s, weights = legendre.leggauss(3 * (self.functions + 4) // 2 + 2)
        return s * self.length / 2, weights * self.length / 2

    @cached_property
    def along(self) -> Array:
        """Functions of y of each component, (3 components, 3 orders, points, functions)."""
        s = self.gauss[0] * 2 / self.length
        scale = (2 / self.length) ** np.arange(3)[:, None, None]
        clamped, held = (along(self.functions, kind, s) * scale for kind in (True, False))
        return np.stack([clamped, held, held])

    @cached_property
    def around(self) -> Around:
        """Functions of theta of the state."""
        return Around.real(self.angles, self.fold, self.harmonics)

    def waves(self, number: int) -> Around:
        """Functions of theta of a perturbation: number + k fold, -harmonics <= k <= harmonics."""
        return Around.waves(self.angles, number + self.fold * np.arange(-self.harmonics, self.harmonics + 1.0))

    @cached_property
    def _weights(self) -> Array:
        """Area of the whole sleeve at the quadrature points (theta, y)."""
        around = 2 * np.pi * self.radius / len(self.angles)
        return np.broadcast_to(around * self.gauss[1], (len(self.angles), len(self.gauss[1])))

    @cached_property
    def _stiffness(self) -> Array:
        """D H and B H of the parameters theta, y with doubled shears, (6, 6)."""
        nu, r = self.poisson, self.radius
        h = np.array([[1 / r**4, nu / r**2, 0], [nu / r**2, 1, 0], [0, 0, (1 - nu) / 2 / r**2]])
        stretching = self.young * self.thickness / (1 - nu**2)
        return np.kron(np.diag([stretching, stretching * self.thickness**2 / 12]), h)

    def _frame(self, tau: float) -> Array:
        """Matrices from the derivatives `ORDERS` of p to the vectors x,1 x,2 x,11 x,22 x,12: (5, 3, 6, 3)."""
        one, s, ss = np.eye(3), SPIN, SPIN @ SPIN
        frame = np.zeros((5, 6, 3, 3))
        frame[0, 1], frame[0, 0] = one, s
        frame[1, 2], frame[1, 0] = one, tau * s
        frame[2, 3], frame[2, 1], frame[2, 0] = one, 2 * s, ss
        frame[3, 4], frame[3, 2], frame[3, 0] = one, 2 * tau * s, tau**2 * ss
        frame[4, 5], frame[4, 2], frame[4, 1], frame[4, 0] = one, s, tau * s, tau * ss
        return np.moveaxis(frame, 1, 2)

    def _frame_slope(self, tau: float) -> Array:
        """Derivative of `_frame` by tau; the frame is quadratic in it."""
        return (self._frame(tau + 1) - self._frame(tau - 1)) / 2

    def _derivatives(self, q: Array, rims: Rims) -> Array:
        """Derivatives `ORDERS` of p at the quadrature points, (theta, y, 6, 3)."""
        c = q.reshape(self.shape)
        y = self.gauss[0]
        p = np.empty((len(self.angles), len(y), 6, 3))
        for k, (one, two) in enumerate(ORDERS):
            p[:, :, k] = np.einsum("tm,cmn,cyn->tyc", self.around.values[one], c, self.along[:, two], optimize=True)
        stretch = 1 - rims.shortening / self.length
        p[:, :, 0, 0] += self.radius
        p[:, :, 0, 1] += stretch * y
        p[:, :, 2, 1] += stretch
        return p

    @cached_property
    def _reference(self) -> Array:
        flat = self._derivatives(np.zeros(self.size), Rims())[:1, :1]
        return strains(np.einsum("kcjd,tyjd->tykc", self._frame(0.0), flat))

    def state(self, q: Array, rims: Rims) -> State:
        """Strains and stresses of coefficients q (size,) between the rims."""
        frame = self._frame(rims.twist / self.length)
        p = self._derivatives(q, rims)
        x = np.einsum("kcjd,tyjd->tykc", frame, p, optimize=True)
        values, gradient = first_variation(x)
        change = values - self._reference
        stress = change @ self._stiffness * self._weights[..., None]
        return State(self, rims, q, p, x, change, stress, gradient)


@dataclass(frozen=True)
class State:
    """A deformation with its strains, stresses (times area) and the strains' gradient at the quadrature points."""

    sleeve: Sleeve
    rims: Rims
    coefficients: Array
    derivatives: Array
    vectors: Array
    strain: Array
    stress: Array
    gradient: Array

    @property
    def energies(self) -> tuple[float, float]:
        """Membrane and bending energy, J."""
        density = np.sum(self.strain * self.stress, axis=(0, 1)) / 2
        return float(density[:3].sum()), float(density[3:].sum())

    @property
    def energy(self) -> float:
        """Strain energy, J."""
        return float(sum(self.energies))

    @cached_property
    def _pull(self) -> Array:
        """Derivative of the energy by the five vectors, (theta, y, 5, 3)."""
        return np.einsum("tys,tyskc->tykc", self.stress, self.gradient, optimize=True)

    @cached_property
    def torque(self) -> float:
        """Derivative of the energy by the twist with q fixed; that of equilibria, N m."""
        slope = self.sleeve._frame_slope(self.rims.twist / self.sleeve.length) / self.sleeve.length
        return float(np.einsum("tykc,kcjd,tyjd->", self._pull, slope, self.derivatives, optimize=True))

    @cached_property
    def force(self) -> float:
        """Derivative of the energy by the shortening with q fixed; that of equilibria, N."""
        pull = np.einsum("tykc,kcjd->tyjd", self._pull, self._frame)[..., 1].sum(axis=0)
        y = self.sleeve.gauss[0]
        return float(-(pull[:, 0] @ y + pull[:, 2].sum()) / self.sleeve.length)

    @cached_property
    def _frame(self) -> Array:
        return self.sleeve._frame(self.rims.twist / self.sleeve.length)

    @cached_property
    def residual(self) -> Array:
        """Derivative of the energy by the coefficients, (size,)."""
        pull = np.einsum("tykc,kcjd->tyjd", self._pull, self._frame, optimize=True)
        total = np.zeros(self.sleeve.shape)
        for k, (one, two) in enumerate(ORDERS):
            around, functions = self.sleeve.around.values[one], self.sleeve.along[:, two]
            total += np.einsum("tm,tyc,cyn->cmn", around, pull[:, :, k], functions, optimize=True)
        return total.ravel()

    def second_variation(self, around: Around | None = None) -> Matrix:
        """Second derivative of the energy by coefficients over functions of theta (the state's own if None).

        It is real symmetric or complex Hermitian, (3 m functions, 3 m functions) for m functions of theta.
        """
        sleeve = self.sleeve
        theta = (around or sleeve.around).values
        shape = self.strain.shape[:2]
        b = self.gradient.reshape(*shape, 6, 15)
        weighted = sleeve._stiffness * sleeve._weights[..., None, None]
        inner = np.swapaxes(b, -1, -2) @ weighted @ b
        inner += second_variation(self.vectors, self.stress).reshape(*shape, 15, 15)
        frame = self._frame.reshape(15, 18)
        inner = (frame.T @ inner @ frame).reshape(*shape, 6, 3, 6, 3)
        m, n, y = theta.shape[2], sleeve.functions, shape[1]
        by_order = np.zeros((3, 3, m * m, y, 3, 3), dtype=theta.dtype)
        for i, (one, two) in enumerate(ORDERS):
            for j, (three, four) in enumerate(ORDERS):
                pairs = np.einsum("tk,tl->klt", theta[one].conj(), theta[three]).reshape(m * m, -1)
                by_order[two, four] += (pairs @ inner[:, :, i, :, j].reshape(shape[0], -1)).reshape(m * m, y, 3, 3)
        total = np.zeros((3, m, n, 3, m, n), dtype=theta.dtype)
        for c in range(3):
            for d in range(c + 1):
                block = np.zeros((m * m, n * n), dtype=theta.dtype)
                for two in range(3):
                    for four in range(3):
                        pairs = np.einsum("ya,yb->yab", sleeve.along[c, two], sleeve.along[d, four]).reshape(y, -1)
                        block += by_order[two, four, :, :, c, d] @ pairs
                total[c, :, :, d] = block.reshape(m, m, n, n).transpose(0, 2, 1, 3)
                total[d, :, :, c] = block.conj().reshape(m, m, n, n).transpose(1, 3, 0, 2)
        return total.reshape(3 * m * n, -1)
