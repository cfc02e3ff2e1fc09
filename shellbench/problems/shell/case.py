"""Cases of shells, read from TOML and checked.

A case is data. Nothing in it is evaluated as Python. An error is reported in one sentence that names the file and the
field.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from shellbench.errors import InputError
from shellbench.problems.shell.mesh.surface import with_fit
from shellbench.problems.shell.posed.course import COURSE_SAMPLES, check_motion, check_path
from shellbench.problems.shell.posed.point_actions import check_point_actions, drifts, remark
from shellbench.problems.shell.posed.rigid import check_held
from shellbench.problems.shell.posed.shell import Shell, Theory
from shellbench.problems.shell.question.conditions import COMPONENTS, rotation_matrix
from shellbench.problems.shell.question.contact import check_contact
from shellbench.problems.shell.question.drawing import Picture
from shellbench.problems.shell.question.features import check_formulas
from shellbench.problems.shell.question.loads import EdgeLoad, GravityLoad, MomentLoad, PointLoad
from shellbench.problems.shell.question.places import Edge, Place, Point, Whole
from shellbench.problems.shell.question.surface import COORDINATES

__all__ = ["Case", "Picture", "Theory", "build_case", "read_case", "rotation_matrix"]

Array = NDArray[np.float64]
BESIDE, JUMP = 1e-9, 1e-6  # of the side: distance of two points from a kink; and their relative change that is a jump
ALONG = 1e-3  # sine of the angle between an axis and a normal below which they are along each other


class Case(Shell):
    """A shell whose file has been checked: as far as can be seen without solving it, it can be solved."""

    @classmethod
    def build(cls, data: Mapping[str, Any], name: str, where: str) -> Self:
        """Make a case of parsed data; paths of meshes are relative to `where`, the case's file."""
        try:
            fitted = with_fit(data, Path(where).parent)
        except InputError as error:
            raise InputError(f"{where}: {error}") from None
        return super().build(fitted, name, where)

    @model_validator(mode="after")
    def _names_are_known_and_used_once(self) -> Self:
        places = self.places
        for what, names in (("support", [s.name for s in self.supports]), ("spring", [s.name for s in self.springs])):
            for name in names:
                if names.count(name) > 1:
                    raise ValueError(f"two of them are called '{name}': {what} names must differ")
        for where, name in self._named_places():
            if name not in places:
                raise ValueError(f"{where} is on '{name}', which is not a place; places are {', '.join(places)}")
        return self

    def _named_places(self) -> Iterator[tuple[str, str]]:
        for support in self.supports:
            yield from ((f"support '{support.name}'", name) for name in support.on)
        for load in self.loads:
            if isinstance(load, EdgeLoad | PointLoad | MomentLoad):
                yield from ((f"a load of kind '{load.kind}'", name) for name in load.on)
        yield from (("the focus", name) for name in self.focus)
        for quantity in self.quantities:
            yield from ((f"quantity '{quantity.name}'", name) for name in quantity.places)

    @model_validator(mode="after")
    def _conditions_fit_their_places(self) -> Self:
        held: set[tuple[str, str]] = set()
        for support, place in self.supported_places():
            if support.holds_slope and not isinstance(place, Edge):
                raise ValueError(f"support '{support.name}' is clamped on '{place.name}', but only edges can be")
            if support.shear is not None and self.theory != "naghdi-linear":
                raise ValueError(
                    f"support '{support.name}' says that its shear is {support.shear}, but normals shear in the theory"
                    " naghdi-linear only"
                )
            if (
                support.local
                and not isinstance(place, Edge)
                and (isinstance(place, Whole) or support.held != ("normal",))
            ):
                named = next(name for name in support.held if isinstance(place, Whole) or name != "normal")
                raise ValueError(f"support '{support.name}' holds '{named}' on '{place.name}', but only edges have it")
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
        self._check_overlaps()
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
            quantity.check(self)
        return self

    def _check_overlaps(self) -> None:
        edges = [(s, place) for s, place in self.supported_places() if isinstance(place, Edge)]
        for (one, first), (other, second) in combinations(edges, 2):
            both = set(one.held) & set(other.held)
            if both and first != second and first.overlaps(second, self.surface.domain):
                raise ValueError(
                    f"component {min(both)} is held by two supports where '{first.name}' and '{second.name}' overlap"
                )

    def _is_normal(self, axis: tuple[float, float, float], place: Place) -> bool:
        """Return True if an axis is along the normal anywhere on an edge."""
        assert isinstance(place, Edge)
        points = place.samples(self.surface.domain, COURSE_SAMPLES)
        x = self.surface.derivatives(points, order=1)
        normal = np.cross(x[1, 0], x[0, 1])
        across = np.linalg.norm(np.cross(normal, axis), axis=-1)
        return bool(np.any(across <= ALONG * np.linalg.norm(normal, axis=-1) * np.linalg.norm(axis)))

    @model_validator(mode="after")
    def _formulas_are_finite(self) -> Self:
        check_formulas(self)
        return self

    @model_validator(mode="after")
    def _kinks_are_where_they_may_be(self) -> Self:
        for support in self.supports:
            for text in support.motion.formulas if support.motion is not None else ():
                if self.formula(text).rivals:
                    raise ValueError(
                        f"the motion of support '{support.name}' is piecewise: only loads, springs and factors of the"
                        " material may be"
                    )
        try:
            kinks = self.kinks
        except InputError as error:
            raise ValueError(str(error)) from None
        domain = self.surface.domain
        for axis, lines in enumerate(kinks):
            grid = domain.grid(COURSE_SAMPLES, COURSE_SAMPLES)
            beside = grid[0] if axis == 0 else grid[:, 0]
            for at in lines:
                sides = []
                for shift in (-BESIDE * domain.size[axis], BESIDE * domain.size[axis]):
                    points = beside.copy()
                    points[:, axis] = np.clip(at + shift, domain.lower[axis], domain.upper[axis])
                    sides.append(self.material.factors(points, self.surface.named_constants))
                for name, before, after in zip(("modulus_factor", "thickness_factor"), *sides, strict=True):
                    if np.any(np.abs(after - before) > JUMP * (np.abs(before) + np.abs(after))):
                        shown = np.degrees(at) if domain.angle[axis] else at
                        raise ValueError(
                            f"field 'material.{name}' jumps at {COORDINATES[axis]} = {shown:.6g}: it may have kinks,"
                            " but no jumps"
                        )
        return self

    @model_validator(mode="after")
    def _course_is_possible(self) -> Self:
        if self.dynamics is None:
            check_path(self)
        else:
            check_motion(self)
        return self

    @model_validator(mode="after")
    def _theory_has_its_material(self) -> Self:
        if self.material.stiffening is not None and (self.linear or self.modal or self.dynamics is not None):
            raise ValueError(
                "field 'material.stiffening': a membrane stiffens in the theory 'kirchhoff-love-nonlinear' alone, at"
                " rest and without modes"
            )
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
    def _starts_outside_obstacles(self) -> Self:
        check_contact(self)
        return self

    @model_validator(mode="after")
    def _is_held(self) -> Self:
        if self.dynamics is None:
            check_held(self)
        check_point_actions(self)
        return self

    def drifts(self, solution: Any) -> dict[str, float]:
        """Return the change over a solver's cells of unbounded values; see `shellbench.problem.Problem.drifts`."""
        return drifts(self, solution)

    @cached_property
    def remark(self) -> str:
        """A clause on values that have no limit but are given; empty if there are none."""
        return remark(self)


def read_case(path: Path) -> Case:
    """Read and check a case file; see `shellbench.problem.Problem.read`."""
    return Case.read(path)


def build_case(data: Mapping[str, Any], name: str, where: str) -> Case:
    """Make a case of parsed data; see `shellbench.problem.Problem.build`."""
    return Case.build(data, name, where)
