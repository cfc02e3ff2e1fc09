"""Whether a solver and its solutions have the parts of the protocol, each of its type."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any, get_args

from pydantic import ValidationError

from shellbench.model import one_sentence
from shellbench.problem import Capabilities, Device, SeededSettings, Settings, Solver
from shellbench.problems.shell.case import Theory

THEORIES: tuple[str, ...] = get_args(Theory)
DEVICES: tuple[str, ...] = get_args(Device)
SOLVER_METHODS = ("declines", "solve", "load")
METHODS = ("displacement", "velocity", "evaluate", "energies", "reaction", "save")
VALUES = ("case", "history", "parameters", "storage_bytes", "diagnostics", "uncertainty", "extrapolated")
OPTIONAL_SOLVER_PARTS = ("refinements",)
FEWEST_REFINEMENTS = 3  # settings by which a rate of convergence can be told


def solver_facts(solver: Solver) -> dict[str, Any]:
    """Return what a solver says about itself in plain data, and under `faults` what is wrong with it."""
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
    """Say what is wrong with a solver's capabilities."""
    if not isinstance(capabilities, Capabilities):
        return [f"capabilities is a {type(capabilities).__name__}, not a Capabilities"]
    faults = []
    if not capabilities.theories or not set(capabilities.theories) <= set(THEORIES):
        faults.append(f"its theories are {list(capabilities.theories)}, but must be among {', '.join(THEORIES)}")
    if not capabilities.devices or not set(capabilities.devices) <= set(DEVICES):
        faults.append(f"its devices are {list(capabilities.devices)}, but must be among {', '.join(DEVICES)}")
    if not isinstance(capabilities.label, str) or not capabilities.label.strip() or "\n" in capabilities.label:
        faults.append("its label is not one line of text")
    return faults


def refinement_faults(refinements: Any, settings_type: type[Settings]) -> list[str]:
    """Say what is wrong with the settings by which a solver is refined."""
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


def solution_faults(solution: Any) -> list[str]:
    """Say which parts of the protocol a solution lacks, and which are of another type."""
    lacking = [part for part in (*VALUES, *METHODS) if not hasattr(solution, part)]
    if lacking:
        return [f"a solution has no {', '.join(lacking)}"]
    faults = [f"a solution's {part} can't be called" for part in METHODS if not callable(getattr(solution, part))]
    for part in ("uncertainty", "extrapolated"):
        numbers = getattr(solution, part)
        if not isinstance(numbers, Mapping) or not all(math.isfinite(v) for v in numbers.values()):
            faults.append(f"a solution's {part} is no mapping of names to finite numbers")
    if not isinstance(solution.diagnostics, Mapping):
        faults.append("a solution's diagnostics is no mapping")
    else:
        try:
            json.dumps(dict(solution.diagnostics))
        except (TypeError, ValueError) as error:
            faults.append(f"a solution's diagnostics are no JSON values: {error}")
    return faults
