"""Cases: the questions that the suite asks, read from TOML and checked.

A case is data. Nothing in it is evaluated as Python, and whatever is wrong with it is said in one sentence
that names the file and the field.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, ValidationError, model_validator

from shellbench.errors import InputError
from shellbench.model import LONGEST_TITLE, Finite, Model, one_sentence, read_toml
from shellbench.problems.expression import Expression
from shellbench.problems.shell.conditions import (
    COMPONENTS,
    EdgeLoad,
    Formula,
    GravityLoad,
    Load,
    MomentLoad,
    Name,
    PointLoad,
    Rotation,
    Spring,
    Support,
    Translation,
    Value,
    VectorFormula,
)
from shellbench.problems.shell.course import SAMPLES, check_motion, check_path, formulas_of
from shellbench.problems.shell.dynamics import Dynamics
from shellbench.problems.shell.material import Material
from shellbench.problems.shell.path import Path as LoadPath
from shellbench.problems.shell.places import Edge, Place, Point, Whole, places_of
from shellbench.problems.shell.quantities import (
    CriticalPoint,
    DisplacementQuantity,
    PositionQuantity,
    QuantityModel,
    ReactionQuantity,
    TorqueQuantity,
    Unmarked,
)
from shellbench.problems.shell.rigid import RigidMotion, check_held
from shellbench.problems.shell.surface import SurfaceModel

Array = NDArray[np.float64]
Theory = Literal["kirchhoff-love-linear", "kirchhoff-love-nonlinear"]
ALONG = 1e-3  # sine of the angle between an axis and a normal below which they are along each other
MOTION_VARIABLES = ("xi1", "xi2", "t")  # t is the time, or the load factor of a static case
NOT_PHYSICS = {"name", "title", "description", "suites", "units", "picture"}
NOT_PHYSICS_OF_A_QUANTITY = {"description", "unit", "primary", "tolerance", "absolute", "open_finding"}


class Picture(Model):
    """How the report draws the deformed shell.

    Without a `scale` the report chooses one by which the largest displacement can be seen.
    """

    scale: Finite | None = Field(None, description="factor of the displacement")
    direction: tuple[Finite, Finite, Finite] | None = Field(None, description="colour by this component")
    view: tuple[Finite, Finite] = Field((25.0, -60.0), description="elevation and azimuth of the camera, degrees")
    up: Literal["x", "y", "z"] = "z"


class Case(Model):
    """One declared problem.

    Attributes
    ----------
    name
        Stem of the file; records and known values refer to it.
    theory
        Which theory the answer is asked for: known values of another theory do not judge it.
    units
        Units of the file: SI unless it says otherwise (text for tables; nothing is converted).
    points
        Named points (xi1, xi2); degrees for angles.
    focus
        Names of points near which the answer varies quickly, though no force acts at them as such: meshes and inputs
        may be graded toward them.
    path
        How a non-linear static case is loaded.
    dynamics
        That, and until when, the shell moves by Newton's law; None in a static case.
    remove_rigid_motions
        Rigid motions that nothing holds; the answer is made orthogonal to them in the mean over the area.
    """

    name: Name
    kind: Literal["shell"] = "shell"
    title: str = Field(max_length=LONGEST_TITLE)
    description: str = ""
    units: str = "SI"
    suites: tuple[Name, ...] = ()
    theory: Theory
    surface: SurfaceModel
    material: Material
    points: dict[Name, tuple[Finite, Finite]] = Field(default_factory=dict)
    supports: tuple[Support, ...] = ()
    springs: tuple[Spring, ...] = ()
    remove_rigid_motions: tuple[RigidMotion, ...] = ()
    loads: tuple[Load, ...] = ()
    focus: tuple[Name, ...] = ()
    path: LoadPath = Field(default_factory=lambda: LoadPath())
    dynamics: Dynamics | None = None
    quantities: tuple[QuantityModel, ...] = Field(min_length=1)
    picture: Picture = Field(default_factory=lambda: Picture())

    @property
    def linear(self) -> bool:
        """Whether strains are linearised."""
        return self.theory == "kirchhoff-love-linear"

    @cached_property
    def places(self) -> dict[str, Place]:
        """Edges, corners and points by name."""
        return places_of(self.surface.domain, self.points)

    @property
    def prescribed(self) -> bool:
        """Whether the whole surface is moved as prescribed, so that nothing is left to solve for."""
        return any(isinstance(place, Whole) and support.motion for support, place in self.supported_places())

    @property
    def held_everywhere(self) -> tuple[int, ...]:
        """Components (0, 1, 2) that are held at zero on the whole surface, as in plane motion."""
        held = {c for s, place in self.supported_places() if isinstance(place, Whole) and not s.motion for c in s.held}
        return tuple("xyz".index(c) for c in sorted(held))

    def spring_stiffness(self, points: ArrayLike) -> Array:
        """Return the stiffness (..., 3) of all springs at points (..., 2), by component, N/m^3."""
        xi = np.asarray(points, dtype=float)
        total = np.zeros((*xi.shape[:-1], 3))
        for spring in self.springs:
            total[..., ["xyz".index(c) for c in spring.components]] += self._checked_stiffness(spring, xi)[..., None]
        return total

    @property
    def primary(self) -> QuantityModel:
        """The headline quantity."""
        return next(q for q in self.quantities if q.primary)

    @property
    def states(self) -> tuple[float, ...]:
        """Times, load factors or other marks of the path (see `Path`) at which the answer is kept, increasing.

        In the non-linear theory the last one is the end of the path, or of the motion.
        """
        asked = {q.at for q in self.quantities if not isinstance(q, Unmarked)}
        if self.dynamics is not None:
            return tuple(sorted(asked | {*self.dynamics.states, self.dynamics.until}))
        end = set() if self.linear else {self.path.until}
        return tuple(sorted(asked | set(self.path.states) | end))

    def quantity(self, name: str) -> QuantityModel:
        """Return the quantity of this name; KeyError if there is none."""
        for quantity in self.quantities:
            if quantity.name == name:
                return quantity
        raise KeyError(name)

    def supported_places(self) -> Iterator[tuple[Support, Place]]:
        """Yield each support with each of its places."""
        for support in self.supports:
            for name in support.on:
                yield support, self.places[name]

    def evaluate(
        self, vector: VectorFormula, points: ArrayLike, t: float = 1.0, order: int = 0
    ) -> dict[tuple[int, int], Array]:
        """Evaluate a vector of numbers or formulas.

        Parameters
        ----------
        vector
            Three numbers or formulas in xi1, xi2 and t.
        points
            (..., 2) curvilinear coordinates, angles in radians.
        t
            Time, s, or load factor.
        order
            Highest order of the derivatives with respect to (xi1, xi2).

        Returns
        -------
        dict
            (i, j) -> (..., 3), in the units of the formulas.
        """
        components = [self.formula(text).derivatives(points, order, t) for text in vector]
        return {key: np.stack([c[key] for c in components], axis=-1) for key in components[0]}

    def formula(self, text: Formula) -> Expression:
        """Read a number or formula of a support or load; the surface's constants are known to it."""
        return Expression(text, MOTION_VARIABLES, self.surface.named_constants)

    @property
    def steady(self) -> bool:
        """Whether no load depends on t."""
        return not any(self.formula(f).depends_on("t") for load in self.loads for f in formulas_of(load))

    def scalar(self, text: Formula, t: float) -> float:
        """Evaluate a number or a formula in t alone."""
        return float(self.formula(text).derivatives(np.zeros(2), 0, t)[0, 0])

    def motion(
        self, support: Support, place: Place, points: ArrayLike, t: float = 1.0, order: int = 0
    ) -> dict[tuple[int, int], Array]:
        """Evaluate the motion that a support prescribes at one of its places, extended to all points.

        A rotation or translation moves every point of the shell as it moves the support. A prescribed value
        belongs to the edge: it is constant along the other coordinate, so that it tilts no normal.

        Parameters
        ----------
        support, place
            One of the case's supports and one of its places.
        points
            (..., 2) curvilinear coordinates, angles in radians.
        t
            Time, s, or load factor.
        order
            Highest order of the derivatives with respect to (xi1, xi2).

        Returns
        -------
        dict
            (i, j) -> (..., 3) displacement in metres, and its derivatives.
        """
        xi = np.asarray(points, dtype=float)
        keys = [(i, total - i) for total in range(order + 1) for i in range(total, -1, -1)]
        result = {key: np.zeros((*xi.shape[:-1], 3)) for key in keys}
        match support.motion:
            case Translation(vector=vector):
                result[0, 0][...] = [self.scalar(text, t) for text in vector]
            case Value() as value if isinstance(place, Edge):
                on_edge = self.evaluate(value.vector, place.project(self.surface.domain, xi), t, order)
                result |= {key: d for key, d in on_edge.items() if key[place.axis] == 0}
            case Value() as value if isinstance(place, Whole):
                result = self.evaluate(value.vector, xi, t, order)
            case Value() as value if isinstance(place, Point):
                result[0, 0][...] = self.evaluate(value.vector, np.asarray(place.xi), t)[0, 0]
            case Rotation() as rotation:
                turn = rotation_matrix(rotation, self.scalar(rotation.angle, t), self.linear) - np.eye(3)
                for key, x in self.surface.derivatives(xi, order).items():
                    result[key] = (x - np.asarray(rotation.centre) if key == (0, 0) else x) @ turn.T
        return result

    def turn(self, support: Support, t: float = 1.0) -> Array:
        """Return the matrix (3, 3) by which a support turns the normals that it carries.

        In linear theory a turned normal differs by what is of second order, and it is the identity.
        """
        if self.linear or not isinstance(support.motion, Rotation):
            return np.eye(3)
        return rotation_matrix(support.motion, self.scalar(support.motion.angle, t), linear=False)

    def physics(self) -> dict[str, Any]:
        """Return all that an answer depends on: no tolerances, suites or prose."""
        data = self.model_dump(mode="json", exclude=NOT_PHYSICS)
        for quantity in data["quantities"]:
            for field in NOT_PHYSICS_OF_A_QUANTITY:
                quantity.pop(field, None)
        return data

    def digest(self) -> str:
        """Return the hexadecimal SHA-256 of the physics."""
        text = json.dumps(self.physics(), sort_keys=True, allow_nan=False)
        return hashlib.sha256(text.encode()).hexdigest()

    @model_validator(mode="after")
    def _names_are_known_and_used_once(self) -> Self:
        places = self.places
        for what, names in (
            ("support", [s.name for s in self.supports]),
            ("spring", [s.name for s in self.springs]),
            ("quantity", [q.name for q in self.quantities]),
        ):
            for name in names:
                if names.count(name) > 1:
                    raise ValueError(f"two of them are called '{name}': {what} names must differ")
        for where, name in self._named_places():
            if name not in places:
                raise ValueError(f"{where} is on '{name}', which is not a place; places are {', '.join(places)}")
        if sum(q.primary for q in self.quantities) != 1:
            raise ValueError("exactly one quantity must be primary")
        return self

    def _named_places(self) -> Iterator[tuple[str, str]]:
        for support in self.supports:
            yield from ((f"support '{support.name}'", name) for name in support.on)
        for load in self.loads:
            if isinstance(load, EdgeLoad | PointLoad | MomentLoad):
                yield from ((f"a load of kind '{load.kind}'", name) for name in load.on)
        yield from (("the focus", name) for name in self.focus)
        for quantity in self.quantities:
            if isinstance(quantity, DisplacementQuantity | PositionQuantity):
                yield from ((f"quantity '{quantity.name}'", name) for name in quantity.points)

    @model_validator(mode="after")
    def _conditions_fit_their_places(self) -> Self:
        held: set[tuple[str, str]] = set()
        for support, place in self.supported_places():
            if support.holds_slope and not isinstance(place, Edge):
                raise ValueError(f"support '{support.name}' is clamped on '{place.name}', but only edges can be")
            if isinstance(place, Whole) and support.motion is not None:
                if len(self.supports) > 1 or len(support.on) > 1:
                    raise ValueError(
                        f"support '{support.name}' moves the whole surface, so there can be no other place or support"
                    )
                if len(support.held) < len(COMPONENTS):
                    raise ValueError(
                        f"support '{support.name}' on the surface holds all components, not {support.held}"
                    )
            elif isinstance(place, Whole) and len(support.held) == len(COMPONENTS):
                raise ValueError(f"support '{support.name}' on the surface needs a motion, or leaves a component free")
            for component in support.held:
                if (place.name, component) in held:
                    raise ValueError(f"component {component} on '{place.name}' is held by two supports")
                held.add((place.name, component))
        everywhere = {c for s, place in self.supported_places() if isinstance(place, Whole) for c in s.held}
        for support, place in self.supported_places():
            twice = everywhere & set(support.held) if not isinstance(place, Whole) else ()
            if twice:
                raise ValueError(f"component {min(twice)} on '{place.name}' is held on the whole surface already")
        for load in self.loads:
            for name in load.on if isinstance(load, EdgeLoad | PointLoad | MomentLoad) else ():
                if not isinstance(self.places[name], Point if isinstance(load, PointLoad) else Edge):
                    raise ValueError(f"a load of kind '{load.kind}' can't act on '{name}'")
                if isinstance(load, MomentLoad) and self._is_normal(load.axis, self.places[name]):
                    raise ValueError(
                        f"the axis of a moment on '{name}' is the normal there, which no moment about itself turns"
                    )
        for quantity in self.quantities:
            if isinstance(quantity, DisplacementQuantity | PositionQuantity):
                for name in quantity.points:
                    if not isinstance(self.places[name], Point):
                        raise ValueError(f"quantity '{quantity.name}' needs points, but '{name}' is none")
            names = [s.name for s in self.supports]
            if isinstance(quantity, ReactionQuantity | TorqueQuantity) and quantity.support not in names:
                raise ValueError(f"quantity '{quantity.name}' names support '{quantity.support}'; known are {names}")
            if isinstance(quantity, CriticalPoint) and quantity.gives != "load":
                others = [q.name for q in self.quantities if not isinstance(q, Unmarked)]
                if quantity.gives not in others:
                    raise ValueError(f"quantity '{quantity.name}' gives '{quantity.gives}'; known are {others}")
        return self

    def _is_normal(self, axis: tuple[float, float, float], place: Place) -> bool:
        """Tell whether an axis is along the normal anywhere on an edge."""
        assert isinstance(place, Edge)
        domain, running = self.surface.domain, 1 - place.axis
        points = place.points(domain, np.linspace(domain.lower[running], domain.upper[running], SAMPLES))
        x = self.surface.derivatives(points, order=1)
        normal = np.cross(x[1, 0], x[0, 1])
        across = np.linalg.norm(np.cross(normal, axis), axis=-1)
        return bool(np.any(across <= ALONG * np.linalg.norm(normal, axis=-1) * np.linalg.norm(axis)))

    @model_validator(mode="after")
    def _formulas_are_finite(self) -> Self:
        sample = self.surface.domain.grid(SAMPLES, SAMPLES)
        for spring in self.springs:
            stiffness = self._checked_stiffness(spring, sample)
            if not np.all(np.isfinite(stiffness)) or np.any(stiffness < 0):
                raise ValueError(f"the stiffness of spring '{spring.name}' is not finite, or negative, on the shell")
        for support, place in self.supported_places():
            if not all(np.all(np.isfinite(v)) for v in self._checked_motion(support, place, sample).values()):
                raise ValueError(f"the motion of support '{support.name}' is not finite on the shell")
        for load in self.loads:
            formulas = formulas_of(load)
            try:
                values = [self.formula(f).derivatives(sample, 0)[0, 0] for f in formulas]
            except InputError as error:
                raise ValueError(f"a load of kind '{load.kind}': {error}") from None
            if not np.all(np.isfinite(values)):
                raise ValueError(f"a load of kind '{load.kind}' is not finite on the shell")
        return self

    def _checked_stiffness(self, spring: Spring, sample: Array) -> Array:
        try:
            formula = Expression(spring.stiffness, MOTION_VARIABLES[:2], self.surface.named_constants)
            return formula.derivatives(sample, 0)[0, 0]
        except InputError as error:
            raise ValueError(f"spring '{spring.name}': {error}") from None

    def _checked_motion(self, support: Support, place: Place, sample: Array) -> dict[tuple[int, int], Array]:
        try:
            return self.motion(support, place, sample, order=2)
        except InputError as error:
            raise ValueError(f"support '{support.name}': {error}") from None

    @model_validator(mode="after")
    def _course_is_possible(self) -> Self:
        if self.dynamics is None:
            check_path(self)
        else:
            check_motion(self)
        return self

    @model_validator(mode="after")
    def _gravity_has_a_mass_to_act_on(self) -> Self:
        density = self.material.areal_density
        if density <= 0 and any(isinstance(load, GravityLoad) for load in self.loads):
            raise ValueError(
                f"field 'material.areal_density': found {density:g}, but it must be given and positive where a load of"
                " kind 'gravity' acts"
            )
        return self

    @model_validator(mode="after")
    def _is_held(self) -> Self:
        if self.dynamics is None:
            check_held(self)
        return self


def rotation_matrix(rotation: Rotation, degrees: float, linear: bool) -> Array:
    """Return the matrix (3, 3) of a rotation by an angle in degrees; linearised if asked for."""
    axis = np.asarray(rotation.axis) / np.linalg.norm(rotation.axis)
    angle = math.radians(degrees)
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    if linear:
        return np.eye(3) + angle * cross
    turn: Array = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    return turn


def read_case(path: Path) -> Case:
    """Read and check a case file.

    Raises
    ------
    InputError
        In one sentence with the file, the field, what was found and what is allowed.
    """
    return build_case(read_toml(path), name=path.stem, where=str(path))


def build_case(data: Mapping[str, Any], name: str, where: str) -> Case:
    """Make a case of parsed data; `where` stands at the start of error messages."""
    if "name" in data:
        raise InputError(f"{where}: field 'name' is not known here; a case is named by its file")
    whole = {**data, "name": name}
    try:
        return Case.model_validate(whole)
    except ValidationError as error:
        raise InputError(f"{where}: {one_sentence(error, whole)}") from None
