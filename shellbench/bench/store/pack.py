"""Packs: one file with a solver's records, for a board.

A pack is a zip of JSON. `pack.json` has the name of the solver, the command to install it, and the SHA-256 of each
record; its own checksum covers all its other fields. Reading detects later changes, and values that are in no record. A
checksum is no signature: only a new measurement detects a deliberate forgery of all checksums.
"""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from shellbench import __version__
from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.registry import SolverEntry, find_solver, given_as, solver_entries
from shellbench.bench.store.conformance import Conformance, read_conformance, why_unchecked
from shellbench.bench.store.current import CurrentRun, current_runs, overrides_of
from shellbench.bench.store.record import LARGEST_RECORD, STATED, Digest, Plain, Record, Time, document, read_document
from shellbench.bench.store.store import Store
from shellbench.errors import InputError
from shellbench.files import check_file
from shellbench.protocol.schema import Model, one_sentence

MANIFEST, FOLDER, SUFFIX = "pack.json", "records/", ".zip"
MOST_RUNS = 20_000
LARGEST_PACK = 1_000_000_000  # bytes of all records together, unpacked
WRITTEN_AT = (2000, 1, 1, 0, 0, 0)  # of each member, so that equal records make equal packs

Words = Annotated[str, Field(max_length=500, pattern=r"^[^\n\r]*$")]
Line = Annotated[Words, Field(min_length=1)]


class Setting(Model):
    """Settings that differ from the solver's defaults, and the number of runs with them."""

    overrides: Plain
    runs: int


class Manifest(Model):
    """The manifest of a pack.

    Attributes
    ----------
    solver, label
        Name of the solver, and a description in one line.
    distribution, version
        The package that provides the solver, or the name of the file that describes it.
    install
        A command that installs it; empty if not stated.
    shellbench
        Version of shellbench that made the pack.
    made
        Time at which the pack was made.
    defaults, settings
        The solver's default settings; the settings of runs that differ from them.
    versions
        Versions of all packages that the records name.
    commits
        Commits that the records name.
    runs
        SHA-256 of each record by its name.
    conformance
        Results of the checks for the source of the runs; none if it was not checked.
    checksum
        SHA-256 of all other fields.
    """

    format: Literal[1] = 1
    solver: Line
    label: Line
    distribution: Line
    version: Line
    install: Words
    shellbench: Line
    made: Time
    defaults: Plain
    settings: tuple[Setting, ...]
    versions: dict[str, tuple[str, ...]]
    commits: tuple[str, ...]
    runs: Annotated[dict[str, Digest], Field(min_length=1, max_length=MOST_RUNS)]
    conformance: tuple[Conformance, ...] = ()
    checksum: Digest


@dataclass(frozen=True)
class Pack:
    """A pack that was read and is unchanged."""

    path: Path
    manifest: Manifest
    records: tuple[Record, ...]

    @property
    def unchecked(self) -> str:
        """Reason why its solver is not checked, as a clause; empty if it is checked."""
        return why_unchecked(self.manifest.solver, self.records, self.manifest.conformance)


def write_pack(
    store: Store, solver: str, out: Path, suites: Sequence[str] = (), install: str = ""
) -> tuple[Manifest, tuple[str, ...]]:
    """Write a solver's valid records of the suite's own cases.

    Parameters
    ----------
    store
        Where the records are.
    suites
        Only runs that these suites declare; all if none is named.
    install
        A command that installs the solver. If empty: that of the Git address that the installer recorded, if any.

    Returns
    -------
    Manifest, notes
        The manifest of the pack, and a sentence for each omission.

    Raises
    ------
    InputError
        If there is nothing to pack, or the file can't be written.
    """
    entry = entry_of(store, solver)
    solver = entry.name
    for name in suites:
        catalog.find_suite(name)
    contents = store.read()
    records = tuple(record for record in contents.records if record.identity.solver == solver)
    found = current_runs(replace(contents, records=records))
    runs = [run for run in found.runs if not suites or set(suites) & set(run.declared_by)]
    kept, notes = [run for run in runs if _can_be_sent(run)], list(found.notes)
    if len(kept) < len(runs):
        notes.append(f"left out: {len(runs) - len(kept)} runs of own cases")
    if not kept:
        why = f" ({notes[0]})" if notes else ""
        raise InputError(f"store {store.folder}: holds no runs of solver '{solver}' that can be packed{why}")
    packed = {run.record.run_id: document(run.record) for run in kept}
    sent, noted = [run.record for run in kept], read_conformance(store)
    sources = {record.identity.source for record in sent}
    checked = [one for one in noted.found if one.solver == solver and one.source in sources]
    notes += noted.damaged
    if (why := why_unchecked(solver, sent, checked)) and sent[0].stated is None:
        notes.append(f"not checked: {why} (`shellbench check-solver {given_as(solver)}` makes the checks)")
    manifest = _manifest(entry, sent, packed, install or _install(entry), checked)
    try:
        with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
            _add(archive, MANIFEST, _as_json(manifest.model_dump(mode="json")))
            for name, data in sorted(packed.items()):
                _add(archive, f"{FOLDER}{name}.json", data)
    except OSError as error:
        raise InputError(f"{out}: the pack can't be written ({error.strerror})") from None
    return manifest, tuple(notes)


def entry_of(store: Store, name: str) -> SolverEntry:
    """Return the solver of this name, or the stated results of a store, whose version is their program."""
    stated = [record.stated for record in store.read().records if record.identity.solver in (name, f"{name}{STATED}")]
    if name in solver_entries() or not stated or stated[-1] is None:
        return find_solver(name)
    return SolverEntry(f"{name.removesuffix(STATED)}{STATED}", "", "stated", stated[-1].program or "unknown program")


def _can_be_sent(run: CurrentRun) -> bool:
    return (run.installed or run.record.stated is not None) and not run.record.own_case


def _add(archive: zipfile.ZipFile, name: str, data: bytes) -> None:
    about = zipfile.ZipInfo(name, WRITTEN_AT)
    about.compress_type, about.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
    archive.writestr(about, data)


def _manifest(
    entry: SolverEntry,
    records: Sequence[Record],
    packed: Mapping[str, bytes],
    install: str,
    checked: Sequence[Conformance],
) -> Manifest:
    data = {
        "format": 1,
        "solver": entry.name,
        "distribution": entry.distribution or (entry.file.name if entry.file else ""),
        "version": entry.version,
        "install": install,
        "shellbench": __version__,
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "runs": {name: hashlib.sha256(text).hexdigest() for name, text in sorted(packed.items())},
        "conformance": [one.model_dump(mode="json") for one in checked],
        **_summary(records),
    }
    return Manifest.model_validate_json(json.dumps(data | {"checksum": _checksum(data)}))


def _summary(records: Sequence[Record]) -> dict[str, Any]:
    """Return the fields of a manifest that follow from its records."""
    newest = max(records, key=lambda record: record.order)
    counted: dict[str, int] = {}
    versions: dict[str, set[str]] = {}
    for record in records:
        text = json.dumps(overrides_of(record), sort_keys=True)
        counted[text] = counted.get(text, 0) + 1
        for package, version in record.environment.versions.items():
            versions.setdefault(package, set()).add(version)
    return {
        "label": newest.solver_label,
        "defaults": newest.defaults,
        "settings": [{"overrides": json.loads(text), "runs": count} for text, count in sorted(counted.items())],
        "versions": {package: sorted(found) for package, found in sorted(versions.items())},
        "commits": sorted({sha for record in records if (sha := record.environment.git_sha)}),
    }


def _install(entry: SolverEntry) -> str:
    """Return the command that installs a solver's package from the repository that it came from; empty if unknown."""
    try:
        came_from = json.loads(distribution(entry.distribution).read_text("direct_url.json") or "{}")
    except (PackageNotFoundError, ValueError):
        return ""
    vcs = came_from.get("vcs_info", {})
    if not vcs or "@" in came_from["url"]:  # an address with a user's name, and maybe a password, is not published
        return ""
    return f'python -m pip install "{entry.distribution} @ {vcs["vcs"]}+{came_from["url"]}@{vcs["commit_id"]}"'


def read_pack(path: Path) -> Pack:
    """Read a pack, and check that it is unchanged.

    Raises
    ------
    InputError
        In one sentence, if it is no pack, or if its content was changed, added or removed.
    """
    # 1. The zip has a manifest and one member for each run that it names; nothing else.
    # 2. The manifest has the checksum of its own content, each record that of the manifest and that of itself.
    # 3. Each record is the solver's, of one of the suite's cases, and sealed by the store that made it.
    # 4. The manifest's fields about the records agree with them.
    try:
        check_file(path, LARGEST_PACK)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    try:
        with zipfile.ZipFile(path) as archive:
            return _read(path, archive)
    except (zipfile.BadZipFile, zipfile.LargeZipFile, NotImplementedError, RuntimeError, EOFError) as error:
        raise InputError(f"{path}: is no pack: it can't be unpacked ({' '.join(str(error).split())})") from None
    except OSError as error:
        raise InputError(f"{path}: can't be read ({error.strerror or error})") from None


def _read(path: Path, archive: zipfile.ZipFile) -> Pack:
    members = archive.infolist()
    names = [member.filename for member in members]
    if MANIFEST not in names:
        raise InputError(f"{path}: is no pack: it has no {MANIFEST}")
    if len(members) > MOST_RUNS + 1 or sum(member.file_size for member in members) > LARGEST_PACK:
        raise InputError(f"{path}: is no pack: it is larger than {MOST_RUNS} runs or {LARGEST_PACK} bytes")
    try:
        text = _bytes(archive, MANIFEST, path)
        data = json.loads(text)
        manifest = Manifest.model_validate_json(text, strict=True)
    except ValidationError as error:
        raise InputError(f"{path}: is no pack: {MANIFEST}: {one_sentence(error)}") from None
    except (ValueError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: is no pack: {MANIFEST} is no JSON ({' '.join(str(error).split())})") from None
    if _checksum({key: value for key, value in data.items() if key != "checksum"}) != manifest.checksum:
        raise InputError(f"{path}: was changed: {MANIFEST} does not match its checksum")
    if sorted(names) != sorted([MANIFEST, *(f"{FOLDER}{name}.json" for name in manifest.runs)]):
        raise InputError(f"{path}: was changed: its files are not those that {MANIFEST} names")
    records = tuple(_record(path, archive, name, manifest) for name in manifest.runs)
    said = manifest.model_dump(mode="json")
    for name, value in json.loads(json.dumps(_summary(records))).items():
        if said[name] != value:
            raise InputError(f"{path}: was changed: '{name}' of {MANIFEST} is not what its records say")
    return Pack(path, manifest, records)


def _record(path: Path, archive: zipfile.ZipFile, name: str, manifest: Manifest) -> Record:
    data = _bytes(archive, f"{FOLDER}{name}.json", path)
    if hashlib.sha256(data).hexdigest() != manifest.runs[name]:
        raise InputError(f"{path}: was changed: record {name} does not match its checksum")
    try:
        record = read_document(data)
    except InputError as error:
        raise InputError(f"{path}: record {name} is refused, for {error}") from None
    identity = record.identity
    wrong = {
        "it is another run's": record.run_id != name,
        f"it is of solver '{identity.solver}'": identity.solver != manifest.solver,
        "no store has sealed it": record.sequence is None,
        "its case is none of the suite's": record.own_case or not catalog.has_case(record.case_name),
    }
    for why, true in wrong.items():
        if true:
            raise InputError(f"{path}: record {name} is refused, for {why}")
    return record


def _bytes(archive: zipfile.ZipFile, name: str, path: Path) -> bytes:
    with archive.open(name) as member:
        data = member.read(LARGEST_RECORD + 1)
    if len(data) > LARGEST_RECORD:
        raise InputError(f"{path}: is no pack: {name} has more than {LARGEST_RECORD} bytes")
    return data


def _checksum(data: Mapping[str, Any]) -> str:
    return hashlib.sha256(_as_json(data)).hexdigest()


def _as_json(data: Mapping[str, Any]) -> bytes:
    return (json.dumps(data, indent=1, sort_keys=True, ensure_ascii=False, allow_nan=False) + "\n").encode()
