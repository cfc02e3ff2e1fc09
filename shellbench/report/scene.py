"""From records to what pictures and views need: whose fields are shown, and deformed shells made of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from shellbench.bench.kinds import portrait_of
from shellbench.bench.record import Record
from shellbench.bench.row import Row
from shellbench.portrait import Portrait, Scene
from shellbench.report.fields import Fields, read_fields
from shellbench.report.shells import Camera, Shell
from shellbench.report.suites import leading_rows

Array = NDArray[np.float64]
T = TypeVar("T")

DRAWN, PLAIN = 1 / 8, 1 / 20  # of a shell's extent: how large a displacement is drawn; from where on it shows as it is
STEPS = np.array([1.0, 2.0, 5.0, 10.0])
MOST_SHOWN = 6  # states


def pictured(records: Mapping[str, Record], rows: Sequence[Row]) -> dict[str, list[Record]]:
    """Return, for each case, a record for each solver: of its own runs that kept a field, that of the lowest seed."""
    chosen: dict[str, dict[str, tuple[int, Record]]] = {}
    for row in leading_rows([row for row in rows if row.primary]):
        record = records.get(row.run_id or "")
        if record is None or record.fields_file is None:
            continue
        of_case, seed = chosen.setdefault(row.case, {}), row.seed or 0
        if row.solver not in of_case or seed < of_case[row.solver][0]:
            of_case[row.solver] = (seed, record)
    return {case: [record for _, record in of_case.values()] for case, of_case in chosen.items()}


def lead_shells(candidates: Mapping[str, Sequence[Record]], folder: Path) -> list[Shell]:
    """Return one shell a case, by one solver as far as possible.

    That is the solver which answered most cases; of several, the one whose solutions take the fewest bytes.
    """
    answered: dict[str, list[int]] = {}
    for records in candidates.values():
        for record in records:
            answered.setdefault(record.identity.solver, []).append(record.storage_bytes or 0)
    order = sorted(answered, key=lambda solver: (-len(answered[solver]), sum(answered[solver]), solver))
    shells = []
    for records in candidates.values():
        ranked = sorted(records, key=lambda record: order.index(record.identity.solver))
        shells.append(next((one for record in ranked if (one := shell(record, folder)) is not None), None))
    return [one for one in shells if one is not None]


def shell(record: Record, folder: Path) -> Shell | None:
    """Return the deformed shell of a run; None if it kept no fields or they can't be read."""
    fields, case = read_fields(record, folder), portrait_of(record)
    return None if fields is None or case is None else drawn(record, case, fields, fields.displacement)


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
        held=tuple(np.take(fields.position, 0 if side == "min" else -1, axis=axis) for axis, side in scene.held),
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
    whole = np.inf if scene.as_it_is else extent
    if not largest > 0 or not np.isfinite(largest) or PLAIN * extent <= largest <= whole:
        return 1.0
    wanted = DRAWN * extent / largest
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(min(power * STEPS, key=lambda step: abs(np.log(step / wanted))))


def point_forces(scene: Scene, xi: Array, position: Array) -> tuple[tuple[Array, Array], ...]:
    """Return point and force (3,) of each point load, at the grid point nearest to it."""
    forces = []
    for place, force in scene.forces:
        distance = np.linalg.norm((xi - place) / np.asarray(scene.size), axis=-1)
        forces.append((position[np.unravel_index(np.argmin(distance), distance.shape)], force))
    return tuple(forces)
