"""Solvers by name, found through the entry-point group ``shellbench.solvers``.

Nothing is imported until a solver is asked for: entry points are text in the metadata of installed packages.
A plug-in registers in the same way as built-in solvers::

    [project.entry-points."shellbench.solvers"]
    mine = "my_package.solver:MySolver"

A solver may also be a command that a TOML file describes (`shellbench.protocol.program`). It has no entry point: it is
known from when a user names its file, until the process ends.
"""

from __future__ import annotations

import os
import shlex
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import Distribution, entry_points
from pathlib import Path
from typing import Any, Literal

from shellbench.errors import InputError
from shellbench.problem import Solver
from shellbench.protocol.program import Program
from shellbench.protocol.spelling import did_you_mean

GROUP = "shellbench.solvers"
OWN = "shellbench"  # shellbench's package and distribution
OF_FILES = "shellbench.solvers.external.solver:CommandSolver"  # the class of solvers that a file describes
FILE, FILE_AFTER = ".toml", "?"  # end of such a file's name; the sign before its path in the place of the solver
PARTS = ("name", "capabilities", "settings_type", "declines", "solve", "load")


@dataclass(frozen=True)
class SolverEntry:
    """A registered solver, not yet imported.

    Attributes
    ----------
    name
        Name on the command line and in records.
    target
        Its place, ``module:attribute``; of a solver that a file describes ``module:attribute?path``.
    distribution, version
        The installed package that registers it; none, and its program's fingerprint, if a file describes it.
    """

    name: str
    target: str
    distribution: str
    version: str

    @property
    def module(self) -> str:
        """Dotted name of the solver's module."""
        return self.target.partition(":")[0].strip()

    @property
    def own(self) -> bool:
        """True for a solver of shellbench itself, False for a plug-in."""
        return self.module.partition(".")[0] == OWN and self.distribution in ("", OWN)

    @property
    def file(self) -> Path | None:
        """The file that describes it; None for a solver of a package."""
        path = self.target.partition(FILE_AFTER)[2]
        return Path(path) if path else None

    @property
    def version_of_code(self) -> tuple[str, ...]:
        """Its version where that counts as its code: not for solvers of shellbench."""
        if self.file is not None:
            return (Program.read(self.file).fingerprint(self.file),)  # as it is now
        return () if self.own else (f"{self.distribution} {self.version}",)


_OF_FILES: dict[str, SolverEntry] = {}  # those that the user has named so far, by name


def solver_entries() -> dict[str, SolverEntry]:
    """Return all registered solvers by name, and those of files that the user has named.

    Raises
    ------
    InputError
        If two packages register different solvers under one name.
    """
    return registered(GROUP, "solver") | _OF_FILES


def registered(group: str, what: str) -> dict[str, SolverEntry]:
    """Return all entries of a group of entry points, by name; InputError as `solver_entries`."""
    entries: dict[str, SolverEntry] = {}
    named: dict[Distribution | None, tuple[str, str]] = {}  # each access reads the package's metadata again
    for point in entry_points(group=group):
        if point.dist not in named:
            named[point.dist] = (str(point.dist.name), str(point.dist.version)) if point.dist else ("", "")
        entry = SolverEntry(point.name, point.value, *named[point.dist])
        known = entries.setdefault(entry.name, entry)
        if known.target != entry.target:
            raise InputError(
                f"two installed packages call a {what} '{entry.name}': {known.distribution} and {entry.distribution}"
            )
    return dict(sorted(entries.items()))


def find_solver(name: str) -> SolverEntry:
    """Return the registered solver of this name; InputError, naming the known ones, if there is none.

    The path to a file, which ends in .toml, stands for the solver that it describes.
    """
    if name.endswith(FILE):
        return _solver_of_file(Path(name))
    entries = solver_entries()
    if name not in entries:
        refuse_without_package("solver", name)
        hint = did_you_mean(name, entries)
        raise InputError(f"unknown solver '{name}'{hint}: solvers are {', '.join(entries) or 'not installed'}")
    return entries[name]


def name_of(text: str | Path) -> str:
    """Return the name of a solver that a user has named, or of which the user has given the file; InputError."""
    return find_solver(str(text)).name if str(text).endswith(FILE) else str(text)


def given_as(name: str) -> str:
    """Return the name of a solver on the command line: the path of its file, if one describes it."""
    file = _OF_FILES[name].file if name in _OF_FILES else None
    return shlex.quote(os.path.relpath(file) if file else name)


def _solver_of_file(path: Path) -> SolverEntry:
    """Return the solver that a file describes, as its program is now, and make it known by its name."""
    described = Program.read(path)
    entry = SolverEntry(described.name, f"{OF_FILES}{FILE_AFTER}{path.resolve()}", "", described.fingerprint(path))
    known = solver_entries().get(entry.name, entry)
    if known.target != entry.target:
        of = f"that of {known.file}" if known.file else "that of an installed solver"
        raise InputError(f"{path}: field 'name': '{entry.name}' is {of} already; give another name")
    _OF_FILES[entry.name] = entry
    return entry


def refuse_without_package(what: Literal["solver", "suite"], name: str) -> None:
    """Raise InputError with the command to install it, if a package of this repository has the requested entry."""
    packages = tomllib.loads(Path(__file__).with_name("packages.toml").read_text(encoding="utf-8"))
    for package, brings in packages.items():
        if name in brings[f"{what}s"]:
            install = f"python -m pip install ./{brings['folder']}"
            raise InputError(f"{what} '{name}' comes with {package}, which is not installed: {install} in a clone")


def loads_here(entry: SolverEntry) -> bool:
    """Return True if the judging process loads the solver: it loads only solvers of shellbench itself."""
    return entry.own


def load(entry: SolverEntry, what: str, make: Callable[[Any], Any] = lambda found: found) -> Any:
    """Import an entry and construct the result from it.

    Raises
    ------
    InputError
        In one sentence with its name, if this raises an exception.
    """
    module, _, attribute = entry.target.partition(FILE_AFTER)[0].partition(":")
    try:
        found: Any = import_module(module.strip())
        for part in attribute.strip().split("."):
            found = getattr(found, part)
        return make(found)
    except Exception as error:  # a plug-in's import can raise anything, and must cost that plug-in only
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{what} '{entry.name}' can't be used: {reason}") from error


def load_solver(entry: SolverEntry) -> Solver:
    """Import a solver and make one.

    Raises
    ------
    InputError
        If its module can't be imported for any reason, or its attribute is not a solver.
    """

    def make(found: Any) -> Any:
        return found.of(entry.file) if entry.file else found() if isinstance(found, type) else found

    solver: Solver = load(entry, "solver", make)
    missing = [part for part in PARTS if not hasattr(solver, part)]
    if missing:
        raise InputError(f"solver '{entry.name}' can't be used: {entry.target} has no {', '.join(missing)}")
    return solver
