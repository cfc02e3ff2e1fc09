"""A sheet of a shell: its question in words, and its meshes for other programs."""

from __future__ import annotations

from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.deck.deck import Deck
from shellbench.problems.shell.deck.grid import ON_NODE, square_cells
from shellbench.problems.shell.deck.nodal import why_not_held
from shellbench.problems.shell.declining import Beyond, why_not_by_load, why_not_plain
from shellbench.problems.shell.question.loads import PointLoad
from shellbench.problems.shell.question.places import Point
from shellbench.problems.shell.records.portrait import ShellPortrait
from shellbench.problems.shell.sheet.formats import ELEMENTS, writers
from shellbench.problems.shell.sheet.statement import marked, statement
from shellbench.problems.shell.sheet.units import in_system, unit_in
from shellbench.problems.shell.symmetry.symmetry import Part, part_of, whole_of
from shellbench.protocol.sheet import Request, Sheet, Sketch
from shellbench.protocol.spelling import did_you_mean

Array = NDArray[np.float64]

TAKES: frozenset[Beyond] = frozenset(
    {"transverse shear", "supported parts", "local supports", "local loads", "kinks", "folds", "resultants"}
)
# cells across the coarsest mesh: the first number with which all named points are nodes
FIRST = (*range(8, 17), 20, 24, 32)
LADDER = (1, 2, 4)  # times as many cells across
GRID, ROUGH = 33, (5, 5)  # points of a sketch a side; cells whose nodal forces are its arrows


def why_no_sheet(case: Case) -> str | None:
    """Return the reason why a case has no sheet, as a clause; None if it has one."""
    if case.dynamics is not None:
        return "it is a motion, and sheets are of shells at rest"
    if (reason := why_not_plain(case, TAKES)) is not None:
        return reason.replace("this solver", "a sheet")
    if not case.linear and (reason := why_not_by_load(case, case.remove_rigid_motions)) is not None:
        return reason.replace("this solver", "a sheet")
    if case.following:
        return "its pressure follows the deformed shell, and nodal loads do not"
    if case.material.bending_factor != 1:
        return "its bending stiffness is not that of a homogeneous shell"
    if any(fold.hinged for fold in case.surface.fold_lines):
        return "it has a hinge, and the cells of a mesh are welded"
    return why_not_held(case)


def sheet(case: Case, request: Request) -> Sheet:
    """Return the sheet of a case.

    Raises
    ------
    InputError
        If the case makes no sense for a program with meshes, units or an element are not known, or a place that is held
        or loaded lies on no node.
    """
    if (reason := why_no_sheet(case)) is not None:
        raise InputError(f"{case.name} has no sheet: {reason}")
    for element in request.elements:
        if element not in ELEMENTS:
            known = f"{did_you_mean(element, ELEMENTS)}; allowed are {', '.join(ELEMENTS)}"
            raise InputError(f"--element: found '{element}'{known}")
    case, system, own = in_system(case, request.units)
    unit = partial(unit_in, system, own, case)
    part = whole_of(case) if request.whole else part_of(case)
    counts = [square_cells(part, across) for across in dict.fromkeys(request.cells or _ladder(part))]
    decks = {(n, name): _steps(part, n, name) for n in counts for name in request.elements}
    files = {
        f"{n[0]}x{n[1]}_{element}{ending}": write
        for (n, element), steps in decks.items()
        for ending, write in writers(steps, element, f"{case.name}, {n[0]} x {n[1]} {element}, {request.units}").items()
    }
    answers = tuple(
        (case.name, q.name, f"{q.at:g}" if marked(case) else "", "", unit(q), f"{n[0]}x{n[1]}", "", "")
        for n in counts
        for q in case.quantities
    )
    last = {f"{n[0]}x{n[1]}_{name}": steps[-1] for (n, name), steps in decks.items()}
    words = statement(last, system, unit)
    return Sheet(case.name, case.title, words, files, answers, _sketch(case, part))


def _steps(part: Part, counts: tuple[int, int], element: str) -> list[Deck]:
    """Return the decks of a mesh at all states of the case; InputError if a place lies on no node."""
    steps = [Deck.of(part, counts, ELEMENTS[element].shape, at=at) for at in part.whole.states]
    try:
        for fold in part.case.surface.fold_lines:
            place = (fold.at - part.lower[fold.axis]) / steps[0].grid.steps[fold.axis]
            if abs(place - round(place)) > ON_NODE:
                raise InputError(f"field 'cells': a fold crosses cells of {counts[0]} x {counts[1]}; choose others")
        for deck in steps:
            _ = deck.forces, deck.prescribed, deck.held  # so that bad cells are refused before anything is written
    except InputError as error:
        raise InputError(f"{part.whole.name}: {error}") from None
    return steps


def _ladder(part: Part) -> list[int]:
    """Return cells across of three meshes: the coarsest for which places are nodes, and as many named points as can be.

    Raises
    ------
    InputError
        If a place that is held or loaded is no node of any.
    """
    lacking: dict[int, int] = {}
    for across in FIRST:
        try:
            (deck,) = _steps(part, square_cells(part, across), "S4")[-1:]
        except InputError as error:
            refused = error
            continue
        points = [name for name, place in part.case.places.items() if isinstance(place, Point)]
        lacking[across] = sum(name not in deck.sets for name in points)
    if not lacking:
        raise refused
    first = min(lacking, key=lambda across: lacking[across])
    return [first * times for times in LADDER]


def _sketch(case: Case, part: Part) -> Sketch:
    surface, domain = case.surface, case.surface.domain
    (low1, low2), (high1, high2) = part.lower, part.upper
    corners = np.array([(low1, low2), (high1, low2), (high1, high2), (low1, high2), (low1, low2)])
    share = np.linspace(0, 1, GRID)[:, None]
    sides = [start + share * (end - start) for start, end in pairwise(corners)]
    plain = case.model_copy(update={"loads": tuple(load for load in case.loads if not isinstance(load, PointLoad))})
    rough = Deck.of(whole_of(plain), ROUGH, at=case.states[-1])
    spread = np.stack([rough.nodes, rough.forces[:, :3]], axis=1)
    named = {place.xi: name for name, place in case.places.items() if isinstance(place, Point) and name in case.points}
    return Sketch(
        scene=ShellPortrait(case).scene,
        xi=domain.grid(GRID, GRID),
        position=surface.position(domain.grid(GRID, GRID)),
        part=surface.position(np.concatenate(sides)),
        points={name: surface.position(np.array(xi)) for xi, name in named.items()},
        spread=spread[np.abs(spread[:, 1]).max(axis=1) > 0],
    )
