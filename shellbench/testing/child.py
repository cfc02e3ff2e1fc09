"""Checks that a solver and its solutions have the parts of the protocol, each of its type."""

from __future__ import annotations

import contextlib
import json
import math
import os
import sys
import time
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, get_args

import numpy as np
from pydantic import ValidationError

from shellbench.bench.plugins.inside import error_line, serve
from shellbench.bench.plugins.kinds import find_kind, kind_entries, problem_of
from shellbench.bench.plugins.registry import SolverEntry, load_solver
from shellbench.errors import InputError
from shellbench.problem import (
    Capabilities,
    Device,
    Progress,
    SeededSettings,
    Settings,
    Solution,
    Solver,
    answerable,
    why_declined,
)
from shellbench.problems.shell.quantities.energy_quantities import EnergyQuantity
from shellbench.protocol.schema import one_sentence

DEVICES: tuple[str, ...] = get_args(Device)
METHODS = {"shell": ("displacement", "velocity", "evaluate", "energies", "reaction"), "rope": ("state",)}
"""Of solutions, by kind of problem, beside `save`."""

VALUES = ("case", "history", "parameters", "storage_bytes", "diagnostics", "uncertainty", "extrapolated")
OPTIONAL_SOLVER_PARTS = ("refinements",)
FEWEST_REFINEMENTS = 3  # least number of settings for a rate of convergence
MOST_WORDS = 1000  # progress reports that are kept of one solve
PLAIN = (np.ndarray, np.generic, float, int, str, type(None))


def solver_facts(solver: Solver) -> dict[str, Any]:
    """Return a solver's description of itself as plain data; its faults are under `faults`."""
    faults: list[str] = []
    kind = solver.settings_type
    typed = isinstance(kind, type) and issubclass(kind, Settings)
    if not typed:
        faults.append("settings_type is no subclass of Settings")
    faults += [
        f"{part} can't be called" for part in ("declines", "solve", "load") if not callable(getattr(solver, part))
    ]
    faults += capability_faults(solver.capabilities)
    defaults: dict[str, Any] = {}
    if typed:
        try:
            defaults = kind().model_dump(mode="json")
        except ValidationError as error:
            faults.append(f"settings_type has no defaults: {one_sentence(error)}")
        except Exception as error:
            faults.append(f"the default settings are no plain data: {error}")
    refinements = getattr(solver, "refinements", ())
    faults += refinement_faults(refinements, kind) if typed else []
    seeded = typed and issubclass(kind, SeededSettings)
    return {
        "name": solver.name,
        "label": getattr(solver.capabilities, "label", ""),
        "theories": [str(t) for t in getattr(solver.capabilities, "theories", ())],
        "seeded": seeded,
        "defaults": defaults,
        "schema": kind.model_json_schema() if typed else {},
        "refinements": [dict(r) for r in refinements] if not refinement_faults(refinements, kind) else [],
        "optional": [part for part in OPTIONAL_SOLVER_PARTS if hasattr(solver, part)],
        "faults": faults,
    }


def capability_faults(capabilities: Any) -> list[str]:
    """Return the faults of a solver's capabilities."""
    if not isinstance(capabilities, Capabilities):
        return [f"capabilities is a {type(capabilities).__name__}, not a Capabilities"]
    faults = []
    theories: list[str] = []
    for name, entry in sorted(kind_entries().items(), key=lambda item: not item[1].own):
        if entry.own or not set(capabilities.theories) <= set(theories):  # other packages' kinds only if needed
            theories += find_kind(name).theories
    if not capabilities.theories or not set(capabilities.theories) <= set(theories):
        faults.append(f"its theories are {list(capabilities.theories)}, but must be among {', '.join(theories)}")
    if not capabilities.devices or not set(capabilities.devices) <= set(DEVICES):
        faults.append(f"its devices are {list(capabilities.devices)}, but must be among {', '.join(DEVICES)}")
    if not isinstance(capabilities.label, str) or not capabilities.label.strip() or "\n" in capabilities.label:
        faults.append("its label is not one line of text")
    return faults


def refinement_faults(refinements: Any, settings_type: type[Settings]) -> list[str]:
    """Return the faults of a solver's settings for refinement."""
    if not isinstance(refinements, tuple | list) or not all(isinstance(r, Mapping) for r in refinements):
        return ["refinements is no tuple of settings"]
    if refinements and len(refinements) < FEWEST_REFINEMENTS:
        return [f"it names {len(refinements)} refinements; a rate needs {FEWEST_REFINEMENTS}"]
    for refinement in refinements:
        try:
            settings_type.model_validate(dict(refinement))
        except Exception as error:
            reason = one_sentence(error) if isinstance(error, ValidationError) else str(error)
            return [f"its settings refuse a refinement: {reason}"]
    return []


def solution_faults(solution: Any, kind: str) -> list[str]:
    """Return the missing parts of the protocol in a solution of a kind of problem, and those of a wrong type."""
    methods = (*METHODS.get(kind, ()), "save")
    lacking = [part for part in (*VALUES, *methods) if not hasattr(solution, part)]
    if lacking:
        return [f"a solution has no {', '.join(lacking)}"]
    faults = [f"a solution's {part} can't be called" for part in methods if not callable(getattr(solution, part))]
    for part in ("uncertainty", "extrapolated"):
        numbers = getattr(solution, part)
        if not isinstance(numbers, Mapping) or not all(math.isfinite(v) for v in numbers.values()):
            faults.append(f"a solution's {part} is no mapping of names to finite numbers")
    unsettled = getattr(solution, "unsettled", None)
    if unsettled is not None and not (isinstance(unsettled, str) and unsettled.strip() and "\n" not in unsettled):
        faults.append("a solution's unsettled is neither None nor one clause")
    if not isinstance(solution.diagnostics, Mapping):
        faults.append("a solution's diagnostics is no mapping")
    else:
        try:
            json.dumps(dict(solution.diagnostics))
        except (TypeError, ValueError) as error:
            faults.append(f"a solution's diagnostics are no JSON values: {error}")
    return faults


def _worked() -> float:
    """Return the processor time of this process and its children, s, which is independent of other processes."""
    return sum(os.times()[:4])


class Child:
    """A solver and its solutions by key."""

    def __init__(self, solver: Solver) -> None:
        self.solver = solver
        self.solutions: dict[str, Solution] = {}

    def describe(self) -> dict[str, Any]:
        """Return the solver's description of itself, with its faults."""
        return solver_facts(self.solver)

    def declines(self, cases: list[dict[str, Any]]) -> list[tuple[str, Any, float]]:
        """Ask if each case is declined; return ("ok", answer) or ("raised", words), with seconds of processor time."""
        answers: list[tuple[str, Any, float]] = []
        for data in cases:
            case = problem_of(data)
            start = _worked()
            try:
                kind, answer = "ok", why_declined(self.solver, case)
                if not isinstance(answer, str | None):
                    kind, answer = "raised", f"returned {type(answer).__name__}, not a text or None"
            except Exception as error:
                kind, answer = "raised", f"raised {error_line(error)}"
            answers.append((kind, answer, _worked() - start))
        return answers

    def declines_energy(self, data: dict[str, Any]) -> str | None:
        """Return the reason why the solver declines the strain energy of a shell, or None."""
        ask = getattr(self.solver, "declines_quantity", lambda *_: None)
        return ask(problem_of(data), EnergyQuantity(name="strain_energy", kind="strain_energy"))

    def settings(self, given: Mapping[str, Any]) -> None:
        """Check settings; raises InputError if they are refused."""
        try:
            self.solver.settings_type.model_validate(dict(given))
        except ValidationError as error:
            raise InputError(one_sentence(error)) from None

    def solve(self, key: str, data: dict[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
        """Solve a case, keep the solution under the key, and return its facts."""
        self.settings(given)
        words: list[tuple[Any, Any, Any]] = []

        def tell(progress: Progress) -> None:
            if len(words) < MOST_WORDS:
                words.append((progress.step, progress.total, progress.message))

        settings = self.solver.settings_type.model_validate(dict(given))
        case, _ = answerable(self.solver, problem_of(data))
        start = time.perf_counter()
        self.solutions[key] = self.solver.solve(case, settings, progress=tell)
        return {**facts(self.solutions[key], case.kind), "progress": words, "took": time.perf_counter() - start}

    def load(self, key: str, path: str) -> dict[str, Any]:
        """Read a saved solution, keep it under the key, and return its facts."""
        self.solutions[key] = self.solver.load(Path(path))
        return facts(self.solutions[key], self.solutions[key].case.kind)

    def save(self, key: str, path: str) -> str:
        """Write a solution; return its path."""
        return str(self.solutions[key].save(Path(path)))

    def ask(self, key: str, method: str, *arguments: Any) -> Any:
        """Call a method of a solution; raises TypeError if it returns anything but arrays and numbers."""
        answer = getattr(self.solutions[key], method)(*arguments)
        parts = answer if isinstance(answer, tuple) else (answer,)
        odd = [type(part).__name__ for part in parts if not isinstance(part, PLAIN)]
        if odd:
            raise TypeError(f"{method} answers with {', '.join(odd)}, not with NumPy arrays or numbers")
        return answer

    def state(self, key: str, at: float) -> dict[str, Any]:
        """Return the state of a rope at a time, its arrays and numbers by name."""
        return {name: np.asarray(value) for name, value in vars(self.solutions[key].state(at)).items()}  # type: ignore[attr-defined]

    def values(self, key: str) -> dict[str, float]:
        """Return all quantities of a solution by name."""
        solution = self.solutions[key]
        return {quantity.name: float(quantity.measure(solution)) for quantity in solution.case.quantities}

    def derivatives(self, key: str) -> dict[str, float]:
        """Return the derivatives that a solution gives, of those that its case asks for, by name."""
        solution, found = self.solutions[key], {}
        for quantity in (q for q in solution.case.quantities if q.kind == "derivative"):
            with contextlib.suppress(Exception):
                found[quantity.name] = float(quantity.measure(solution))
        return found

    def headline(self, key: str) -> float:
        """Return the headline quantity of a solution."""
        solution = self.solutions[key]
        return float(solution.case.primary.measure(solution))


def facts(solution: Solution, kind: str) -> dict[str, Any]:
    """Return a solution's description of itself as plain data."""
    return {
        "faults": solution_faults(solution, kind),
        "history": [asdict(step) for step in solution.history],
        "parameters": _number(solution.parameters),
        "derivatives": callable(getattr(solution, "derivative", None)),
        "storage_bytes": _number(solution.storage_bytes),
        "unsettled": getattr(solution, "unsettled", None),
        "uncertainty": {str(k): float(v) for k, v in dict(solution.uncertainty).items()},
    }


def _number(value: Any) -> Any:
    """Return an integer unchanged, and any other value as text."""
    return int(value) if isinstance(value, int | np.integer) and not isinstance(value, bool) else repr(value)


def main(descriptor: str, name: str, target: str) -> None:
    """Serve one solver until the other end closes."""
    serve(descriptor, lambda: Child(load_solver(SolverEntry(name, target, "", ""))))


if __name__ == "__main__":
    main(*sys.argv[1:])
