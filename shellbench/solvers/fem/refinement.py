"""One mesh after another until every quantity of the case is converged.

The meshes of a sequence grow by the square root of two a side. The ratio of cells of the coordinates is determined
first, on coarse meshes, by the gain of potential energy from refining either coordinate alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import SolveFailure
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.quantities import (
    ContactPoint,
    CriticalPoint,
    DerivativeQuantity,
    DisplacementQuantity,
    EnergyQuantity,
    FieldError,
    LargestDisplacement,
    LargestPenetration,
    LimitPoint,
    LoadQuantity,
    ModeQuantity,
    PotentialEnergy,
    QuantityModel,
    ResultantQuantity,
)
from shellbench.problems.shell.question.places import Point
from shellbench.solvers.fem.algebra.direct_solve import RoundingError
from shellbench.solvers.fem.derivatives.answer import FemAnswer
from shellbench.solvers.fem.linear.equilibrium import Equilibrium
from shellbench.solvers.fem.mechanics.contact_points import REACH
from shellbench.solvers.fem.mechanics.kinematics import stiffness_moduli
from shellbench.solvers.fem.mechanics.solution import FemSolution
from shellbench.solvers.fem.mesh.basis import ROUNDING, UNSTRAINED
from shellbench.solvers.fem.mesh.convergence import ASYMPTOTIC, Estimate, estimate, observed_rate
from shellbench.solvers.fem.mesh.grading import FEWEST, SIZE_POINTS, Cells, shell_size
from shellbench.solvers.fem.path.buckling import BRACKET

Array = NDArray[np.float64]

# Of the largest change of the field: the uncertainty of a displacement is not below this by one small change of its
# own. With less, values that stay constant by chance pass after two meshes; with more, irrelevant parts of the field
# have to settle.
ACCIDENT = 0.25
BASE = 8  # cells a side of level 0
COARSEST = -4  # level of the least mesh
FIRST_UNKNOWNS = 12_000  # the first mesh has no more degrees of freedom, unless the coarsest has
MOST_UNEVEN = 3  # largest share: a factor of 8 between the coordinates
ENERGY_LEEWAY = 10  # factor by which energies may be less certain than displacements, forces and moments
# Part of the largest displacement, force or moment below which a value's relative error is meaningless: values that are
# zero by symmetry never settle relative to themselves.
NEGLIGIBLE = 1e-3
# Factor of the change by the last refinement of a solve; the product is the error by rounding.
ROUNDING_FACTOR = 4.0
EPSILON = 16 * float(np.finfo(float).eps)  # relative error of every sum
RESULTANT_LEEWAY = 50  # factor by which resultants may be less certain than displacements: they are derivatives
# Of a cell: the agreement of two meshes on an edge of contact may be chance within a cell. Set on the suite `contact`.
WITHIN_CELL = 0.005
# The same at finite strain, in cubics. Set on `contact_heavy_strip`.
WITHIN_CUBIC_CELL = 0.05
# Relative: two meshes whose paths end closer to each other have found a limit point of the shell. Set on
# `semi_cylinder`, whose coarse meshes end their paths at other loads.
MOVED = 0.01
MOVING = 3  # meshes whose paths may end at other loads, each with twice the unknowns
PROBES = 41  # points a side at which the fields of two meshes are compared


def level_cells(level: int, share: int, degree: int = 3) -> Cells:
    """Return the cells of a level: xi1 gets 2**share times as many as xi2, at the same product.

    They are even in degree 4 and 5, so that closed coordinates have quarters to fold.
    """
    # The product of both counts doubles from level to level, for any share.
    pace = 1 if degree == 3 else 2
    first, second = (max(FEWEST, pace * round(BASE / pace * 2 ** ((level + sign * share) / 2))) for sign in (1, -1))
    return first, second


def first_level(dofs: Callable[[Cells], int], degree: int = 3) -> int:
    """Return the first level: 0 for cubics, lower for higher degrees, whose cells have more unknowns.

    It is even lower if that mesh has many unknowns; `dofs` counts a mesh's degrees of freedom.
    """
    level = 3 - degree
    while level > COARSEST and dofs(level_cells(level, 0)) > FIRST_UNKNOWNS:
        level -= 1
    return level


def balanced_share(solve: Callable[[Cells], Equilibrium], pilot: int, degree: int = 3) -> int:
    """Return the share at which both coordinates contribute equally to the error of the energy.

    With an energy error C1 n1**-p + C2 n2**-p a given number of cells n1 n2 is used best where both terms are equal.
    Their ratio is observed: it is that of the changes of the energy when either coordinate alone is refined. This needs
    no known answer, and works for loads and for prescribed motions. `pilot` is the level of the trials; the order of
    the element's energy error is twice that of its second derivatives, 2 (degree - 1).
    """
    # The textbook estimates the error in every cell; here three coarse solves suffice. If one coordinate alone is
    # refined, the energy changes by C n^-p (1 - growth^-p). All factors except C are common to both coordinates, and
    # cancel in the ratio.
    rate = 2 * (degree - 1)
    n, finer = level_cells(pilot, 0)[0], level_cells(pilot + 1, 0)[0]
    found = solve((n, n))
    even = found.potential_energy
    first, second = (abs(solve(cells).potential_energy - even) for cells in ((finer, n), (n, finer)))
    unstrained = _unstrained_energy(found.solution)  # for a motion without strains all changes are rounding
    if max(first, second) <= max(ROUNDING * abs(even), unstrained):
        return 0
    # C1 n1^-p = C2 n2^-p and n1 = 2^share n2 give p share = log2 (C1 / C2). A coordinate along which nothing changes
    # would get no cells: therefore the ratio and the share are bounded.
    least = 2.0 ** (-rate * MOST_UNEVEN) * max(first, second)
    return round(math.log2(max(first, least) / max(second, least)) / rate)


@dataclass(frozen=True)
class Level:
    """One mesh of the sequence, with the estimates from all meshes up to it.

    Attributes
    ----------
    equilibrium
        The answer on this mesh.
    quantities
        Its values of the case's quantities.
    estimates
        Estimates by quantity, from all meshes so far.
    errors
        Uncertainty by quantity, relative to its scale.
    difference
        Largest difference to the field of the mesh before, metres; None on the first.
    """

    equilibrium: Equilibrium
    quantities: Mapping[str, float]
    estimates: Mapping[str, Estimate]
    errors: Mapping[str, float]
    difference: float | None

    @property
    def error(self) -> float:
        """Largest of the errors: the slowest quantity decides."""
        return max(self.errors.values())


def levels(
    case: Case,
    meshes: Iterator[Cells],
    solve: Callable[[Cells], Equilibrium],
    measure: Callable[[FemSolution], Mapping[str, float]],
    forgiven: int = 0,
    slowest: float = ASYMPTOTIC,
) -> Iterator[Level]:
    """Yield the answers on ever finer meshes, until rounding dominates.

    The first `forgiven` meshes may fail, and `MOVING` more whose paths end at another load than on the mesh before. The
    energy converges at most at the rate `slowest`.
    """
    # 1. Solve on the next mesh and measure; skip a mesh that is no finer than the last one.
    # 2. Start the sequences again if the path reaches other quantities than before.
    # 3. Observe the rate of the energy, and extrapolate each quantity with at most this rate.
    # 4. Raise an uncertainty to the least values for small changes of fields and for contact; add rounding.
    # 5. Divide by the scale of each quantity.
    # A limit point of the shell is at the same load on every mesh. A spurious one of a mesh, which does not resolve a
    # travelling fold, moves as the mesh is refined.
    values: dict[str, list[float]] = {}
    resolutions: list[float] = []
    energies: list[float] = []
    before: FemSolution | None = None
    last, moving = math.nan, MOVING
    for cells in meshes:
        try:
            equilibrium = solve(cells)
            solution = equilibrium.solution
            quantities = measure(solution)
        except SolveFailure as failure:
            if before is not None and isinstance(failure, RoundingError):
                return  # the answer of coarser meshes stays, with its uncertainty
            # The coarsest meshes may have no equilibrium although finer ones do. A later failure is that of the case.
            end = _path_end(failure)
            moving = moving - 1 if forgiven <= 0 else moving
            if before is not None or (forgiven <= 0 and (moving < 0 or _end_alike(end, last))):
                raise
            forgiven, last = forgiven - 1, end
            continue
        # Cells a side of the square mesh with the same number of cells. Kinks require a least number of cells, so that
        # coarse levels may have the same mesh, which counts once.
        resolution = float(np.sqrt(np.prod(solution.mesh.cells)))
        if resolutions and resolution <= resolutions[-1]:
            continue
        if values.keys() != quantities.keys():  # a path that goes farther, or less far, than those before
            values, resolutions, energies, before = {name: [] for name in quantities}, [], [], None
        asked = [q for q in case.quantities if q.name in quantities]
        resolutions.append(resolution)
        for name, value in quantities.items():
            values[name].append(value)
        energies.append(equilibrium.potential_energy)
        seen = observed_rate(energies[-3:], resolutions[-3:]) if len(energies) > 2 else None
        fastest = min(slowest, seen) if seen is not None else slowest if slowest < ASYMPTOTIC else None
        difference = field_difference(solution, before) if before else None
        # One change may be small by chance, for example at a place where the field's change passes through zero.
        least = ACCIDENT * difference if case.linear and difference is not None and len(resolutions) == 2 else 0.0
        estimates = {}
        for q in asked:
            found = estimate(values[q.name], resolutions, fastest)
            sure = max(found.uncertainty, least if isinstance(q, LargestDisplacement | DisplacementQuantity) else 0.0)
            if isinstance(q, ContactPoint):
                within = WITHIN_CELL if case.linear else WITHIN_CUBIC_CELL
                sure = max(sure, within * cell_along(solution, q))
            estimates[q.name] = replace(found, uncertainty=sure + rounding_error(equilibrium, q, quantities))
        # Each uncertainty is compared with a scale, since a value near zero has no relative error.
        errors = {q.name: estimates[q.name].uncertainty / uncertainty_scale(solution, q, quantities) for q in asked}
        for q in asked:
            if isinstance(q, ContactPoint) and (left := q.length(case) - quantities[q.name]) < cell_along(solution, q):
                # Contact at the very end of a line acts at points within the last cell, so that its uncertainty is at
                # least their distance from the end. This falls with the cell only: it is no reason to refine.
                estimates[q.name] = replace(estimates[q.name], uncertainty=max(estimates[q.name].uncertainty, left))
        yield Level(equilibrium, quantities, estimates, errors, difference)
        before = solution


def _path_end(failure: SolveFailure) -> float:
    """Return the load factor at which a path ended, NaN if there is none."""
    history = failure.partial.history if isinstance(failure.partial, FemSolution) else ()
    return history[-1].at if history else math.nan


def _end_alike(end: float, other: float) -> bool:
    """Return True if two paths end at the same load factor; an unknown factor counts as the same."""
    return not abs(end - other) > MOVED * abs(end)


def cell_along(solution: FemSolution, quantity: ContactPoint) -> float:
    """Return the length of the longest cell along the line of an edge of contact, m."""
    return float(solution.touch(quantity.at).reach[int(quantity.along == "xi2")]) / REACH


def uncertainty_scale(solution: FemSolution, quantity: QuantityModel, quantities: Mapping[str, float]) -> float:
    """Return the scale of a quantity's uncertainty.

    It is the value itself, but at least a small part of the largest displacement, force or moment. Parts of the strain
    energy are compared with the whole, with their leeway. The whole is at least a small part of the energy that bends
    the shell as far. No scale is absolute: doubling the load changes no relative uncertainty.
    """
    value = abs(quantities[quantity.name])
    tiny = float(np.finfo(float).tiny)
    match quantity:
        case ResultantQuantity():
            arm = 1.0 if quantity.kind == "moment" else 1 / shell_size(solution.case)
            return RESULTANT_LEEWAY * max(value, NEGLIGIBLE * _sum_of_reactions(solution, quantity.at) * arm, tiny)
        case EnergyQuantity():
            idle = NEGLIGIBLE * _arc_energy(solution, quantity.at)
            return ENERGY_LEEWAY * max(sum(solution.energies(quantity.at)), idle, tiny)
        case FieldError():
            return 1.0  # it is already relative, and converges to zero
        case LoadQuantity() | LimitPoint() | CriticalPoint() | PotentialEnergy() | ModeQuantity():
            return max(value, tiny)
        case DerivativeQuantity():
            other: Any = solution.case.quantity(quantity.derivative_of)
            per = 1.0 if quantity.relative else abs(quantity.parameter(solution.case).value) or 1.0
            whole = 1.0 if quantity.relative else uncertainty_scale(solution, other, quantities)
            return max(value, NEGLIGIBLE * whole / per, tiny)
        case LargestPenetration():
            return max(_largest_displacement(solution, quantity.at), tiny)
        case LargestDisplacement() | DisplacementQuantity():
            return max(value, NEGLIGIBLE * _largest_displacement(solution, quantity.at), tiny)
        case _:
            arm = shell_size(solution.case) if quantity.kind == "torque" else 1.0
            return max(value, NEGLIGIBLE * _sum_of_reactions(solution, quantity.at) * arm, tiny)


def _sum_of_reactions(solution: FemSolution, at: float | None) -> float:
    """Return the sum of the magnitudes of the supports' nodal forces, N."""
    return float(np.abs(solution.support_forces[..., 0, solution.state(at)]).sum())


def _largest_displacement(solution: FemSolution, at: float | None) -> float:
    return float(np.linalg.norm(solution.coefficients[:, :, 0, solution.state(at)], axis=1).max())


def _arc_energy(solution: FemSolution, at: float | None) -> float:
    """Return the energy, J, of the shell's bending by its largest displacement in one arc over its whole size.

    It is B/2 (w / L^2)^2 A, with the least B. Waves and membrane strains take more energy, and a rigid motion takes
    less.
    """
    case, mesh = solution.case, solution.mesh
    points = mesh.domain.wrap(mesh.domain.grid(SIZE_POINTS, SIZE_POINTS).reshape(-1, 2))
    stiffness = float(stiffness_moduli(case.surface, case.material, points)[:, 1].min())
    curvature = _largest_displacement(solution, at) / shell_size(solution.case) ** 2
    return stiffness * curvature**2 * solution.area / 2


def _unstrained_energy(solution: FemSolution) -> float:
    """Return the energy, J, of a rigidly moved shell by rounding."""
    strain = UNSTRAINED * _largest_displacement(solution, None)
    return solution.case.material.membrane_stiffness * strain**2


def rounding_error(equilibrium: Equilibrium, quantity: QuantityModel, quantities: Mapping[str, float]) -> float:
    """Return the error of a quantity by rounding.

    The last refinement of the linear solve changed the displacements by `correction`, relative to the largest, and the
    change has the energy e = `noise`. A part P of the energy changes by 2 sqrt(P e) + e at most (Cauchy & Schwarz), and
    forces in linear theory by sqrt(e) over the root of the energy.
    """
    solution, value = equilibrium.solution, abs(quantities[quantity.name])
    change, noise = equilibrium.correction, equilibrium.noise
    match quantity:
        case EnergyQuantity():
            return ROUNDING_FACTOR * (2 * math.sqrt(value * noise) + noise) + EPSILON * value
        case FieldError():
            return ROUNDING_FACTOR * max(change, EPSILON)
        case LargestDisplacement() | DisplacementQuantity() | LargestPenetration():
            return ROUNDING_FACTOR * max(change, EPSILON) * _largest_displacement(solution, quantity.at)
        case PotentialEnergy() if solution.case.linear:
            return ROUNDING_FACTOR * noise + EPSILON * value
        case CriticalPoint():
            return BRACKET * value
        case LoadQuantity() | LimitPoint() | PotentialEnergy():
            return EPSILON * value
        case ModeQuantity():
            return (ROUNDING_FACTOR * change**2 + EPSILON) * value
        case DerivativeQuantity():
            other: Any = solution.case.quantity(quantity.derivative_of)
            if isinstance(solution, FemAnswer):
                change = max(change, solution.interpolation_error(other))
            return ROUNDING_FACTOR * max(change, EPSILON) * uncertainty_scale(solution, quantity, quantities)
        case _:
            energy = sum(solution.energies(quantity.at))
            share = math.sqrt(noise / energy) if energy > 0 else 0.0
            return ROUNDING_FACTOR * max(share, EPSILON) * uncertainty_scale(solution, quantity, quantities)


def field_difference(solution: FemSolution, other: FemSolution) -> float:
    """Return the largest difference of two fields at fixed probe points, metres."""
    named = [place.xi for place in solution.case.places.values() if isinstance(place, Point)]
    grid = solution.mesh.domain.grid(PROBES, PROBES).reshape(-1, 2)
    probes = np.concatenate([grid, np.array(named).reshape(-1, 2)])
    return float(np.linalg.norm(solution.displacement(probes) - other.displacement(probes), axis=-1).max())
