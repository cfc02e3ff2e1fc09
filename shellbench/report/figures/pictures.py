"""Pictures of shells made of the fields that runs kept: each solver's, with obstacles, supports and forces."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import TypeVar

import numpy as np

from shellbench.bench.judge.row import Row
from shellbench.bench.plugins.kinds import find_kind
from shellbench.bench.store.record import Record, portrait_of
from shellbench.problem import Solution
from shellbench.protocol.picture import Portrait, Scene
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import Exhibit
from shellbench.report.data.fields import Array, Fields, read_fields
from shellbench.report.data.runs import grouped, leading_rows, rows_at_home, suite_title
from shellbench.report.figures.shells import Camera, Shell, course_figure, scale_words, shell_figure

T = TypeVar("T")
DRAWN, PLAIN = 1 / 8, 1 / 20  # of a shell's extent: how large a displacement is drawn; from where on it shows as it is
STEPS = np.array([1.0, 2.0, 5.0, 10.0])
BEYOND = 1.5  # largest displacements up to which an obstacle is drawn
MARGIN = 0.06  # of a shell's extent by which obstacles are drawn beyond its edges
MOST_SHOWN = 6  # states
MOST_TOGETHER = 15  # shells in one composite
COMPOSITE, PICTURE = "course_", "shell_"  # how names of figures begin


def pictures(evidence: Evidence) -> Iterator[Exhibit]:
    """Yield the pictures of deformed shells: of each suite together, and of each case."""
    drawn: dict[str, Shell] = {}
    for suite, of_suite in rows_at_home(evidence.headline).items():
        candidates = pictured(evidence.records, [row for row in of_suite if row.default_settings])
        shells = lead_shells(candidates, evidence.folder)
        drawn |= {one.case: one for one in shells if one.case not in drawn}
        if len(shells) > 1:
            shown = shells[:MOST_TOGETHER]
            left_out = f" {len(shown)} of {len(shells)} cases." if len(shown) < len(shells) else ""
            yield Exhibit(
                name=f"{COMPOSITE}{suite}",
                title=suite_title(suite),
                caption="Above, the reference surfaces with held edges (thick) and points (dots), and loads at points"
                " (arrows); below, the deformed shells coloured by the displacement, magnified by the factor given, the"
                f" reference surface a wire. {_solved_by(shown)}{left_out}",
                description="; ".join(f"{one.title}: {one.words}" for one in shown),
                figure=course_figure(shown),
                run_ids=tuple(one.run_id for one in shown),
                drawing=False,
            )
    for one in drawn.values():
        yield Exhibit(
            name=f"{PICTURE}{one.case}",
            title=one.title,
            caption=f"Deformed shell, {scale_words(one)}. {_solved_by([one])}",
            description=f"{one.title}: {one.words}",
            figure=shell_figure(one),
            run_ids=(one.run_id,),
            drawing=False,
        )


def _solved_by(shells: Sequence[Shell]) -> str:
    return f"Solved by {' and '.join(dict.fromkeys(shell.solver for shell in shells))}."


def pictured(records: Mapping[str, Record], rows: Sequence[Row]) -> dict[str, list[Record]]:
    """Return, for each case, a record for each solver: of its own runs that kept a field, that of the lowest seed."""
    leading = ((row, records.get(row.run_id or "")) for row in leading_rows([row for row in rows if row.primary]))
    kept = [(row, record) for row, record in leading if record is not None and record.fields_file is not None]
    return {
        case: [
            min(of_solver, key=lambda one: one[0].seed or 0)[1]
            for of_solver in grouped(of_case, lambda one: one[0].solver).values()
        ]
        for case, of_case in grouped(kept, lambda one: one[0].case).items()
    }


def lead_shells(candidates: Mapping[str, Sequence[Record]], folder: Path) -> list[Shell]:
    """Return one shell a case, by one solver as far as possible.

    That is the solver which answered most cases; of several, the one whose solutions take the fewest bytes.
    """
    answered = grouped(chain.from_iterable(candidates.values()), lambda record: record.identity.solver)
    size = {solver: sum(record.storage_bytes or 0 for record in records) for solver, records in answered.items()}
    order = sorted(answered, key=lambda solver: (-len(answered[solver]), size[solver], solver))
    shells = []
    for records in candidates.values():
        ranked = sorted(records, key=lambda record: order.index(record.identity.solver))
        shells.append(next((one for record in ranked if (one := shell(record, folder)) is not None), None))
    return [one for one in shells if one is not None]


def shell(record: Record, folder: Path) -> Shell | None:
    """Return the deformed shell of a run; None if it kept no fields or they can't be read."""
    fields, case = read_fields(record, folder), portrait_of(record)
    return None if fields is None or case is None else drawn(record, case, fields, fields.displacement)


def shell_of(solution: Solution) -> Shell | None:
    """Return the deformed shell of an answer that was never recorded; None if it has no field, or can't be drawn."""
    case, kind = solution.case, find_kind(solution.case.kind)
    kept, portrait = kind.keep(solution, case), kind.portrait(case)
    if kept is None or "displacement" not in kept:
        return None
    fields = Fields(*(np.asarray(kept[name], dtype=float) for name in ("xi", "position", "displacement")))
    return drawn(None, portrait, fields, fields.displacement)


def states(record: Record, folder: Path) -> list[tuple[str, Shell]]:
    """Return the deformed shell at each state of its path that a run kept, with the words for its mark."""
    fields, case = read_fields(record, folder), portrait_of(record)
    if fields is None or case is None:
        return []
    kept = zip(fields.marks, fields.displacements, strict=True)
    shells = [(case.mark_words(float(mark)), drawn(record, case, fields, state)) for mark, state in kept]
    return [(words, one) for words, one in shells if one is not None]


def spread(states: Sequence[T], most: int = MOST_SHOWN) -> list[T]:
    """Return so many of the states at most, the last one among them, evenly spread."""
    if len(states) <= most:
        return list(states)
    kept = np.unique(np.round(np.linspace(0, len(states), most + 1)[1:]).astype(int) - 1)
    return [states[i] for i in kept]


def drawn(
    record: Record | None, case: Portrait, fields: Fields, displacement: Array, among: Sequence[Fields] = ()
) -> Shell | None:
    """Return a shell of a run with one of its fields (n, n, 3), ready to be drawn; None if its case can't be.

    Its scale suits all states of its run, and those that it stands among.
    """
    scene = case.scene
    if scene is None:
        return None
    states = [state for one in (fields, *among) for state in (one.displacement, *one.displacements)]
    return Shell(
        case=record.case_name if record else case.name,
        title=case.title,
        solver=record.identity.solver if record else "",
        position=fields.position,
        displacement=displacement,
        scale=picture_scale(scene, fields.position, [displacement, *states]),
        camera=Camera(*scene.view, scene.up),
        direction=scene.direction,
        held=held_lines(scene, fields.xi, fields.position),
        forces=point_forces(scene, fields.xi, fields.position),
        run_id=record.run_id if record else "",
        unit=case.unit_of_shape,
        obstacles=near_obstacles(case, fields.position, states),
    )


def near_obstacles(case: Portrait, position: Array, displacements: Iterable[Array]) -> tuple[tuple[Array, Array], ...]:
    """Return points at rest (n1, n2, 3), beyond the edges, too, and their ways to where they would touch an obstacle.

    Ways are NaN where they are far longer than the largest displacement: what stays far away is not drawn.
    """
    largest = max((float(np.linalg.norm(one, axis=-1).max()) for one in displacements), default=0.0)
    around = widened(position)
    ways = case.ways_to_obstacles(around)
    far = [np.linalg.norm(way, axis=-1)[..., None] > BEYOND * largest for way in ways]
    return tuple((around, np.where(there, np.nan, way)) for there, way in zip(far, ways, strict=True))


def widened(position: Array) -> Array:
    """Return a grid (n1 + 2, n2 + 2, 3) that goes straight on beyond the edges of one (n1, n2, 3)."""
    length = MARGIN * float(np.ptp(position.reshape(-1, 3), axis=0).max())
    for axis in (0, 1):
        grid = np.moveaxis(position, axis, 0)
        steps = [grid[0] - grid[1], grid[-1] - grid[-2]]
        sizes = [np.maximum(np.linalg.norm(step, axis=-1, keepdims=True), np.finfo(float).tiny) for step in steps]
        first, last = (
            end + length * step / size for end, step, size in zip((grid[0], grid[-1]), steps, sizes, strict=True)
        )
        position = np.moveaxis(np.concatenate([first[None], grid, last[None]]), 0, axis)
    return position


def picture_scale(scene: Scene, position: Array, displacements: Iterable[Array]) -> float:
    """Return the factor by which a picture magnifies displacements: the case's own, or one that shows something.

    Without one of its own the largest of all that a run kept is drawn as an eighth of the shell's extent, by a factor
    of 1, 2 or 5 times a power of ten. A displacement between a twentieth of the extent and the whole is drawn as it is.

    Parameters
    ----------
    position
        (n1, n2, 3), in the case's units.
    displacements
        Each (n1, n2, 3).
    """
    if scene.scale is not None:
        return scene.scale
    extent = float(np.ptp(position.reshape(-1, 3), axis=0).max())
    largest = max((float(np.linalg.norm(one, axis=-1).max()) for one in displacements), default=0.0)
    whole = np.inf if scene.as_it_is else extent
    if not largest > 0 or not np.isfinite(largest) or PLAIN * extent <= largest <= whole:
        return 1.0
    wanted = DRAWN * extent / largest
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(min(power * STEPS, key=lambda step: abs(np.log(step / wanted))))


def held_lines(scene: Scene, xi: Array, position: Array) -> tuple[Array, ...]:
    """Return the points (n, 3) of each held edge, and (1, 3) of each held point, of the grid (n1, n2, 3)."""
    edges = (np.take(position, 0 if side == "min" else -1, axis=axis) for axis, side in scene.held)
    return (*edges, *(nearest(scene, place, xi, position)[None] for place in scene.pins))


def point_forces(scene: Scene, xi: Array, position: Array) -> tuple[tuple[Array, Array], ...]:
    """Return point and force (3,) of each point load, at the grid point nearest to it."""
    return tuple((nearest(scene, place, xi, position), force) for place, force in scene.forces)


def nearest(scene: Scene, place: Array, xi: Array, position: Array) -> Array:
    """Return the point (3,) of the grid (n1, n2, 3) whose parameters are nearest to a place's (2,)."""
    distance = np.linalg.norm((xi - place) / np.asarray(scene.size), axis=-1)
    return np.asarray(position[np.unravel_index(np.argmin(distance), distance.shape)])
