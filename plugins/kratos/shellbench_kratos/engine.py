"""Kratos Multiphysics as an engine: imported without its banner, and without later output.

Kratos writes to the process's standard output from C++, not through `sys.stdout`: a banner at import, and a message
about each application at exit. A solver's output belongs to its user. The descriptor itself is therefore redirected
while Kratos is imported, and the logger's severity suppresses later output, including warnings. A solver reports by
its diagnostics, or by a `SolveFailure`.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from shellbench.errors import SolveFailure
from shellbench.problem import Solution
from shellbench.problems.shell.records.history import failing_with
from shellbench_kratos.settings import APPLICATIONS, DISTRIBUTION

BELOW_WARNINGS = -1  # of Kratos' severities, of which a warning is the gravest and has number 0
STDOUT = 1  # its descriptor, whatever sys.stdout is


@contextmanager
def _silent_descriptor() -> Iterator[None]:
    """Discard output to the standard output's descriptor."""
    sys.stdout.flush()
    try:
        kept = os.dup(STDOUT)
    except OSError:  # closed: nothing can be written to it
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, STDOUT)
        yield
    finally:
        os.dup2(kept, STDOUT)
        os.close(nowhere)
        os.close(kept)


def _imported() -> tuple[ModuleType, ...]:
    """Import Kratos and its applications without output."""
    with _silent_descriptor():
        core = importlib.import_module(DISTRIBUTION)
        core.Logger.GetDefaultOutput().SetSeverity(core.Logger.Severity(BELOW_WARNINGS))
        return (core, *(importlib.import_module(f"{DISTRIBUTION}.{name}") for name in APPLICATIONS))


_modules: tuple[Any, ...] = _imported()
kratos, structural, iga, linear_solvers = _modules
"""The modules of Kratos, which have no types: its core, and its applications in the order of `APPLICATIONS`."""


@contextmanager
def failing_with_kratos(partial: Callable[[], Solution | None], too_large: str) -> Iterator[None]:
    """Attach the solution so far to a failure, including failures of Kratos (see `history.failing_with`)."""
    with failing_with(partial, too_large):
        try:
            yield
        except RuntimeError as error:  # of Kratos: a sentence, and where in its source
            sentence = (str(error).strip() or "an error without words").splitlines()[0]
            raise SolveFailure(f"Kratos stopped: {sentence}") from None


@dataclass(frozen=True)
class FreshModel:
    """A model of Kratos with one model part; the part lives as long as its model.

    Attributes
    ----------
    model, part
        Kratos' `Model` and `ModelPart`.
    """

    model: Any
    part: Any


def fresh_model(*variables: Any) -> FreshModel:
    """Return a model with one empty model part in three dimensions, whose nodes carry historical variables.

    Kratos uses the present value of OMP_NUM_THREADS, not that at its import.
    """
    threads = os.environ.get("OMP_NUM_THREADS", "").split(",")[0]
    if threads.isdigit() and int(threads) > 0:
        kratos.ParallelUtilities.SetNumThreads(int(threads))
    model = kratos.Model()
    part = model.CreateModelPart("shell")
    part.ProcessInfo[kratos.DOMAIN_SIZE] = 3
    for variable in variables:
        part.AddNodalSolutionStepVariable(variable)
    return FreshModel(model, part)
