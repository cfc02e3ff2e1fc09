"""Cases, suites, known values and tolerances, from the wheel or the source tree, or from other packages.

What is called *own* here comes with shellbench; the rest is what other packages bring
(`shellbench.bench.catalogue.brought`).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

from pydantic import ValidationError

from shellbench.bench.catalogue.brought import brought, distinct, suites_brought
from shellbench.bench.catalogue.headings import Heading, headings, read_heading
from shellbench.bench.catalogue.reference import (
    FOLDER,
    KnownValues,
    Tolerance,
    Tolerances,
    read_known_values,
    read_tolerances,
)
from shellbench.bench.catalogue.suite import Suite, read_suite
from shellbench.bench.plugins.kinds import find_kind, read_problem
from shellbench.bench.plugins.registry import OWN, refuse_without_package
from shellbench.errors import InputError
from shellbench.problem import VARIANT, Problem
from shellbench.protocol.schema import LONGEST_TITLE, one_sentence
from shellbench.protocol.spelling import did_you_mean

PACKAGE = Path(__file__).resolve().parents[2]  # the folder of shellbench
LOCK = "lock.json"  # see `shellbench.bench.judge.lock`


def data_folder(name: str) -> Path:
    """Return the folder `cases` or `references`: beside the modules in a wheel, beside the package in a source tree."""
    installed = PACKAGE / "data" / name
    return installed if installed.is_dir() else PACKAGE.parent / name


def shipped_baseline() -> Path:
    """Return the path of the baseline that comes with the suite; only in a catalog of tests the file is absent."""
    return data_folder("reports") / "baseline.json"


def case_names() -> list[str]:
    """Names of the suite's own cases, and of those that other packages bring."""
    return distinct("case", own_case_names(), [(one.package, name) for one in brought() for name in one.cases])


def own_case_names() -> list[str]:
    """Names of the cases that come with shellbench."""
    return _names_in(data_folder("cases"))


def case_file(name: str) -> Path:
    """Return the file of a case that has this name."""
    found = (one.cases[name] for one in brought() if name in one.cases)
    return next(found, data_folder("cases") / f"{name}.toml")


def package_of(case: str) -> str:
    """Return the package that a case, or a variant of it, comes with."""
    return next((one.package for one in brought() if case.partition(VARIANT)[0] in one.cases), OWN)


def package_of_suite(name: str) -> str:
    """Return the package that a suite comes with."""
    return next((package for package, of, suite in suites_brought() if of == name and not suite.extends), OWN)


def suite_names() -> list[str]:
    """Names of the suites, those of other packages among them."""
    others = [(package, name) for package, name, suite in suites_brought() if suite.extends is None]
    names = distinct("suite", own_suite_names(), others)
    for package, name, _ in suites_brought():
        if name not in names:
            raise InputError(f"package {package} extends the unknown suite '{name}'")
    return names


def own_twins() -> list[str]:
    """Names of the twins that have known values, such as ``scordelis_lo@naghdi``."""
    return [name for name in _names_in(data_folder("references")) if VARIANT in name]


def own_suite_names() -> list[str]:
    """Names of the suites that come with shellbench."""
    return _names_in(data_folder("cases") / "suites")


@cache
def _names_in(folder: Path) -> list[str]:
    return sorted(path.stem for path in folder.glob("*.toml"))


@cache
def _headings() -> dict[Path, Heading]:
    return headings(map(case_file, case_names()))


def _named_by(name: str) -> Heading:
    """Return the kind and the suites that a case's file names; the rest of it is not checked."""
    path = case_file(name)
    return _headings().get(path) or read_heading(path)


def kind_named_by(name: str) -> str:
    """Return the kind of problem that a case's file names."""
    return _named_by(name)[0]


@cache
def suites_named_by(name: str) -> tuple[str, ...]:
    """Return the suites to which a case says that it belongs, and those that ask it; of a twin those that ask it."""
    if VARIANT in name:
        return _suites_that_ask(name)
    return (*_named_by(name)[1], *_asked_by(name))


def _asked_by(case: str) -> tuple[str, ...]:
    """Return the suites of other packages that ask a case, which does not name them."""
    return tuple(name for _, name, suite in suites_brought() if case in suite.cases)


def has_case(name: str) -> bool:
    """Return True if a name is one of the suite's own cases or a variant of one."""
    base, _, variant = name.partition(VARIANT)
    return base in case_names() and (not variant or variant in find_kind(named_case(base).kind).statements)


@cache
def named_case(name: str) -> Problem:
    """Return one of the suite's own cases, or a variant of one, such as ``scordelis_lo@oblique``.

    Raises
    ------
    InputError
        If it is malformed, or states a tolerance: those of own cases are frozen in references/tolerances/. If there is
        no such variant of the case.
    """
    base, _, variant = name.partition(VARIANT)
    if variant:
        return variant_of(named_case(base), variant)
    path = case_file(name)
    case = read_problem(path)
    if case.known:
        raise InputError(f"{path}: field 'known' is no field of a suite's case: references/ holds it")
    for number, quantity in enumerate(case.quantities):
        if quantity.tolerance or quantity.open_finding:
            field = f"quantities.{number}.{'tolerance' if quantity.tolerance else 'open_finding'}"
            raise InputError(f"{path}: field '{field}' is no field of a suite's case: references/{FOLDER}/ holds it")
    more = _asked_by(name)
    return case.model_copy(update={"suites": (*case.suites, *more)}) if more else case


def variant_of(case: Problem, name: str) -> Problem:
    """Return a variant of a case, an equivalent statement of the same question, or its twin in another theory.

    Raises
    ------
    InputError
        If its kind of problem has no such variant, or the case can't be asked so.
    """
    kind = find_kind(case.kind)
    if name not in kind.statements:
        names = ", ".join(kind.statements)
        known = f"variants are {names}" if names else f"problems of kind '{case.kind}' have none"
        raise InputError(f"unknown variant '{name}' of case '{case.name}': {known}")
    variant, full = kind.statements[name], f"{case.name}{VARIANT}{name}"
    try:
        data = variant.make(case)
        title = f"{case.title[: LONGEST_TITLE - len(variant.words) - 2]}, {variant.words}"
        return kind.problem.model_validate(data | {"name": full, "title": title, "suites": _suites_that_ask(full)})
    except InputError as error:
        raise InputError(f"case '{case.name}' has no variant '{name}': {error}") from None
    except ValidationError as error:
        raise InputError(f"variant '{full}': {one_sentence(error)}") from None


def find_case(text: str) -> Problem:
    """Return the case of this name, or of this path to a TOML file; of either a variant, if ``@NAME`` follows.

    Raises
    ------
    InputError
        If there is no such case, variant or file, or it is malformed.
    """
    name, _, variant = text.rpartition(VARIANT)
    if text.partition(VARIANT)[0] in case_names():
        return named_case(text)
    if name.endswith(".toml"):
        return variant_of(read_problem(Path(name)), variant)
    path = Path(text)
    if path.suffix == ".toml":
        return read_problem(path)
    hint = did_you_mean(text.partition(VARIANT)[0], case_names())
    raise InputError(f"unknown case '{text}'{hint}: see `shellbench list`; suites need --suite, paths end in .toml")


def is_own(case: Problem) -> bool:
    """Return True if a case is a user's own: no case of the suite has the same name and physics."""
    return not has_case(case.name) or named_case(case.name).digest() != case.digest()


@cache
def find_suite(name: str) -> Suite:
    """Return the suite of this name; InputError if there is none."""
    if name not in suite_names():
        refuse_without_package("suite", name)
        hint = did_you_mean(name, suite_names())
        raise InputError(f"unknown suite '{name}'{hint}: suites are {', '.join(suite_names())}")
    base = [suite for _, of, suite in suites_brought() if of == name and suite.extends is None]
    found = base[0] if base else own_suite(name)
    for suite in (suite for _, of, suite in suites_brought() if of == name and suite.extends):
        more = {"runs": (*found.runs, *suite.runs), "remarks": (*found.remarks, *suite.remarks)}
        found = found.model_copy(update=more | {"order": (*found.order, *suite.order)})
    return found


def own_suite(name: str) -> Suite:
    """Return a suite that comes with shellbench, without what other packages add."""
    return read_suite(data_folder("cases") / "suites" / f"{name}.toml")


def cases_of(suite: str) -> list[Problem]:
    """Return the suite's own cases that belong to a suite, in the order of its file, each before its variants."""
    return _in_order(suite, [*members(suite), *map(named_case, variants_asked(suite))])


def members(suite: str) -> list[Problem]:
    """Return the suite's own cases that belong to a suite, without variants, in the order of its file."""
    return _in_order(suite, [named_case(name) for name in case_names() if suite in suites_named_by(name)])


def place_in(suite: str, name: str) -> tuple[int, ...]:
    """Return a key that sorts cases and variants of a suite in the order of `cases_of`; others come last.

    Only the case of a variant is built.
    """
    base, _, variant = name.partition(VARIANT)
    order, names = find_suite(suite).order, case_names()
    asked = _variants_asked_of(suite, base) if variant else (name,)
    if base not in names or name not in asked or not (variant or suite in suites_named_by(name)):
        return (len(order) + 1,)
    at = order.index(base) if base in order else len(order)
    return at, int(bool(variant)), names.index(base), asked.index(name)


def _in_order(suite: str, cases: list[Problem]) -> list[Problem]:
    order = find_suite(suite).order
    return sorted(cases, key=lambda case: order.index(case.base) if case.base in order else len(order))


def cases_named(suite: str, name: str) -> list[Problem]:
    """Return the cases of a suite that a name selects: the case and those of its variants that the suite has."""
    return [case for case in cases_of(suite) if name in (case.name, case.base)]


@cache
def variants_asked(suite: str) -> tuple[str, ...]:
    """Return the names of a suite's variants: named ones, all, or a number for each case, drawn by its seed."""
    asked = find_suite(suite).variants
    if asked is None:
        return ()
    if asked.named:
        return asked.named
    cases = {case.name: case for source in asked.suites or (suite,) for case in members(source)}
    return tuple(name for case in cases.values() for name in _drawn(case, asked.drawn, asked.seed))


def _drawn(case: Problem, count: int | None, seed: int) -> Iterator[str]:
    """Yield the variants of a case in the order of the draw, `count` of them or all."""

    # A hash draws the same on every machine and in every version of Python.
    def lot(name: str) -> str:
        return hashlib.sha256(f"{seed} {case.name} {name}".encode()).hexdigest()

    variants = find_kind(case.kind).variants
    found = 0
    for name in sorted(variants, key=lot) if count else variants:
        if found == count:
            return
        try:
            variants[name].make(case)
        except InputError:  # it can't be asked so
            continue
        found += 1
        yield f"{case.name}{VARIANT}{name}"


def _suites_that_ask(variant: str) -> tuple[str, ...]:
    """Return the suites that have a variant; only its case is built."""
    base = variant.partition(VARIANT)[0]
    return tuple(name for name in suite_names() if variant in _variants_asked_of(name, base))


def _variants_asked_of(suite: str, case: str) -> tuple[str, ...]:
    asked = find_suite(suite).variants
    if asked is None:
        return ()
    if asked.named:
        return asked.named
    of_case = suites_named_by(case) if case in case_names() else ()
    among = {*(asked.suites or (suite,))}
    return () if among.isdisjoint(of_case) else tuple(_drawn(named_case(case), asked.drawn, asked.seed))


def exam_version() -> int | None:
    """Return the version of the exam, as its lock says; None if there is no lock that can be read."""
    try:
        found = json.loads((data_folder("references") / LOCK).read_bytes())["version"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return found if isinstance(found, int) else None


def _judged_as(case_name: str) -> str:
    """Return the name under which a case is judged: a variant's case, but a twin itself."""
    return case_name if case_name in own_twins() else case_name.partition(VARIANT)[0]


@cache
def known_values(case_name: str) -> KnownValues:
    """Return the known values of a case, for a variant those of its case, for a twin its own if it has any.

    A user's own case has none. Those of its case never judge a twin, as they are of another theory.
    """
    name = _judged_as(case_name)
    found = (one.references(name) for one in brought() if name in one.cases)
    path = next(found, data_folder("references") / f"{name}.toml")
    return read_known_values(path) if path.is_file() else KnownValues()


@cache
def tolerances() -> Mapping[str, Tolerances]:
    """Return the frozen tolerances by solver: those that come with shellbench and are in the lock.

    Raises
    ------
    InputError
        If a file is malformed.
    """
    files = sorted((data_folder("references") / FOLDER).glob("*.toml"))
    return {path.stem: read_tolerances(path) for path in files}


def tolerance(case_name: str, quantity: str, solver: str) -> Tolerance | None:
    """Return the frozen tolerance of a quantity for a solver; None if there is none. The case may be a variant."""
    name = _judged_as(case_name)
    found = tolerances_of(solver).get(name, {}).get(quantity)
    return found.of_variant(case_name[len(name) + 1 :]) if found else None


def tolerances_of(solver: str) -> Tolerances:
    """Return the tolerances of a solver by case and quantity. Each package sets those of its own cases."""
    found = tolerances().get(solver, {})
    for one in brought():
        found = found | {case: held for case, held in one.tolerances.get(solver, {}).items() if case in one.cases}
    return found


def tolerated(case_name: str, quantity: str) -> dict[str, Tolerance]:
    """Return the frozen tolerance of a quantity by solver."""
    solvers = dict.fromkeys((*tolerances(), *(solver for one in brought() for solver in one.tolerances)))
    found = {solver: tolerance(case_name, quantity, solver) for solver in solvers}
    return {solver: allowed for solver, allowed in found.items() if allowed}
