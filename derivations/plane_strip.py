r"""A strip that bends in a plane, by virtual work in polynomials of its position: a second form of four cases.

With p = x' and q = x'' along the reference length, eps = (p.p - 1) / 2 and b = (p1 q2 - p2 q1) / abs(p). The position is
(s, 0) plus Chebyshev polynomials of s times s for x and s^2 for z, which clamps the strip at s = 0. Loads at the tip are
a dead force across the strip and a moment, whose work is its product with the angle of p there. A pressure P that
follows the strip exerts P (-p2, p1) per reference length: no gradient, as its derivative is not symmetric. `elastica`,
`roll_up` and `spiral` start from angle and stretch instead, and from the equations of equilibrium.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from .elastica import FORCES, SOFT, SWUNG, Cantilever
from .estimate import Estimate
from .roll_up import MARKS, PAST_HALF, Strip
from .spiral import PRESSURES, named

Array = np.ndarray
ITERATIONS = 60
CONVERGED = 1e-11
"""Last correction of Newton's method relative to the position: it converges quadratically."""


SPREAD = 1e-11
"""Uncertainty relative to the length: 16, 20 and 24 functions differ by less."""


@dataclass(frozen=True)
class Bent:
    """Load factor, the tip's displacement toward the wall and across (m) and angle (rad), energies per width (N), coefficients."""

    factor: float
    shortening: float
    deflection: float
    angle: float
    membrane: float
    bending: float
    coefficients: Array


@dataclass(frozen=True)
class PlaneStrip:
    """Length and thickness in m, Young's modulus in Pa; polynomials a component."""

    length: float
    thickness: float
    young: float
    count: int = 20

    def derivative(self, s: Array, order: int) -> Array:
        """Derivative of the functions of x, then of z, at points: (2, points, count)."""
        clamps = (Polynomial([0.0, 1.0]), Polynomial([0.0, 0.0, 1.0]))
        line = [Chebyshev.basis(i, domain=[0.0, self.length]) for i in range(self.count)]
        factors = [c(Chebyshev.identity(domain=[0.0, self.length]) / self.length) for c in clamps]
        functions = [[(factor * basis).deriv(order) for basis in line] for factor in factors]
        return np.array([[function(s) for function in row] for row in functions]).transpose(0, 2, 1)

    @cached_property
    def _gauss(self) -> tuple[Array, Array, Array]:
        """Weights, and first and second derivatives at 3 count Gauss points."""
        s, weights = self._rule
        return weights, self.derivative(s, 1), self.derivative(s, 2)

    @cached_property
    def _values(self) -> Array:
        """Values of the functions at the same points."""
        return self.derivative(self._rule[0], 0)

    @property
    def _rule(self) -> tuple[Array, Array]:
        x, w = np.polynomial.legendre.leggauss(3 * self.count)
        return (1 + x) * self.length / 2, w * self.length / 2

    def position(self, coefficients: Array, s: float) -> Array:
        """Position at a reference length, (2,)."""
        return np.array([s, 0.0]) + np.einsum("cpi,ci->pc", self.derivative(np.array([s]), 0), coefficients)[0]

    def _angle(self, coefficients: Array) -> float:
        """The angle of p at the tip, full turns counted: the integral of (p1 q2 - p2 q1) / abs(p)^2."""
        weight, first, second = self._gauss
        p1, p2 = np.einsum("cpi,ci->cp", first, coefficients) + np.array([[1.0], [0.0]])
        q1, q2 = np.einsum("cpi,ci->cp", second, coefficients)
        return float(weight @ ((p1 * q2 - p2 * q1) / (p1**2 + p2**2)))

    def _energy(self, coefficients: Array) -> tuple[float, float, Array, Array]:
        """Membrane and bending energy per width, gradient and Hessian of both together by the coefficients."""
        weight, first, second = self._gauss
        stretching = self.young * self.thickness
        bending = stretching * self.thickness**2 / 12
        p1, p2 = np.einsum("cpi,ci->cp", first, coefficients) + np.array([[1.0], [0.0]])
        q1, q2 = np.einsum("cpi,ci->cp", second, coefficients)
        zero, one = np.zeros_like(p1), np.ones_like(p1)
        # derivatives by y = (p1, p2, q1, q2): b = c / r with c = p1 q2 - p2 q1, r = abs(p)
        r, c = np.hypot(p1, p2), p1 * q2 - p2 * q1
        strain, curvature = (r**2 - 1) / 2, c / r
        pull = np.stack([p1, p2, zero, zero])
        dc = np.stack([q2, -q1, -p2, p1])
        plane = np.stack([one, one, zero, zero])[:, None] * np.eye(4)[:, :, None]
        turn = np.zeros((4, 4, 1))
        turn[0, 3] = turn[3, 0] = 1.0
        turn[1, 2] = turn[2, 1] = -1.0
        db = dc / r - c * pull / r**3
        mixed = dc[:, None] * pull[None]
        ddb = turn / r - (mixed + mixed.swapaxes(0, 1) + c * plane) / r**3 + 3 * c * pull[:, None] * pull[None] / r**5
        gradient = weight * (stretching * strain * pull + bending * curvature * db)
        hessian = stretching * (pull[:, None] * pull[None] + strain * plane)
        hessian = weight * (hessian + bending * (db[:, None] * db[None] + curvature * ddb))
        shapes = np.zeros((4, len(weight), 2 * self.count))
        for k, (component, values) in enumerate(((0, first), (1, first), (0, second), (1, second))):
            shapes[k, :, component * self.count : (component + 1) * self.count] = values[component]
        energies = weight @ (stretching * strain**2 / 2), weight @ (bending * curvature**2 / 2)
        force = np.einsum("kpi,kp->i", shapes, gradient)
        rows = np.einsum("klp,lpj->kpj", hessian, shapes).reshape(-1, 2 * self.count)
        stiffness = shapes.reshape(-1, 2 * self.count).T @ rows
        return float(energies[0]), float(energies[1]), force, stiffness

    def _work(self, coefficients: Array, force: float, moment: float, pull: float) -> tuple[Array, Array]:
        """Gradient and Hessian of the load's work per width; the angle of p is atan2(p2, p1)."""
        end = np.array([self.length])
        lift, slope = self.derivative(end, 0)[:, 0], self.derivative(end, 1)[:, 0]
        shapes = np.zeros((2, 2 * self.count))
        shapes[0, : self.count], shapes[1, self.count :] = slope
        p1, p2 = shapes @ coefficients.ravel() + [1.0, 0.0]
        square = p1**2 + p2**2
        gradient = moment * np.array([-p2, p1]) / square @ shapes
        gradient[self.count :] += force * lift[1]
        gradient[: self.count] += pull * lift[0]
        second = np.array([[2 * p1 * p2, p2**2 - p1**2], [p2**2 - p1**2, -2 * p1 * p2]]) / square**2
        return gradient, moment * shapes.T @ second @ shapes

    def _push(self, coefficients: Array, pressure: float) -> tuple[Array, Array]:
        """Forces of a pressure that follows per width, and their derivative, by the coefficients."""
        weight, first, _ = self._gauss
        values = self._values
        p1, p2 = np.einsum("cpi,ci->cp", first, coefficients) + np.array([[1.0], [0.0]])
        force = pressure * np.concatenate([-(weight * p2) @ values[0], (weight * p1) @ values[1]])
        across = pressure * (weight[:, None] * values[0]).T @ first[1]
        along = pressure * (weight[:, None] * values[1]).T @ first[0]
        zero = np.zeros_like(across)
        return force, np.block([[zero, -across], [along, zero]])

    def path(
        self,
        factors: Array,
        force: float = 0.0,
        moment: float = 0.0,
        pressure: float = 0.0,
        pull: float = 0.0,
        weight: float = 0.0,
    ) -> Iterator[Bent]:
        """Yield the equilibria under rising fractions of a load per width; a force pulls along the strip as it was.

        A weight is per area, and acts along -z.

        Raises
        ------
        RuntimeError
            If Newton's method doesn't converge.
        """
        coefficients = np.zeros((2, self.count))
        fall = weight * np.append(np.zeros(self.count), -(self._rule[1] @ self._values[1]))
        for factor in factors:
            for _ in range(ITERATIONS):
                inner, stiffness = self._energy(coefficients)[2:]
                outer, of_load = self._work(coefficients, factor * force, factor * moment, factor * pull)
                push, of_push = self._push(coefficients, factor * pressure)
                step = np.linalg.solve(stiffness - of_load - of_push, outer + push + factor * fall - inner)
                coefficients = coefficients + step.reshape(2, -1)
                if np.abs(step).max() < CONVERGED * self.length:
                    break
            else:
                raise RuntimeError(f"no equilibrium of the strip at {factor:.3g} of its load")
            membrane, bending = self._energy(coefficients)[:2]
            x, z = self.position(coefficients, self.length)
            tip = self.length - float(x), float(z), self._angle(coefficients)
            yield Bent(float(factor), *tip, membrane, bending, coefficients)


def cantilever_shear() -> dict[str, Estimate]:
    """Known values of the strip under an end force."""
    case = Cantilever()
    strip = PlaneStrip(case.length, case.thickness, case.young)
    factors = np.arange(1, 9) / 8
    found = {bent.factor: bent for bent in strip.path(factors, force=FORCES[-1] / case.width)}
    values = {}
    for force in FORCES:
        bent = found[force / FORCES[-1]]
        values |= {f"shortening_{force:g}": bent.shortening, f"deflection_{force:g}": bent.deflection}
    return {name: Estimate(value, SPREAD * case.length, "m") for name, value in values.items()}


def cantilever_moment() -> dict[str, Estimate]:
    """Known values of the strip under an end moment."""
    case = Strip()
    strip = PlaneStrip(case.length, case.thickness, case.young)
    found = {bent.factor: bent for bent in strip.path(np.arange(1, 65) / 64, moment=case.moment)}
    values = {}
    for factor, name in MARKS.items():
        values[f"shortening_{name}"] = found[factor].shortening
        if factor < 1.0:
            values[f"deflection_{name}"] = found[factor].deflection
    energies = {}
    for factor, name in ((PAST_HALF, "potential_energy_63"), (1.0, "potential_energy")):
        bent = found[factor]
        stored = case.width * (bent.membrane + bent.bending)
        potential = stored - case.width * factor * case.moment * bent.angle
        energies[name] = Estimate(potential, 1e3 * SPREAD * stored, "J")
    return {name: Estimate(value, SPREAD * case.length, "m") for name, value in values.items()} | energies


def cantilever_pressure() -> dict[str, Estimate]:
    """Known values of the strip under a pressure that follows it; the wall's moment is p d^2 / 2, see `spiral`."""
    case = Cantilever()
    strip = PlaneStrip(case.length, case.thickness, case.young)
    found = {bent.factor: bent for bent in strip.path(np.arange(1, 9) / 8, pressure=PRESSURES[-1])}
    lengths, spread = {}, SPREAD * case.length
    for pressure in PRESSURES:
        bent = found[pressure / PRESSURES[-1]]
        lengths |= {named("shortening", pressure): bent.shortening, named("deflection", pressure): bent.deflection}
    energy, arm = case.width * (bent.membrane + bent.bending), (case.length - bent.shortening, bent.deflection)
    moment = case.width * PRESSURES[-1] * float(np.dot(arm, arm)) / 2
    return {key: Estimate(value, spread, "m") for key, value in lengths.items()} | {
        "strain_energy": Estimate(energy, SPREAD * energy, "J"),
        "wall_moment": Estimate(moment, 2 * SPREAD * moment, "N m"),
    }


def swung_cantilever() -> dict[str, Estimate]:
    """Known values of the strip whose wall turns while the force grows: the straight strip with the force turned back."""
    case, values = Cantilever(), {}
    strip, load = PlaneStrip(case.length, case.thickness, case.young), FORCES[-1] / case.width
    for factor, name in ((0.5, "_50"), (1.0, "")):
        push, cos, sin = factor * load, np.cos(factor * SWUNG), np.sin(factor * SWUNG)
        *_, bent = strip.path(np.arange(1, 9) / 8, force=push * cos, pull=push * sin)
        along, across = case.length - bent.shortening, bent.deflection
        values |= {f"shortening{name}": case.length - along * cos + across * sin}
        values |= {f"deflection{name}": along * sin + across * cos}
    stored = {"strain": bent.membrane + bent.bending, "bending": bent.bending}
    spread = SPREAD * SOFT * case.width * stored["strain"]
    return {name: Estimate(float(value), SPREAD * case.length, "m") for name, value in values.items()} | {
        f"{name}_energy": Estimate(SOFT * case.width * value, spread, "J") for name, value in stored.items()
    }
