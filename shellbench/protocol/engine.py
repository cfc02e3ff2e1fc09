"""Engines: third-party programs that a solver uses, which come with a plug-in or an extra.

The answer depends on the engine as much as on the solver's own source. The engine's version must therefore be part of a
run's identity. A solver on an engine has a setting `engine`, whose default is `engine_version` of the distribution, and
refuses any other value. Records from another version of the engine are not valid any more.
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
    """Check that the packages of an extra are installed, or the package itself if the extra is empty.

    Raises
    ------
    InputError
        If not, with the package to install.
    """
    missing = [name for name in distributions if engine_version(name) is None]
    if missing:
        what = f"{package}[{extra}]" if extra else package
        are = "is" if len(missing) == 1 else "are"
        raise InputError(f"{', '.join(missing)} {are} not installed: python -m pip install '{what}'")
