"""The lock: the state of the exam when the lock was last moved, deliberately and by a commit.

references/lock.json holds, of every case that is gated or has a known value, the digest of its physics, the runs that
its suites declare, all values that judge, and how closely each solver must answer. Known values also judge third-party
solvers, so that they are locked even if no built-in solver has a tolerance. The lock also holds the constants of the
judgement, such as the classes. The gate compares it with today's files and constants in every run.
Changes that make the exam easier or different are red. Changes that make it harder are only reported. A maintainer
moves the lock:

    python -m shellbench.bench.judge.lock            what has changed
    python -m shellbench.bench.judge.lock --write    make that the lock
"""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.reference import FOLDER, Tolerance
from shellbench.bench.catalogue.suite import SuiteRun
from shellbench.bench.judge import baseline, calibration, classes, row
from shellbench.bench.store import identity, settled
from shellbench.errors import InputError
from shellbench.problem import VARIANT, Problem
from shellbench.protocol.schema import Finite, Model, one_sentence

COMMAND = "python -m shellbench.bench.judge.lock --write"
SHOWN = 12  # characters of a digest
JUDGING: dict[ModuleType, tuple[str, ...]] = {
    baseline: ("REPEATS", "ROOM", "DEVIATIONS", "SLOWER", "LARGER"),
    calibration: ("ASKED_SHARE", "WITHIN", "MOST", "ROUNDING"),
    classes: ("CLASSES", "BLUNT", "BLUNTEST"),
    identity: ("GATED_DTYPE",),
    row: ("UNEXPLAINED",),
    settled: ("SETTLED",),
}
"""Constants that judge, by module."""

Constant = Finite | str | tuple[Finite, ...]
Found = tuple[Literal["broken", "unlocked"], str]


class Judge(Model):
    """The known value that judges a quantity, in its unit."""

    value: Finite
    uncertainty: Finite | None = None
    theory: str


class Figure(Model):
    """A quantity that is gated or has a known value: this value, and the tolerance of each solver."""

    judge: Judge | None = None
    tolerances: dict[str, Tolerance] = Field(default_factory=dict)


class LockedCase(Model):
    """A case that is gated or has a known value.

    Attributes
    ----------
    digest
        SHA-256 of the physics.
    suites
        By suite, and by solver that the case gates: the seeds that run with default settings.
    figures
        By name of the quantity.
    """

    digest: str
    suites: dict[str, dict[str, tuple[int, ...]]]
    figures: dict[str, Figure]


class Lock(Model):
    """All judged cases by name, and the digests of the variants by suite.

    Attributes
    ----------
    version
        Of the exam: one more whenever the lock is moved.
    constants
        Those of `JUDGING`, by module and name.
    """

    schema_version: Literal[1] = 1
    version: Annotated[int, Field(ge=1)] = 1
    constants: dict[str, Constant] = Field(default_factory=dict)
    cases: dict[str, LockedCase]
    variants: dict[str, dict[str, str]] = Field(default_factory=dict)


@dataclass(frozen=True)
class LockCheck:
    """Differences of today's exam from the locked one.

    Attributes
    ----------
    cases, figures
        Numbers of cases and values that are judged today.
    version
        Version of the locked exam; None if there is no lock.
    broken
        Changes that make the exam easier or different, one sentence each; they make the gate red.
    unlocked
        Changes that make the exam harder and are not locked yet, one clause each.
    part
        True if only the cases of some suites were compared.
    """

    cases: int
    figures: int
    version: int | None = None
    broken: tuple[str, ...] = ()
    unlocked: tuple[str, ...] = ()
    part: bool = False


def lock_path() -> Path:
    """Return the path of the lock."""
    return catalog.data_folder("references") / catalog.LOCK


def todays_lock(cases: Collection[str] | None = None, suites: Collection[str] | None = None) -> Lock:
    """Return the lock of today's cases, suites, known values and tolerances; of all cases, and variants of all suites.

    Parameters
    ----------
    cases, suites
        Names of the only cases that count, and of the only suites whose variants do.
    """
    gated = {name for held in catalog.tolerances().values() for name in held}
    own = _own()  # other packages lock their own data
    counted = own if cases is None else own & {*cases}
    judged = {name for name in counted if any(v.role == "judge" for v in catalog.known_values(name).values)}
    asked = {
        suite: [name for name in catalog.variants_asked(suite) if name.partition(VARIANT)[0] in own]
        for suite in catalog.own_suite_names()
        if suites is None or suite in suites
    }
    return Lock(
        constants={
            f"{module.__name__.rpartition('.')[2]}.{name}": getattr(module, name)
            for module, names in JUDGING.items()
            for name in names
        },
        cases={name: _locked(catalog.named_case(name)) for name in sorted((gated | judged) & counted)},
        variants={
            suite: {name: catalog.named_case(name).digest() for name in sorted(names)}
            for suite, names in asked.items()
            if names
        },
    )


def _own() -> set[str]:
    """Return the names of all own cases and twins."""
    return {*catalog.own_case_names(), *catalog.own_twins()}


def _locked(case: Problem) -> LockedCase:
    known, figures = catalog.known_values(case.name), {}
    for quantity in case.quantities:
        held = {solver: cases.get(case.name, {}) for solver, cases in catalog.tolerances().items()}
        of_solver = {solver: found.get(quantity.name) for solver, found in held.items()}
        allowed = {solver: tolerance for solver, tolerance in of_solver.items() if tolerance}
        judge = known.judge(quantity.name, case.theory)
        if allowed or judge:
            found = judge and Judge(value=judge.value, uncertainty=judge.uncertainty, theory=judge.theory)
            figures[quantity.name] = Figure(judge=found, tolerances=allowed)
    solvers = {solver for figure in figures.values() for solver in figure.tolerances}
    suites = {name: _seeds(catalog.own_suite(name).runs, case, solvers) for name in _suites(case)}
    return LockedCase(digest=case.digest(), suites=suites, figures=figures)


def _suites(case: Problem) -> list[str]:
    return [name for name in case.suites if name in catalog.own_suite_names()]


def _seeds(runs: tuple[SuiteRun, ...], case: Problem, solvers: set[str]) -> dict[str, tuple[int, ...]]:
    """Return the seeds of the runs of a suite that a case gates, by solver."""
    found: dict[str, set[int]] = {}
    for run in runs:
        if run.solver in solvers and not run.settings and run.is_for(case.name):
            found.setdefault(run.solver, set()).update(run.seeds)
    return {solver: tuple(sorted(seeds)) for solver, seeds in sorted(found.items())}


def read_lock(path: Path) -> Lock:
    """Read a lock.

    Raises
    ------
    InputError
        In one sentence that says what to do.
    """
    remedy = f"restore it from the repository, or install shellbench anew (a maintainer makes it: `{COMMAND}`)"
    try:
        return Lock.model_validate_json(path.read_bytes())
    except FileNotFoundError:
        raise InputError(f"{path}: is not there: {remedy}") from None
    except OSError as error:
        raise InputError(f"{path}: can't be read ({error.strerror}): {remedy}") from None
    except ValidationError as error:
        raise InputError(f"{path}: {one_sentence(error)}: {remedy}") from None


def write_lock() -> None:
    """Make today's exam the lock; each figure has a line, so that a commit shows what it changes."""
    now = todays_lock()
    with contextlib.suppress(InputError):  # no lock yet
        old = read_lock(lock_path())
        same = now.model_copy(update={"version": old.version}) == old
        now = now.model_copy(update={"version": old.version + (not same)})
    data = now.model_dump(mode="json", exclude_none=True)
    cases = []
    for name, case in data["cases"].items():
        figures = ",\n".join(f"    {json.dumps(key)}: {json.dumps(figure)}" for key, figure in case["figures"].items())
        head = f'   "digest": {json.dumps(case["digest"])},\n   "suites": {json.dumps(case["suites"])},\n'
        cases.append(f'  {json.dumps(name)}: {{\n{head}   "figures": {{\n{figures}\n   }}\n  }}')
    joined = ",\n".join(cases)
    variants = json.dumps(data["variants"], indent=1)
    text = (
        f'{{\n "schema_version": {data["schema_version"]},\n "version": {data["version"]},\n'
        f' "constants": {json.dumps(data["constants"], indent=1)},\n'
        f' "cases": {{\n{joined}\n }},\n "variants": {variants}\n}}\n'
    )
    lock_path().write_text(text, encoding="utf-8")


def check_lock(suites: Collection[str] | None = None, cases: Iterable[str] = ()) -> LockCheck:
    """Compare today's exam with the lock; a lock that is missing or can't be read is broken.

    With suites, only what they ask is compared, or asked when it was locked, and these cases: to build all cases takes
    10 seconds.
    """
    try:
        locked = read_lock(lock_path())
    except InputError as error:
        return LockCheck(0, 0, broken=(str(error),), part=suites is not None)
    names = None
    if suites is not None:
        of_lock = {name: case for name, case in locked.cases.items() if not case.suites.keys().isdisjoint(suites)}
        names = {name for name in _own() if not {*suites}.isdisjoint(catalog.suites_named_by(name))}
        names |= of_lock.keys() | {*cases}.intersection(_own(), locked.cases)
        variants = {suite: asked for suite, asked in locked.variants.items() if suite in suites}
        of_lock |= {name: case for name, case in locked.cases.items() if name in names}
        locked = locked.model_copy(update={"cases": of_lock, "variants": variants})
    now = todays_lock(names, suites)
    found = [*_dangling(names), *_differences(locked, now)]
    broken = tuple(words for kind, words in found if kind == "broken")
    unlocked = tuple(words for kind, words in found if kind == "unlocked")
    figures = sum(len(case.figures) for case in now.cases.values())
    return LockCheck(len(now.cases), figures, locked.version, broken, unlocked, suites is not None)


def _dangling(cases: Collection[str] | None) -> Iterator[Found]:
    """Yield tolerances of missing quantities, which have no effect; only of these cases, if some are given."""
    names = _own()
    for solver, held in catalog.tolerances().items():
        file = f"references/{FOLDER}/{solver}.toml"
        for name, quantities in held.items():
            if name not in names:
                yield "broken", f"{file} names '{name}', which is no case"
            elif cases is None or name in cases:
                known = {quantity.name for quantity in catalog.named_case(name).quantities}
                for quantity in sorted(quantities.keys() - known):
                    yield "broken", f"{file} names '{quantity}', which is no quantity of {name}"


def _differences(locked: Lock, now: Lock) -> Iterator[Found]:
    for name, value in locked.constants.items():
        if now.constants.get(name) != value:
            yield "broken", f"the constant {name} is {now.constants.get(name)}, and {value} is locked"
    for name in sorted(now.constants.keys() - locked.constants.keys()):
        yield "broken", f"the constant {name} judges, and the lock does not hold it"
    for name in sorted(now.cases.keys() - locked.cases.keys()):
        yield "unlocked", f"new case {name}"
    for name, then in locked.cases.items():
        if name in now.cases:
            yield from _of_case(name, then, now.cases[name])
        else:
            yield "broken", f"{name} is no case that is judged any more"
    for suite, variants in locked.variants.items():
        yield from _of_variants(suite, variants, now.variants.get(suite, {}))
    for suite, variants in now.variants.items():
        if more := sorted(variants.keys() - locked.variants.get(suite, {}).keys()):
            yield "unlocked", f"suite {suite} asks {len(more)} more variants, {more[0]} the first"


def _of_variants(suite: str, then: dict[str, str], now: dict[str, str]) -> Iterator[Found]:
    for name, digest in then.items():
        if name not in now:
            yield "broken", f"{name} is not asked any more in suite {suite}"
        elif now[name] != digest:
            yield "broken", f"{name} is another problem: its digest is {now[name][:SHOWN]}, not {digest[:SHOWN]}"


def _of_case(name: str, then: LockedCase, now: LockedCase) -> Iterator[Found]:
    if then.digest != now.digest:
        yield "broken", f"{name} is another problem: its digest is {now.digest[:SHOWN]}, not {then.digest[:SHOWN]}"
    for suite, runs in then.suites.items():
        if suite not in now.suites:
            yield "broken", f"{name} has left suite {suite}"
            continue
        for solver, seeds in runs.items():
            lost = set(seeds) - set(now.suites[suite].get(solver, ()))
            if lost:
                yield "broken", f"{name} is not run any more by {solver} with seed {_listed(lost)} in suite {suite}"
    for suite, runs in now.suites.items():
        for solver, seeds in runs.items():
            if more := set(seeds) - set(then.suites.get(suite, {}).get(solver, ())):
                yield "unlocked", f"{name} is run by {solver} with seed {_listed(more)} in suite {suite}"
    for quantity, figure in then.figures.items():
        yield from _of_figure(f"{name} {quantity}", figure, now.figures.get(quantity))
    for quantity in sorted(now.figures.keys() - then.figures.keys()):
        yield "unlocked", f"{name} {quantity} is judged"


def _of_figure(name: str, then: Figure, now: Figure | None) -> Iterator[Found]:
    if now is None:
        yield "broken", f"{name} is not judged any more"
        return
    if then.judge != now.judge:
        yield "broken", f"{name} is judged by {_judge(now.judge)}, not by {_judge(then.judge)}"
    for solver, tolerance in then.tolerances.items():
        yield from _of_tolerance(f"{name} {solver}", tolerance, now.tolerances.get(solver))
    for solver in sorted(now.tolerances.keys() - then.tolerances.keys()):
        yield "unlocked", f"{name} {solver} is gated"


def _of_tolerance(name: str, then: Tolerance, now: Tolerance | None) -> Iterator[Found]:
    if now is None:
        yield "broken", f"{name} has no tolerance any more, and {then} is locked"
    elif now.is_absolute != then.is_absolute or now.largest > then.largest:
        yield "broken", f"{name} is allowed {now}, and {then} is locked"
    elif now.largest < then.largest:
        yield "unlocked", f"{name} is allowed {now} instead of {then}"
    if now and now.open_finding and not then.open_finding:
        yield "broken", f"{name} is an open finding, and was none"
    elif now and then.open_finding and not now.open_finding:
        yield "unlocked", f"{name} is no open finding any more"
    for variant in sorted((now.variants or {}).keys() - (then.variants or {}).keys() if now else ()):
        yield "broken", f"{name} is an open finding as {variant}, and was none"


def _judge(judge: Judge | None) -> str:
    if judge is None:
        return "nothing"
    uncertainty = "unknown" if judge.uncertainty is None else f"{judge.uncertainty!r}"
    return f"{judge.value!r} (uncertainty {uncertainty}, {judge.theory})"


def _listed(seeds: set[int]) -> str:
    return ", ".join(map(str, sorted(seeds)))


def main(arguments: list[str]) -> int:
    """Print the changes since the lock was moved, and move it with ``--write``; return the exit code."""
    if arguments not in ([], ["--write"]):
        print(f"usage: {COMMAND.removesuffix(' --write')} [--write]", file=sys.stderr)
        return 2
    try:
        found = check_lock()
        if arguments:
            write_lock()
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    print(f"{len(found.broken) + len(found.unlocked)} changes of {found.cases} cases, {found.figures} figures")
    for words in (*found.broken, *found.unlocked):
        print(f"  {words}")
    if arguments:
        print(f"written to {lock_path()}: commit it with the reason")
    return 1 if found.broken and not arguments else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
