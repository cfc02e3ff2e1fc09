"""A shell solved for a range of materials, and judged at held-out materials.

The file holds a shell without its material, in the table `[shell]`, and the ranges of thickness, Young's modulus and
Poisson's ratio. Its held-out materials are drawn with a seed: moduli and thicknesses by their logarithm, evenly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from shellbench.errors import InputError
from shellbench.problems.series.quantities import ConditionedQuantity
from shellbench.problems.series.shell_table import SeriesCase
from shellbench.problems.shell.case import Case
from shellbench.protocol.schema import Finite, Model, Name, Positive, Vector

Ratio = Annotated[Finite, Field(ge=0, lt=0.5)]
SLACK = 1e-12  # relative: allowed excess of a range by rounding
ASKED = "asked"  # name of the quantity that each shell is asked


class Material(NamedTuple):
    """Thickness, m, Young's modulus, Pa, and Poisson's ratio."""

    thickness: float
    youngs_modulus: float
    poissons_ratio: float


class Ranges(Model):
    """Ends of each range, the smaller one first."""

    thickness: tuple[Positive, Positive] = Field(description="h, m")
    youngs_modulus: tuple[Positive, Positive] = Field(description="E, Pa")
    poissons_ratio: tuple[Ratio, Ratio] = Field(description="nu; not negative")

    @model_validator(mode="after")
    def _increase(self) -> Self:
        for name in Material._fields:
            low, high = getattr(self, name)
            if not low < high:
                raise ValueError(f"field '{name}': found {low:g} to {high:g}, but the first must be the smaller one")
        return self

    def material(self, shares: tuple[float, float, float]) -> Material:
        """Return the material at shares from 0 to 1 of the ranges: of log h, of log E and of nu."""
        (thin, thick), (soft, stiff), (low, high) = self.thickness, self.youngs_modulus, self.poissons_ratio
        return Material(
            thin * math.exp(shares[0] * math.log(thick / thin)),
            soft * math.exp(shares[1] * math.log(stiff / soft)),
            low + shares[2] * (high - low),
        )

    def outside(self, material: Material) -> str | None:
        """Return the parameter of a material that is beyond its range, as one clause, or None if all are within."""
        for name, value in material._asdict().items():
            low, high = getattr(self, name)
            if not low - SLACK * high <= value <= high * (1 + SLACK):  # not so where it is not a number
                return f"{name} is {value:g}, but the range goes from {low:g} to {high:g}"
        return None


class HeldOut(Model):
    """Materials at which answers are judged."""

    count: int = Field(20, ge=1, le=1000, strict=True, description="how many")
    seed: int = Field(ge=0, le=2**31 - 1, strict=True, description="of the draw")


class Asked(Model):
    """The displacement asked of every material: along a direction, the mean over points."""

    points: Annotated[tuple[Name, ...], Field(min_length=1)] = Field(description="points of the shell")
    direction: Vector | Annotated[tuple[Vector, ...], Field(min_length=1)] = Field(
        description="one for all points, or one for each"
    )


class ConditionedCase(SeriesCase):
    """A shell of a range of materials.

    Attributes
    ----------
    shell
        Its table of the file, as in a case of kind `shell`, without title, quantities, and the three parameters of the
        material that have a range. It stands still in the linear theory, and moves in the non-linear one.
    ranges
        Ranges of thickness, Young's modulus and Poisson's ratio.
    held_out
        Materials at which answers are judged.
    asked
        The displacement asked of every material: at rest, or at the end of the motion.
    quantities
        Quantities asked of every answer; exactly one is primary.
    """

    kind: Literal["conditioned"]
    theory: Literal["kirchhoff-love-linear-conditioned", "kirchhoff-love-nonlinear-conditioned"]
    ranges: Ranges
    held_out: HeldOut
    asked: Asked
    quantities: Annotated[tuple[ConditionedQuantity, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _makes_shells(self) -> Self:
        for name in ("material", "dynamics"):
            if not isinstance(found := self.shell.get(name, {}), Mapping):
                raise ValueError(f"field 'shell.{name}': found {found!r}, but a table is expected")
        for name in Material._fields:
            if name in self.shell.get("material", {}):
                raise ValueError(f"field 'shell.material.{name}' is not known here: `ranges` has it")
        if self.moving != self.theory.startswith("kirchhoff-love-nonlinear"):
            raise ValueError(
                "a shell of many materials stands still in the linear theory, or moves in the non-linear one"
            )
        self._shell(self.middle)
        for quantity in self.quantities:
            if quantity.material >= self.held_out.count:
                raise ValueError(
                    f"quantity '{quantity.name}' is of material {quantity.material}, but {self.held_out.count} are held"
                    " out, from 0"
                )
        return self

    @property
    def middle(self) -> Material:
        """The middle of the ranges."""
        return self.ranges.material((0.5, 0.5, 0.5))

    @cached_property
    def materials(self) -> tuple[Material, ...]:
        """The held-out materials."""
        shares = np.random.default_rng(self.held_out.seed).random((self.held_out.count, 3))
        return tuple(self.ranges.material((float(h), float(e), float(nu))) for h, e, nu in shares)

    def shell_of(self, material: Material) -> Case:
        """Return the shell of one material, with one quantity, `asked`.

        Raises
        ------
        InputError
            If the material is beyond the ranges.
        """
        if reason := self.ranges.outside(material):
            raise InputError(f"{self.name}: {reason}")
        return self._shell(material)

    def near(self, material: Material) -> Case:
        """Return the shell of a material that may be beyond the ranges by a step of a difference quotient."""
        return self._shell(material)

    def chosen_material(self, given: Material | Mapping[str, float] | None) -> Material:
        """Return a material of the ranges, given by its parameters; the middle one if None.

        Raises
        ------
        InputError
            If it is beyond the ranges, or parameters are missing.
        """
        if given is None:
            return self.middle
        if not isinstance(given, Material):
            if set(given) != set(Material._fields):
                names = ", ".join(Material._fields)
                raise InputError(f"{self.name}: a material has {names}, but found {', '.join(given) or 'none'}")
            given = Material(**{name: float(value) for name, value in given.items()})
        if reason := self.ranges.outside(given):
            raise InputError(f"{self.name}: {reason}")
        return given

    @property
    def moving(self) -> bool:
        """True if the shell moves."""
        return "dynamics" in self.shell

    def _shell(self, material: Material) -> Case:
        table = dict(self.shell)
        table["material"] = {**table.get("material", {}), **material._asdict()}
        asked = {"name": ASKED, "kind": "displacement", "primary": True, **self.asked.model_dump()}
        if self.moving:
            asked["at"] = dict(table["dynamics"]).get("until")
        return self.shell_case(table, self.base, [asked], "in the table 'shell'")
