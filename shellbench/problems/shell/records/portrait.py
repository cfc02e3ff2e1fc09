"""Portraits of shells: the data that a report draws, and the grouping of quantities."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence

import numpy as np

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.quantities import (
    CriticalPoint,
    DisplacementQuantity,
    EnergyQuantity,
    LimitPoint,
    LoadQuantity,
    MotionEnergy,
)
from shellbench.problems.shell.question.loads import GravityLoad, PointLoad
from shellbench.problems.shell.question.places import Edge, Point
from shellbench.problems.shell.records.series import asked_series
from shellbench.protocol.picture import (
    Along,
    Array,
    Critical,
    LoadAt,
    LoadAxis,
    PathSeries,
    Portrait,
    Scene,
    Thinness,
    Turning,
)

GRID = 33  # points a side from which the extent of a shell is taken
TOWARD = 5  # steps toward an obstacle: one if it is given by its distance, more if by another formula
ENERGIES = ("kinetic_energy", "membrane_energy", "bending_energy", "total_energy")


class ShellPortrait(Portrait):
    """Portrait of a shell: the data that a report draws and names."""

    def __init__(self, case: Case) -> None:
        super().__init__(case)
        self.case = case

    def mark_words(self, mark: float) -> str:
        """Return the meaning of a mark of the case, such as "t = 0.25" or "deflection = 12 mm"."""
        case = self.case
        if case.dynamics is not None:
            return f"t = {mark:.4g} s"
        if case.path.quantity is None:
            return f"t = {mark:.4g}"
        return f"{case.path.quantity.replace('_', ' ')} = {mark:.4g} {case.quantity(case.path.quantity).unit}".rstrip()

    @property
    def unit_of_length(self) -> str:
        """Unit of the case's displacements."""
        return next((q.unit for q in self.case.quantities if isinstance(q, DisplacementQuantity)), "m")

    @property
    def unit_of_shape(self) -> str:
        """Unit of the displacements in pictures; empty for modes, whose size means nothing."""
        return "" if self.case.modal else self.unit_of_length

    @property
    def extent(self) -> float:
        """Largest extent of the surface along x, y or z, m."""
        surface = self.case.surface
        points = surface.position(surface.domain.grid(GRID, GRID)).reshape(-1, 3)
        return float(np.ptp(points, axis=0).max())

    @property
    def ends(self) -> float | None:
        """Time, s, at which a motion ends; None without a motion."""
        return None if self.case.dynamics is None else self.case.dynamics.until

    @property
    def way(self) -> float:
        """Mark at which a motion or a path ends."""
        return self.case.path.until if self.case.dynamics is None else self.case.dynamics.until

    @property
    def buckles(self) -> bool:
        """True if the path is followed through buckling."""
        return self.case.path.after_buckling == "follow"

    @property
    def controlled_by(self) -> str | None:
        """Displacement quantity that controls the path; None under load control."""
        return self.case.path.quantity

    @property
    def scene(self) -> Scene:
        """Scene of the shell: with the whole edges that are held, except those in planes of symmetry."""
        case, picture = self.case, self.case.picture
        held = [place for support, place in case.supported_places() if not support.symmetry]
        forces: list[tuple[Array, Array]] = []
        for load in case.loads:
            if not isinstance(load, PointLoad):
                continue
            force = np.array([case.scalar(text, 1.0) for text in load.force])
            places = [case.places[name] for name in load.on] if np.any(force) else []
            forces += [(np.asarray(place.xi), force) for place in places if isinstance(place, Point)]
        return Scene(
            size=case.surface.domain.size,
            scale=picture.scale,
            as_it_is=not case.linear,
            direction=picture.direction,
            view=picture.view,
            up=picture.up,
            held=tuple((place.axis, place.side) for place in held if isinstance(place, Edge) and place.whole),
            pins=tuple(np.asarray(place.xi) for place in held if isinstance(place, Point)),
            forces=tuple(forces),
        )

    def ways_to_obstacles(self, position: Array) -> tuple[Array, ...]:
        """Return the vectors (n1, n2, 3) from points (n1, n2, 3) at rest to their contact with each obstacle.

        A moving obstacle is taken at its final place.
        """
        case, ways = self.case, []
        t = 1.0 if case.dynamics is None else case.dynamics.until
        skin = case.material.thickness / 2 if case.contact.thickness else 0.0
        for obstacle in case.obstacles:
            offsets, way = position - obstacle.at(t)[0], np.zeros_like(position)
            for _ in range(TOWARD):
                there = offsets + way
                way = way - (obstacle.distance(there) - skin)[..., None] * obstacle.gradient(there)
            ways.append(way)
        return tuple(ways)

    @property
    def along(self) -> tuple[Along, ...]:
        """Quantities measured all along the path or motion, except energies: positions, and forces of supports."""
        kinds = EnergyQuantity | MotionEnergy
        asked = asked_series(self.case)
        return tuple(Along(o.name, o.quantity, o.quantities) for o in asked if not isinstance(o.quantity, kinds))

    @property
    def energies(self) -> tuple[Along, ...]:
        """Energies along the way, in the order in which they are shown; not the sum of two."""
        found = {o.quantity.kind: Along(o.name, o.quantity, o.quantities) for o in asked_series(self.case)}
        return tuple(found[kind] for kind in ENERGIES if kind in found)

    @property
    def paths(self) -> tuple[PathSeries, ...]:
        """Distinct displacements that the case asks for, in its order."""
        alike: dict[tuple[object, ...], list[DisplacementQuantity]] = {}
        for quantity in self.case.quantities:
            if isinstance(quantity, DisplacementQuantity):
                alike.setdefault((quantity.points, quantity.directions), []).append(quantity)
        found: dict[str, PathSeries] = {}
        for quantities in alike.values():
            last = max(quantities, key=lambda quantity: quantity.at)
            parts = zip(*(quantity.name.split("_") for quantity in quantities), strict=False)
            common = "_".join(part[0] for part in itertools.takewhile(lambda part: len(set(part)) == 1, parts))
            name = common if common and common not in found else last.name
            found[name] = PathSeries(name, last.unit, _common_description(quantities), tuple(quantities))
        return tuple(found.values())

    @property
    def load_axis(self) -> LoadAxis:
        """Axis of the load: in the unit of the case's own load quantities."""
        for quantity in self.case.quantities:
            if isinstance(quantity, LoadQuantity) or (isinstance(quantity, LimitPoint) and quantity.gives == "load"):
                return LoadAxis(quantity.scale, f"load ({quantity.unit})")
        return super().load_axis

    @property
    def load_words(self) -> str:
        """Name of the path's load factor with its unit, from the critical point."""
        for quantity in self.case.quantities:
            if isinstance(quantity, CriticalPoint) and quantity.gives == "load" and quantity.scale == 1:
                return f"{readable(quantity.name.removeprefix('critical_'))} ({quantity.unit})"
        return super().load_words

    @property
    def loads(self) -> tuple[LoadAt, ...]:
        """Quantities that are loads of the path."""
        return tuple(LoadAt(q.name, q.at, q.scale) for q in self.case.quantities if isinstance(q, LoadQuantity))

    @property
    def turnings(self) -> tuple[Turning, ...]:
        """Quantities of the turning points of the path."""
        points = (q for q in self.case.quantities if isinstance(q, LimitPoint))
        return tuple(Turning(q.name, q.turning, q.number, q.gives, q.scale) for q in points)

    @property
    def criticals(self) -> tuple[Critical, ...]:
        """Quantities of the critical state of the path."""
        return tuple(Critical(q.name, q.gives, q.scale) for q in self.case.quantities if isinstance(q, CriticalPoint))

    @property
    def thinness(self) -> Thinness:
        """Ratio of thickness to extent; the family of shells that differ in thickness and loads only, as a digest."""
        material = self.case.material.model_copy(update={"thickness": 1.0})
        names = {quantity.kind: quantity.name for quantity in self.case.quantities}
        return Thinness(
            ratio=self.case.material.thickness / self.extent,
            family=self.case.model_copy(update={"material": material, "loads": ()}).digest(),
            membrane=names.get("membrane_energy", ""),
            bending=names.get("bending_energy", ""),
        )

    @property
    def gravity(self) -> Array | None:
        """Acceleration (3,), m/s2, of a case with gravity alone and without supports; None for any other case."""
        case = self.case
        if case.dynamics is None or case.supports or case.springs or len(case.loads) != 1:
            return None
        (load,) = case.loads
        if not isinstance(load, GravityLoad) or not all(isinstance(a, int | float) for a in load.acceleration):
            return None
        return np.array(load.acceleration, dtype=float)

    def direction_of(self, series: str) -> Array | None:
        """Return the one direction (3,) of a series of displacements; None for any other series."""
        quantity = next((one.quantity for one in asked_series(self.case) if one.name == series), None)
        if not isinstance(quantity, DisplacementQuantity) or len(quantity.directions) != 1:
            return None
        return np.asarray(quantity.directions[0])

    @property
    def rolling_stiffness(self) -> float:
        """B A / L^2 of a plate that is rolled along xi1, J: its bending energy is half of it times theta^2."""
        length, width = self.case.surface.domain.size
        return self.case.material.bending_stiffness * width / length


def _common_description(quantities: Sequence[DisplacementQuantity]) -> str:
    """Return the words that the descriptions have in common, up to those on the mark."""
    words = zip(*(quantity.description.split() for quantity in quantities), strict=False)
    common = " ".join(word[0] for word in itertools.takewhile(lambda word: len(set(word)) == 1, words))
    return common if len(quantities) == 1 else f"{common} ".partition(" at ")[0].strip()


def readable(name: str) -> str:
    """Return the name of a series for an axis: letters with an index as such, all else as words."""
    if found := re.fullmatch(r"([A-Za-z])_(\w)", name):
        return f"${found[1]}_{{{found[2]}}}$"
    return name.replace("_", " ")
