"""The question of a case in words: what an engineer needs to model it, and what to report."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.deck import nodal
from shellbench.problems.shell.deck.deck import Deck
from shellbench.problems.shell.quantities.quantity import ShellQuantity
from shellbench.problems.shell.quantities.resultant_quantities import PlacedQuantity
from shellbench.problems.shell.question.conditions import Support
from shellbench.problems.shell.question.loads import EdgeLoad, GravityLoad, Load, MomentLoad, PointLoad, PressureLoad
from shellbench.problems.shell.question.places import Edge, Place, Point, Whole
from shellbench.problems.shell.question.surface import COORDINATES
from shellbench.problems.shell.sheet.formats import set_name
from shellbench.problems.shell.sheet.units import System
from shellbench.problems.shell.symmetry.symmetry import Part, whole_of

Array = NDArray[np.float64]

THEORIES = {
    "kirchhoff-love-linear": "Thin shell (Kirchhoff-Love), small displacements: normals stay straight and normal to the"
    " midsurface, without transverse shear. Elements with transverse shear tend to another limit, which is near on thin"
    " shells.",
    "kirchhoff-love-nonlinear": "Thin shell (Kirchhoff-Love), large displacements and rotations, Green's strains,"
    " linear elastic (St. Venant-Kirchhoff): normals stay straight and normal to the midsurface, without transverse"
    " shear. Loads are dead: they keep their direction.",
    "naghdi-linear": "Shell with transverse shear (Reissner-Mindlin, Naghdi), small displacements: normals stay"
    " straight. The shear correction factor is 5/6, the shear modulus G = E/(2(1 + nu)).",
}
MOVES, TURNS = ("u_x", "u_y", "u_z"), ("r_x", "r_y", "r_z")
FINE = (48, 48)  # cells of the mesh on which totals of loads are taken
ROUNDING = 1e-12  # of the largest number of a vector
SAID = {"largest_displacement": "largest magnitude of the displacement anywhere on the midsurface"}
VECTORS = {"direction", "axis", "centre", "exact"}
NOT_TOLD = {"name", "kind", "description", "unit", "primary", "at", "factor", "tolerance", "absolute", "open_finding"}


def statement(case: Case, decks: Mapping[str, Deck], names: System, units: str, files: Sequence[str]) -> str:
    """Return the question as Markdown.

    Parameters
    ----------
    decks
        Meshes by their words, such as "8x8", at the last load; all of the same part.
    files
        Rows of the table of files.
    """
    deck = next(iter(decks.values()))
    return "\n".join(line for part in (
        [f"# {case.title}", "", f"Case `{case.name}`. {case.description}", "", "![sketch](sketch.svg)", ""],
        [f"Units here and in all files: {names.length}, {names.force}, {names.stress} (`--units {units}`).", ""],
        ["## Theory", "", THEORIES[case.theory], ""],
        _geometry(deck.part, names),
        _material(case, names),
        _supports(deck, names),
        _loads(deck, names),
        _asked(deck, names),
        files,
    ) for line in part) + "\n"  # fmt: skip


def marked(case: Case) -> bool:
    """Return True if values belong to load factors: on a path, or with several states."""
    return len(case.states) > 1 or not case.linear


def number(value: float) -> str:
    """Write a number with ten digits at most."""
    return f"{value + 0.0:.10g}"


def vector(values: Iterable[float | str]) -> str:
    """Write numbers or formulas in brackets; rounding is zero."""
    given = list(values)
    largest = max((abs(v) for v in given if not isinstance(v, str)), default=0.0)
    words = (f"`{v}`" if isinstance(v, str) else number(0.0 if abs(v) <= ROUNDING * largest else v) for v in given)
    return f"({', '.join(words)})"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a table in Markdown, and an empty one; none without rows."""
    lines = [f"| {' | '.join(row)} |" for row in rows]
    return [f"| {' | '.join(head)} |", "|---" * len(head) + "|", *lines, ""] if lines else []


def _at(case: Case, *points: tuple[float, float]) -> Array:
    return case.surface.position(np.array(points))


def _geometry(part: Part, names: System) -> Iterator[str]:
    surface = part.whole.surface
    yield from ("## Midsurface", "")
    if surface.kind == "mesh":
        yield "A spline through the points of a mesh file: take its points from the meshes of this folder."
    else:
        xyz = ", ".join(f"{axis} = `{formula}`" for axis, formula in zip("xyz", surface.formulas, strict=True))
        given = "".join(f", {name} = {number(value)}" for name, value in surface.named_constants.items())
        yield f"{xyz}{given}."
    for axis, name in enumerate(COORDINATES):
        low, high = getattr(surface, name)
        angle, closed = surface.domain.angle[axis], surface.domain.periodic[axis]
        unit = "degrees (radians in formulas)" if angle else names.length
        yield f"{name} runs from {number(low)} to {number(high)} {unit}{', and closes on itself' if closed else ''}."
    middle = np.add(part.lower, part.upper) / 2
    tangents = surface.derivatives(middle, order=1)
    normal = np.cross(tangents[1, 0], tangents[0, 1])
    normal = normal / np.linalg.norm(normal)
    place = vector(surface.position(middle))
    yield f"The normal is along the derivatives x,1 cross x,2: at {place} it is {vector(np.round(normal, 12))}."
    for fold in surface.fold_lines:
        at = np.degrees(fold.at) if surface.domain.angle[fold.axis] else fold.at
        yield f"A fold runs along {COORDINATES[fold.axis]} = {number(at)}: it keeps its angle (welded)."
    yield ""
    if part.mirrors:
        bounds = zip(part.lower, part.upper, part.ends, surface.domain.angle, COORDINATES, strict=True)
        words = [
            f"{name} from {number(np.degrees(low) if angle else low)} to {number(np.degrees(high) if angle else high)}"
            for low, high, ends, angle, name in bounds
            if ends != (None, None)
        ]
        yield f"**The meshes are one of {part.copies} equal parts**: {', '.join(words)}. The rest is its mirror image."
        yield ""


def _material(case: Case, names: System) -> list[str]:
    made = case.material
    return [
        "## Material",
        "",
        f"Isotropic, linear elastic: E = {number(made.youngs_modulus)} {names.stress}, nu ="
        f" {number(made.poissons_ratio)}, thickness {number(made.thickness)} {names.length}.",
        "",
    ]


def _where(case: Case, place: Place, names: System) -> str:
    """Return where a place lies in space."""
    if isinstance(place, Whole):
        return "everywhere"
    if isinstance(place, Point):
        return f"at {vector(_at(case, place.xi)[0])}"
    x = case.surface.position(place.samples(case.surface.domain, 33))
    plane = next((a for a in range(3) if np.ptp(x[:, a]) <= 1e-9 * np.ptp(x, axis=0).max()), None)
    lies = "" if plane is None else f"{'xyz'[plane]} = {number(round(float(x[0, plane]), 12))}, "
    ends = np.where(np.abs(x) <= ROUNDING * np.abs(x).max(), 0.0, x)
    straight = np.allclose(x[16], (x[0] + x[-1]) / 2, atol=1e-9 * np.ptp(x, axis=0).max())
    middle = "" if straight else f" by {vector(ends[16])}"
    return f"{lies}from {vector(ends[0])}{middle} to {vector(ends[-1])}"


def _kept(case: Case, support: Support, place: Place) -> tuple[str, str, str]:
    """Return the displacements and rotations that a support holds, and a remark."""
    held = nodal.held_components(case, support, place) or ()
    moves = " = ".join(MOVES[c] for c in held if c < 3)
    turns = " = ".join(TURNS[c - 3] for c in held if c >= 3)
    remarks = [support.name.replace("_", " ") if support.symmetry is None else f"plane of symmetry {support.symmetry}"]
    if support.clamped:
        remarks.append("clamped: the edge does not turn about its tangent")
    elif case.theory == "naghdi-linear" and isinstance(place, Edge) and not support.symmetry:
        soft = "soft: normals are free to turn along the edge"
        remarks.append(soft if not turns else "hard: normals do not turn along the edge")
    if support.motion is not None:
        given = ", ".join(f"{key} = {value}" for key, value in support.motion.model_dump(exclude_unset=True).items())
        remarks.append(f"moved: {given}")
    zero = "" if support.motion is None else " (moved)"
    return moves + (" = 0" if moves and not zero else zero), turns + (" = 0" if turns else ""), "; ".join(remarks)


def _supports(deck: Deck, names: System) -> Iterator[str]:
    part, case = deck.part, deck.part.case
    rows: list[tuple[str, ...]] = []
    held: dict[str, list[Support]] = {}
    for support, place in case.supported_places():
        held.setdefault(place.name, []).append(support)
    for name, place in case.places.items():
        if name in held or (isinstance(place, Edge) and place.whole):
            where = _where(case, place, names)
            for support in held.get(name, ()):
                rows.append((f"`{set_name(name)}`", where, *_kept(case, support, place)))
            if name not in held:
                rows.append((f"`{set_name(name)}`", where, "", "", "free"))
    yield from ("## Supports", "", "All that is not named is free. Rotations are about the axes x, y and z.", "")
    yield from table(("boundary", "where", "displacements", "rotations", "what it is"), rows)
    hinged = any(isinstance(place, Edge) and not s.holds_slope for s, place in case.supported_places())
    if hinged and case.theory.startswith("kirchhoff"):
        yield (
            "Hinged edges are soft here: no rotation is held. An element with transverse shear comes nearer to the thin"
            " limit with hard supports, where normals do not turn along the edge."
        )
        yield ""
    if case.remove_rigid_motions:
        motions = ", ".join(
            name.replace("_", " along " if name[0] == "t" else " about ") for name in case.remove_rigid_motions
        )
        yield (
            f"Nothing holds these rigid motions: {motions}. Decks hold one component of a node for each, which gets no"
            " force. Values are those of the displacement without its mean rigid motion over the area."
        )
        yield ""
    if part.mirrors:
        yield "A drilling rotation (about the normal) is held only where the table names it; else leave it free."
        yield ""


def _load_words(case: Case, load: Load, names: System) -> str:
    on = ", ".join(f"`{set_name(name)}`" for name in getattr(load, "on", ()))
    frame = " in the shell's own frame (along, across, normal)" if getattr(load, "frame", "") == "local" else ""
    match load:
        case PointLoad():
            return f"force {vector(load.force)} {names.force} at each of {on}"
        case EdgeLoad():
            return f"force per length {vector(load.vector)} {names.unit(-1, 1)}{frame} on {on}"
        case MomentLoad():
            value = vector([load.value])[1:-1]
            return f"moment per length {value} {names.unit(0, 1)} about {vector(load.axis)} (right hand) on {on}"
        case PressureLoad():
            return f"pressure {vector([load.value])[1:-1]} {names.stress} along the normal, on the whole midsurface"
        case GravityLoad():
            density = number(case.material.areal_density)
            return f"mass per area {density} times acceleration {vector(load.acceleration)}, on the whole midsurface"
    return f"force per area {vector(load.vector)} {names.stress}{frame}, on the whole midsurface"


def _loads(deck: Deck, names: System) -> Iterator[str]:
    part = deck.part
    yield from ("## Loads", "")
    if marked(part.whole):
        yield from (
            f"At the load factor t = {number(deck.at)}; before, loads grow in proportion unless formulas say else.",
            "",
        )
    rows = []
    for load in part.whole.loads:
        whole = part.whole.model_copy(update={"loads": (load,)})
        if isinstance(load, PointLoad):
            total = len(load.on) * np.array([whole.scalar(text, deck.at) for text in load.force] + [0.0] * 3)
        else:
            total = _total(Deck.of(whole_of(whole), FINE, at=deck.at))
        rows.append((_load_words(part.whole, load, names), *(vector(t) for t in np.split(total, 2))))
    unit = (names.force, names.unit(1, 1))
    yield from table(("load", f"total force on the whole, {unit[0]}", f"total of moments on nodes, {unit[1]}"), rows)
    if part.mirrors:
        shared = vector(_total(deck)[:3])
        yield f"The nodes of a mesh bear {shared} {names.force} together: forces in planes of symmetry are shared with"
        yield "the mirror images."
        yield ""
    if rows:
        yield "Nodal loads of the decks, in `*_loads.csv` too, are consistent: integrals of the load times the shape"
        yield "functions over the true midsurface."
        yield ""


def _total(deck: Deck) -> Array:
    total = deck.forces.sum(axis=0)
    size = np.abs(deck.forces).sum(axis=0)
    return np.where(np.abs(total) <= 1e-9 * size.max(initial=0.0), 0.0, total)


def _asked(deck: Deck, names: System) -> Iterator[str]:
    case = deck.part.whole
    yield from ("## What to report", "")
    marks = ["at load factor"] if marked(case) else []
    rows = [
        (f"`{q.name}`", _what(q), *([number(q.at)] if marks else []), names.of(case, q) or "none")
        for q in case.quantities
    ]
    yield from table(("quantity", "what", *marks, "unit"), rows)
    if deck.part.mirrors:
        yield f"Energies are those of the whole shell: {deck.part.copies} times those of the part."
        yield ""
    yield from _points(deck, names)


def _what(quantity: ShellQuantity) -> str:
    """Return what a quantity is, and the data of its measurement."""
    said = quantity.description or SAID.get(quantity.kind, quantity.kind.replace("_", " "))
    if isinstance(quantity, PlacedQuantity) and quantity.kind not in said:
        said = f"{quantity.kind.replace('_', ' ')}: {said}"
    told = []
    for key, value in quantity.model_dump(exclude_none=True, exclude_defaults=True).items():
        if key in NOT_TOLD:
            continue
        if isinstance(value, tuple | list):
            words = vector(value) if key in VECTORS and not isinstance(value[0], tuple) else _listed(value)
        else:
            words = str(value)
        told.append(f"{key.replace('_', ' ')} {words}")
    return "; ".join([said, *told, *([f"times {number(quantity.factor)}"] if quantity.factor != 1 else [])])


def _listed(values: Iterable[object]) -> str:
    return ", ".join(vector(v) if isinstance(v, tuple) else f"`{set_name(str(v))}`" for v in values)


def _points(deck: Deck, names: System) -> Iterator[str]:
    """Yield the table of named points, and where each is in the meshes."""
    case, part = deck.part.whole, deck.part
    rows = []
    named = {name for q in case.quantities for name in q.places} | {
        n for load in case.loads for n in getattr(load, "on", ())
    }
    for name in sorted(named, key=list(case.places).index):
        place = case.places[name]
        if not isinstance(place, Point):
            continue
        folded = part.fold(np.array([place.xi]))
        image = "" if part.place(place.xi) else f"; mirror image of {vector(_at(case, tuple(folded.points[0]))[0])}"
        on = f"node set `{set_name(name)}`" if name in deck.sets else "no node" if not image else "outside the part"
        rows.append((f"`{set_name(name)}`", vector(_at(case, place.xi)[0]), on + image))
    yield from table(("point", f"x, y, z in {names.length}", "in the meshes"), rows)
    if any(row[2].startswith("no node") for row in rows):
        yield "Where a point is on no node, interpolate by the shape functions of its cell, or mesh it yourself."
        yield ""
