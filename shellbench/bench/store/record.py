"""Records: one immutable JSON file for one run, with its arrays beside it.

A record in a store carries a sequence number and a seal, the SHA-256 of its content. Reading
detects later changes. Records of old versions have neither: their changes can't be detected, and they are not valid.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from datetime import UTC, datetime
from functools import lru_cache
from typing import Annotated, Any, Final, Literal, Self

from pydantic import AfterValidator, Field, ValidationError, model_validator
from pydantic_core import from_json, to_json

from shellbench.bench.plugins.kinds import kind_of
from shellbench.errors import InputError
from shellbench.problem import Problem
from shellbench.protocol.history import (
    LARGEST_COUNT,
    Count,
    Figure,
    FrameRateStep,
    HistoryStep,
    PrecisionStep,
    ResolutionStep,
    Seconds,
    SelfIntersection,
    Series,
    StateEnergies,
)
from shellbench.protocol.picture import Portrait
from shellbench.protocol.schema import LARGEST, Model, one_sentence

SEAL = "seal"  # the key in the document of a record; no field of the record itself
STATED: Final = " (stated)"  # ends the name under which stated values are recorded
LONGEST_REASON = 4000  # characters
LARGEST_RECORD = 20_000_000  # bytes: an hour's motion with all its steps takes a few per cent of it
Status = Literal["ok", "not settled", "failed", "timeout"]
NOT_SETTLED: Final = "not settled"  # there is an answer, but its solver states that it still changes
ANSWERED = ("ok", NOT_SETTLED)
SAID_OF_CONVERGENCE = ("converged", "settled")  # names of the flag in the solvers' diagnostics
NOT_CONVERGED = "not_converged"  # the diagnostic that names the quantities that did not


def _is_time(text: str) -> str:
    try:
        datetime.fromisoformat(text).astimezone(UTC)
    except (ValueError, OverflowError, OSError):
        raise ValueError(f"found {text[:60]!r}, which is no time in ISO 8601") from None
    return text


def _has_figures(data: Any) -> Any:
    if not _all_figures(data):
        path, value = next((path, value) for path, value in leaves(data) if not _all_figures(value))
        found = f"found {str(value)[:60]} at '{'.'.join(map(str, path))}'"
        raise ValueError(f"{found}, but figures are finite and at most {LARGEST:g}")
    return data


def _all_figures(data: Any) -> bool:
    if isinstance(data, Mapping):
        return all(map(_all_figures, data.values()))
    if isinstance(data, list | tuple):
        return all(map(_all_figures, data))
    return not isinstance(data, int | float) or abs(data) <= LARGEST


def leaves(data: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[tuple[str | int, ...], Any]]:
    """Yield all values of JSON data that are neither objects nor lists, with the keys that lead to them."""
    if isinstance(data, Mapping | list | tuple):
        for key, value in data.items() if isinstance(data, Mapping) else enumerate(data):
            yield from leaves(value, (*path, key))
    else:
        yield path, data


Time = Annotated[str, AfterValidator(_is_time)]
Plain = Annotated[dict[str, Any], AfterValidator(_has_figures)]
FileName = Annotated[str, Field(pattern=r"^[^/\\]{1,255}$")]
Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class Identity(Model):
    """Identity of a run: an old record replaces a new run if all fields agree.

    Attributes
    ----------
    case
        SHA-256 of the case's physics.
    source
        SHA-256 of the solver's source, of all its imports from its own package, and of the code that measures it;
        for a plug-in also its package version.
    settings
        All settings, defaults included, except seed and device.
    seed
        None for a deterministic solver.
    """

    case: str
    solver: str
    source: str
    settings: Plain
    seed: int | None
    device: str
    dtype: str


class Measured(Model):
    """One quantity as measured: SI units, or the case's own.

    Attributes
    ----------
    uncertainty
        The solver's own estimate of its error, plus the error from the question's data; None if it states none.
    data_error
        Twice the change of the value with equivalent data, such as another fit of a mesh; None for exact data.
    """

    value: Figure
    uncertainty: Figure | None = None
    extrapolated: Figure | None = None
    data_error: Figure | None = None


class Environment(Model):
    """The environment of a run."""

    python: str
    versions: dict[str, str]
    platform: str
    processor: str
    cores: Count
    threads: Count
    gpu: str | None = None
    git_sha: str | None = None
    git_dirty: bool | None = None


class Stated(Model):
    """Origin of values that shellbench did not compute.

    Attributes
    ----------
    program, element, theory
        As the person says who states them; may be empty.
    files
        SHA-256 of the files that they come from, by name.
    cells, unknowns, seconds
        Of the finest mesh, if stated. No table ranks such seconds: nobody knows the machine.
    """

    program: str = ""
    element: str = ""
    theory: str = ""
    files: dict[str, Digest]
    cells: Count | None = None
    unknowns: Count | None = None
    seconds: Seconds | None = None

    @property
    def words(self) -> str:
        """The origin in one clause."""
        files = ", ".join(f"{name} (SHA-256 {digest[:8]})" for name, digest in self.files.items())
        what = ", ".join(filter(None, (self.program, self.element, self.theory)))
        took = f"; {self.seconds:g} s on a machine that nobody knows" if self.seconds is not None else ""
        return f"stated, not computed here: {f'{what}; ' if what else ''}from {files}{took}"


class Record(Model):
    """The record of one run, or of stated values.

    Attributes
    ----------
    run_id
        Name of the record's files in the store.
    created
        Time at which the run was planned, by the clock of its machine; `sequence` determines the newest record.
    sequence
        From 1, one more than the largest in its store when it was stored; None if no store has stored it.
    case
        The whole case as it was read, texts and tolerances included, so that a report needs nothing else.
    own_case
        True if the case is a user's own file, not one of the suite's.
    defaults
        The solver's default settings, without seed and device: valid as long as its source is the same.
    solver_label
        Description of the solver in one line.
    exam
        Version of the exam when the run was planned: of cases, known values and tolerances.
    seconds
        Wall time of the solve, without the start of the process and measuring.
    peak_memory_bytes
        Largest resident memory of the solving process; `idle_memory_bytes` is its memory before the solve.
    status, reason
        Status at the end of the run, and its reason unless it is "ok". A run that is "not settled" has all fields of a
        good one, and its solver's reason.
    values
        By name of quantity; empty for a failed run without results.
    declined
        Reasons, as clauses, by name of each quantity that the solver can't give for this case.
    energies
        Of each stored state of a non-linear case, in the order of its marks; a failed run may lack the last ones.
    series
        Quantities over time, or forces and torques along a path; for a failed run up to its last state.
    self_intersection
        One entry for a surface with finite displacement; empty for other results.
    fields_file
        npz beside the record: `xi` (n, n, 2), `position` (n, n, 3), `displacement` (n, n, 3), metres; for a
        non-linear case also `marks` (k,) and `displacements` (k, n, n, 3) of its stored states, in single precision,
        and in motion of frames at regular times. `membrane_energy_density` and `bending_energy_density` (n, n) of
        the last state, J/m2, in single precision. `probes` (m, 2) are material points that are the same in all runs
        of a case and lie on no regular grid, `probe_marks` (j,) marks (only the last state's for a linear case),
        `probe` (j, m, 3) in double precision, metres.
    solution_file
        The solution in its solver's own format, beside the record.
    checksums
        SHA-256 of these two files by name; none for older records.
    stated
        Origin of values that shellbench did not compute; None for a run. The solver's name then ends in `STATED`, and
        the identity's source is the checksum of their files.
    """

    schema_version: Literal[1] = 1
    run_id: str
    created: Time
    sequence: Annotated[int, Field(ge=1, le=LARGEST_COUNT)] | None = None
    identity: Identity
    case_name: str
    case: Plain
    own_case: bool = False
    defaults: Plain = Field(default_factory=dict)
    solver_label: str
    exam: Annotated[int, Field(ge=1, le=LARGEST_COUNT)] | None = None
    status: Status
    reason: Annotated[str, Field(max_length=LONGEST_REASON)] | None = None
    seconds: Seconds
    peak_memory_bytes: Count | None = None
    idle_memory_bytes: Count | None = None
    parameters: Count | None = None
    storage_bytes: Count | None = None
    values: dict[str, Measured] = Field(default_factory=dict)
    declined: dict[str, Annotated[str, Field(max_length=LONGEST_REASON)]] = Field(default_factory=dict)
    diagnostics: Plain = Field(default_factory=dict)
    history: tuple[HistoryStep, ...] = ()
    resolution: tuple[ResolutionStep, ...] = ()
    frame_rates: tuple[FrameRateStep, ...] = ()
    precision: tuple[PrecisionStep, ...] = ()
    self_intersection: tuple[SelfIntersection, ...] = ()
    energies: tuple[StateEnergies, ...] = ()
    series: tuple[Series, ...] = ()
    environment: Environment
    fields_file: FileName | None = None
    solution_file: FileName | None = None
    checksums: dict[str, Digest] = Field(default_factory=dict)
    stated: Stated | None = None

    @model_validator(mode="after")
    def _says_what_is_stated(self) -> Self:
        if (self.stated is not None) != self.identity.solver.endswith(STATED):
            raise ValueError(f"names of stated results, and only these, end in '{STATED}'")
        return self

    @property
    def order(self) -> tuple[int, float, str]:
        """Sort key of records, oldest first; the clock orders only older records without `sequence`."""
        return self.sequence or 0, datetime.fromisoformat(self.created).timestamp(), self.run_id

    def converged(self, quantity: str) -> bool | None:
        """Return True if the solver states that a quantity converged; None if it states nothing.

        Names of quantities that did not converge take precedence over flags for the whole answer.
        """
        named = self.diagnostics.get(NOT_CONVERGED)
        if named and isinstance(named, list | tuple):
            return quantity not in named
        said = [self.diagnostics[name] for name in SAID_OF_CONVERGENCE if name in self.diagnostics]
        return all(said) if said and all(isinstance(one, bool) for one in said) else None


def document(record: Record) -> bytes:
    """Return the JSON of a record, sealed if it has its number in a store."""
    data = json.loads(record.model_dump_json())
    if record.sequence is not None:
        data = sealed(data)
    return (json.dumps(data, indent=1, ensure_ascii=False) + "\n").encode()


def read_document(text: bytes) -> Record:
    """Read what `document` wrote.

    Raises
    ------
    InputError
        If it is no complete record, or was changed since it was sealed; as a clause without the name of the file.
    """
    if len(text) > LARGEST_RECORD:
        raise InputError(f"it has {len(text)} bytes, and a record has at most {LARGEST_RECORD}")
    try:
        data = from_json(text)
        seal = data.pop(SEAL, None) if isinstance(data, dict) else None
        record = Record.model_validate_json(to_json(data), strict=True)
        intact = seal == (None if record.sequence is None else _seal(data))
    except ValidationError as error:
        raise InputError(f"it is no whole record ({one_sentence(error)})") from None
    except RecursionError:
        raise InputError("it is no whole record (it is nested too deeply)") from None
    except ValueError as error:
        raise InputError(f"it is no whole record ({' '.join(str(error).split())})") from None
    if not intact:
        raise InputError("it is damaged: its content does not match its checksum")
    return record


def sealed(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return JSON data with their seal."""
    return {**data, SEAL: _seal(data)}


def _seal(data: Mapping[str, Any]) -> str:
    """Return the SHA-256 of JSON data, independent of layout and order of keys."""
    plain = json.dumps(data, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(plain.encode()).hexdigest()


def readable(record: Record) -> Record:
    """Return the record; if it could not be read back, the record without its results."""
    try:
        read_document(document(record))
    except (InputError, ValueError, RecursionError) as error:
        bare = {name: getattr(record, name) for name, field in Record.model_fields.items() if field.is_required()}
        why = record.reason or f"what the solver left can't be recorded: {' '.join(str(error).split())}"
        kept: dict[str, Any] = {"sequence": record.sequence, "own_case": record.own_case, "defaults": record.defaults}
        kept |= {"stated": record.stated}
        return Record(**bare | kept | {"status": "failed", "reason": shortened(why)})
    return record


def shortened(reason: str) -> str:
    """Return a reason for a record: of limited length, and without halves of characters."""
    whole = reason.encode(errors="replace").decode()
    return whole if len(whole) <= LONGEST_REASON else whole[: LONGEST_REASON - 3] + "..."


def portrait_of(record: Record) -> Portrait | None:
    """Return the portrait of the problem that a record answers; None if it can't be read any more."""
    try:
        kind = kind_of(record.case)
        return _portrait(kind.problem, kind.portrait, json.dumps(record.case))
    except (ValidationError, InputError):
        return None


@lru_cache(maxsize=256)  # a report asks hundreds of times for the few problems of its records
def _portrait(problem: type[Problem], portrait: Callable[[Problem], Portrait], data: str) -> Portrait:
    return portrait(problem.model_validate(json.loads(data)))
