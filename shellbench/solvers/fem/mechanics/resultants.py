"""Stress resultants of the finite element solution, recovered from superconvergent points.

Strains of a C1 element of degree p jump between cells. Their error is orthogonal to polynomials of degree p - 2 on a
cell (in one dimension; nearly so on a plate), and converges one order faster at the p - 1 Gauss points of a cell.
Recovery (Zienkiewicz & Zhu 1992, Int. J. Numer. Meth. Engng 33, 1331):

1. Take the patch of a point: the cell that contains it and its neighbours, three by three. It does not cross edges, nor
   lines on which stiffness or loads have kinks; there it lies to one side.
2. Evaluate n^ab = D H eps and m^ab = B H kappa at the Gauss points of its cells.
3. Fit polynomials of degree p - 1 in each coordinate to them by least squares.
4. Take their values at the point as membrane forces and moments. Shear forces follow from their slopes by the
   equilibrium of moments, q^a = m^ab|_b = m^ab,b + Gamma^a_bc m^cb + Gamma^b_bc m^ac.

The textbook fits at nodes and interpolates; here a patch is fitted for each point that is asked for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.quantities import ResultantQuantity
from shellbench.problems.shell.question.places import SIDES
from shellbench.solvers.fem.mechanics.corners import corner_exponents
from shellbench.solvers.fem.mechanics.kinematics import DERIVATIVES as GRADIENTS
from shellbench.solvers.fem.mechanics.kinematics import (
    STRAINS,
    Midsurface,
    elasticities,
    stiffness_moduli,
    strain_operator,
)
from shellbench.solvers.fem.mesh.basis import SAME, Derivative, gauss_rule
from shellbench.solvers.fem.mesh.grading import break_coordinates
from shellbench.solvers.fem.mesh.mesh import TensorMesh

if TYPE_CHECKING:

    class FemSolution(Protocol):
        """Protocol of an answer whose resultants are evaluated."""

        @property
        def case(self) -> Case: ...  # noqa: D102
        @property
        def mesh(self) -> TensorMesh: ...  # noqa: D102
        def partial(self, points: ArrayLike, order: Derivative, at: float | None) -> Array: ...  # noqa: D102


Array = NDArray[np.float64]
Integers = NDArray[np.int64]

REACH = 3  # cells of a patch along each coordinate
AT_ONCE = 64  # points whose patches are sampled together
HALF = np.array([1.0, 1.0, 0.5])  # H counts the component 12 twice, for itself and for 21


def why_infinite(case: Case, quantity: ResultantQuantity) -> str | None:
    """Return the reason that a resultant of a case has no finite value, as one clause, or None if it has one."""
    corner = quantity.corner_of(case)
    if corner is None:
        return None
    name, (first, second) = corner
    exponent = corner_exponents(case).get((SIDES[first], SIDES[second]))
    if exponent is None:
        return None
    return (
        f"forces or moments grow without bound toward the corner '{name}', as r^{exponent - 1:.2g} with the distance r,"
        f" and quantity '{quantity.name}' asks for one there"
    )


def resultants(solution: FemSolution, name: str, points: Array, at: float | None) -> Array:
    """Return recovered resultants at points (n, 2): see `shellbench.problems.shell.field.RESULTANTS`."""
    part = int(name != "membrane_force")
    portions = [_recover(solution, part, points[k : k + AT_ONCE], at) for k in range(0, len(points), AT_ONCE)]
    found = np.concatenate(portions) if portions else np.zeros((0, 3, 3))
    surface = Midsurface.from_position(solution.case.surface.derivatives(solution.mesh.domain.wrap(points), order=2))
    if name == "shear_force":
        return np.asarray(np.einsum("na,nai->ni", _divergence(surface, found), _frame_components(surface)))
    return components_in_frame(surface, found[:, 0])


def contravariant_resultants(solution: FemSolution, part: int, points: Array, at: float | None) -> Array:
    """Return n^ab (part 0) or m^ab (1) directly from the strains, (n, 3): 11, 22, 12, at points (n, 2)."""
    wrapped = solution.mesh.domain.wrap(points)
    surface = Midsurface.from_position(solution.case.surface.derivatives(wrapped, order=2))
    gradients = np.stack([solution.partial(points, d, at) for d in GRADIENTS], axis=-1)
    rows = strain_operator(surface)[:, 3 * part : 3 * part + 3].reshape(len(points), 3, -1)
    strains = (rows @ gradients.reshape(len(points), -1, 1))[..., 0]
    moduli = stiffness_moduli(solution.case.surface, solution.case.material, wrapped)[:, part, None]
    stresses = (elasticities(surface, solution.case.material)[:, part] @ strains[..., None])[..., 0]
    return np.asarray(moduli * stresses * HALF)


def components_in_frame(surface: Midsurface, tensor: Array) -> Array:
    """Return components 11, 22, 12 (n, 3) in the orthonormal frame of a tensor t^ab (n, 3)."""
    along = _frame_components(surface)
    return np.stack([_contraction(tensor, along[:, :, i], along[:, :, j]) for i, j in STRAINS], axis=-1)


def _frame_components(surface: Midsurface) -> Array:
    """Return a_a . e_i (n, 2, 2), with e_1 along a_1 and e_2 = a_3 x e_1."""
    first = surface.base[:, 0] / np.linalg.norm(surface.base[:, 0], axis=-1, keepdims=True)
    frame = np.stack([first, np.cross(surface.normal, first)], axis=-1)
    return np.asarray(surface.base @ frame)


def _contraction(tensor: Array, one: Array, two: Array) -> Array:
    """Return t^ab one_a two_b (n,) of symmetric tensors (n, 3) and vectors (n, 2)."""
    mixed = one[:, 0] * two[:, 1] + one[:, 1] * two[:, 0]
    return np.asarray(
        tensor[:, 0] * one[:, 0] * two[:, 0] + tensor[:, 1] * one[:, 1] * two[:, 1] + tensor[:, 2] * mixed
    )


def _divergence(surface: Midsurface, found: Array) -> Array:
    """Return q^a (n, 2) of moments with their slopes (n, 3, 3): by value, slope 1, slope 2, then by component."""
    full = found[:, :, [[0, 2], [2, 1]]]  # (n, 3, a, b)
    second = surface.second[:, [[0, 2], [2, 1]]]  # x,bc (n, b, c, 3)
    raised = surface.contravariant_metric @ surface.base
    christoffel = np.einsum("nai,nbci->nabc", raised, second)
    moment = full[:, 0]
    slopes = full[:, 1, :, 0] + full[:, 2, :, 1]
    turned = np.einsum("nabc,ncb->na", christoffel, moment) + np.einsum("nbbc,nac->na", christoffel, moment)
    return np.asarray(slopes + turned)


def _recover(solution: FemSolution, part: int, points: Array, at: float | None) -> Array:
    """Return t^ab at points (n, 2) and its slopes along both coordinates, (n, 3, 3): by derivative and component."""
    fits = patch_fits(solution.case, solution.mesh, points)
    sampled = contravariant_resultants(solution, part, np.concatenate([grid for grid, _ in fits]), at)
    parts = np.split(sampled, np.cumsum([len(grid) for grid, _ in fits])[:-1])
    return np.array([weights @ values for (_, weights), values in zip(fits, parts, strict=True)])


def patch_fits(case: Case, mesh: TensorMesh, points: Array) -> list[tuple[Array, Array]]:
    """Return for each point (n, 2) the samples (k, 2) of its patch, and weights (3, k) of the fit: value, slopes."""
    breaks, fits = [break_coordinates(case, axis) for axis in (0, 1)], []
    for xi in mesh.into_period(points):
        (first, one), (second, two) = (_fit_weights(mesh, axis, float(xi[axis]), breaks[axis]) for axis in (0, 1))
        grid = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)
        fits.append((grid, np.array([np.outer(one[p], two[q]).ravel() for p, q in ((0, 0), (1, 0), (0, 1))])))
    return fits


def _fit_weights(mesh: TensorMesh, axis: int, at: float, breaks: list[float]) -> tuple[Array, Array]:
    """Return the Gauss points (k,) of a patch along a coordinate, and weights (2, k) of the fit's value and slope."""
    ends = patch_lines(mesh, axis, at, breaks)
    gauss, _ = gauss_rule(mesh.degree - 1)
    samples = (ends[:-1, None] + np.diff(ends)[:, None] * (gauss + 1) / 2).ravel()
    middle, half = (ends[0] + ends[-1]) / 2, (ends[-1] - ends[0]) / 2
    # A patch may cross the seam of a closed coordinate: the point is then a period further.
    period = mesh.lines[axis][-1] - mesh.lines[axis][0]
    where = (at + (period if at < ends[0] - SAME * period else 0.0) - middle) / half
    fit = np.linalg.pinv(np.polynomial.legendre.legvander((samples - middle) / half, mesh.degree - 1))
    basis = np.polynomial.legendre.legvander(np.array([where]), mesh.degree - 1)[0]
    slopes = [
        np.polynomial.legendre.legval(where, np.polynomial.legendre.legder(c)) / half for c in np.eye(mesh.degree)
    ]
    return samples, np.array([basis, slopes]) @ fit


def patch_lines(mesh: TensorMesh, axis: int, at: float, breaks: list[float]) -> Array:
    """Return the mesh lines (k,) of a patch around a coordinate; those beyond a seam go on increasing."""
    line = mesh.lines[axis]
    cells, period = len(line) - 1, line[-1] - line[0]
    number = int(np.clip(np.searchsorted(line, at, side="right") - 1, 0, cells - 1))
    # Kinks of stiffness or loads are mesh lines: the patch stays between two of them.
    low, high = 0, cells
    if breaks:
        stops = [k for k, x in enumerate(line) if min(abs(x - b) for b in breaks) <= SAME * period]
        low = max([k for k in stops if k <= number], default=low)
        high = min([k for k in stops if k > number], default=high)
    if mesh.domain.periodic[axis] and not breaks:
        numbers = np.arange(number - REACH // 2, number - REACH // 2 + REACH + 1)
        return np.asarray(line[numbers % cells] + period * (numbers // cells))
    start = max(min(number - REACH // 2, high - REACH), low)
    return np.asarray(line[start : min(start + REACH, high) + 1])
