"""The fields that runs kept, read from the arrays beside their records, and how far two of them are apart."""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shellbench.bench.store.record import Record
from shellbench.protocol.picture import Portrait

Array = NDArray[np.float64]
BREADTH = 0.012  # of a chain's length: half the breadth of the ribbon that shows it


@dataclass(frozen=True)
class Fields:
    """The stored solution of a run: points (n, n, 2), positions and displacements (n, n, 3) in metres.

    Attributes
    ----------
    marks, displacements
        Of the kept states of a path, (k,) and (k, n, n, 3); none for a linear case.
    """

    xi: Array
    position: Array
    displacement: Array
    marks: Array = field(default_factory=lambda: np.empty(0))
    displacements: Array = field(default_factory=lambda: np.empty((0, 0, 0, 3)))


def read_fields(record: Record, folder: Path) -> Fields | None:
    """Return the fields that a run kept; None if it kept none, or they are lost, damaged or not finite."""
    kept = kept_arrays(record, folder, "xi", "position", "displacement", optional=("marks", "displacements"))
    if kept is None:
        return None
    xi, position, displacement, *states = kept
    fields = Fields(xi, position, displacement, *(states if states and len(states[0]) else ()))
    fits = position.shape == displacement.shape
    if len(fields.marks):
        fits &= fields.displacements.shape == (len(fields.marks), *displacement.shape)
    return fields if fits else None


def read_ribbon(record: Record, folder: Path, case: Portrait) -> Fields | None:
    """Return the frames of a chain as a narrow surface, nodes by two sides; None if it has none, or they can't be read.

    Displacements are from the first frame.
    """
    kept = None if case.frames is None else kept_arrays(record, folder, *case.frames)
    if kept is None or kept[1].ndim != 3 or not len(kept[1]):
        return None
    times, nodes = kept
    length = float(np.linalg.norm(np.diff(nodes[0], axis=0), axis=1).sum())
    sides = BREADTH * length * np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
    moved = np.broadcast_to((nodes - nodes[0])[:, :, None], (*nodes.shape[:2], 2, 3))
    xi = np.stack(np.meshgrid(np.arange(nodes.shape[1]), [0.0, 1.0], indexing="ij"), axis=-1)
    return Fields(xi, nodes[0][:, None] + sides, moved[-1], times, moved)


def kept_arrays(record: Record, folder: Path, *names: str, optional: Sequence[str] = ()) -> list[Array] | None:
    """Return arrays that a run kept, the optional ones only if the first of them is there.

    None if it kept none, or they are lost, damaged or not finite.
    """
    try:
        with np.load(folder / (record.fields_file or ""), allow_pickle=False) as stored:
            wanted = (*names, *(optional if optional and optional[0] in stored else ()))
            arrays = [np.asarray(stored[name], dtype=float) for name in wanted]
    except (OSError, EOFError, KeyError, TypeError, ValueError, zipfile.BadZipFile):
        return None
    return arrays if all(np.all(np.isfinite(one)) for one in arrays) else None


def differences(ours: Fields, theirs: Fields) -> tuple[float, float]:
    """Return the relative mean-square and largest difference of two fields on the same grid."""
    weights = areas(theirs.position)
    difference = np.linalg.norm(ours.displacement - theirs.displacement, axis=-1)
    size = np.linalg.norm(theirs.displacement, axis=-1)
    mean_square = np.sqrt(np.sum(weights * difference**2) / np.sum(weights * size**2))
    return float(mean_square), float(difference.max() / size.max())


def areas(position: Array) -> Array:
    """Return the share (n1, n2) of the surface's area that belongs to each point of a grid (n1, n2, 3)."""
    first, second = np.gradient(position, axis=0), np.gradient(position, axis=1)
    weights = np.linalg.norm(np.cross(first, second), axis=-1)
    for axis in (0, 1):  # the trapezoidal rule: half a cell at the ends
        ends = [slice(None), slice(None)]
        for end in (0, -1):
            ends[axis] = end  # type: ignore[call-overload]
            weights[tuple(ends)] *= 0.5
    return np.asarray(weights)
