"""The environment of a run: versions, processor, threads and commit."""

from __future__ import annotations

import os
import platform
import re
import subprocess
from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from shellbench import __file__ as package_file
from shellbench.bench.store.record import Environment
from shellbench.protocol.engine import ENGINE

PACKAGES = ("shellbench", "numpy", "scipy", "scikit-fem", "torch", "pypardiso")
THREADS = 2  # threads of a run, for which the suite's seconds are stated
NAME_AND_VERSION = re.compile(
    r"(\S+) \d\S*"
)  # of a distribution, as `shellbench.protocol.engine.engine_version` writes them
PATIENCE = 10.0  # seconds for git or the GPU's driver to answer


def cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def threads() -> int:
    """Return the default number of threads of a run."""
    return min(THREADS, cores())


def environment(
    device: str = "cpu", distribution: str = "", *, threads_each: int | None = None, engine: str | None = None
) -> Environment:
    """Describe this machine and tree.

    Parameters
    ----------
    distribution
        The package of the solver.
    threads_each
        Threads of each run; `threads` if not given.
    engine
        Distribution of the solver's engine, if it has one (see `engine_distribution`).
    """
    sha, dirty = _commit()
    return Environment(
        python=platform.python_version(),
        versions=_versions(distribution, engine or ""),
        platform=f"{platform.system()} {platform.release()} {platform.machine()}",
        processor=_processor(),
        cores=cores(),
        threads=threads_each or threads(),
        gpu=gpu() if device == "cuda" else None,
        git_sha=sha,
        git_dirty=dirty,
    )


def engine_distribution(settings: Mapping[str, Any]) -> str | None:
    """Return the distribution of the engine of a run with these settings; None if it has no engine."""
    found = NAME_AND_VERSION.fullmatch(str(settings.get(ENGINE)))
    return found[1] if found else None


def _versions(*more: str) -> dict[str, str]:
    found: dict[str, str] = {}
    for package in dict.fromkeys((*PACKAGES, *more)):
        try:
            found[package] = str(version(package))  # None for a package without a version
        except (PackageNotFoundError, ValueError):
            continue
    return found


@cache
def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


@cache
def gpu() -> str | None:
    """Return the name of the first GPU, as its driver says; None if there is none."""
    answer = _ask("nvidia-smi", "--query-gpu=name", "--format=csv,noheader")
    return answer.splitlines()[0].strip() if answer else None


def _commit() -> tuple[str | None, bool | None]:
    """Return the commit of the package's tree, and True if tracked files differ from it."""
    package = Path(package_file).resolve().parent
    if not (package.parent / ".git").exists():  # an installed package may lie inside a tree of something else
        return None, None
    sha = _ask("git", "-C", str(package), "rev-parse", "HEAD")
    if not sha:
        return None, None
    changes = _ask("git", "-C", str(package), "status", "--porcelain", "--untracked-files=no")
    return sha.strip(), None if changes is None else bool(changes.strip())


def _ask(*command: str) -> str | None:
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout if done.returncode == 0 else None
