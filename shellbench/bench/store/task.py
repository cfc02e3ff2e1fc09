"""A task: one run to be made, as data for another process."""

from __future__ import annotations

import re
import secrets
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pydantic import Field

from shellbench.bench.store.record import Environment, Identity, Record, shortened
from shellbench.problem import Problem
from shellbench.protocol.schema import Model

TASK = "task.json"


class Task(Model):
    """One run to be made.

    Attributes
    ----------
    target
        Place of the solver, ``module:attribute``.
    case
        The case as it was read; its kind of problem rebuilds it.
    settings
        All settings of the solver, seed and device included.
    defaults
        See `shellbench.bench.store.record.Record`.
    start
        File of the earlier solution that it continues; None for none. The identity has its name among the settings.
    """

    run_id: str
    created: str
    identity: Identity
    target: str
    case_name: str
    case: dict[str, Any]
    own_case: bool
    settings: dict[str, Any]
    defaults: dict[str, Any] = Field(default_factory=dict)
    solver_label: str
    exam: int | None = None
    start: str | None = None
    environment: Environment

    def record(self, reason: str | None = None, **result: Any) -> Record:
        """Return the record of this task with its result."""
        return Record(
            reason=None if reason is None else shortened(reason),
            run_id=self.run_id,
            created=self.created,
            identity=self.identity,
            case_name=self.case_name,
            case=self.case,
            own_case=self.own_case,
            defaults=self.defaults,
            solver_label=self.solver_label,
            exam=self.exam,
            environment=self.environment,
            **result,
        )

    def write(self, folder: Path) -> None:
        """Write the task into its folder."""
        (folder / TASK).write_text(self.model_dump_json(), encoding="utf-8")

    @classmethod
    def read(cls, folder: Path) -> Task:
        """Read the task of a folder."""
        return cls.model_validate_json((folder / TASK).read_bytes())


def case_data(case: Problem) -> dict[str, Any]:
    """Return a case as JSON data from which `shellbench.bench.plugins.kinds.problem_of` rebuilds it."""
    return case.data()


def new_run_id(case: str, solver: str, seed: int | None) -> tuple[str, str]:
    """Return a unique name for a new run, and the time in it."""
    now = datetime.now(UTC)
    safe = re.sub(r"[^A-Za-z0-9_-]+", "_", solver)
    seeded = "" if seed is None else f"-s{seed}"
    run_id = f"{case}-{safe}{seeded}-{now:%Y%m%dT%H%M%S}-{secrets.token_hex(4)}"
    return run_id, now.isoformat(timespec="milliseconds")
