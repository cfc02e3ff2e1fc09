"""Where the suite's cases, suites, known values and tolerances are: in the wheel, or in the source tree."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

from shellbench.bench.kinds import read_problem
from shellbench.bench.reference import FOLDER, KnownValues, Tolerance, Tolerances, read_known_values, read_tolerances
from shellbench.bench.suite import Suite, read_suite
from shellbench.errors import InputError
from shellbench.model import read_toml
from shellbench.problem import Problem

PACKAGE = Path(__file__).resolve().parents[1]


def data_folder(name: str) -> Path:
    """Return the folder `cases` or `references`: beside the modules in a wheel, beside the package in a source tree."""
    installed = PACKAGE / "data" / name
    return installed if installed.is_dir() else PACKAGE.parent / name


def case_names() -> list[str]:
    """Names of the suite's own cases."""
    return sorted(path.stem for path in data_folder("cases").glob("*.toml"))


def suite_names() -> list[str]:
    """Names of the suites."""
    return sorted(path.stem for path in (data_folder("cases") / "suites").glob("*.toml"))


def suites_named_by(name: str) -> tuple[str, ...]:
    """Return the suites to which one of the suite's own cases says that it belongs; the rest of it is not checked."""
    return tuple(map(str, read_toml(data_folder("cases") / f"{name}.toml").get("suites", ())))


@cache
def named_case(name: str) -> Problem:
    """Return one of the suite's own cases.

    Raises
    ------
    InputError
        If it is malformed, or states a tolerance: what our cases allow is frozen in references/tolerances/.
    """
    path = data_folder("cases") / f"{name}.toml"
    case = read_problem(path)
    for number, quantity in enumerate(case.quantities):
        if quantity.tolerance or quantity.open_finding:
            field = f"quantities.{number}.{'tolerance' if quantity.tolerance else 'open_finding'}"
            raise InputError(f"{path}: field '{field}' is no field of a suite's case: references/{FOLDER}/ holds it")
    return case


def find_case(text: str) -> Problem:
    """Return the case of this name, or of this path to a TOML file.

    Raises
    ------
    InputError
        If there is no such case or file, or it is malformed.
    """
    if text in case_names():
        return named_case(text)
    path = Path(text)
    if path.suffix == ".toml":
        return read_problem(path)
    raise InputError(f"unknown case '{text}': name one of {', '.join(case_names())}, or a path to a .toml file")


def is_own(case: Problem) -> bool:
    """Whether a case is a user's own: none of the suite's has its name and its physics."""
    return case.name not in case_names() or named_case(case.name).digest() != case.digest()


@cache
def find_suite(name: str) -> Suite:
    """Return the suite of this name; InputError if there is none."""
    if name not in suite_names():
        raise InputError(f"unknown suite '{name}': suites are {', '.join(suite_names())}")
    return read_suite(data_folder("cases") / "suites" / f"{name}.toml")


def cases_of(suite: str) -> list[Problem]:
    """Return the suite's own cases that belong to a suite, in the order of its file."""
    order = find_suite(suite).order
    members = [case for case in map(named_case, case_names()) if suite in case.suites]
    return sorted(members, key=lambda case: order.index(case.name) if case.name in order else len(order))


@cache
def known_values(case_name: str) -> KnownValues:
    """Return the known values of a case; none for a case that the suite has not seen."""
    path = data_folder("references") / f"{case_name}.toml"
    return read_known_values(path) if path.is_file() else KnownValues()


@cache
def tolerances() -> Mapping[str, Tolerances]:
    """Return the frozen tolerances by solver.

    Raises
    ------
    InputError
        If a file is malformed.
    """
    files = sorted((data_folder("references") / FOLDER).glob("*.toml"))
    return {path.stem: read_tolerances(path) for path in files}


def tolerance(case_name: str, quantity: str, solver: str) -> Tolerance | None:
    """Return what one of the suite's own cases allows a solver; None if nothing is frozen."""
    return tolerances().get(solver, {}).get(case_name, {}).get(quantity)
