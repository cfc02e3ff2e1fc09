"""Data that records keep of a solution beside its values: its history, and measurements along the way and on samples.

Problems compute these data from their solutions, and records store them. Problems and records don't import each other.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from shellbench.protocol.schema import LARGEST, Model

Phase = Literal["solve", "path", "critical", "time"]

LARGEST_COUNT = 2**63 - 1  # largest count: 64 bits
LONGEST_RUN = 1e10  # seconds: three centuries


def finite_or_none(value: Any) -> float | None:
    """Return a number; None if there is none, or if it is not finite or too large for a record.

    Raises
    ------
    ValueError
        If it is complex, because its real part alone would look like an answer.
    """
    if np.iscomplexobj(value):
        raise ValueError(f"found {value}, which is no real number")
    return float(value) if value is not None and abs(value) <= LARGEST else None


Figure = Annotated[float, Field(ge=-LARGEST, le=LARGEST, allow_inf_nan=False)]
Amount = Annotated[float, Field(ge=0, le=LARGEST, allow_inf_nan=False)]
Seconds = Annotated[float, Field(ge=0, le=LONGEST_RUN, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=0, le=LARGEST_COUNT)]


class HistoryStep(Model):
    """One entry of the solve's history (see `shellbench.problem.Step`)."""

    iteration: Count
    seconds: Seconds
    energy: Figure
    unknowns: Count
    at: Figure = 1.0
    gap: Figure | None = None
    quantities: dict[str, Figure] = Field(default_factory=dict)
    phase: Phase = "solve"
    iterations: Count | None = None


class StateEnergies(Model):
    """The strain energy of one kept state of a path, J, in its membrane and bending parts.

    Attributes
    ----------
    at
        The state's mark: a time, a load factor, or another mark of the problem.
    """

    at: Figure
    membrane: Figure
    bending: Figure


class Series(Model):
    """A quantity along the way, in SI units or the case's own.

    Attributes
    ----------
    name
        Common name of the quantities that measure it, without their mark.
    quantities
        Names of these quantities; empty for an energy that the case does not ask for.
    marks, values
        (k,) times, s, or load factors, increasing, and the values at them.
    """

    name: str
    quantities: tuple[str, ...] = ()
    unit: str
    description: str = ""
    marks: tuple[Figure, ...]
    values: tuple[Figure, ...]

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        if len(self.marks) != len(self.values):
            raise ValueError(f"found {len(self.marks)} marks and {len(self.values)} values, but each mark has one")
        return self


class ResolutionStep(Model):
    """The same solution sampled on a grid of `points` x `points` samples.

    Attributes
    ----------
    probe_difference
        Largest difference at fixed material points between a query as part of this grid and one by itself, m.
    interpolation_difference
        Largest difference at the points of the finest grid between this grid's bilinear interpolant and the
        field itself, m: the error that a mesh of this resolution would add.
    interpolation_rms
        The same as root mean square over these points, m.
    largest_displacement
        Largest magnitude on the grid's points, m.
    """

    points: Count
    probe_difference: Amount
    interpolation_difference: Amount
    interpolation_rms: Amount | None = None
    largest_displacement: Amount


class FrameRateStep(Model):
    """The same motion sampled at `frames` even instants, both ends counted, at the first of the record's probes.

    Attributes
    ----------
    probe_difference
        Largest difference at fixed instants between a query among these frames and one by itself, m.
    interpolation_difference, interpolation_rms
        Largest and root mean square difference, over even instants at twice the finest rate, between the motion and
        frames joined by straight lines, m: the error that a sequence of meshes at this rate would add.
    largest_displacement
        Largest magnitude at the probes, m.
    """

    frames: Count
    frames_per_second: Amount
    probe_difference: Amount
    interpolation_difference: Amount
    interpolation_rms: Amount
    largest_displacement: Amount


class SelfIntersection(Model):
    """Self-intersection of a deformed surface, by triangles on a grid.

    Attributes
    ----------
    points
        Number of grid points along each coordinate.
    states
        Number of kept states that were checked, in order, up to the first self-intersection.
    free_until
        Mark of the last checked state without self-intersection; None if the first state has one.
    at, places
        Mark of the first self-intersection, and two of the material points that meet there; None and empty if there is
        none.
    sag
        Estimate of the largest distance between the triangles and the surface, m.
    words
        Description in a clause, or the mark from which on it is not known, and the reason; empty if there is no
        self-intersection.
    """

    points: tuple[Count, Count]
    states: Count
    free_until: Figure | None = None
    at: Figure | None = None
    places: tuple[tuple[Figure, Figure], ...] = ()
    sag: Amount = 0.0
    words: str = ""


class PrecisionStep(Model):
    """The same solution with its stored numbers rounded to a shorter format.

    Attributes
    ----------
    format
        "float64" (as solved), "float32" or "float16".
    storage_bytes
        Bytes of the solution in this format.
    largest_difference, rms_difference
        From the solution as solved, over all the record's probes and marks, m; None if it is not finite any more.
    quantities
        The case's quantities of displacement, position and reference-free energies that could be measured, SI.
    """

    format: Literal["float64", "float32", "float16"]
    storage_bytes: Count
    largest_difference: Amount | None = None
    rms_difference: Amount | None = None
    quantities: dict[str, Figure] = Field(default_factory=dict)
