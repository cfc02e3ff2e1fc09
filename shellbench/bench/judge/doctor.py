"""Checks of a machine: versions, threads, memory, disk, a GPU, and the result of one small solve."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Literal

import psutil
import threadpoolctl

from shellbench import __version__
from shellbench.bench.catalogue.listing import list_solver
from shellbench.bench.judge.compare import rows
from shellbench.bench.plugins.process import THREAD_LIMITS
from shellbench.bench.plugins.registry import solver_entries
from shellbench.bench.run.display import Silent
from shellbench.bench.run.execute import execute
from shellbench.bench.run.local import LocalProcesses
from shellbench.bench.run.plan import Request, make_plan
from shellbench.bench.store import environment
from shellbench.bench.store.store import Store
from shellbench.errors import ShellbenchError

State = Literal["ok", "note", "BAD"]
PACKAGES = ("numpy", "scipy", "scikit-fem", "torch", "pandas", "pydantic")
OPTIONAL = {"pypardiso": "fast", "numba": "compiled", "pyvista": "vtk"}  # with their extras
GIGABYTE = 1e9
MEMORY = 2 * GIGABYTE  # a training of the course takes 1.6 GB
DISK, LEAST_DISK = 2 * GIGABYTE, 0.05 * GIGABYTE  # a suite's records, and one record with its fields
PATIENCE = 120.0  # limits in seconds: for the solve, and for PyTorch to find a GPU
SEES_GPU = "import torch; print(torch.cuda.is_available())"


@dataclass(frozen=True)
class Line:
    """Result of one check."""

    about: str
    state: State
    words: str

    def __str__(self) -> str:
        return f"{self.state:<4}  {self.about}: {self.words}"


def examine(store: Store, case: str, solver: str) -> Iterator[Line]:
    """Yield the results of the checks, fast ones first; the last check is a solve of the case by the solver."""
    yield Line(
        "shellbench", "ok", f"{__version__}, Python {platform.python_version()}, {platform.platform(terse=True)}"
    )
    yield _packages()
    yield from _computing()
    yield _memory()
    yield _disk(store.folder)
    yield _store(store)
    yield _solvers()
    yield _solve(case, solver)


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _packages() -> Line:
    found = {name: _version(name) for name in (*PACKAGES, *OPTIONAL)}
    missing = [name for name in PACKAGES if found[name] is None]
    if missing:
        return Line("packages", "BAD", f"{', '.join(missing)} not installed: python -m pip install shellbench")
    listed = ", ".join(f"{name} {said}" for name, said in found.items() if said)
    absent = ", ".join(f"{name} (extra {extra})" for name, extra in OPTIONAL.items() if not found[name])
    return Line("packages", "ok", listed + (f"; not installed, and not needed: {absent}" if absent else ""))


def _computing() -> Iterator[Line]:
    limits = ", ".join(f"{name}={os.environ[name]}" for name in THREAD_LIMITS if name in os.environ)
    words = f"{environment.cores()} cores, {environment.threads()} threads a run"
    yield Line("threads", "ok", f"{words}{f' ({limits} outside of runs)' if limits else ''}")
    blas = [pool for pool in threadpoolctl.threadpool_info() if pool.get("user_api") == "blas"]
    named = [f"{pool['internal_api']} {pool.get('version') or '?'}, {pool.get('architecture', '?')}" for pool in blas]
    yield Line("BLAS", "ok" if named else "note", "; ".join(dict.fromkeys(named)) or "not known")
    gpu = environment.gpu()
    if gpu is None:
        yield Line("GPU", "ok", "none, and none is needed")
    else:
        sees = _torch_sees_gpu()
        yield Line("GPU", "ok" if sees else "note", gpu if sees else f"{gpu}, which the installed PyTorch does not see")


def _torch_sees_gpu() -> bool:
    command = (sys.executable, "-c", SEES_GPU)
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    except (OSError, subprocess.SubprocessError):
        return False
    return done.stdout.strip() == "True"


def _memory() -> Line:
    memory = psutil.virtual_memory()
    words = f"{memory.available / GIGABYTE:.1f} of {memory.total / GIGABYTE:.1f} GB free"
    short = memory.available < MEMORY
    return Line("memory", "note" if short else "ok", f"{words}; trainings take up to 1.6 GB" if short else words)


def _disk(folder: Path) -> Line:
    there = next(place for place in (folder.absolute(), *folder.absolute().parents) if place.is_dir())
    free = shutil.disk_usage(there).free
    state: State = "BAD" if free < LEAST_DISK else "note" if free < DISK else "ok"
    return Line("disk", state, f"{free / GIGABYTE:.1f} GB free where {folder} is")


def _store(store: Store) -> Line:
    try:
        found = store.read()
    except ShellbenchError as error:
        return Line("store", "BAD", str(error))
    there = next(place for place in (store.folder.absolute(), *store.folder.absolute().parents) if place.exists())
    if not os.access(there, os.W_OK):
        return Line("store", "BAD", f"{there} may not be written")
    damaged = f", {len(found.damaged)} of them damaged" if found.damaged else ""
    total = len(found.records) + len(found.damaged)
    return Line("store", "note" if damaged else "ok", f"{store.folder}, {total} records{damaged}")


def _solvers() -> Line:
    try:
        listed = [list_solver(entry) for entry in solver_entries().values()]
    except ShellbenchError as error:
        return Line("solvers", "BAD", str(error))
    # A solver whose engine is not installed reports it itself; other solvers are not affected.
    broken = [str(one["reason"]) for one in listed if not one["available"]]
    words = f"{len(listed) - len(broken)} can be used"
    return Line("solvers", "note" if broken else "ok", "; ".join([words, *broken]))


def _solve(case: str, solver: str) -> Line:
    """Solve as `run` does, in a process of its own, and compare the answer with the known value."""
    began = time.monotonic()
    about = f"a solve, {case} by {solver}"
    with tempfile.TemporaryDirectory() as folder:
        store = Store(Path(folder))
        try:
            with closing(LocalProcesses(1, environment.threads(), PATIENCE)) as executor:
                plan = make_plan(Request(cases=(case,), solvers=(solver,)), store.read(), expect=executor.expect)
                execute(plan.tasks, store, Silent(), executor)
            row = next(row for row in rows(store) if row.primary)
        except (ShellbenchError, OSError, StopIteration) as error:
            return Line(about, "BAD", " ".join(str(error).split()) or "it has left no record")
    took = f"in {row.seconds or 0.0:.1f} s, {time.monotonic() - began:.1f} s with the start of a process"
    if row.value is None or row.relative_error is None:
        return Line(about, "BAD", f"{row.status}: {row.reason}")
    words = f"{row.value:.7g} {row.unit}, off the known value by {100 * row.relative_error:+.2g} %, {took}"
    return Line(about, "ok" if row.passed else "BAD", words if row.passed else f"{words}: {row.reason}")
