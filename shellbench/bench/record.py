"""Records: one immutable JSON file for one run, with its fields beside it."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from shellbench.model import Model
from shellbench.solution import Phase

SCHEMA = 1
Status = Literal["ok", "failed", "timeout"]


class Identity(Model):
    """What makes two runs the same: if all of it agrees, an old record answers for a new run.

    Attributes
    ----------
    case
        SHA-256 of the case's physics.
    source
        SHA-256 of the solver's source, of all that it imports from its own package, and of what measures it;
        of a plug-in also its package version.
    settings
        All settings, defaults included, but for seed and device.
    seed
        None for a deterministic solver.
    """

    case: str
    solver: str
    source: str
    settings: dict[str, Any]
    seed: int | None
    device: str
    dtype: str


class Measured(Model):
    """One quantity as measured: SI units, or the case's own."""

    value: float
    uncertainty: float | None = None
    extrapolated: float | None = None


class HistoryStep(Model):
    """One entry of the solve's history (see `shellbench.solution.Step`)."""

    iteration: int
    seconds: float
    energy: float
    unknowns: int
    at: float = 1.0
    gap: float | None = None
    quantities: dict[str, float] = Field(default_factory=dict)
    phase: Phase = "solve"
    iterations: int | None = None


class StateEnergies(Model):
    """The strain energy of one kept state of a path, J, in its membrane and bending parts.

    Attributes
    ----------
    at
        The state's mark (see `shellbench.path.Path`).
    """

    at: float
    membrane: float
    bending: float


class Series(Model):
    """What one thing was along the way, in SI units or the case's own (see `shellbench.bench.series`).

    Attributes
    ----------
    name
        What the quantities that measure it are called, without their mark.
    quantities
        Names of these quantities; none of an energy that the case does not ask for.
    marks, values
        (k,) times, s, or load factors, increasing, and what it was then.
    """

    name: str
    quantities: tuple[str, ...] = ()
    unit: str
    description: str = ""
    marks: tuple[float, ...]
    values: tuple[float, ...]


class ResolutionStep(Model):
    """The same solution seen through a grid of `points` x `points` samples.

    Attributes
    ----------
    probe_difference
        Largest difference at fixed material points between a query as part of this grid and one by itself, m.
    interpolation_difference
        Largest difference at the points of the finest grid between this grid's bilinear interpolant and the
        field itself, m: what a mesh of this resolution would add.
    interpolation_rms
        The same as root mean square over these points, m.
    largest_displacement
        Largest magnitude on the grid's points, m.
    """

    points: int
    probe_difference: float
    interpolation_difference: float
    interpolation_rms: float | None = None
    largest_displacement: float


class FrameRateStep(Model):
    """The same motion seen through `frames` even instants, both ends counted, at the first of the record's probes.

    Attributes
    ----------
    probe_difference
        Largest difference at fixed instants between a query among these frames and one by itself, m.
    interpolation_difference, interpolation_rms
        Largest and root mean square difference, over even instants at twice the finest rate, between the motion and
        frames joined by straight lines, m: what a sequence of meshes at this rate would add.
    largest_displacement
        Largest magnitude at the probes, m.
    """

    frames: int
    frames_per_second: float
    probe_difference: float
    interpolation_difference: float
    interpolation_rms: float
    largest_displacement: float


class PrecisionStep(Model):
    """The same solution with its stored numbers rounded to a shorter format.

    Attributes
    ----------
    format
        "float64" (as solved), "float32" or "float16".
    storage_bytes
        Bytes needed to keep it so.
    largest_difference, rms_difference
        From the solution as solved, over all the record's probes and marks, m; None if it is not finite any more.
    quantities
        The case's quantities of displacement, position and reference-free energies that could be measured, SI.
    """

    format: Literal["float64", "float32", "float16"]
    storage_bytes: int
    largest_difference: float | None = None
    rms_difference: float | None = None
    quantities: dict[str, float] = Field(default_factory=dict)


class Environment(Model):
    """Where a run was made."""

    python: str
    versions: dict[str, str]
    platform: str
    processor: str
    cores: int
    threads: int
    gpu: str | None = None
    git_sha: str | None = None
    git_dirty: bool | None = None


class Record(Model):
    """What is known of one run.

    Attributes
    ----------
    run_id
        Name of the record's files in the store.
    case
        The whole case as it was read, prose and tolerances included, so that a report needs nothing else.
    own_case
        Whether the case is a user's own file, not one of the suite's.
    defaults
        The solver's default settings, without seed and device: valid as long as its source is the same.
    solver_label
        One line that says what the solver is.
    seconds
        Wall time of the solve, start of the process and measuring excluded.
    peak_memory_bytes
        Largest resident memory of the solving process; `idle_memory_bytes` is what it held before the solve.
    values
        By name of quantity; empty for a failed run that left nothing.
    energies
        Of each kept state of a non-linear case, in the order of its marks; a failed run may lack the last ones.
    series
        Quantities over time, or forces and torques along a path; a failed run has them as far as it came.
    fields_file
        npz beside the record: `xi` (n, n, 2), `position` (n, n, 3), `displacement` (n, n, 3), metres; of a
        non-linear case also `marks` (k,) and `displacements` (k, n, n, 3) of its kept states, in single precision,
        and in motion of frames all along the way. `membrane_energy_density` and `bending_energy_density` (n, n) of
        the last state, J/m2, in single precision. `probes` (m, 2) are material points that are the same in all runs
        of a case and lie on no regular grid, `probe_marks` (j,) marks (the last state's alone where the case is
        linear), `probe_displacements` (j, m, 3) in double precision, metres.
    solution_file
        The solution as its solver keeps it, beside the record.
    """

    schema_version: Literal[1] = 1
    run_id: str
    created: str
    identity: Identity
    case_name: str
    case: dict[str, Any]
    own_case: bool = False
    defaults: dict[str, Any] = Field(default_factory=dict)
    solver_label: str
    status: Status
    reason: str | None = None
    seconds: float
    peak_memory_bytes: int | None = None
    idle_memory_bytes: int | None = None
    parameters: int | None = None
    storage_bytes: int | None = None
    values: dict[str, Measured] = Field(default_factory=dict)
    diagnostics: dict[str, Any] = Field(default_factory=dict)
    history: tuple[HistoryStep, ...] = ()
    resolution: tuple[ResolutionStep, ...] = ()
    frame_rates: tuple[FrameRateStep, ...] = ()
    precision: tuple[PrecisionStep, ...] = ()
    energies: tuple[StateEnergies, ...] = ()
    series: tuple[Series, ...] = ()
    environment: Environment
    fields_file: str | None = None
    solution_file: str | None = None
