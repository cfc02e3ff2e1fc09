"""Supports and material as data of a case file. Solvers give them their meaning.

Linear isotropic shell material (Kairanda et al. 2023, eqs. (17)-(19)).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from shellbench.problems.expression import Expression
from shellbench.problems.taylor import numbers
from shellbench.protocol.schema import LARGEST, SMALLEST, Finite, Flag, Model, Name, Positive, Vector

Component = Literal["x", "y", "z"]
LOCAL: tuple[Literal["along"], Literal["across"], Literal["normal"]] = ("along", "across", "normal")
AnyComponent = Literal["x", "y", "z", "along", "across", "normal"]
Frame = Literal["global", "local"]
COMPONENTS: tuple[Component, Component, Component] = ("x", "y", "z")
RigidMotion = Literal["translation_x", "translation_y", "translation_z", "rotation_x", "rotation_y", "rotation_z"]
RIGID_MOTIONS: tuple[RigidMotion, ...] = (
    "translation_x", "translation_y", "translation_z", "rotation_x", "rotation_y", "rotation_z",
)  # fmt: skip
Formula = Finite | str
VectorFormula = tuple[Formula, Formula, Formula]
Places = Annotated[tuple[str, ...], Field(min_length=1)]
LIMITS = (
    "a shell is linear elastic, isotropic or orthotropic (kind = 'orthotropic', laminates too, by their stiffnesses),"
    " under forces, moments and moved supports, without plasticity or temperatures"
)


class Value(Model):
    """Prescribed displacement, metres: numbers or formulas in xi1, xi2 and t, evaluated on the edge.

    Attributes
    ----------
    x, y, z
        Component of the displacement, m.
    """

    kind: Literal["value"]
    x: Formula = 0.0
    y: Formula = 0.0
    z: Formula = 0.0

    @property
    def vector(self) -> VectorFormula:
        """The three components."""
        return (self.x, self.y, self.z)

    @property
    def formulas(self) -> tuple[Formula, ...]:
        """Its numbers and formulas."""
        return self.vector


class Translation(Model):
    """A translation of the support, metres; each component a number or a formula in t.

    Attributes
    ----------
    vector
        Displacement of the support, m.
    """

    kind: Literal["translation"]
    vector: VectorFormula

    @property
    def formulas(self) -> tuple[Formula, ...]:
        """Its numbers and formulas."""
        return self.vector


class Rotation(Model):
    """A rotation of the support about an axis: u = R(angle) (x - centre) - (x - centre).

    In linear theory the rotation is linearised, like every displacement: u = angle axis x (x - centre).

    Attributes
    ----------
    axis
        Direction of the axis, of any length; the sign follows the right hand.
    centre
        A point of the axis, m.
    """

    kind: Literal["rotation"]
    axis: Vector
    centre: Vector = (0.0, 0.0, 0.0)
    angle: Formula = Field(description="degrees; a number or a formula in t")

    @property
    def formulas(self) -> tuple[Formula, ...]:
        """Its numbers and formulas."""
        return (self.angle,)

    @model_validator(mode="after")
    def _has_an_axis(self) -> Self:
        if max(map(abs, self.axis)) < SMALLEST:
            raise ValueError("the axis of a rotation can't be zero")
        return self


Motion = Annotated[Value | Translation | Rotation, Field(discriminator="kind")]


class Support(Model):
    """A support: it holds or moves the shell at some places.

    The `components` are held at zero, or moved as `motion` says; the others are free. They are Cartesian, or local to
    the shell at rest: "along" an edge, "across" it within the surface, and "normal" to the surface. `clamped` holds the
    slope too, on edges only: u,n . a3 = 0 (n the conormal), where a rotation carries a3 along. `symmetry = "x"` states
    that an edge lies in a plane of symmetry whose normal is x: u_x = 0, and the slope is held.

    In linear theory, a support that holds a point along the midsurface may only prevent rigid motions, and the loads
    have to be in balance without it. Under a force the point would move without bound as meshes are refined.

    Attributes
    ----------
    name
        Name by which quantities refer to it.
    on
        Places that it holds: edges and parts of them, corners, named points, or the whole "surface".
    components
        Components of the displacement that it prescribes: some of x, y and z, or some of along, across and normal; on
        points normal alone.
    clamped
        Whether it holds the slope too; on edges only.
    symmetry
        Normal of the plane of symmetry in which the edge lies. It implies components and clamp, and takes neither.
    motion
        Motion of the held components; at rest without it.
    shear
        Whether it keeps normals from turning along the edge where it holds the displacement along the normal ("hard",
        the default) or leaves them free ("soft"); in the theory naghdi-linear only.
    """

    name: Name
    on: Places
    components: tuple[AnyComponent, ...] = COMPONENTS
    clamped: Flag = False
    symmetry: Component | None = None
    motion: Motion | None = None
    shear: Literal["hard", "soft"] | None = None

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        if len(set(self.components)) != len(self.components):
            raise ValueError(f"components {list(self.components)} repeat")
        if not self.components and not self.clamped:
            raise ValueError("a support holds at least one component or is clamped")
        if len({name in LOCAL for name in self.components}) > 1:
            raise ValueError(f"components {list(self.components)} are in part Cartesian, in part local to the shell")
        if self.symmetry and {"components", "clamped", "motion", "shear"} & self.model_fields_set:
            raise ValueError("a plane of symmetry takes no components, clamp, motion or shear: it implies them")
        return self

    @property
    def held(self) -> tuple[AnyComponent, ...]:
        """Components whose displacement is prescribed."""
        return (self.symmetry,) if self.symmetry else self.components

    @property
    def local(self) -> bool:
        """True if these are directions local to the shell."""
        return any(name in LOCAL for name in self.held)

    @property
    def holds_slope(self) -> bool:
        """True if the rotation about the edge is held."""
        return self.clamped or self.symmetry is not None


class Spring(Model):
    """An elastic support spread over the shell: it pulls each point back to its place at rest.

    Attributes
    ----------
    name
        Name that error messages give.
    stiffness
        k, N/m^3: a number or formula in xi1 and xi2. The energy per reference area is k |u|^2 / 2, of the components
        that it holds.
    components
        Components of the displacement that it acts on.
    """

    name: Name
    stiffness: Formula
    components: tuple[Component, ...] = COMPONENTS

    @model_validator(mode="after")
    def _holds_something(self) -> Self:
        if not self.components or len(set(self.components)) != len(self.components):
            raise ValueError("a spring holds at least one component, and none twice")
        return self


class Material(Model):
    """Young's modulus, Poisson's ratio, thickness and density of a shell.

    The strain energy per reference area is W = 1/2 (D H eps eps + B H kappa kappa). A homogeneous shell has one H, of
    its Poisson's ratio; with a `bending_poissons_ratio`, bending has an H of its own. In a shell that varies, modulus
    and thickness are `youngs_modulus` and `thickness` times their factors. The factors vary the stiffnesses D and B
    alone, not the areal density.

    Attributes
    ----------
    modulus_factor
        Factor of Young's modulus: a number or formula in xi1 and xi2; positive on the shell. It may have kinks along
        coordinate lines, but can't jump.
    thickness_factor
        Factor of the thickness, of the same form.
    """

    limits: ClassVar[str] = LIMITS
    stiffening: ClassVar[None] = None

    kind: Literal["isotropic"] = Field("isotropic", description="the kind; see orthotropic materials for the other one")
    youngs_modulus: Positive = Field(description="E, Pa")
    poissons_ratio: Annotated[Finite, Field(gt=-1, lt=0.5)] = Field(description="nu")
    bending_poissons_ratio: Annotated[Finite, Field(gt=-1, lt=1)] | None = Field(
        None, description="nu of bending alone, where it is another; B stays what nu makes it"
    )
    thickness: Positive = Field(description="h, metres")
    areal_density: Annotated[Finite, Field(ge=0)] = Field(0.0, description="rho, kg per square metre")
    bending_factor: Positive = Field(1.0, description="scales B alone; 1 for a homogeneous shell")
    modulus_factor: Formula = 1.0
    thickness_factor: Formula = 1.0

    @model_validator(mode="after")
    def _stiffnesses_are_in_range(self) -> Self:
        for what, value in (("membrane", self.membrane_stiffness), ("bending", self.bending_stiffness)):
            if not SMALLEST <= value <= LARGEST:
                raise ValueError(f"its {what} stiffness is {value:g}, but it must be from {SMALLEST:g} to {LARGEST:g}")
        return self

    @property
    def uniform(self) -> bool:
        """True if modulus and thickness are constant over the shell."""
        return self.modulus_factor == 1.0 and self.thickness_factor == 1.0

    def factors(
        self, points: ArrayLike, constants: Mapping[str, float]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the factors (...) of modulus and thickness at points (..., 2), with the surface's constants."""
        xi = numbers(points)
        formulas = (
            Expression(f, ("xi1", "xi2"), constants, piecewise=True)
            for f in (self.modulus_factor, self.thickness_factor)
        )
        modulus, thickness = (np.array(formula.derivatives(xi, 0)[0, 0]) for formula in formulas)
        return modulus, thickness

    @property
    def poissons_ratios(self) -> tuple[float, float]:
        """Poisson's ratios of stretching and of bending."""
        bending = self.bending_poissons_ratio
        return self.poissons_ratio, self.poissons_ratio if bending is None else bending

    @property
    def membrane_stiffness(self) -> float:
        """D = E h / (1 - nu^2), N/m (eq. (18))."""
        return self.youngs_modulus * self.thickness / (1 - self.poissons_ratio**2)

    @property
    def bending_stiffness(self) -> float:
        """B = E h^3 / (12 (1 - nu^2)), N m (eq. (18)). Timoshenko's books call it D."""
        return self.bending_factor * self.membrane_stiffness * self.thickness**2 / 12


Array = NDArray[np.float64]


def rotation_matrix(rotation: Rotation, degrees: float, linear: bool) -> Array:
    """Return the matrix (3, 3) of a rotation by an angle in degrees; linearised if asked for."""
    axis = np.asarray(rotation.axis) / np.linalg.norm(rotation.axis)
    angle = math.radians(degrees)
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    if linear:
        return np.eye(3) + angle * cross
    turn: Array = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    return turn
