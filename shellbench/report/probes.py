"""The same material points in all runs of a case: how far two runs' displacements are from each other there."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shellbench.bench.record import Record

Array = NDArray[np.float64]

SAME = 1e-6  # relative difference of marks, or of points in units of the largest coordinate, that are one


@dataclass(frozen=True)
class Probes:
    """Displacements (j, m, 3), m, at material points (m, 2) and marks (j,); see `shellbench.bench.record.Record`."""

    points: Array
    marks: Array
    displacements: Array

    @property
    def largest(self) -> float:
        """Largest magnitude of the displacement, m."""
        return float(np.linalg.norm(self.displacements, axis=-1).max(initial=0.0))


@dataclass(frozen=True)
class Difference:
    """How far two runs are from each other at the same material points.

    Attributes
    ----------
    marks
        (j,) marks that both reached.
    by_mark
        (j,) largest magnitude over the points, m.
    rms
        Root of the mean square of the magnitude over points and marks, m.
    """

    marks: Array
    by_mark: Array
    rms: float

    @property
    def largest(self) -> float:
        """Largest magnitude over points and marks, m."""
        return float(self.by_mark.max())


def read_probes(record: Record, folder: Path) -> Probes | None:
    """Return what a run answered at its probes; None if it kept none, or they are lost, damaged or not finite."""
    if record.fields_file is None:
        return None
    try:
        with np.load(folder / record.fields_file, allow_pickle=False) as stored:
            points, marks, displacements = (
                np.asarray(stored[name], dtype=float) for name in ("probes", "probe_marks", "probe_displacements")
            )
    except (OSError, EOFError, KeyError, TypeError, ValueError, zipfile.BadZipFile):
        return None
    whole = displacements.size > 0 and displacements.shape == (len(marks), len(points), 3)
    finite = all(np.all(np.isfinite(a)) for a in (points, marks, displacements))
    return Probes(points, marks, displacements) if whole and finite else None


def difference(ours: Probes | None, theirs: Probes | None) -> Difference | None:
    """Return how far two runs are from each other; None if they have no point or no mark in common."""
    if ours is None or theirs is None or ours.points.shape != theirs.points.shape:
        return None
    if not np.allclose(ours.points, theirs.points, rtol=0.0, atol=SAME * np.abs(theirs.points).max()):
        return None
    extent = np.abs(theirs.marks).max()
    near = np.abs(ours.marks[:, None] - theirs.marks) <= SAME * max(extent, SAME)
    i, j = np.nonzero(near)
    if not len(i):
        return None
    apart = np.linalg.norm(ours.displacements[i] - theirs.displacements[j], axis=-1)
    return Difference(theirs.marks[j], apart.max(axis=1), float(np.sqrt(np.mean(apart**2))))
