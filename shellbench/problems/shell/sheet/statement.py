"""The question of a case in words: what an engineer needs to model it, and what to report."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping

import jinja2
import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.deck import nodal
from shellbench.problems.shell.deck.deck import Deck
from shellbench.problems.shell.quantities.quantity import ShellQuantity
from shellbench.problems.shell.quantities.resultant_quantities import PlacedQuantity
from shellbench.problems.shell.question.conditions import Support
from shellbench.problems.shell.question.directions import local_directions
from shellbench.problems.shell.question.loads import EdgeLoad, GravityLoad, Load, MomentLoad, PointLoad, PressureLoad
from shellbench.problems.shell.question.places import Edge, Place, Point, Whole
from shellbench.problems.shell.question.surface import COORDINATES
from shellbench.problems.shell.sheet.formats import ABAQUS, ELEMENTS, set_name
from shellbench.problems.shell.symmetry.symmetry import whole_of
from shellbench.protocol.units import System

Array = NDArray[np.float64]

TEMPLATE = "problem.md.j2"
MOVES, TURNS = ("u_x", "u_y", "u_z"), ("r_x", "r_y", "r_z")
FINE = (48, 48)  # cells of the mesh on which totals of loads are taken
SAMPLES = 33  # of an edge
ROUNDING = 1e-9  # of the largest number of a vector
WHOLE = ("energy", "largest displacement")  # quantities that have no place
VECTORS = {"direction", "axis", "centre"}
NOT_TOLD = {"name", "kind", "description", "unit", "primary", "at", "tolerance", "absolute", "open_finding"}


def marked(case: Case) -> bool:
    """Return True if values belong to load factors: on a path, or with several states."""
    return len(case.states) > 1 or not case.linear


def statement(decks: Mapping[str, Deck], names: System, unit: Callable[[ShellQuantity], str]) -> str:
    """Return the question as Markdown.

    Parameters
    ----------
    decks
        Meshes of one part by the names of their files, at the last load.
    unit
        Unit of a quantity.
    """
    deck = next(iter(decks.values()))
    part, case = deck.part, deck.part.whole
    bounds = [
        f"{name} from {number(np.degrees(low) if angle else low)} to {number(np.degrees(high) if angle else high)}"
        for name, low, high, angle in zip(COORDINATES, part.lower, part.upper, case.surface.domain.angle, strict=True)
    ]
    middle = np.add(part.lower, part.upper)[None] / 2
    words = jinja2.Environment(
        loader=jinja2.PackageLoader(__package__, ""),
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    words.filters |= {"number": number, "vector": vector}
    return words.get_template(TEMPLATE).render(
        case=case, part=part, deck=deck, decks=decks, names=names, unit=unit, elements=ELEMENTS, abaqus=ABAQUS.strip(),
        coordinates=_coordinates(case, names),
        bounds=", ".join(bounds),
        middle=case.surface.position(middle)[0],
        normal=local_directions(case.surface, middle)[0, 2],
        supports=[*_supports(part.case)],
        hinged=any(isinstance(place, Edge) and not s.holds_slope for s, place in case.supported_places()),
        marked=marked(case),
        pointed=any(isinstance(load, PointLoad) for load in case.loads),
        loads=[*_loads(deck, names)],
        total=_total(deck)[:3],
        what=_what,
        points=[*_points(deck)],
    )  # fmt: skip


def number(value: float) -> str:
    """Write a number with ten digits at most."""
    return f"{value + 0.0:.10g}"


def vector(values: Iterable[float | str]) -> str:
    """Write numbers or formulas in brackets; rounding is zero."""
    given = list(values)
    largest = max((abs(v) for v in given if not isinstance(v, str)), default=0.0)
    words = (f"`{v}`" if isinstance(v, str) else number(0.0 if abs(v) <= ROUNDING * largest else v) for v in given)
    return f"({', '.join(words)})"


def _sets(names: Iterable[str]) -> str:
    return ", ".join(f"`{set_name(name)}`" for name in names)


def _coordinates(case: Case, names: System) -> Iterator[str]:
    domain = case.surface.domain
    for name, angle, closed in zip(COORDINATES, domain.angle, domain.periodic, strict=True):
        low, high = map(number, getattr(case.surface, name))
        unit = "degrees (radians in formulas)" if angle else names.length
        yield f"{name} runs from {low} to {high} {unit}{', and closes on itself' if closed else ''}."
    for fold in case.surface.fold_lines:
        at = number(np.degrees(fold.at) if domain.angle[fold.axis] else fold.at)
        yield f"A fold runs along {COORDINATES[fold.axis]} = {at}: it keeps its angle (welded)."


def _where(case: Case, place: Place) -> str:
    """Return where a place lies in space."""
    if isinstance(place, Whole):
        return "everywhere"
    if isinstance(place, Point):
        return f"at {vector(case.surface.position(np.array(place.xi)))}"
    x = case.surface.position(place.samples(case.surface.domain, SAMPLES))
    slack = ROUNDING * float(np.abs(x).max())
    plane = "".join(f"{'xyz'[a]} = {number(round(x[0, a], 12))}, " for a in range(3) if np.ptp(x[:, a]) <= slack)
    start, middle, end = (vector(np.where(np.abs(x[k]) <= slack, 0.0, x[k])) for k in (0, SAMPLES // 2, -1))
    straight = np.allclose(x[SAMPLES // 2], (x[0] + x[-1]) / 2, atol=slack)
    return f"{plane}from {start}{'' if straight else f' by {middle}'} to {end}"


def _supports(case: Case) -> Iterator[tuple[str, ...]]:
    """Yield a row for each support of a place, and for each whole edge without one."""
    held = [*case.supported_places()]
    for name, place in case.places.items():
        found = [support for support, on in held if on.name == name]
        head = _sets([name]), _where(case, place)
        yield from ((*head, *_held(case, support, place)) for support in found)
        if not found and isinstance(place, Edge) and place.whole:
            yield (*head, "", "", "free")


def _held(case: Case, support: Support, place: Place) -> tuple[str, str, str]:
    """Return the displacements and rotations that a support holds, and a remark."""
    held = nodal.held_components(case, support, place) or ()
    moves, turns = [MOVES[c] for c in held if c < 3], [TURNS[c - 3] for c in held if c >= 3]
    remark = f"plane of symmetry {support.symmetry}" if support.symmetry else support.name.replace("_", " ")
    if support.clamped:
        remark += "; clamped: the edge does not turn about its tangent"
    elif case.theory == "naghdi-linear" and isinstance(place, Edge) and not support.symmetry:
        hard, soft = "hard: normals do not turn along the edge", "soft: normals are free to turn along the edge"
        remark += f"; {hard if turns else soft}"
    if support.motion is not None:
        given = support.motion.model_dump(exclude_unset=True, exclude={"kind"}).items()
        remark += f"; moved, {support.motion.kind}: {', '.join(f'`{key} = {value}`' for key, value in given)}"
        return ", ".join(moves), " = ".join([*turns, "0"] if turns else ""), remark
    return " = ".join([*moves, "0"] if moves else ""), " = ".join([*turns, "0"] if turns else ""), remark


def _loads(deck: Deck, names: System) -> Iterator[tuple[str, str, str]]:
    """Yield for each load its words, and the totals of its forces and moments on the whole."""
    for load in deck.part.whole.loads:
        case = deck.part.whole.model_copy(update={"loads": (load,)})
        if isinstance(load, PointLoad):
            total = len(load.on) * np.array([*(case.scalar(text, deck.at) for text in load.force), 0.0, 0.0, 0.0])
        else:
            total = _total(Deck.of(whole_of(case), FINE, at=deck.at))
        yield _load_words(case, load, names), vector(total[:3]), vector(total[3:])


def _load_words(case: Case, load: Load, names: System) -> str:
    on = _sets(getattr(load, "on", ()))
    frame = " along, across and normal to the shell" if getattr(load, "frame", "") == "local" else ""
    match load:
        case PointLoad():
            return f"force {vector(load.force)} {names.force} at each of {on}"
        case EdgeLoad():
            return f"force per length {vector(load.vector)} {names.unit(-1, 1)}{frame} on {on}"
        case MomentLoad():
            moment = f"moment per length {vector([load.value])} {names.unit(0, 1)}"
            return f"{moment} about {vector(load.axis)} (right hand) on {on}"
        case PressureLoad():
            return f"pressure {vector([load.value])} {names.stress} along the normal, on the whole midsurface"
        case GravityLoad():
            density = number(case.material.areal_density)
            return f"mass per area {density} times acceleration {vector(load.acceleration)}, on the whole midsurface"
    return f"force per area {vector(load.vector)} {names.stress}{frame}, on the whole midsurface"


def _total(deck: Deck) -> Array:
    total = deck.forces.sum(axis=0)
    return np.where(np.abs(total) <= ROUNDING * np.abs(deck.forces).sum(axis=0).max(initial=0.0), 0.0, total)


def _what(quantity: ShellQuantity) -> str:
    """Return the description of a quantity, and the data of its measurement."""
    kind = quantity.kind.replace("_", " ")
    said = quantity.description or kind + (" of the whole shell" if kind.endswith(WHOLE) else "")
    if isinstance(quantity, PlacedQuantity) and kind not in said:
        said = f"{kind}: {said}"
    for key, value in quantity.model_dump(exclude_none=True, exclude_defaults=True, exclude=NOT_TOLD).items():
        words = number(value) if isinstance(value, float) else str(value)
        if isinstance(value, tuple) and isinstance(value[0], tuple):
            words = ", ".join(map(vector, value))
        elif isinstance(value, tuple):
            words = vector(value) if key in VECTORS else _sets(value)
        said += f"; {key.replace('_', ' ')} {words}"
    return said


def _points(deck: Deck) -> Iterator[tuple[str, str, str]]:
    """Yield the named points, and where each is in the meshes."""
    case, part = deck.part.whole, deck.part
    for name in case.points:
        xi = np.array(case.surface.domain.internal(case.points[name]))
        found = f"node set `{set_name(name)}`" if name in deck.sets else "on no node"
        if not part.place((xi[0], xi[1])):
            image = case.surface.position(part.fold(xi[None]).points[0])
            found = f"outside the part; mirror image of {vector(image)}"
        yield f"`{set_name(name)}`", vector(case.surface.position(xi)), found
