"""What the options of the pytest plug-in ask for, checked before anything is collected."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from shellbench.bench import catalog
from shellbench.bench.compare import near_zero
from shellbench.bench.identity import make_settings, parse_setting
from shellbench.bench.plan import FIRST_SEED
from shellbench.bench.reference import Tolerance
from shellbench.bench.registry import find_solver, load_solver
from shellbench.errors import InputError
from shellbench.problem import Problem, Quantity

DEFAULT_TOLERANCE = 1e-2  # relative: an engineer's percent, until the project states its own
WHOLE = 1.0  # relative error of the answer zero
CACHE = "shellbench"  # folder in pytest's cache


@dataclass(frozen=True)
class Tolerances:
    """Errors that are allowed of a solver for which shellbench freezes none.

    Attributes
    ----------
    general
        Relative error, where nothing narrower is given.
    narrower
        By case, or by case and quantity; absolute, in the quantity's unit, where its error is.
    """

    general: float = DEFAULT_TOLERANCE
    narrower: Mapping[tuple[str, str | None], float] = field(default_factory=dict)

    @classmethod
    def read(cls, texts: Sequence[str]) -> Tolerances:
        """Read ``TOL``, ``CASE=TOL`` and ``CASE.QUANTITY=TOL``; InputError in one sentence if it is none of these."""
        general = DEFAULT_TOLERANCE
        narrower: dict[tuple[str, str | None], float] = {}
        for text in texts:
            where, _, number = text.rpartition("=")
            tolerance = _positive(number, f"--shellbench-tolerance={text}")
            case_name, _, quantity = where.partition(".")
            if not quantity and tolerance >= WHOLE:
                raise InputError(f"--shellbench-tolerance={text}: a relative tolerance is below 1, or 0 would pass")
            if not where:
                general = tolerance
                continue
            case = catalog.find_case(case_name)
            asked = next((q for q in case.quantities if q.name == quantity), None)
            if quantity and asked is None:
                names = ", ".join(q.name for q in case.quantities)
                raise InputError(f"--shellbench-tolerance={text}: quantities of {case.name} are {names}")
            if asked and tolerance >= WHOLE and not is_absolute(case, asked):
                raise InputError(f"--shellbench-tolerance={text}: a relative tolerance is below 1, or 0 would pass")
            narrower[case.name, quantity or None] = tolerance
        return cls(general, narrower)

    def allowed(self, case: Problem, quantity: Quantity, solver: str) -> Tolerance | None:
        """Return the largest admissible error; what shellbench has frozen for the solver wins.

        None where only a relative tolerance is given, and the known value is so near zero that it says nothing.
        """
        frozen = catalog.tolerance(case.name, quantity.name, solver)
        own = self.narrower.get((case.name, quantity.name))
        if frozen is not None:
            return frozen
        if is_absolute(case, quantity):
            return None if own is None else Tolerance(absolute=own)
        return Tolerance(relative=own or self.narrower.get((case.name, None), self.general))


def is_absolute(case: Problem, quantity: Quantity) -> bool:
    """Whether errors of a quantity are given in its unit, because relative ones would say nothing."""
    judge = catalog.known_values(case.name).judge(quantity.name, case.theory)
    return quantity.absolute or (judge is not None and near_zero(judge, quantity))


@dataclass(frozen=True)
class GateOptions:
    """What is to be gated, and how.

    Attributes
    ----------
    settings
        By solver; of the others the defaults.
    timeout
        Seconds after which a run is stopped; None for none.
    """

    suites: tuple[str, ...]
    solvers: tuple[str, ...]
    tolerances: Tolerances
    settings: Mapping[str, Mapping[str, Any]]
    store: Path
    timeout: float | None

    @classmethod
    def checked(
        cls,
        config: pytest.Config,
        *,
        suites: Sequence[str],
        solvers: Sequence[str],
        tolerances: Sequence[str],
        settings: Sequence[str],
        store: str | None,
        timeout: str | None,
    ) -> GateOptions:
        """Check what was given as text.

        Raises
        ------
        pytest.UsageError
            In one sentence, if something is unknown, can't be read or is not installed.
        """
        if not solvers:
            raise pytest.UsageError("--shellbench needs a solver: --shellbench-solver=NAME")
        try:
            for suite in suites:
                if not catalog.cases_of(suite):
                    raise InputError(f"suite '{suite}' has no cases")
            given = _settings(settings, solvers)
            for name in solvers:
                entry = find_solver(name)
                if not hasattr(config, "workerinput"):  # the process that started this one has tried it
                    make_settings(load_solver(entry), given.get(name, {}), FIRST_SEED, "cpu")
            return cls(
                suites=tuple(suites),
                solvers=tuple(solvers),
                tolerances=Tolerances.read(tolerances),
                settings=given,
                store=_folder(config, store),
                timeout=None if timeout is None else _positive(timeout, f"--shellbench-timeout={timeout}"),
            )
        except InputError as error:
            raise pytest.UsageError(" ".join(f"shellbench: {error}".split())) from None

    def headline(self, root: Path) -> str:
        """Say in one line what is gated, for the head of pytest's output; `root` is the project's folder."""
        store = self.store.relative_to(root) if self.store.is_relative_to(root) else self.store
        own = self.tolerances.narrower.items()
        given = ", ".join(f"{case}{f'.{name}' if name else ''} {tolerance:g}" for (case, name), tolerance in own)
        narrower = f" ({given})" if given else ""
        return (
            f"shellbench: {_list('suite', self.suites)}, {_list('solver', self.solvers)}, relative tolerance "
            f"{self.tolerances.general:g}{narrower} where shellbench freezes none, store {store}"
        )


def _settings(texts: Sequence[str], solvers: Sequence[str]) -> dict[str, dict[str, Any]]:
    given: dict[str, dict[str, Any]] = {}
    for text in texts:
        name, key, value = parse_setting(text)
        if name not in solvers:
            raise InputError(f"--shellbench-set={text}: solver '{name}' is not gated here")
        given.setdefault(name, {})[key] = value
    return given


def _folder(config: pytest.Config, store: str | None) -> Path:
    if store is not None:
        return config.invocation_params.dir / store
    cache: pytest.Cache | None = getattr(config, "cache", None)  # there is none with -p no:cacheprovider
    if cache is None:
        raise InputError("pytest's cache is off, so name a folder for finished runs: --shellbench-store=DIR")
    try:
        return cache.mkdir(CACHE)
    except OSError as error:
        reason = error.strerror or "no folder"
        raise InputError(
            f"pytest's cache can't be written ({reason}), so name a folder for finished runs: --shellbench-store=DIR"
        ) from None


def _positive(text: str, option: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0 < number < math.inf:
        raise InputError(f"{option}: found '{text}', but expected a positive number")
    return number


def _list(what: str, names: Sequence[str]) -> str:
    return f"{what}{'s' if len(names) > 1 else ''} {', '.join(names)}"
