"""Shells: the data of a case, and their values at points and times."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from shellbench.errors import InputError
from shellbench.problem import Problem, Quantity
from shellbench.problems.expression import Expression, derivatives_of
from shellbench.problems.kinks import kink_lines
from shellbench.problems.obstacle import Obstacle
from shellbench.problems.shell.mesh.surface import MeshSurface
from shellbench.problems.shell.posed.surfaces import SurfaceModel
from shellbench.problems.shell.quantities.measure import area_rule
from shellbench.problems.shell.quantities.quantities import CriticalPoint, ModeQuantity, QuantityModel
from shellbench.problems.shell.question.conditions import (
    LIMITS,
    Formula,
    Material,
    RigidMotion,
    Rotation,
    Spring,
    Support,
    Translation,
    Value,
    VectorFormula,
    rotation_matrix,
)
from shellbench.problems.shell.question.contact import Contact
from shellbench.problems.shell.question.drawing import Picture
from shellbench.problems.shell.question.features import Feature, features_of, undecided
from shellbench.problems.shell.question.folds import join_folds
from shellbench.problems.shell.question.loads import Load, PressureLoad
from shellbench.problems.shell.question.orthotropic import AnyMaterial
from shellbench.problems.shell.question.path import Dynamics
from shellbench.problems.shell.question.path import Path as LoadPath
from shellbench.problems.shell.question.places import Edge, EdgePart, Place, Point, Whole, places_of
from shellbench.protocol.schema import Finite, Name

Array = NDArray[np.float64]
Theory = Literal["kirchhoff-love-linear", "kirchhoff-love-nonlinear", "naghdi-linear"]
LATER: dict[str, Any] = {"kind": "isotropic", "modulus_factor": 1.0, "thickness_factor": 1.0, "follows": False,
         "bending_poissons_ratio": None, "frame": "global", "fold_side": None, "axes": "shell",
         "stiffening": None}  # fmt: skip
MOTION_VARIABLES = ("xi1", "xi2", "t")  # t is the time, or the load factor of a static case


class Shell(Problem):
    """A thin shell with its supports, its loads and the quantities asked of it.

    Attributes
    ----------
    theory
        Theory of the answer: known values of another theory do not judge it.
    surface
        The midsurface.
    material
        Stiffness, thickness and mass.
    points
        Named points (xi1, xi2); degrees for angles.
    edge_parts
        Named parts of edges; like whole edges, they are places for supports and loads.
    supports
        Supports that hold or move the shell.
    springs
        Elastic supports and foundations; in linear theory and in motion.
    obstacles
        Bodies that the shell can't enter; in linear theory without friction, and in motion.
    contact
        Options of contact with obstacles: with `thickness` a face of the shell touches them, not the midsurface.
    focus
        Names of points near which the answer varies quickly although no point force acts there: meshes and inputs may
        be graded toward them.
    loads
        Loads on the shell.
    path
        Path of the load of a non-linear static case.
    dynamics
        Motion by Newton's law and its final time; None in a static case.
    remove_rigid_motions
        Rigid motions that are left free; the answer is made orthogonal to them in the mean over the area.
    quantities
        Quantities asked of every answer; exactly one is primary.
    picture
        Options of the report's picture.
    """

    limits: ClassVar[str] = LIMITS
    not_physics: ClassVar[frozenset[str]] = Problem.not_physics | {"picture"}

    kind: Literal["shell"] = "shell"
    theory: Theory
    surface: SurfaceModel
    material: AnyMaterial
    points: dict[Name, tuple[Finite, Finite]] = Field(default_factory=dict)
    edge_parts: dict[Name, EdgePart] = Field(default_factory=dict)
    supports: tuple[Support, ...] = ()
    springs: tuple[Spring, ...] = ()
    remove_rigid_motions: tuple[RigidMotion, ...] = ()
    loads: tuple[Load, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()
    contact: Contact = Field(default_factory=lambda: Contact())
    focus: tuple[Name, ...] = ()
    path: LoadPath = Field(default_factory=lambda: LoadPath())
    dynamics: Dynamics | None = None
    quantities: tuple[QuantityModel, ...] = Field(min_length=1)
    picture: Picture = Field(default_factory=lambda: Picture())

    @property
    def linear(self) -> bool:
        """True if the strains are linearised."""
        return self.theory != "kirchhoff-love-nonlinear"

    @property
    def isotropic(self) -> Material:
        """Its material, for solvers that decline all but isotropic ones."""
        assert isinstance(self.material, Material)
        return self.material

    @property
    def modal(self) -> bool:
        """True if the case asks for modes: frequencies or buckling loads."""
        return bool(self.quantities) and isinstance(self.quantities[0], ModeQuantity)

    @property
    def following(self) -> tuple[PressureLoad, ...]:
        """Pressures that follow the deformed shell: none in linear theory, where they are dead loads."""
        if self.linear:
            return ()
        return tuple(load for load in self.loads if isinstance(load, PressureLoad) and load.follows)

    @property
    def dead(self) -> tuple[Load, ...]:
        """All other loads."""
        following = self.following
        return tuple(load for load in self.loads if load not in following)

    def pressure(self, points: ArrayLike, t: float = 1.0) -> Array:
        """Return the sum (...) of the pressures that follow the shell at points (..., 2), N/m^2."""
        xi = np.asarray(points, dtype=float)
        values = [self.formula(load.value).derivatives(xi, 0, t)[0, 0] for load in self.following]
        return np.asarray(sum(values, start=np.zeros(xi.shape[:-1])))

    def physics(self) -> dict[str, Any]:
        """Return all data that an answer depends on; see `shellbench.problem.Problem.physics`."""
        data = super().physics()
        for support in data["supports"]:
            if support["shear"] != "soft":
                del support["shear"]
        if not data["edge_parts"]:  # so that digests of cases without stay as they were
            del data["edge_parts"]
        if not data["obstacles"]:
            del data["obstacles"], data["contact"]
        for part in (data["material"], *data["loads"], *data["quantities"]):  # left out for the same reason
            for name in [name for name, default in LATER.items() if part.get(name, ...) == default]:
                del part[name]
        for name in ("folds", "hinges"):  # left out for the same reason
            if not data["surface"].get(name, True):
                del data["surface"][name]
        if "fit" in data["surface"]:  # its last digits depend on the machine: the mesh stands for it
            del data["surface"]["mesh"]
            data["surface"]["fit"] = data["surface"]["fit"]["sha256"]
        return data

    def shown(self) -> dict[str, Any]:
        """Return the case's data without the coefficients of a surface that was fitted."""
        data = self.data()
        if "fit" in data["surface"]:
            fit = data["surface"]["fit"]
            fit |= {knots: {"spans": fit[knots]["spans"]} for knots in ("first", "second")}
        return data

    def asked_as_well(self) -> Self | None:
        """Return the same case with the mesh's other fit; None if its surface is no fit."""
        if not isinstance(self.surface, MeshSurface):
            return None
        knots = "second" if self.surface.knots == "first" else "first"
        surface = {**self.surface.model_dump(exclude={"knots"}), "knots": knots}
        return type(self).model_validate({**self.data(), "surface": surface})

    @cached_property
    def places(self) -> dict[str, Place]:
        """Edges, their parts, corners and points by name."""
        return places_of(self.surface.domain, self.points, self.edge_parts)

    @cached_property
    def area_rule(self) -> tuple[Array, Array]:
        """Points (n, 2) and weights (n,), m^2, that integrate over the midsurface."""
        return area_rule(self)

    @property
    def prescribed(self) -> bool:
        """True if a support prescribes the motion of the whole surface, so that nothing is left to solve for."""
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
            total[..., ["xyz".index(c) for c in spring.components]] += self.stiffness_of(spring, xi)[..., None]
        return total

    def stiffness_of(self, spring: Spring, sample: Array) -> Array:
        """Return the stiffness of one spring at points (..., 2), N/m^3."""
        try:
            formula = self.formula(spring.stiffness, MOTION_VARIABLES[:2])
            return formula.derivatives(sample, 0)[0, 0]
        except InputError as error:
            raise ValueError(f"spring '{spring.name}': {error}") from None

    @property
    def states(self) -> tuple[float, ...]:
        """Times, load factors or other marks of the path (see `Path`) at which the answer is kept, increasing.

        In the non-linear theory the last one is the end of the path, or of the motion. A path that ends at buckling has
        no mark at its end.
        """
        asked = {q.mark for q in self.quantities if q.mark is not None}
        if self.dynamics is not None:
            return tuple(sorted(asked | {*self.dynamics.states, self.dynamics.until}))
        end = set() if self.linear or self.ends_critical else {self.path.until}
        return tuple(sorted(asked | set(self.path.states) | end))

    @property
    def buckles(self) -> bool:
        """True if the path leads to the buckling of the shell; it may go on from there."""
        critical = any(isinstance(q, CriticalPoint) for q in self.quantities)
        return critical or self.path.after_buckling == "follow"

    @property
    def ends_critical(self) -> bool:
        """True if the path ends at the buckling of the shell."""
        return self.buckles and self.path.after_buckling == "stop"

    @property
    def path_marks(self) -> tuple[float, ...]:
        """Increasing load factors of the states of a path under load control; buckling may end it before."""
        return tuple(sorted({*self.states, self.path.until}))

    def mark_words(self, mark: float) -> str:
        """Return the meaning of a mark, such as "t = 0.25 s", "deflection = 12 mm" or "mode 2"."""
        if self.modal:
            return f"mode {mark:g}"
        if self.dynamics is not None:
            return f"t = {mark:.4g} s"
        if self.path.quantity is None:
            return f"t = {mark:.4g}"
        unit = self.quantity(self.path.quantity).unit
        return f"{self.path.quantity.replace('_', ' ')} = {mark:.4g} {unit}".rstrip()

    def telling_mark(self, quantity: Quantity) -> str:
        """Return the words for a quantity's mark; empty if all values belong to the full load."""
        if self.modal:
            return ""  # the quantity's own name tells
        if quantity.mark is None or (self.path.quantity is None and self.dynamics is None):
            return super().telling_mark(quantity)
        return self.mark_words(quantity.mark)

    def check_state(self, at: float) -> None:
        """Raise InputError if a solution has no state at a mark."""
        if self.dynamics is not None and not 0 <= at <= self.dynamics.until:
            raise InputError(f"--at: found {at:g}, but {self.name} moves from 0 to {self.dynamics.until:g} s")
        if self.modal and at not in self.states:
            raise InputError(f"--at: found {at:g}, but {self.name} asks for the modes {self.states}")
        if self.linear and not self.modal:
            raise InputError(f"--at: {self.name} is linear and has one state only")

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
        return derivatives_of([self.formula(text) for text in vector], points, order, t)

    def formula(self, text: Formula, variables: tuple[str, ...] = MOTION_VARIABLES) -> Expression:
        """Read a number or formula of a support, load or spring, which may use the surface's constants."""
        return Expression(text, variables, self.surface.named_constants, piecewise=True)

    @cached_property
    def kinks(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Values of xi1, and of xi2, of folds, and at which loads, springs or material factors have kinks or jump."""
        domain, found = self.surface.domain, (set[float](), set[float]())
        (low1, low2), (up1, up2) = domain.lower, domain.upper
        material = self.material.modulus_factor, self.material.thickness_factor
        springs = (spring.stiffness for spring in self.springs)
        for text in (*material, *springs, *(f for load in self.loads for f in load.formulas)):
            if isinstance(text, str):
                lines = kink_lines(self.formula(text), ((low1, up1), (low2, up2)))
                for axis in (0, 1):
                    found[axis].update(lines[axis])
                    # around a closed coordinate such a formula has another kink at the seam
                    found[axis].update([domain.lower[axis]] if lines[axis] and domain.periodic[axis] else [])
        first, second = (join_folds(self.surface.fold_lines, a, found[a], domain.size[a]) for a in (0, 1))
        return first, second

    @cached_property
    def features(self) -> tuple[Feature, ...]:
        """The formulas that vary, and cells that resolve them; meshes and quadratures have to be as fine."""
        return features_of(self)

    @property
    def undecided(self) -> str | None:
        """The formula that no number of cells resolves, and its place, as one clause; None if all are resolved."""
        return undecided(self)

    @property
    def steady(self) -> bool:
        """True if no load depends on t."""
        return not any(self.formula(f).depends_on("t") for load in self.loads for f in load.formulas)

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

        In linear theory it is the identity, since a turned normal differs by terms of second order.
        """
        if self.linear or not isinstance(support.motion, Rotation):
            return np.eye(3)
        return rotation_matrix(support.motion, self.scalar(support.motion.angle, t), linear=False)
