"""Identity of runs, including their settings.

The identity of a planned run needs the solver's class for its settings, and is made where the solver is imported
anyway. The validity of a *stored* record needs only the digest of the source: a record contains the solver's default
settings, which are the present defaults as long as the source is the same. Tables and gates therefore import no solver.
"""

from __future__ import annotations

from pydantic import ValidationError

from shellbench.bench.plugins.kinds import DEFAULT, module_of
from shellbench.bench.plugins.registry import SolverEntry
from shellbench.bench.plugins.settings import dump_settings
from shellbench.bench.plugins.source import source_digest
from shellbench.bench.store.record import Identity
from shellbench.errors import InputError
from shellbench.problem import Problem, SeededSettings, Settings
from shellbench.protocol.schema import one_sentence

MEASURING = "shellbench.bench.run.worker"  # the code that measures a solution counts as its source
GATED_DTYPE = "float64"


def current_source(entry: SolverEntry, kind: str = DEFAULT) -> str:
    """Return the digest of the solver's source, of its kind of problem, and of the code that measures it.

    For a plug-in the digest includes the version, for a command the fingerprint of its program.
    """
    return source_digest([entry.module, module_of(kind), MEASURING], *entry.version_of_code)


def make_identity(case: Problem, entry: SolverEntry, settings: Settings) -> Identity:
    """Return the identity of a run.

    Raises
    ------
    InputError
        If a setting is a number that no record can keep.
    """
    dtype = str(getattr(settings, "dtype", GATED_DTYPE)).removeprefix("torch.")
    seed, device = (settings.seed, settings.device) if isinstance(settings, SeededSettings) else (None, "cpu")
    try:
        return Identity(
            case=case.digest(),
            solver=entry.name,
            source=current_source(entry, case.kind),
            settings=dump_settings(settings),
            seed=seed,
            device=device,
            dtype=dtype,
        )
    except ValidationError as error:  # such as a setting that is not finite, which no record can keep
        raise InputError(f"settings of solver '{entry.name}': {one_sentence(error)}") from None
