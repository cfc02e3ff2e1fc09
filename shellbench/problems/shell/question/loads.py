"""Loads as data of a case file. Solvers give them their meaning."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from shellbench.problems.shell.question.conditions import LIMITS, Formula, Frame, Places, VectorFormula
from shellbench.protocol.schema import SMALLEST, Flag, Model, Vector


class AreaLoad(Model):
    """A dead load per reference area, N/m^2: numbers or formulas in xi1, xi2 and t.

    Attributes
    ----------
    vector
        Load by component, N/m^2.
    frame
        Whether the components are Cartesian, or local to the shell at rest: in the direction in which xi1 grows, across
        it within the surface (normal x the first), and along the normal a3.
    """

    limits: ClassVar[str] = LIMITS
    spread: ClassVar[bool] = True  # over the area

    kind: Literal["area"]
    vector: VectorFormula
    frame: Frame = "global"

    @property
    def formulas(self) -> tuple[Formula, ...]:
        """Its numbers and formulas."""
        return self.vector


class PressureLoad(Model):
    """A load along the normal a3 = a1 x a2 / |a1 x a2|, N/m^2; positive pushes along a3.

    It is dead, a force along the reference normal per reference area, or follows the deformed shell: then it is a force
    along the deformed normal per deformed area, p a1 x a2 / |A1 x A2| per reference area. In linear theory both are
    the dead load.

    Attributes
    ----------
    value
        Pressure, N/m^2: a number or a formula in xi1, xi2 and t.
    follows
        Whether it follows the deformed shell, in the non-linear theory.
    """

    spread: ClassVar[bool] = True

    kind: Literal["pressure"]
    value: Formula
    follows: Flag = False

    @property
    def formulas(self) -> tuple[Formula, ...]:
        """Its numbers and formulas."""
        return (self.value,)


class GravityLoad(Model):
    """Gravity: areal density times acceleration.

    Attributes
    ----------
    acceleration
        By component, m/s^2: numbers or formulas in xi1, xi2 and t. The material needs an areal density.
    """

    spread: ClassVar[bool] = True

    kind: Literal["gravity"]
    acceleration: VectorFormula

    @property
    def formulas(self) -> tuple[Formula, ...]:
        """Its numbers and formulas."""
        return self.acceleration


class EdgeLoad(Model):
    """A dead load per reference length of edges, N/m: numbers or formulas in xi1, xi2 and t.

    Attributes
    ----------
    on
        Edges, and parts of them, that it acts on.
    vector
        Load by component, N/m.
    frame
        Whether the components are Cartesian, or local to the shell at rest: along the edge, in the direction in which
        the coordinate grows, across the edge within the surface, outward, and along the normal a3.
    """

    spread: ClassVar[bool] = False

    kind: Literal["edge"]
    on: Places
    vector: VectorFormula
    frame: Frame = "global"

    @property
    def formulas(self) -> tuple[Formula, ...]:
        """Its numbers and formulas."""
        return self.vector


class PointLoad(Model):
    """A dead force at points, N (at each of them).

    A force along the midsurface moves its point without bound as meshes are refined: displacements along the midsurface
    there, the largest displacement and energies have no limit. They can't be asked for, unless the force leans from the
    normal by less than 45 degrees. Then the drift down to cells as small as the thickness is part of the stated
    uncertainty; above a hundredth of the value the answer has not settled. At finite strain, two planes of symmetry
    have to keep the force along the normal.

    Attributes
    ----------
    on
        Corners and named points that it acts on.
    force
        Force by component, N: numbers or formulas in t.
    """

    spread: ClassVar[bool] = False

    kind: Literal["point"]
    on: Places
    force: VectorFormula

    @property
    def formulas(self) -> tuple[Formula, ...]:
        """Its numbers and formulas."""
        return self.force


class MomentLoad(Model):
    """A moment about a fixed axis per reference length of edges, N m/m: a number or formula in xi1, xi2 and t.

    It is conservative: its work is the moment times the angle by which the shell's normal turns about the axis
    (of the normal's part across the axis, where the normal is not at right angles to it). The axis should be
    tangential to the edge; the sign follows the right hand.

    Attributes
    ----------
    on
        Edges, and parts of them, that it acts on.
    axis
        Direction of the axis, of any length.
    value
        Moment per length, N m/m.
    """

    spread: ClassVar[bool] = False

    kind: Literal["moment"]
    on: Places
    axis: Vector
    value: Formula

    @property
    def formulas(self) -> tuple[Formula, ...]:
        """Its numbers and formulas."""
        return (self.value,)

    @model_validator(mode="after")
    def _has_an_axis(self) -> Self:
        if max(map(abs, self.axis)) < SMALLEST:
            raise ValueError("the axis of a moment can't be zero")
        return self


Load = Annotated[AreaLoad | PressureLoad | GravityLoad | EdgeLoad | PointLoad | MomentLoad, Field(discriminator="kind")]
