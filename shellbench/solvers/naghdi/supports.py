"""The fields that vanish at supported edges.

A support of an edge holds components of the displacement. Where these hold the displacement along the normal, the edge
is kept straight, and the normal can't turn about it sideways: its change along the edge is held too (a hard support,
as that of a rigid diaphragm), unless it is soft. A clamp, or a plane of symmetry, holds its change across the edge.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.conditions import COMPONENTS
from shellbench.problems.shell.question.places import Edge
from shellbench.solvers.naghdi.strains import FIELDS, Frame

Array = NDArray[np.float64]

ALONG_EDGE = 33  # points of an edge at which its frame is looked at
STRAIGHT = 1e-9  # allowed error of a frame in a support's condition


def held_fields(case: Case) -> list[set[Edge]]:
    """Return, for each of the five fields, the edges on which it vanishes.

    Raises
    ------
    InputError
        If an edge that holds one component of the normal's change is not at right angles to the other coordinate.
    """
    held: list[set[Edge]] = [set() for _ in range(FIELDS)]
    for support, place in case.supported_places():
        assert isinstance(place, Edge)
        frame = Frame.at(case, place.samples(case.surface.domain, ALONG_EDGE))
        components = [COMPONENTS.index(name) for name in COMPONENTS if name in support.held]
        for component in components:
            held[component].add(place)
        free = np.delete(frame.normal, components, axis=1)
        kept_straight = support.symmetry is None and bool(np.all(np.abs(free) < STRAIGHT))
        hard = kept_straight and support.shear != "soft"
        # t_1 is along edges of xi2, and t_2 along those of xi1 if the coordinates are at right angles there.
        along, across = (4, 3) if place.axis == 0 else (3, 4)
        if hard != support.holds_slope and np.abs(_skew(frame)).max() > STRAIGHT:
            raise InputError(f"{case.name}: support '{support.name}' is on an edge of skew coordinates")
        if hard:
            held[along].add(place)
        if support.holds_slope:
            held[across].add(place)
    return held


def _skew(frame: Frame) -> Array:
    """Return the cosines (N,) of the angle between the coordinates."""
    second = frame.base[:, 1] / np.linalg.norm(frame.base[:, 1], axis=-1)[:, None]
    return np.asarray(np.sum(second * frame.tangents[:, 0], axis=-1))
