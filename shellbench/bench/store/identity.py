"""Identity: what makes two runs the same, and which settings a run has.

The identity of a planned run needs the solver's class (for its settings), so it is made where the solver is
imported anyway. Whether a *stored* record is current needs only the digest of the source: a record keeps the
solver's default settings, and as long as the source is the same they are the defaults. So tables and gates
import no solver.
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

MEASURING = "shellbench.bench.run.worker"  # what measures a solution counts as its source
GATED_DTYPE = "float64"


def current_source(entry: SolverEntry, kind: str = DEFAULT) -> str:
    """Return the digest of the solver's source, of its kind of problem, and of what measures it.

    Of a plug-in the version counts too.
    """
    version = () if entry.own else (f"{entry.distribution} {entry.version}",)
    return source_digest([entry.module, module_of(kind), MEASURING], *version)


def make_identity(case: Problem, entry: SolverEntry, settings: Settings) -> Identity:
    """Return the identity of a run.

    Raises
    ------
    InputError
        If a setting is a figure that no record can keep.
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
