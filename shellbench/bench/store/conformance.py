"""Conformance: results of the checks that a solver must pass to get a class.

Known values judge only a few numbers. A solver that looks them up passes without a field. `shellbench check-solver`
therefore checks properties that a list of values can't have: that a field is continuous, that its energies are those of
its strains, and that it follows the load and the placement. The results are kept in the store, in one sealed file for
each solver and kind of problem. They are valid for runs of the checked source only.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from shellbench.bench.plugins.kinds import kind_name
from shellbench.bench.plugins.registry import SolverEntry
from shellbench.bench.store.identity import current_source
from shellbench.bench.store.record import SEAL, Digest, Record, sealed
from shellbench.bench.store.store import Store
from shellbench.disk import said_plainly
from shellbench.protocol.schema import Model

FOLDER = ".conformance"
LARGEST_FILE = 1_000_000  # bytes
NOT_ASKED = "no checks are known of it"


class Conformance(Model):
    """Findings of the checks of a solver.

    Attributes
    ----------
    kind
        Kind of the checked problems.
    source
        SHA-256 as in the identity of its runs.
    checks
        By check: its result on each case, such as "passed".
    lacking
        Reasons why it gets no class, one clause each; empty if it has passed all required checks.
    """

    solver: str
    kind: str
    source: Digest
    checks: dict[str, tuple[str, ...]]
    lacking: tuple[str, ...]


@dataclass(frozen=True)
class Noted:
    """Findings of conformance that a store holds.

    Attributes
    ----------
    found
        One for each solver and kind.
    damaged
        One sentence for each file that is invalid, or was changed since it was written.
    """

    found: tuple[Conformance, ...] = ()
    damaged: tuple[str, ...] = ()


def note_conformance(
    store: Store, entry: SolverEntry, kind: str, checks: Mapping[str, tuple[str, ...]], lacking: tuple[str, ...]
) -> None:
    """Store the results of the checks for the present source of a solver, in place of earlier results.

    Raises
    ------
    StoreError
        If the store can't be written.
    """
    source = current_source(entry, kind)
    one = Conformance(solver=entry.name, kind=kind, source=source, checks=dict(checks), lacking=lacking)
    folder = store.folder / FOLDER
    # Names may have any characters and any case: their digest has neither.
    path = folder / f"{hashlib.sha256(json.dumps([entry.name, kind]).encode()).hexdigest()[:16]}.json"
    with said_plainly(store.folder):
        folder.mkdir(parents=True, exist_ok=True)
        partial = path.with_suffix(".partial")
        partial.write_text(json.dumps(sealed(one.model_dump(mode="json")), indent=1) + "\n", encoding="utf-8")
        partial.replace(path)


def read_conformance(store: Store) -> Noted:
    """Return all results of conformance checks in a store, and one sentence for each damaged file."""
    found: list[Conformance] = []
    damaged: list[str] = []
    for path in sorted((store.folder / FOLDER).glob("*.json")):
        try:
            if not path.is_file() or path.stat().st_size > LARGEST_FILE:
                raise OSError
            found.append(_read(json.loads(path.read_bytes())))
        except (OSError, TypeError, ValueError, RecursionError):
            damaged.append(f"{path}: is left out, for it is no whole result of checks; `check-solver` makes it anew")
    return Noted(tuple(found), tuple(damaged))


def _read(data: Any) -> Conformance:
    """Return the content of sealed data; ValueError if they are damaged."""
    content = {key: value for key, value in dict(data).items() if key != SEAL}
    if sealed(content) != data:
        raise ValueError("its content is not that of which its checksum was taken")
    return Conformance.model_validate_json(json.dumps(content), strict=True)


def why_unchecked(solver: str, runs: Iterable[Record], noted: Iterable[Conformance]) -> str:
    """Return the reason why the source of a solver's runs is not checked, as a clause; empty if it is checked."""
    known = {(one.kind, one.source): one for one in noted if one.solver == solver}
    for kind, source in sorted({(kind_name(run.case), run.identity.source) for run in runs}):
        one = known.get((kind, source))
        if one is None:
            earlier = any(name == kind for name, _ in known)
            return "its source has changed since it was checked" if earlier else NOT_ASKED
        if one.lacking:
            return one.lacking[0]
    return ""
