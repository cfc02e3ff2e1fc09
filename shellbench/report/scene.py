"""From records to what the plots need: deformed shells from stored fields."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shellbench.bench.kinds import portrait_of
from shellbench.bench.record import Record
from shellbench.bench.row import Row
from shellbench.portrait import Portrait, Scene
from shellbench.report.fields import Fields, read_fields
from shellbench.report.projection import Camera
from shellbench.report.shells import Shell

Array = NDArray[np.float64]

DRAWN, PLAIN = 1 / 8, 1 / 20  # of a shell's extent: how large a displacement is drawn; from where on it shows as it is
STEPS = np.array([1.0, 2.0, 5.0, 10.0])


def shell(record: Record, folder: Path) -> Shell | None:
    """Return the deformed shell of a run; None if it kept no fields or they can't be read."""
    fields = read_fields(record, folder)
    if fields is None:
        return None
    case = portrait_of(record)
    return None if case is None else drawn(record, case, fields, fields.displacement)


def states(record: Record, folder: Path) -> list[tuple[str, Shell]]:
    """Return the deformed shell at each state of its path that a run kept, with the words for its mark."""
    fields, case = read_fields(record, folder), portrait_of(record)
    if fields is None or case is None:
        return []
    return [
        (case.mark_words(float(mark)), one)
        for mark, displacement in zip(fields.marks, fields.displacements, strict=True)
        if (one := drawn(record, case, fields, displacement)) is not None
    ]


def drawn(
    record: Record, case: Portrait, fields: Fields, displacement: Array, among: Sequence[Fields] = ()
) -> Shell | None:
    """Return a shell of a run with one of its fields (n, n, 3), ready to be drawn; None if its case can't be.

    Its scale suits all states of its run, and those that it stands among.
    """
    scene = case.scene
    if scene is None:
        return None
    states = [state for one in (fields, *among) for state in (one.displacement, *one.displacements)]
    return Shell(
        case=record.case_name,
        title=case.title,
        solver=record.identity.solver,
        position=fields.position,
        displacement=displacement,
        scale=picture_scale(scene, fields.position, [displacement, *states]),
        camera=Camera(*scene.view, scene.up),
        direction=scene.direction,
        held=held_edges(scene, fields.position),
        forces=point_forces(scene, fields.xi, fields.position),
        run_id=record.run_id,
        unit=case.unit_of_length,
    )


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
    if (
        not largest > 0
        or not np.isfinite(largest)
        or PLAIN * extent <= largest <= (np.inf if scene.as_it_is else extent)
    ):
        return 1.0
    wanted = DRAWN * extent / largest
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(min(power * STEPS, key=lambda step: abs(np.log(step / wanted))))


def held_edges(scene: Scene, position: Array) -> tuple[Array, ...]:
    """Return the held edges as polylines (n, 3) of the grid of positions (n1, n2, 3)."""
    return tuple(np.take(position, 0 if side == "min" else -1, axis=axis) for axis, side in scene.held)


def point_forces(scene: Scene, xi: Array, position: Array) -> tuple[tuple[Array, Array], ...]:
    """Return point and force (3,) of each point load, at the grid point nearest to it."""
    forces = []
    for place, force in scene.forces:
        distance = np.linalg.norm((xi - place) / np.asarray(scene.size), axis=-1)
        forces.append((position[np.unravel_index(np.argmin(distance), distance.shape)], force))
    return tuple(forces)


def pictured(records: Mapping[str, Record], rows: Sequence[Row]) -> dict[str, list[Record]]:
    """Return, for each case, a record with fields of each solver: its run with default settings and the lowest seed."""
    chosen: dict[str, dict[str, tuple[int, Record]]] = {}
    for row in rows:
        record = records.get(row.run_id or "")
        if record is None or record.fields_file is None or not row.primary or row.overrides:
            continue
        of_case, seed = chosen.setdefault(row.case, {}), row.seed or 0
        if row.solver not in of_case or seed < of_case[row.solver][0]:
            of_case[row.solver] = (seed, record)
    return {case: [record for _, record in of_case.values()] for case, of_case in chosen.items()}
