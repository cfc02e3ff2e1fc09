"""Engines: programs of others that a solver stands on, which come with a plug-in or an extra.

The engine decides the answer as much as the solver's own source does, so its version must be part of a run's
identity. A solver on an engine has a setting `engine`, whose default is `engine_version` of the distribution, and
refuses any other value; records that an engine of another version has made do not answer any more.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version

from shellbench.errors import InputError

ENGINE = "engine"  # the setting


def engine_version(distribution: str) -> str | None:
    """Return name and version of an installed distribution, such as "mujoco 4.0.0"; None if it is not installed."""
    try:
        return f"{distribution} {version(distribution)}"
    except PackageNotFoundError:
        return None


def thread_limit() -> int:
    """Return the number of threads that a solve may use, from OMP_NUM_THREADS; one if it is not set."""
    told = os.environ.get("OMP_NUM_THREADS", "").split(",")[0]
    return int(told) if told.isdigit() and int(told) > 0 else 1


def need(extra: str, distributions: Iterable[str], package: str = "shellbench") -> None:
    """Make sure that what an extra of a package installs is there, or the package itself if the extra is empty.

    Raises
    ------
    InputError
        If not; it says what to install.
    """
    missing = [name for name in distributions if engine_version(name) is None]
    if missing:
        what = f"{package}[{extra}]" if extra else package
        are = "is" if len(missing) == 1 else "are"
        raise InputError(f"{', '.join(missing)} {are} not installed: python -m pip install '{what}'")
