"""Data that other packages bring: cases, suites, known values, tolerances and claims.

A package names its folder in the entry-point group ``shellbench.data``::

    [project.entry-points."shellbench.data"]
    mine = "my_package.data"

The folder is laid out as shellbench's own data: ``cases/*.toml``, ``cases/suites/*.toml``, ``references/*.toml`` and
``references/tolerances/*.toml``. It is found and read without importing the package. Known values and tolerances judge
the package's own cases only. Its tolerances for its own solvers on other cases are claims, and decide nothing.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from shellbench.bench.catalogue.reference import FOLDER, Tolerances, read_tolerances
from shellbench.bench.catalogue.suite import Suite, read_suite
from shellbench.bench.plugins.registry import OWN, SolverEntry, registered, solver_entries
from shellbench.bench.plugins.source import locate
from shellbench.errors import InputError

GROUP = "shellbench.data"


@dataclass(frozen=True)
class Brought:
    """Data of one package.

    Attributes
    ----------
    package
        Name of the distribution.
    cases, suites
        Its cases' files and its suites, by name. A suite may extend one of another package.
    tolerances
        By solver and case; those on cases of others are claims.
    """

    package: str
    folder: Path
    cases: Mapping[str, Path]
    suites: Mapping[str, Suite]
    tolerances: Mapping[str, Tolerances]

    def references(self, case: str) -> Path:
        """Return the file of a case's known values; it need not be there."""
        return self.folder / "references" / f"{case}.toml"


def brought() -> tuple[Brought, ...]:
    """Return the data of all installed packages except shellbench.

    Raises
    ------
    InputError
        In one sentence, if a folder is not there, a file is malformed, or a file judges cases of another package.
    """
    return _brought(tuple(sys.path))


@cache  # cached: the installed packages do not change
def _brought(path: tuple[str, ...]) -> tuple[Brought, ...]:
    return tuple(_read(entry) for entry in registered(GROUP, "folder of data").values())


def _read(entry: SolverEntry) -> Brought:
    folder = _folder_of(entry)
    cases = _files(folder / "cases")
    for name, path in _files(folder / "references").items():
        if name not in cases:
            raise InputError(f"{path}: package {entry.distribution} has no case '{name}', and may judge no other")
    suites = {name: read_suite(path) for name, path in _files(folder / "cases" / "suites").items()}
    held = {}
    for solver, path in _files(folder / "references" / FOLDER).items():
        held[solver] = read_tolerances(path)
        others = sorted(held[solver].keys() - cases.keys())
        owner = solver_entries().get(solver)
        if others and (owner is None or owner.distribution != entry.distribution):
            raise InputError(
                f"{path}: package {entry.distribution} has neither the case '{others[0]}' nor the solver '{solver}',"
                " and sets no tolerance there"
            )
    return Brought(entry.distribution, folder, cases, suites, held)


def _folder_of(entry: SolverEntry) -> Path:
    """Return the folder that an entry point names, without importing anything."""
    begin = f"data '{entry.name}' of package {entry.distribution} can't be used"
    top, *rest = entry.target.split(".")
    try:
        spec = find_spec(top) if top.isidentifier() else None
    except (ImportError, ValueError, AttributeError):
        spec = None
    for root in (spec.submodule_search_locations or ()) if spec else ():
        folder = Path(root).joinpath(*rest)
        if folder.is_dir():
            return folder
    raise InputError(f"{begin}: there is no folder {entry.target!r}, written as package.folder")


def _files(folder: Path) -> dict[str, Path]:
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def suites_brought() -> Iterator[tuple[str, str, Suite]]:
    """Yield the suites of other packages: the package, the name of the suite, and the content of its file."""
    for one in brought():
        for name, suite in one.suites.items():
            yield one.package, suite.extends or name, suite


def distinct(what: str, own: list[str], others: list[tuple[str, str]]) -> list[str]:
    """Return the names of shellbench and of other packages as (package, name), sorted.

    Raises
    ------
    InputError
        If two packages use the same name.
    """
    owners = dict.fromkeys(own, OWN)
    for package, name in others:
        if name in owners:
            raise InputError(f"two installed packages call a {what} '{name}': {owners[name]} and {package}")
        owners[name] = package
    return sorted(owners)


def claimed(entry: SolverEntry) -> Tolerances:
    """Return the errors that a package promises for its solver, read without importing it.

    They are beside the solver's module, or in the data of its package.
    """
    module = locate(entry.module)
    path = module.parent / FOLDER / f"{entry.name}.toml" if module else None
    found = read_tolerances(path) if path and path.is_file() else {}
    for one in brought():
        if one.package == entry.distribution:
            held = one.tolerances.get(entry.name, {})
            found |= {case: of for case, of in held.items() if case not in one.cases}
    return found
