"""Values without a limit, which forces and supports at single points leave undefined.

A force F at a point, along the midsurface, moves that point without bound as the cells around it shrink. Each halving
of the cell adds (G = E / (2 (1 + nu)), all per thickness h)

    inside the shell        (1 + nu) (3 - nu) F ln 2 / (4 pi E h)       Kelvin's plane stress
    on a free edge          2 F ln 2 / (pi E h)                         Flamant
    at a corner of angle a  2 F ln 2 / (E h (a - sin a))                Michell; a + sin a along the bisector

to the displacement along F, and half of F times that to the strain energy. The displacement along the normal is finite,
and so are all values at other points. A support that holds a point along the midsurface exerts such a force: the point
yields without bound, so that the support holds nothing in the limit. With shear deformation (Naghdi) all of this is
true of the normal as well.

A force that leans from the normal by less than 45 degrees is accepted, since bending displaces the shell much more. The
drift of the value from the largest conceivable cell to one of the shell's thickness is part of its uncertainty
(`drifts`). All other such quantities are refused when the case is read (`check_point_actions`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.posed.mirrors import ON_THE_WAY, ComparisonPoints, mirror_of
from shellbench.problems.shell.posed.point_supports import LEANING, check_point_supports, leaning_supports, mark_of
from shellbench.problems.shell.posed.shell import Shell
from shellbench.problems.shell.posed.spots import NO_PART, Spot, is_on, spot_at
from shellbench.problems.shell.quantities.quantities import (
    DisplacementQuantity,
    EnergyQuantity,
    LargestDisplacement,
    PositionQuantity,
    PotentialEnergy,
)
from shellbench.problems.shell.quantities.quantity import ShellQuantity
from shellbench.problems.shell.question.conditions import COMPONENTS
from shellbench.problems.shell.question.loads import PointLoad
from shellbench.problems.shell.question.places import Point

Array = NDArray[np.float64]

SPREAD = "spread it over a stated length (a load of kind 'edge' on a part of an edge, or of kind 'area')"


@dataclass(frozen=True)
class Pull:
    """A force on a point along which it moves without bound.

    Attributes
    ----------
    force
        Its magnitude, N.
    steep
        Whether it is so large a part of the force there that the case is refused.
    """

    spot: Spot
    force: float
    steep: bool

    @property
    def drift(self) -> float:
        """Displacement of the point by refinement to cells as small as the thickness, m."""
        return self.force * self.spot.softness * self.spot.halvings


def check_point_actions(case: Shell) -> None:
    """Check that the quantities of a case have a limit as meshes are refined.

    Raises
    ------
    ValueError
        In one clause with the reason and the way out.
    """
    if case.prescribed:
        return
    if not case.linear:
        _check_finite_strain(case)
        return
    for quantity in case.quantities:
        for pull in _unlimited_pulls(case, mark_of(case, quantity)):
            if pull.steep and _value_change(case, quantity, pull, None):
                how, way = (
                    ("at a single point", "ask for the theory kirchhoff-love-linear")
                    if pull.spot.shears
                    else ("along the midsurface at a single point", "turn it into the normal")
                )
                raise ValueError(
                    f"quantity '{quantity.name}' has no limit: the force at '{pull.spot.name}' acts {how}, which it"
                    f" moves without bound as meshes are refined; {SPREAD}, or {way}"
                )
    check_point_supports(case)


def drifts(case: Shell, solution: Any) -> dict[str, float]:
    """Return the change of values by refinement to cells as small as the thickness, by quantity, in SI units."""
    if not _may_drift(case):
        return {}
    found = {}
    for quantity in case.quantities:
        moved = sum(p.drift * _value_change(case, quantity, p, solution) for p in _unlimited_pulls(case, quantity.at))
        for support, spot, lean in leaning_supports(case):
            # The point yields along the midsurface by a drift, and along the support's own direction by its share.
            force = lean * float(np.linalg.norm(solution.reaction(support.name, at=quantity.at)[0]))
            yielding = Pull(spot, force, steep=False)
            of_place = isinstance(quantity, DisplacementQuantity | PositionQuantity | LargestDisplacement)
            moved += yielding.drift * (lean if of_place else _value_change(case, quantity, yielding, solution))
        if moved:
            found[quantity.name] = moved
    return found


def remark(case: Shell) -> str:
    """Return a clause on values that have no limit but are given; empty if there are none."""
    if not _may_drift(case):
        return ""
    words = []
    for pull in {p.spot.name: p for q in case.quantities for p in _unlimited_pulls(case, q.at)}.values():
        names = [q.name for q in case.quantities if _value_change(case, q, pull, None)]
        if names:
            words.append(
                f"the force at '{pull.spot.name}' leans from the normal, so that {', '.join(names)} drift without"
                " bound as meshes are refined"
            )
    feet: dict[str, list[str]] = {}
    for support, spot, _ in leaning_supports(case):
        feet.setdefault(support.name, []).append(f"'{spot.name}'")
    words += [
        f"support '{name}' leans from the normal at {', '.join(places)}, and yields as meshes are refined"
        for name, places in feet.items()
    ]
    end = "the drift down to cells as small as the thickness is part of the stated uncertainty"
    return "; ".join([*words, end]) if words else ""


def _may_drift(case: Shell) -> bool:
    return case.linear and not case.modal and not case.prescribed


def _value_change(case: Shell, quantity: ShellQuantity, pull: Pull, solution: Any) -> float:
    """Return the change of a value for each metre that a point moves; 0 if the value has a limit.

    The largest displacement takes part along the direction in which the point has moved, if that is known. The energy
    takes half the force. On a curved shell membrane strains bend it, with changes of curvature of at most 2 k times
    the strain, and B / D = h^2 / 12.
    """
    spot = pull.spot
    match quantity:
        case DisplacementQuantity() | PositionQuantity():
            alike = (quantity.direction,) * len(quantity.points)
            one = quantity.directions if isinstance(quantity, DisplacementQuantity) else alike
            there = zip(map(case.places.__getitem__, quantity.points), one, strict=True)
            return sum(spot.unlimited_share(along) for place, along in there if is_on(case, place, spot.xi)) / len(one)
        case LargestDisplacement():
            moved = None if solution is None else solution.displacement(np.array([spot.xi]), at=quantity.at)[0]
            return 1.0 if moved is None or not np.any(moved) else spot.unlimited_share(moved)
        case EnergyQuantity(kind="bending_energy") if not spot.shears:
            return pull.force / 2 * spot.bent**2 / 3
        case EnergyQuantity() | PotentialEnergy():
            return pull.force / 2
    return 0.0


def _unlimited_pulls(case: Shell, t: float) -> list[Pull]:
    """Return the forces at points with an unlimited part; forces on the same point are added."""
    found = []
    for spot, force in _points_with_forces(case, t):
        free, part = (float(np.linalg.norm(v)) for v in (spot.free_part(force), spot.unlimited_part(force)))
        if part > NO_PART * np.linalg.norm(force):
            found.append(Pull(spot, part, spot.shears or part > LEANING * free))
    return found


def _points_with_forces(case: Shell, t: float) -> Iterator[tuple[Spot, Array]]:
    """Yield the points at which forces act, and their sum (3,) at each, N."""
    forces: dict[tuple[float, ...], tuple[Point, Array]] = {}
    for load in case.loads:
        if isinstance(load, PointLoad):
            for place in map(case.places.__getitem__, load.on):
                assert isinstance(place, Point)
                key = tuple(case.surface.domain.wrap(place.xi))
                force = case.evaluate(load.force, place.xi, t)[0, 0]
                forces[key] = place, force + (forces[key][1] if key in forces else 0.0)
    yield from ((spot_at(case, place), force) for place, force in forces.values())


def _check_finite_strain(case: Shell) -> None:
    """Check that two planes of symmetry through each point with a force keep the force along the normal."""
    last = case.dynamics.until if case.dynamics else case.path.until if case.path.quantity is None else 1.0
    for t in (last, ON_THE_WAY * last):
        for spot, force in _points_with_forces(case, t):
            size = np.linalg.norm(force)
            if np.linalg.norm(spot.free_part(force)) <= NO_PART * size:
                continue
            if np.linalg.norm(spot.unlimited_part(force)) > NO_PART * size or len(_symmetry_planes(case, spot)) < 2:
                raise ValueError(
                    f"a load of kind 'point' acts on '{spot.name}' at finite strain, and no two planes of symmetry keep"
                    " it along the normal there: strains under it grow to the order of 1, and what it moves depends on"
                    f" the mesh; {SPREAD}"
                )


def _symmetry_planes(case: Shell, spot: Spot) -> set[int]:
    """Return the normals (0, 1, 2) of planes of symmetry through a point and its normal."""
    sight, found = ComparisonPoints.spread_over(case), set[int]()
    for support, place in case.supported_places():
        if support.symmetry and is_on(case, place, spot.xi):
            found.add(COMPONENTS.index(support.symmetry))
    for axis in (0, 1):
        if (mirror := mirror_of(case, axis, spot.xi[axis], sight)) is not None:
            found.add(mirror.normal)
    return {normal for normal in found if abs(spot.normal[normal]) <= NO_PART}
