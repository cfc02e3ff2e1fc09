"""A spring that a weight pulls: u = F / k (Hooke)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from shellbench.problem import Capabilities, Kind, Problem, Quantity, Settings, Step


class Extension(Quantity):
    kind: Literal["extension"] = "extension"

    def measure(self, solution: Any) -> float:
        return solution.extension


class Spring(Problem):
    kind: Literal["spring"] = "spring"
    theory: Literal["hooke"] = "hooke"
    stiffness: float  # N/m
    force: float  # N
    quantities: tuple[Extension, ...]


@dataclass(frozen=True)
class SpringSolution:
    case: Spring
    extension: float
    parameters: int = 1
    storage_bytes: int = 8
    history: tuple[Step, ...] = (Step(0, 0.0, 0.0, 1),)
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    extrapolated: Mapping[str, float] = field(default_factory=dict)
    diagnostics: Mapping[str, Any] = field(default_factory=dict)

    def save(self, path: Path) -> Path:
        file = path.with_suffix(".json")
        file.write_text(json.dumps([self.case.data() | {"name": self.case.name}, self.extension]), encoding="utf-8")
        return file


class HookeSettings(Settings):
    factor: float = 1.0


class HookeSolver:
    name = "hooke"
    capabilities = Capabilities(theories=("hooke",), label="a spring in closed form")
    settings_type = HookeSettings

    def declines(self, case):
        return None if isinstance(case, Spring) else "it solves springs only"

    def solve(self, case, settings, start=None, progress=None):
        return SpringSolution(case, settings.factor * case.force / case.stiffness)

    def load(self, path):
        data, extension = json.loads(path.read_text(encoding="utf-8"))
        return SpringSolution(Spring.model_validate(data), extension)


KIND = Kind(problem=Spring, keep=lambda solution, case: None)
