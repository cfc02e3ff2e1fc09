"""Provenance: how each run was made, from what the record says."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from shellbench.bench.record import Environment, Record
from shellbench.bench.row import Row


@dataclass(frozen=True)
class Making:
    """How one run was made.

    Attributes
    ----------
    environment
        Number of its environment in the report, from 1.
    """

    record: Record
    command: str
    environment: int


def command(record: Record, overrides: Mapping[str, Any]) -> str:
    """Return the command that makes the run again, for a shell."""
    identity = record.identity
    words = ["shellbench", "run", f"{record.case_name}.toml" if record.own_case else record.case_name]
    words += ["--solver", identity.solver]
    if identity.seed is not None:
        words += ["--seed", str(identity.seed)]
    for key, value in _flat(overrides):
        words += ["--set", f"{identity.solver}.{key}={value if isinstance(value, str) else json.dumps(value)}"]
    if identity.device != "cpu":
        words += ["--device", identity.device]
    return shlex.join(words)


def _flat(settings: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    flat: list[tuple[str, Any]] = []
    for key, value in settings.items():
        flat += _flat(value, f"{prefix}{key}.") if isinstance(value, Mapping) else [(f"{prefix}{key}", value)]
    return flat


def makings(records: Mapping[str, Record], rows: Sequence[Row]) -> tuple[list[Making], list[Environment]]:
    """Return how each run of the rows was made, and the different environments."""
    environments: list[Environment] = []
    found: dict[str, Making] = {}
    for row in rows:
        record = records.get(row.run_id or "")
        if record is None or record.run_id in found:
            continue
        if record.environment not in environments:
            environments.append(record.environment)
        found[record.run_id] = Making(
            record=record,
            command=command(record, row.overrides),
            environment=environments.index(record.environment) + 1,
        )
    return list(found.values()), environments


def environment_words(environment: Environment) -> str:
    """Say where runs were made in one line."""
    versions = ", ".join(f"{name} {version}" for name, version in sorted(environment.versions.items()))
    commit = f"commit {environment.git_sha[:12]}" if environment.git_sha else "commit unknown"
    state = " with uncommitted changes" if environment.git_dirty else ""
    parts = (
        environment.processor,
        f"{environment.cores} cores, {environment.threads} thread{'s' if environment.threads != 1 else ''} a solve",
        environment.gpu,
        environment.platform,
        f"Python {environment.python}",
        versions,
        commit + state,
    )
    return "; ".join(part for part in parts if part)
