"""Places where the formulas of a case vary quickly; see `shellbench.problems.features`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np

from shellbench.errors import InputError
from shellbench.problems.expression import Expression
from shellbench.problems.features import (
    MOST_CELLS,
    NAMES,
    NARROW,
    POINTLIKE,
    Box,
    Division,
    Measure,
    Place,
    divided,
    place,
)
from shellbench.problems.obstacle import FormulaBody
from shellbench.problems.shell.question.conditions import Value
from shellbench.problems.shell.question.loads import AreaLoad, EdgeLoad, GravityLoad, MomentLoad, PressureLoad
from shellbench.problems.shell.question.places import Edge, Whole
from shellbench.problems.shell.question.surface import AnalyticSurface, ExpressionSurface
from shellbench.problems.smoothness import bad_place
from shellbench.protocol.schema import LARGEST, SMALLEST

Role = Literal["load", "stiffness", "obstacle"]
ON_THE_WAY = 0.37  # of a motion: a time at which formulas of t are examined beside its end


@dataclass(frozen=True)
class Feature:
    """A formula of a case with its division.

    Attributes
    ----------
    of
        Its owner: a load, spring, support, material or surface of the case.
    what
        Its name in the case.
    role
        Loads need to be integrated. Stiffnesses and motions need fields that vary as quickly. Contact with an obstacle
        is searched at points, which miss narrow features.
    edge
        The edge that it acts on; None of the whole surface.
    division
        Cells that resolve the formula.
    """

    of: Any
    what: str
    role: Role
    edge: Edge | None
    division: Division

    @cached_property
    def peaks(self) -> list[Place]:
        """Places where a load is equivalent to a force at a point."""
        axes = (0, 1) if self.edge is None else (1 - self.edge.axis,)
        return [at for at, _ in self.division.peaks(axes, POINTLIKE)] if self.role == "load" else []


def quick_lines(case: Any, axis: int) -> list[tuple[float, float]]:
    """Return the places on a coordinate where the stiffness of a case varies quickly, and the lengths of variation."""
    found: list[tuple[float, float]] = []
    stiff = (feature.division for feature in case.features if feature.role == "stiffness")
    for at, length in sorted((at for d in stiff for at in d.peaks((axis,), NARROW)), key=lambda one: one[1]):
        if all(abs(at[axis] - other) > NARROW * case.surface.domain.size[axis] for other, _ in found):
            found.append((at[axis], length))
    return found


def narrow_division(case: Any, load: Any, edge: Edge | None = None) -> Division | None:
    """Return the cells that resolve a load, on an edge or on the surface, if any is narrow; None otherwise."""
    found = (f.division for f in case.features if f.of is load and f.edge == edge)
    return next((d for d in found if d.undecided is None and d.narrow.any()), None)


Formulas = tuple[Any, str, Role, Edge | None, Sequence[Expression], Measure]


def features_of(case: Any) -> tuple[Feature, ...]:
    """Return the formulas of a case that vary anywhere, with their divisions."""
    end = case.dynamics.until if case.dynamics is not None else 1.0 if case.linear else case.path.until
    found = []
    for (of, what, role, edge, formulas, measure), box in _in_boxes(case):
        if all(f.constant for f in formulas):
            continue
        times = sorted({end, ON_THE_WAY * end} if case.dynamics is not None and _depend_on_time(formulas) else {end})
        parts = [f.parts for f in formulas]
        whole = all(part == (f,) for part, f in zip(parts, formulas, strict=True))
        together = [formulas] if whole else [[part] for each in parts for part in each]
        groups = [(each, t) for t in times for each in together]
        found.append(Feature(of, what, role, edge, divided(groups, box, measure, case.kinks)))
    return tuple(found)


def _in_boxes(case: Any) -> Iterator[tuple[Formulas, Box]]:
    """Yield the formulas of a case with the rectangles in which they vary: a folded surface has one for each piece."""
    surface = case.surface
    for entry in _formulas(case):
        if entry[0] is surface and surface.fold_lines:
            yield from (((*entry[:4], piece.formulas, entry[5]), piece.box) for piece in surface.pieces)
        else:
            yield entry, _box(case, entry[3])


def _depend_on_time(formulas: Sequence[Expression]) -> bool:
    return any(formula.depends_on("t") for formula in formulas)


def check_formulas(case: Any) -> None:
    """Check that the formulas of a case are finite all over the shell, and stiffnesses positive.

    Raises
    ------
    ValueError
        In one clause that names the formula and the place.
    """
    material, everywhere = case.material, _box(case, None)
    for name in ("modulus_factor", "thickness_factor"):
        formula = _read_formula(case, "a factor of the material", getattr(material, name), NAMES)
        if (at := bad_place(formula, everywhere, SMALLEST)) is not None:
            raise ValueError(
                f"field 'material.{name}' is not finite, or not positive, on the shell: at {shown_place(case, at)}"
            )
    for spring in case.springs:
        formula, what = (
            _read_formula(case, f"spring '{spring.name}'", spring.stiffness, NAMES),
            f"the stiffness of spring '{spring.name}'",
        )
        if (at := bad_place(formula, everywhere, -np.finfo(float).tiny)) is not None:
            raise ValueError(f"{what} is not finite, or negative, on the shell: at {shown_place(case, at)}")
    for load in case.loads:
        what = f"a load of kind '{load.kind}'"
        edges: list[Edge | None] = [p for n in getattr(load, "on", ()) if isinstance(p := case.places[n], Edge)]
        for formula in [_read_formula(case, what, text, (*NAMES, "t")) for text in load.formulas]:
            for edge in edges or [None]:
                if (at := bad_place(formula, _box(case, edge))) is not None:
                    raise ValueError(
                        f"{what} is not finite, or above {LARGEST:g}, on the shell: at {shown_place(case, at)}"
                    )
    for support, held in case.supported_places():
        what = f"the motion of support '{support.name}'"
        for text in support.motion.formulas if support.motion is not None else ():
            formula = _read_formula(case, f"support '{support.name}'", text, (*NAMES, "t"))
            side = held if isinstance(held, Edge) else None
            if (at := bad_place(formula, _box(case, side), order=2)) is not None:
                raise ValueError(
                    f"{what} is not finite, or above {LARGEST:g}, on the shell: at {shown_place(case, at)}"
                )


def _read_formula(case: Any, what: str, text: Any, variables: tuple[str, ...]) -> Expression:
    try:
        return Expression(text, variables, case.surface.named_constants, piecewise=True)
    except InputError as error:
        raise ValueError(f"{what}: {error}") from None


def undecided(case: Any) -> str | None:
    """Return the formula that no cells or no contact search resolves, and its place, as one clause, or None."""
    for feature in case.features:
        if (at := feature.division.undecided) is not None:
            return f"{feature.what} varies more quickly than {MOST_CELLS} cells tell, at {shown_place(case, at)}"
        if feature.role == "obstacle" and feature.division.narrow.any():
            axis = int(feature.division.narrow[:, 1].any())
            return f"{feature.what} {quickness_in_words(case, feature, axis)}, which points in contact may miss"
    return None


def why_too_narrow(case: Any) -> str | None:
    """Return a formula that varies within less than samples resolve, with its place, as one clause, or None."""
    for feature in case.features:
        axes = (0, 1) if feature.edge is None else (1 - feature.edge.axis,)
        for axis in axes:
            d = feature.division
            if np.any(d.narrow[:, axis] & ((d.high - d.low)[:, axis] < POINTLIKE * d.side[axis])):
                return f"{feature.what} {quickness_in_words(case, feature, axis)}"
    return None


def quickness_in_words(case: Any, feature: Feature, axis: int) -> str:
    """Return in words the shortest length of a coordinate over which a formula varies, and its place."""
    division = feature.division
    size = np.where(division.narrow[:, axis], (division.high - division.low)[:, axis], np.inf)
    at, length = place((division.low + division.high)[size.argmin()] / 2), float(size.min())
    shown = np.degrees(length) if case.surface.domain.angle[axis] else length
    return f"varies within {shown:.2g} of {NAMES[axis]} at {shown_place(case, at)}"


def shown_place(case: Any, at: Place) -> str:
    """Return a place in the units of the case file."""
    domain = case.surface.domain
    each = (np.degrees(c) if angle else c for c, angle in zip(at, domain.angle, strict=True))
    return "(xi1, xi2) = ({:.6g}, {:.6g})".format(*each)


def _box(case: Any, edge: Edge | None) -> Box:
    domain = case.surface.domain
    bounds = list(zip(domain.lower, domain.upper, strict=True))
    if edge is not None:
        bounds[edge.axis] = (edge.coordinate(domain),) * 2
        bounds[1 - edge.axis] = edge.bounds(domain)
    return bounds[0], bounds[1]


def _at_rest(case: Any, obstacle: FormulaBody, t: float) -> Expression:
    """Return the formula of an obstacle at its place at a time, on the shell at rest."""
    moved = zip("xyz", case.surface.formulas, obstacle.at(t)[0].tolist(), strict=True)
    place = {name: f"(({formula}) - ({centre!r}))" for name, formula, centre in moved}
    found: Expression = case.formula(re.sub(r"\b[xyz]\b", lambda name: place[name[0]], obstacle.phi))
    return found


def _formulas(case: Any) -> Iterator[Formulas]:
    surface, material = case.surface, case.material
    if isinstance(surface, ExpressionSurface):
        yield surface, "the surface", "stiffness", None, surface.expressions, "curvature"
    if not material.uniform:
        modulus, thickness = material.modulus_factor, material.thickness_factor
        for text in (f"({modulus})*({thickness})**3", f"1/(({modulus})*({thickness})**3)"):
            what = (
                "field 'material.thickness_factor'" if isinstance(thickness, str) else "field 'material.modulus_factor'"
            )
            yield material, what, "stiffness", None, [case.formula(text)], "integral"
    for spring in case.springs:
        yield (
            spring,
            f"the stiffness of spring '{spring.name}'",
            "stiffness",
            None,
            [case.formula(spring.stiffness)],
            "integral",
        )
    for obstacle in case.obstacles:
        if isinstance(obstacle, FormulaBody) and isinstance(surface, AnalyticSurface):
            t = 1.0 if case.dynamics is None else ON_THE_WAY * case.dynamics.until
            yield obstacle, "an obstacle of kind 'formula'", "obstacle", None, [_at_rest(case, obstacle, t)], "integral"
    for load in case.loads:
        formulas, what = [case.formula(f) for f in load.formulas], f"a load of kind '{load.kind}'"
        if isinstance(load, AreaLoad | PressureLoad | GravityLoad):
            yield load, what, "load", None, formulas, "integral"
        for name in load.on if isinstance(load, EdgeLoad | MomentLoad) else ():
            # a moment acts on slopes: fields have to vary as quickly
            yield (
                load,
                what,
                "load" if isinstance(load, EdgeLoad) else "stiffness",
                case.places[name],
                formulas,
                "integral",
            )
    for support, held in case.supported_places():
        if isinstance(support.motion, Value) and isinstance(held, Edge | Whole):
            edge = held if isinstance(held, Edge) else None
            formulas = [case.formula(f) for f in support.motion.formulas]
            yield support, f"the motion of support '{support.name}'", "stiffness", edge, formulas, "curvature"
