"""One mesh after another until every quantity of the case is converged.

The meshes of a sequence grow by the square root of two a side. How the cells are shared out between the coordinates
is settled first, on coarse meshes, by what the potential energy gains from a finer mesh in either coordinate alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import SolveFailure
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.quantities import (
    ContactPoint,
    CriticalPoint,
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
from shellbench.solvers.fem.linear.equilibrium import Equilibrium
from shellbench.solvers.fem.mechanics.contact_points import REACH
from shellbench.solvers.fem.mechanics.kinematics import stiffness_moduli
from shellbench.solvers.fem.mechanics.solution import FemSolution
from shellbench.solvers.fem.mesh.convergence import ASYMPTOTIC, Estimate, estimate, observed_rate
from shellbench.solvers.fem.mesh.grading import FEWEST, SIZE_POINTS, Cells, shell_size
from shellbench.solvers.fem.mesh.mesh import ROUNDING, UNSTRAINED
from shellbench.solvers.fem.path.buckling import BRACKET

Array = NDArray[np.float64]

# Of what a field changes by anywhere: no displacement is surer by one change of its own alone. Less lets values that
# stand still by accident pass after two meshes; more asks fields to settle that nobody reads.
ACCIDENT = 0.25
BASE = 8  # cells a side of level 0
COARSEST = -4  # level of the least mesh
FIRST_UNKNOWNS = 12_000  # the first mesh has no more degrees of freedom, unless the coarsest has
MOST_UNEVEN = 3  # largest share: a factor of 8 between the coordinates
ENERGY_LEEWAY = 10  # energies and their parts may be so much less certain than displacements, forces and moments
# Part of the largest displacement, force or moment below which a value's relative error is idle: values of symmetry
# zero never settle relative to themselves.
NEGLIGIBLE = 1e-3
# Of the change by the last refinement of a solve, as the error that rounding leaves.
ROUNDING_FACTOR = 4.0
EPSILON = 16 * float(np.finfo(float).eps)  # relative error that no sum escapes
RESULTANT_LEEWAY = 50  # resultants may be so much less certain than displacements: they are derivatives
# Of a cell: what two meshes agree on of an edge that lies anywhere in a cell may be chance. Came with the suite
# `contact`.
WITHIN_CELL = 0.005
# The same at finite strain, in cubics. Came with `contact_heavy_strip`.
WITHIN_CUBIC_CELL = 0.05
# Relative: two meshes whose paths end closer to each other have found a limit point of the shell. Came with
# `semi_cylinder`, whose coarse meshes end their paths elsewhere.
MOVED = 0.01
MOVING = 3  # meshes whose paths may end elsewhere, on to twice the unknowns each
PROBES = 41  # points a side at which the fields of two meshes are compared


def level_cells(level: int, share: int, degree: int = 3) -> Cells:
    """Return the cells of a level: xi1 gets 2**share times as many as xi2, at the same product.

    They are even in degree 4 and 5, so that closed coordinates have quarters to fold.
    """
    # The product of both counts doubles from level to level, whatever the share.
    pace = 1 if degree == 3 else 2
    first, second = (max(FEWEST, pace * round(BASE / pace * 2 ** ((level + sign * share) / 2))) for sign in (1, -1))
    return first, second


def first_level(dofs: Callable[[Cells], int], degree: int = 3) -> int:
    """Return the level to begin with: 0 of cubics, lower of higher degrees by what their cells hold more.

    It is lower yet if that is many; `dofs` counts a mesh's degrees of freedom.
    """
    level = 3 - degree
    while level > COARSEST and dofs(level_cells(level, 0)) > FIRST_UNKNOWNS:
        level -= 1
    return level


def balanced_share(solve: Callable[[Cells], Equilibrium], pilot: int, degree: int = 3) -> int:
    """Return the share at which both coordinates contribute alike to the error of the energy.

    With an energy error C1 n1**-p + C2 n2**-p a given number of cells n1 n2 is used best where both terms are equal.
    Their ratio is observed: it is that of the changes of the energy when either coordinate alone is refined. No known
    answer is needed, and it holds for loads and for prescribed motions. `pilot` is the level of the trials;
    the order of the element's energy error is twice that of its second derivatives, 2 (degree - 1).
    """
    # Three coarse solves, where the textbook estimates the error in every cell. With one coordinate refined alone the
    # energy changes by C n^-p (1 - growth^-p). All but C is common to both coordinates, and drops out of the ratio.
    rate = 2 * (degree - 1)
    n, finer = level_cells(pilot, 0)[0], level_cells(pilot + 1, 0)[0]
    found = solve((n, n))
    even = found.potential_energy
    first, second = (abs(solve(cells).potential_energy - even) for cells in ((finer, n), (n, finer)))
    unstrained = _unstrained_energy(found.solution)  # of a motion that strains nothing all changes are rounding
    if max(first, second) <= max(ROUNDING * abs(even), unstrained):
        return 0
    # C1 n1^-p = C2 n2^-p and n1 = 2^share n2 give p share = log2 (C1 / C2). A coordinate along which nothing changes
    # would get no cells: its ratio is bounded, and so is the share.
    least = 2.0 ** (-rate * MOST_UNEVEN) * max(first, second)
    return round(math.log2(max(first, least) / max(second, least)) / rate)


@dataclass(frozen=True)
class Level:
    """One mesh of the sequence, with all that was learnt up to it.

    Attributes
    ----------
    equilibrium
        The answer on this mesh.
    quantities
        Its values of the case's quantities.
    estimates
        By quantity, from all meshes so far.
    errors
        By quantity, its uncertainty relative to its scale.
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
    """Yield the answers on ever finer meshes, until one is lost in rounding.

    As many of the first ones as are `forgiven` may fail, and `MOVING` more whose paths end elsewhere than on the mesh
    before. The energy converges no faster than at the rate `slowest`.
    """
    # A limit point of the shell is where it is on every mesh. One that a mesh makes, as where it does not resolve a
    # fold that travels, moves as it is refined.
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
                return  # what coarser meshes found stands, as sure as they are
            # The coarsest meshes may have no equilibrium where finer ones do. A later failure is the case's own.
            end = _path_end(failure)
            moving = moving - 1 if forgiven <= 0 else moving
            if before is not None or (forgiven <= 0 and (moving < 0 or _alike(end, last))):
                raise
            forgiven, last = forgiven - 1, end
            continue
        # Cells a side of the square mesh with as many cells. Between kinks there is a least number of them, so that
        # coarse levels may share a mesh, which is one answer and not two.
        resolution = float(np.sqrt(np.prod(solution.mesh.cells)))
        if resolutions and resolution <= resolutions[-1]:
            continue
        if values.keys() != quantities.keys():  # a path that comes farther, or less far, than those before
            values, resolutions, energies, before = {name: [] for name in quantities}, [], [], None
        asked = [q for q in case.quantities if q.name in quantities]
        resolutions.append(resolution)
        for name, value in quantities.items():
            values[name].append(value)
        energies.append(equilibrium.potential_energy)
        seen = observed_rate(energies[-3:], resolutions[-3:]) if len(energies) > 2 else None
        fastest = min(slowest, seen) if seen is not None else slowest if slowest < ASYMPTOTIC else None
        difference = field_difference(solution, before) if before else None
        # One change may be small by accident, as that of a place at which the field's change passes through zero.
        least = ACCIDENT * difference if case.linear and difference is not None and len(resolutions) == 2 else 0.0
        estimates = {}
        for q in asked:
            found = estimate(values[q.name], resolutions, fastest)
            sure = max(found.uncertainty, least if isinstance(q, LargestDisplacement | DisplacementQuantity) else 0.0)
            if isinstance(q, ContactPoint):
                within = WITHIN_CELL if case.linear else WITHIN_CUBIC_CELL
                sure = max(sure, within * cell_along(solution, q))
            estimates[q.name] = replace(found, uncertainty=sure + rounding(equilibrium, q, quantities))
        # Each is compared with a scale, as a value near zero has no relative error.
        errors = {q.name: estimates[q.name].uncertainty / scale(solution, q, quantities) for q in asked}
        for q in asked:
            if isinstance(q, ContactPoint) and (left := q.length(case) - quantities[q.name]) < cell_along(solution, q):
                # Contact at the very end of a line is taken by points within the last cell, and is never sure to less
                # than they are away from the end. That falls with the cell alone: it is no reason to refine.
                estimates[q.name] = replace(estimates[q.name], uncertainty=max(estimates[q.name].uncertainty, left))
        yield Level(equilibrium, quantities, estimates, errors, difference)
        before = solution


def _path_end(failure: SolveFailure) -> float:
    """Return the load factor at which a path ended, NaN if there is none."""
    history = failure.partial.history if isinstance(failure.partial, FemSolution) else ()
    return history[-1].at if history else math.nan


def _alike(end: float, other: float) -> bool:
    """Return True if two paths end at the same load factor; an unknown factor counts as the same."""
    return not abs(end - other) > MOVED * abs(end)


def cell_along(solution: FemSolution, quantity: ContactPoint) -> float:
    """Return the length of the longest cell along the line of an edge of contact, m."""
    return float(solution.touch(quantity.at).reach[int(quantity.along == "xi2")]) / REACH


def scale(solution: FemSolution, quantity: QuantityModel, quantities: Mapping[str, float]) -> float:
    """Return the magnitude that the uncertainty of a quantity is compared with.

    It is the value itself, but not less than a small part of the largest displacement, force or moment. Parts of the
    strain energy are compared with the whole, and with the leeway that they are given; the whole, not less than a small
    part of what it takes to bend the shell so far. No scale has a size of its own: twice the load makes nothing surer.
    """
    value = abs(quantities[quantity.name])
    tiny = float(np.finfo(float).tiny)
    match quantity:
        case ResultantQuantity():
            arm = 1.0 if quantity.kind == "moment" else 1 / shell_size(solution.case)
            return RESULTANT_LEEWAY * max(value, NEGLIGIBLE * _push(solution, quantity.at) * arm, tiny)
        case EnergyQuantity():
            idle = NEGLIGIBLE * _arc_energy(solution, quantity.at)
            return ENERGY_LEEWAY * max(sum(solution.energies(quantity.at)), idle, tiny)
        case FieldError():
            return 1.0  # it is relative already, and goes to zero
        case LoadQuantity() | LimitPoint() | CriticalPoint() | PotentialEnergy() | ModeQuantity():
            return max(value, tiny)
        case LargestPenetration():
            return max(_largest_displacement(solution, quantity.at), tiny)
        case LargestDisplacement() | DisplacementQuantity():
            return max(value, NEGLIGIBLE * _largest_displacement(solution, quantity.at), tiny)
        case _:
            arm = shell_size(solution.case) if quantity.kind == "torque" else 1.0
            return max(value, NEGLIGIBLE * _push(solution, quantity.at) * arm, tiny)


def _push(solution: FemSolution, at: float | None) -> float:
    """Return the sum of the magnitudes of the supports' nodal forces, N."""
    return float(np.abs(solution.support_forces[..., 0, solution.state(at)]).sum())


def _largest_displacement(solution: FemSolution, at: float | None) -> float:
    return float(np.linalg.norm(solution.coefficients[:, :, 0, solution.state(at)], axis=1).max())


def _arc_energy(solution: FemSolution, at: float | None) -> float:
    """Return the energy, J, of the shell's bending by its largest displacement in one arc over its whole size.

    It is B/2 (w / L^2)^2 A, with the least B. Waves, and membrane strains, take more; a shell that is only moved less.
    """
    case, mesh = solution.case, solution.mesh
    points = mesh.domain.wrap(mesh.domain.grid(SIZE_POINTS, SIZE_POINTS).reshape(-1, 2))
    stiffness = float(stiffness_moduli(case.surface, case.material, points)[:, 1].min())
    curvature = _largest_displacement(solution, at) / shell_size(solution.case) ** 2
    return stiffness * curvature**2 * solution.area / 2


def _unstrained_energy(solution: FemSolution) -> float:
    """Return the energy, J, that rounding makes of a shell that is only moved."""
    strain = UNSTRAINED * _largest_displacement(solution, None)
    return solution.case.material.membrane_stiffness * strain**2


def rounding(equilibrium: Equilibrium, quantity: QuantityModel, quantities: Mapping[str, float]) -> float:
    """Return the error that rounding leaves in a quantity.

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
        case _:
            energy = sum(solution.energies(quantity.at))
            share = math.sqrt(noise / energy) if energy > 0 else 0.0
            return ROUNDING_FACTOR * max(share, EPSILON) * scale(solution, quantity, quantities)


def field_difference(solution: FemSolution, other: FemSolution) -> float:
    """Return the largest difference of two fields at fixed probe points, metres."""
    named = [place.xi for place in solution.case.places.values() if isinstance(place, Point)]
    grid = solution.mesh.domain.grid(PROBES, PROBES).reshape(-1, 2)
    probes = np.concatenate([grid, np.array(named).reshape(-1, 2)])
    return float(np.linalg.norm(solution.displacement(probes) - other.displacement(probes), axis=-1).max())
