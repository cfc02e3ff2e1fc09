"""The finite element solution of a motion: bicubic elements in space, cubic Hermite polynomials in time."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from shellbench.problem import NumberFormat
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.contact import Touch, kept_touch, restored_touch
from shellbench.problems.shell.solution import Arrays, ShellSolution, Words, time_reached
from shellbench.problems.shortened import expanded, shortened
from shellbench.solvers.fem.mechanics.solution import FORMATS, EnergyRule, FemSolution
from shellbench.solvers.fem.mesh.basis import COMPONENTS, kind_scales, tabulate
from shellbench.solvers.fem.mesh.mesh import TensorMesh

Array = NDArray[np.float64]


STENCIL = 4  # reactions that are interpolated through, at times between those of the displacements
RECENT = 8  # fields, and sets of points, that are kept at hand


@dataclass(frozen=True)
class MotionSolution(ShellSolution):
    """A displacement field on a tensor mesh from rest to the last time that was reached.

    Attributes
    ----------
    case, mesh, quadrature_order, parameters
        See `FemSolution`.
    times
        (k,) increasing, s, the first one 0.
    coefficients, rates
        (nodes, 3, 4, k) u, u,1, u,2 and u,12 of each component at each node, and their rates, or shorter numbers.
    exponents
        Of the powers of two by which coefficients and rates are to be multiplied; see
        `shellbench.problems.shell.solution`.
    support_nodes
        (m,) nodes with supports.
    reaction_times, support_forces
        (r,) times, and (supports, m, 3, 4, r) the forces that each of the case's supports exerts at them: the method
        balances forces within a step.
    touch_times, touching
        (m,) times, and the contact forces at them: impulses at the beginnings of steps. Empty without obstacles.
    """

    formats: ClassVar[tuple[str | int, ...]] = FORMATS

    case: Case
    mesh: TensorMesh
    times: Array
    coefficients: NDArray[np.floating[Any]]
    rates: NDArray[np.floating[Any]]
    support_nodes: NDArray[np.int64]
    reaction_times: Array
    support_forces: Array
    quadrature_order: int
    parameters: int
    exponents: tuple[int, int] = (0, 0)
    touch_times: Array = field(default_factory=lambda: np.zeros(0))
    touching: tuple[Touch, ...] = ()

    @property
    def storage_bytes(self) -> int:
        """Bytes of the coefficients, their rates and times, and the mesh lines."""
        arrays = (self.coefficients, self.rates, self.times, *self.mesh.lines)
        return sum(array.nbytes for array in arrays)

    def frame(self, at: float | None) -> FemSolution:
        """Return the field at one time; InputError if the motion did not reach it."""
        return self._frames(time_reached(self.case, float(self.times[-1]), at))

    @cached_property
    def _frames(self) -> Callable[[float], FemSolution]:
        return lru_cache(maxsize=RECENT)(self._interpolated)

    def _interpolated(self, at: float) -> FemSolution:
        return FemSolution(
            case=self.case,
            mesh=self.mesh,
            coefficients=self._hermite(at)[..., None],
            states=(at,),
            support_nodes=self.support_nodes,
            support_forces=self._reactions_at(at)[..., None],
            quadrature_order=self.quadrature_order,
            parameters=self.parameters,
        )

    def _interval_of(self, at: float) -> tuple[int, float, float]:
        """Return the number of the interval that contains a time, its length, and the position in it."""
        number = int(np.clip(np.searchsorted(self.times, at, side="right") - 1, 0, len(self.times) - 2))
        length = float(self.times[number + 1] - self.times[number])
        return number, length, (at - float(self.times[number])) / length

    def _hermite(self, at: float, rate: bool = False) -> Array:
        k, h, s = self._interval_of(at)
        if rate:
            values = (6 * s**2 - 6 * s) / h, (6 * s - 6 * s**2) / h
            slopes = 3 * s**2 - 4 * s + 1, 3 * s**2 - 2 * s
        else:
            values = 2 * s**3 - 3 * s**2 + 1, 3 * s**2 - 2 * s**3
            slopes = h * (s**3 - 2 * s**2 + s), h * (s**3 - s**2)
        (u, u_next), (v, v_next) = (
            [expanded(numbers[..., number], exponent) for number in (k, k + 1)]
            for numbers, exponent in zip((self.coefficients, self.rates), self.exponents, strict=True)
        )
        return np.asarray(values[0] * u + values[1] * u_next + slopes[0] * v + slopes[1] * v_next)

    def _reactions_at(self, at: float) -> Array:
        """Interpolate the reactions by the polynomial through the nearest ones."""
        count = min(STENCIL, len(self.reaction_times))
        first = int(np.searchsorted(self.reaction_times, at)) - count // 2
        first = min(max(first, 0), len(self.reaction_times) - count)
        times = self.reaction_times[first : first + count]
        weights = [np.prod([(at - other) / (time - other) for other in times if other != time]) for time in times]
        return np.asarray(self.support_forces[..., first : first + count] @ np.asarray(weights))

    def displacement_at(self, xi: Array, at: float | None) -> Array:
        """Return the displacement (N, 3) at points (N, 2) and any time that was reached."""
        return self._field_at_points(xi, self.frame(at).coefficients[..., 0])

    def velocity_at(self, xi: Array, at: float | None) -> Array:
        """Return the velocity (N, 3) at points (N, 2) and any time that was reached."""
        return self._field_at_points(xi, self._hermite(self.frame(at).states[0], rate=True))

    def _field_at_points(self, xi: Array, coefficients: Array) -> Array:
        """Return a field with coefficients (nodes, 3, 4) at points (N, 2); the basis there is cached."""
        return np.asarray(self._bases(xi.tobytes()) @ np.swapaxes(coefficients, 1, 2).reshape(-1, COMPONENTS))

    @cached_property
    def _bases(self) -> Callable[[bytes], csr_matrix]:
        return lru_cache(maxsize=RECENT)(lambda points: basis_at(self.mesh, np.frombuffer(points).reshape(-1, 2)))

    def field_at(self, name: str, xi: Array, at: float | None) -> Array:
        """Return strains (N, 3) or energy densities (N,) at points (N, 2)."""
        return self.frame(at).evaluate(name, xi)

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Return the membrane and the bending part of the strain energy, J."""
        still = self.frame(at)
        vars(still)["energy_rule"] = self._energy_rule  # the same at all times
        return still.energies()

    @cached_property
    def _energy_rule(self) -> EnergyRule:
        return self.frame(float(self.times[0])).energy_rule

    def touch(self, at: float | None = None) -> Touch:
        """Return the contact forces, linear in time between the times that are kept, and constant after the last."""
        times, last = self.touch_times, time_reached(self.case, float(self.times[-1]), at)
        place = float(np.interp(last, times, np.arange(len(times))))
        first, second = self.touching[int(place)], self.touching[math.ceil(place)]
        return replace(first, forces=first.forces + place % 1 * (second.forces - first.forces))

    def reaction_at(self, number: int, centre: Array, at: float | None) -> tuple[Array, Array]:
        """Return force (3,) in N and moment (3,) about `centre` in N m that a support exerts on the shell."""
        return self.frame(at).reaction_at(number, centre, None)

    def rounded(self, format: NumberFormat) -> tuple[MotionSolution, int]:
        """Return the motion with its coefficients and their rates rounded to a format, and the bytes it takes.

        Each of the two is scaled by its largest magnitude before (see `rounding`), and kept in the format; only the
        values of a requested time are expanded. Mesh lines and times, of which there are few, are not rounded.
        """
        values, rates = shortened(self.coefficients, format), shortened(self.rates, format)
        if values.numbers is self.coefficients and rates.numbers is self.rates:
            return self, self.storage_bytes
        bytes_taken = self.storage_bytes - self.coefficients.nbytes - self.rates.nbytes + values.nbytes + rates.nbytes
        exponents = values.exponent, rates.exponent
        return replace(self, coefficients=values.numbers, rates=rates.numbers, exponents=exponents), bytes_taken

    def kept(self) -> tuple[Words, Arrays]:
        """Return the data that a file holds beside the case and the history."""
        return {"quadrature_order": self.quadrature_order}, {
            "lines1": self.mesh.lines[0],
            "lines2": self.mesh.lines[1],
            "times": self.times,
            "coefficients": expanded(self.coefficients, self.exponents[0]),
            "rates": expanded(self.rates, self.exponents[1]),
            "support_nodes": self.support_nodes,
            "reaction_times": self.reaction_times,
            "support_forces": self.support_forces,
            **({"touch_times": self.touch_times} if self.touching else {}),
            **kept_touch(self.touching),
        }

    @classmethod
    def restored(cls, case: Case, words: Words, arrays: Arrays) -> MotionSolution:
        """Make a solution from the data of a file; ValueError or KeyError if they are inconsistent."""
        mesh = TensorMesh(case.surface.domain, (arrays["lines1"], arrays["lines2"]))
        nodes = np.asarray(arrays["support_nodes"], dtype=np.int64)
        shape = (mesh.node_count, 3, 4, len(arrays["times"]))
        if arrays["coefficients"].shape != shape or arrays["rates"].shape != shape or shape[-1] < 2:
            raise ValueError("coefficients do not fit the mesh and the times")
        for name in ("times", "reaction_times"):
            if not np.all(np.diff(arrays[name]) > 0):
                raise ValueError(f"{name} do not increase")
        if arrays["support_forces"].shape != (len(case.supports), len(nodes), 3, 4, len(arrays["reaction_times"])):
            raise ValueError("forces do not fit the supports")
        return cls(
            case=case,
            mesh=mesh,
            times=arrays["times"],
            coefficients=arrays["coefficients"],
            rates=arrays["rates"],
            support_nodes=nodes,
            reaction_times=arrays["reaction_times"],
            support_forces=arrays["support_forces"],
            quadrature_order=int(words["quadrature_order"]),
            parameters=int(words["parameters"]),
            touch_times=arrays.get("touch_times", np.zeros(0)),
            touching=restored_touch(arrays),
        )


def basis_at(mesh: TensorMesh, points: Array) -> csr_matrix:
    """Return the matrix from the coefficients (nodes * kinds, ...) of a field to its values at points (n, 2)."""
    nodes, unit, sizes = mesh.locate(points)
    values = tabulate(unit, (0, 0), mesh.basis) * kind_scales(sizes, mesh.basis)[:, None]
    kinds = len(mesh.kinds)
    columns = nodes[..., None] * kinds + np.arange(kinds)
    starts = np.arange(len(points) + 1) * columns[0].size
    return csr_matrix((values.ravel(), columns.ravel(), starts), shape=(len(points), mesh.node_count * kinds))
