"""One exam in a process of its own: cases are solved, recorded and judged like a third-party solver's until a row is red.

This module does not import shellbench before a mutant is in place.
"""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import chain
from multiprocessing.connection import Connection
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

from tools.mutation.draw import Mutant
from tools.mutation.loader import plant
from tools.mutation.targets import ROOT

MOST_MEMORY = 12 * 2**30  # bytes that an exam may ask for: a mutant can want any number
VALUE, FAILED, DECLINED, CRASH, TIME = "value", "failed run", "declined", "crash", "time limit"  # why a row is red
CONFIDENT = "calibration"  # why a figure is that is within its tolerance: its error is many times what is stated
UNCHANGED = "0" * 64  # stands for the digest of the source
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Question:
    """A case for a solver."""

    solver: str
    case: str


@dataclass(frozen=True)
class Answered:
    """Result of a question.

    Attributes
    ----------
    red
        The first red row in words; empty if all are green.
    seconds
        Processor time of the solve and its judging; the load of the machine does not count.
    reached
        Lines that ran, by module, if they were requested.
    """

    question: Question
    red: str
    seconds: float
    reached: dict[str, list[int]] = field(default_factory=dict)


def examine(mutant: Mutant | None, questions: Sequence[Question], modules: Sequence[str], answers: Connection) -> None:
    """Solve questions until one is red, and send the result of each.

    Parameters
    ----------
    mutant
        The mutant; None for the unchanged code.
    modules
        Modules whose lines are to be noted; none for no lines.
    """
    _prepare()
    if mutant is not None:
        plant(mutant)
    for question in questions:
        start = time.process_time()
        with _noted(modules) as lines:
            try:
                import shellbench.bench.judge.gate
                import shellbench.problems.shell.kind  # noqa: F401

                start = time.process_time()
                red = first_red(question)
            except BaseException as error:  # whatever a mutant does is about the mutant, an exit too
                red = f"{CRASH}: {type(error).__name__}: {error}"
        reached = {module: sorted(rows) for module, rows in lines.items()}
        words = " ".join(red.replace(f"{ROOT}/", "").split())[:200]
        answers.send(Answered(question, words, time.process_time() - start, reached))
        if red:
            break
    answers.close()


def first_red(question: Question) -> str:
    """Return the first red row of the accuracy gate, or else of calibration, in words; empty if all are green.

    The lock is left out: it detects changed questions independently of the solver's answers, and would test nothing.
    """
    from shellbench.bench.judge import gate as gates
    from shellbench.bench.judge.expected import Scope
    from shellbench.bench.judge.lock import LockCheck
    from shellbench.bench.run.plan import Request, make_plan
    from shellbench.bench.run.worker import run
    from shellbench.bench.store.store import Store

    _look_at_nothing_else(question)
    gates.check_lock = lambda suites: LockCheck(0, 0)
    with tempfile.TemporaryDirectory() as folder:
        store = Store(Path(folder))
        plan = make_plan(Request((question.case,), (), (question.solver,), {}, (0,)), store.read())
        if not plan.tasks:
            return f"{DECLINED}: {plan.declined[0].reason}" if plan.declined else f"{CRASH}: nothing was planned"
        for task in plan.tasks:
            store.commit(place := store.begin(task.run_id), run(task, place, lambda _: None))
        verdict = gates.gate(store, None, Scope((), (question.solver,), (0,)))
    return first_mistake(verdict, question.case)


def first_mistake(verdict: Any, case: str) -> str:
    """Return the reason why a verdict on a case is red: a value, a run, or a value whose stated uncertainty is too small."""
    judged = [finding for finding in verdict.accuracy if finding.row.case == case]
    if not judged:
        return f"{FAILED}: no row is judged"
    accuracy = (_told(finding) for finding in judged if finds_a_mistake(finding))
    calibration = (
        f"{CONFIDENT}: {finding.row.quantity}: {finding.sentence}"
        for finding in verdict.calibration
        if finding.colour == "red"
    )
    return next(chain(accuracy, calibration), "")


def finds_a_mistake(finding: Any) -> bool:
    """Return True if a finding is red and its answer fails; an answer that passes unexpectedly is no mistake."""
    better = finding.row.open_finding is not None and finding.row.why_short(finding.row.tolerance) is None
    return bool(finding.colour == "red" and not better)


def _told(finding: Any) -> str:
    """Describe the wrong value or the failed run, with the reason."""
    return f"{VALUE if finding.row.status == 'ok' else FAILED}: {finding.row.quantity}: {finding.sentence}"


def _look_at_nothing_else(question: Question) -> None:
    """Read only the requested case, and digest no source: no file changes during an exam."""
    from shellbench.bench.catalogue import catalog
    from shellbench.bench.judge import classes, gate
    from shellbench.bench.plugins import registry
    from shellbench.bench.run import worker
    from shellbench.bench.store import current, identity

    for module in (identity, current, worker):
        module.current_source = lambda *_: UNCHANGED
    if not hasattr(registry.solver_entries, "cache_clear"):
        kept = cache(registry.solver_entries)
        for module in (registry, classes, current, gate):
            module.solver_entries = kept
    asked = catalog.named_case(question.case.partition("@")[0])
    catalog.members = lambda suite: [asked] if suite in asked.suites else []
    catalog.variants_asked.cache_clear()


def _prepare() -> None:
    """Suppress output, use one thread, and change to the root of the tree."""
    for variable in ONE_THREAD:
        os.environ[variable] = "1"
    os.chdir(ROOT)
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))


@contextlib.contextmanager
def _noted(modules: Sequence[str]) -> Iterator[dict[str, set[int]]]:
    """Record the lines of modules that run."""
    lines: dict[str, set[int]] = {module: set() for module in modules}
    if not modules:
        yield lines
        return
    files = {str(ROOT.joinpath(*module.split("."))) + ".py": rows for module, rows in lines.items()}
    missing: dict[
        CodeType, set[int]
    ] = {}  # lines of a function that have not run: one that has run wholly is left alone

    def ran(frame: FrameType, event: str, _: Any) -> Any:
        files[frame.f_code.co_filename].add(frame.f_lineno)
        missing[frame.f_code].discard(frame.f_lineno)
        return ran

    def called(frame: FrameType, event: str, _: Any) -> Any:
        code = frame.f_code
        if code.co_filename not in files:
            return None
        if code not in missing:
            missing[code] = {line for _, _, line in code.co_lines() if line is not None} - {code.co_firstlineno}
        return ran if missing[code] else None

    sys.settrace(called)
    threading.settrace(called)
    try:
        yield lines
    finally:
        sys.settrace(None)
        threading.settrace(None)  # type: ignore[arg-type]
