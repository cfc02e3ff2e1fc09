"""A case with one parameter off by an imaginary step: the imaginary part of any number made from it is a derivative.

For an analytic function f of real values, f(p + i s) = f(p) + i s f'(p) + O(s^2). With a step of 1e-30 of p the rest is
below rounding, and nothing is subtracted: the derivative has the rounding of f itself (Squire & Trapp 1998, Using
complex variables to estimate derivatives of real functions, SIAM Rev. 40).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.parameters import Parameter, changed
from shellbench.solvers.fem.mesh.basis import Derivative

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

STEP = 1e-30  # of the parameter, or of 1 if it is zero


@dataclass(frozen=True)
class Deviation:
    """A case and one of its parameters.

    Attributes
    ----------
    case
        The case as it is.
    parameter
        The parameter.
    """

    case: Case
    parameter: Parameter

    @property
    def step(self) -> float:
        """Size of the imaginary step, in the unit of the parameter."""
        return STEP * (abs(self.parameter.value) or 1.0)

    @property
    def moves_surface(self) -> bool:
        """True if the parameter changes the midsurface."""
        return self.parameter.group == "surface"

    @property
    def changes_loads(self) -> bool:
        """True if the parameter changes loads otherwise than by a factor."""
        return self.moves_surface or self.parameter.name == "material.areal_density"

    @cached_property
    def moved(self) -> Case:
        """The case with the parameter off by the step; bounds, points and factors stay (see `sites`)."""
        named = self.parameter.group in ("material", "surface") and not self.parameter.bound
        if not named:
            return self.case
        found: Case = changed(self.case, self.parameter, self.parameter.value + 1j * self.step)
        return found

    @cached_property
    def part(self) -> Case | None:
        """The case with no other load or spring than the one of which the parameter is the factor; else None."""
        group, key = self.parameter.group, self.parameter.key
        if group == "loads":
            return self.case.model_copy(update={"loads": (self.case.loads[int(key) - 1],), "springs": ()})
        if group == "springs":
            kept = tuple(s for s in self.case.springs if s.name == key)
            return self.case.model_copy(update={"loads": (), "springs": kept})
        return None

    def rate(self, value: complex | np.complexfloating) -> float:
        """Return the derivative from a number made with the deviating case."""
        return float(np.imag(value)) / self.step

    def sites(self, points: Array) -> tuple[Complex, tuple[complex, complex]]:
        """Return where points (n, 2) of the mesh lie, and the derivatives of that by the mesh's own coordinates."""
        steps, xi = [1.0 + 0j, 1.0 + 0j], np.asarray(points, dtype=complex)
        if self.parameter.bound:
            (axis, end), domain = self.parameter.bound, self.case.surface.domain
            shift = 1j * self.step * (np.pi / 180 if domain.angle[axis] else 1.0)
            share = (points[..., axis] - domain.lower[axis]) / domain.size[axis]
            xi[..., axis] += shift * (share if end else 1 - share)
            steps[axis] += (shift if end else -shift) / domain.size[axis]
        return xi, (steps[0], steps[1])

    def position(self, points: Array, order: int = 2) -> dict[Derivative, Complex]:
        """Return derivatives (n, 3) of the midsurface by the mesh's coordinates at points (n, 2) of the mesh."""
        xi, (first, second) = self.sites(points)
        x = self.moved.surface.derivatives(xi if self.parameter.bound else points, order)
        return {(i, j): np.asarray(first**i * second**j * value, dtype=complex) for (i, j), value in x.items()}

    def slide(self, name: str) -> Array:
        """Return the speed (2,) of a named point or corner in the mesh's coordinates, per unit of the parameter."""
        speed, domain = np.zeros(2), self.case.surface.domain
        if name not in self.case.points:  # a corner moves with the mesh
            return speed
        if self.parameter.point:
            point, axis = self.parameter.point
            speed[axis] = (name == point) * (np.pi / 180 if domain.angle[axis] else 1.0)
        elif self.parameter.bound:
            at = np.array([domain.internal(self.case.points[name])])
            speed = -np.imag(self.sites(at)[0][0]) / self.step
        return speed
