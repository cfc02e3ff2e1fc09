"""Portraits: descriptions of problems beside their values, by which a report draws and sorts them.

The report uses portraits and knows no kind of problem. The base class describes a problem that can't be drawn and has
only quantities; other kinds derive their own portraits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Asked(Protocol):
    """Interface of a quantity for tables and figures."""

    @property
    def name(self) -> str:
        """Its name in records."""
        ...

    @property
    def unit(self) -> str:
        """Its unit."""
        ...

    @property
    def description(self) -> str:
        """Description in words; may be empty."""
        ...

    @property
    def at(self) -> float:
        """Mark of the state that it belongs to."""
        ...


class Drawable(Protocol):
    """Interface of a problem for portraits."""

    @property
    def name(self) -> str:
        """Its name in records."""
        ...

    @property
    def title(self) -> str:
        """Title in tables."""
        ...

    @property
    def theory(self) -> str:
        """Theory that its known values must be of."""
        ...

    @property
    def suites(self) -> tuple[str, ...]:
        """Suites that it belongs to."""
        ...

    @property
    def states(self) -> tuple[float, ...]:
        """Marks at which its answer is kept, increasing."""
        ...

    @property
    def quantities(self) -> Sequence[Asked]:
        """The quantities that the problem asks for."""
        ...


@dataclass(frozen=True)
class Along:
    """One series that a problem measures along the way.

    Attributes
    ----------
    name
        Common name of its quantities, without their mark.
    quantity
        The first of them, or one like it.
    quantities
        Names of the quantities that measure it; none if the problem does not ask for it.
    """

    name: str
    quantity: Asked
    quantities: tuple[str, ...]


@dataclass(frozen=True)
class PathSeries:
    """One displacement along a path of loading: all quantities with the same points and directions.

    Attributes
    ----------
    name
        Common part of their names.
    description
        Common part of their descriptions, without the mark.
    """

    name: str
    unit: str
    description: str
    quantities: tuple[Asked, ...]


@dataclass(frozen=True)
class LoadAxis:
    """The axis of loads: the load factor times `scale`."""

    scale: float
    label: str


@dataclass(frozen=True)
class LoadAt:
    """A quantity that is the load, the factor times `scale`, at which the path's displacement first is `at`."""

    name: str
    at: float
    scale: float


@dataclass(frozen=True)
class Turning:
    """A quantity of a turning point of a path, counted from 1: the displacement there, or the load over `scale`."""

    name: str
    of: Literal["load", "displacement"]
    number: int
    gives: Literal["load", "displacement"]
    scale: float


@dataclass(frozen=True)
class Critical:
    """A quantity of a path's critical state: "load", the factor times `scale`, or another quantity's value there."""

    name: str
    gives: str
    scale: float


@dataclass(frozen=True)
class Scene:
    """Drawing of a surface from the points of a run on a grid (n1, n2).

    Attributes
    ----------
    size
        Lengths of the two parameters' ranges.
    scale
        Factor of the displacement; None for a factor that makes the largest displacement visible.
    as_it_is
        True if displacements larger than the surface are drawn without scaling.
    direction
        Component that determines the colour; "inward" for that into the enclosed side; None for the magnitude.
    view
        Elevation and azimuth of the camera, degrees.
    held
        Axis of the parameters and end, "min" or "max", of each held edge.
    pins
        Parameters (2,) of each held point.
    forces
        Parameters (2,) and force (3,) of each point load.
    """

    size: tuple[float, float]
    scale: float | None
    as_it_is: bool
    direction: tuple[float, float, float] | Literal["inward"] | None
    view: tuple[float, float]
    up: Literal["x", "y", "z"]
    held: tuple[tuple[int, str], ...]
    pins: tuple[Array, ...]
    forces: tuple[tuple[Array, Array], ...]


@dataclass(frozen=True)
class Thinness:
    """Thinness of a shell: its thickness over its extent, and the family of shells that differ only in thickness.

    Attributes
    ----------
    family
        Equal for shells that differ only in thickness, names, texts and loads.
    membrane, bending
        Names of the quantities for the parts of its strain energy; empty if they are not asked for.
    """

    ratio: float
    family: str
    membrane: str
    bending: str


class Portrait:
    """The description of a problem for reports. This base class describes a problem that can't be drawn.

    Parameters
    ----------
    problem
        Any problem.
    """

    def __init__(self, problem: Drawable) -> None:
        self.problem = problem

    @property
    def name(self) -> str:
        """Name of the problem in records."""
        return self.problem.name

    @property
    def title(self) -> str:
        """Title in tables."""
        return self.problem.title

    @property
    def theory(self) -> str:
        """Theory that its known values must be of."""
        return self.problem.theory

    @property
    def suites(self) -> tuple[str, ...]:
        """Suites that it belongs to."""
        return self.problem.suites

    @property
    def states(self) -> tuple[float, ...]:
        """Marks at which its answer is kept, increasing."""
        return self.problem.states

    @property
    def quantities(self) -> Sequence[Asked]:
        """The quantities that the problem asks for."""
        return self.problem.quantities

    def quantity(self, name: str) -> Asked:
        """Return the quantity of this name; KeyError if there is none."""
        return {quantity.name: quantity for quantity in self.quantities}[name]

    def mark_words(self, mark: float) -> str:
        """Return the words for a mark, such as "t = 0.25"."""
        return f"t = {mark:.4g}"

    @property
    def unit_of_length(self) -> str:
        """Unit of its displacements."""
        return "m"

    @property
    def unit_of_shape(self) -> str:
        """Unit of the displacements in pictures; empty if their size has no meaning."""
        return self.unit_of_length

    @property
    def extent(self) -> float | None:
        """Largest extent along an axis; None if the problem has no extent."""
        return None

    @property
    def ends(self) -> float | None:
        """Time, s, at which a motion ends; None for a static problem."""
        return None

    @property
    def way(self) -> float:
        """Mark at which a motion or a path ends."""
        return max(self.states, default=1.0)

    @property
    def buckles(self) -> bool:
        """True if a path is followed through buckling."""
        return False

    @property
    def controlled_by(self) -> str | None:
        """Quantity whose values mark the states of a path; None where times or load factors do."""
        return None

    def ways_to_obstacles(self, position: Array) -> tuple[Array, ...]:
        """Return the vectors (n1, n2, 3) from points (n1, n2, 3) at rest to their contact with each obstacle."""
        return ()

    @property
    def scene(self) -> Scene | None:
        """The drawing of its surface; None if it can't be drawn."""
        return None

    @property
    def steps_in_time(self) -> bool:
        """True if answers are refined by shorter steps in time, with the same number of unknowns."""
        return False

    @property
    def frames(self) -> tuple[str, str] | None:
        """Names of the arrays of times (k,), s, and nodes (k, n, 3), m, of a chain that moves; else None."""
        return None

    @property
    def chains(self) -> tuple[int, int] | None:
        """Number of chains that move step by step, and of links of each; else None."""
        return None

    @property
    def worst(self) -> tuple[str, str] | None:
        """Names of the arrays of a garment's worst mesh (n1, n2, 3), m: simulated, and skinned; else None."""
        return None

    @property
    def materials(self) -> Mapping[str, tuple[float, float, float]]:
        """Thickness, modulus and Poisson's ratio of each quantity that belongs to one of many materials, by name."""
        return {}

    @property
    def derivatives(self) -> tuple[str, ...]:
        """Names of quantities that are derivatives with respect to the material."""
        return ()

    @property
    def edit(self) -> str | None:
        """The edit, for a problem that is solved from an earlier solution and from scratch; else None."""
        return None

    @property
    def learns(self) -> bool:
        """True if answers are fields on the unit square, trained or solved for with a number of parameters."""
        return False

    @property
    def sampled(self) -> tuple[str, str] | None:
        """Names of the arrays of a density by cells (m, n) and of samples (k, 2) that answers may keep."""
        return None

    @property
    def along(self) -> tuple[Along, ...]:
        """Measurements along the way other than energies: positions and holding forces."""
        return ()

    @property
    def energies(self) -> tuple[Along, ...]:
        """Energies that are measured all along the way, in the order in which they are shown."""
        return ()

    @property
    def paths(self) -> tuple[PathSeries, ...]:
        """Distinct displacements that are asked for along a path, in order."""
        return ()

    @property
    def load_axis(self) -> LoadAxis:
        """The axis of a path's loads."""
        return LoadAxis(1.0, "load factor t")

    @property
    def load_words(self) -> str:
        """Description of a path's load factor, with its unit."""
        return "load factor t"

    @property
    def loads(self) -> tuple[LoadAt, ...]:
        """Quantities that are loads of a path."""
        return ()

    @property
    def turnings(self) -> tuple[Turning, ...]:
        """Quantities of the turning points of a path."""
        return ()

    @property
    def criticals(self) -> tuple[Critical, ...]:
        """Quantities of the critical state of a path."""
        return ()

    @property
    def thinness(self) -> Thinness | None:
        """Thinness of the shell; None for a problem without thickness."""
        return None

    @property
    def gravity(self) -> Array | None:
        """Acceleration (3,), m/s2, of a free fall; None for other problems."""
        return None

    def direction_of(self, series: str) -> Array | None:
        """Return the direction (3,) of the displacement of a series; None if it is no displacement."""
        return None

    @property
    def rolling_stiffness(self) -> float | None:
        """Twice the bending energy over the square of the angle, J, of a plate that is rolled along its first side."""
        return None
