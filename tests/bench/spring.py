"""A plate that moves as a block on a non-linear spring: cases of the non-linear theory, and solutions that may end early."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from shellbench.errors import InputError, SolveFailure
from shellbench.problem import Capabilities, Settings, Step
from shellbench.problems.shell.case import Case, build_case

FIRST, SECOND, END = 10.0, 20.0, 30.0  # displacements at which the load turns, and where the path ends, m
REASON = "no equilibrium was found at load factor 0.61; the last converged load factor is 0.5"

PLATE: dict[str, Any] = {
    "title": "Plate on a spring",
    "theory": "kirchhoff-love-nonlinear",
    "surface": {"kind": "plane", "xi1": [0, 1], "xi2": [0, 1]},
    "material": {"youngs_modulus": 1e6, "poissons_ratio": 0.0, "thickness": 0.1},
    "points": {"middle": [0.5, 0.5]},
    "supports": [{"name": "rim", "on": ["xi1_min", "xi1_max"]}],
    "loads": [{"kind": "area", "vector": [0, 0, "t"]}],
}


def displacement(name: str, at: float = 1.0, **more: Any) -> dict[str, Any]:
    return {"name": name, "kind": "displacement", "points": ["middle"], "direction": [0, 0, 1], "at": at, **more}


def loaded_case() -> Case:
    """The load is given; the plate rises by t squared."""
    quantities = [
        displacement("half", 0.5),
        displacement("full", 1.0, primary=True),
        {"name": "bending", "kind": "bending_energy", "at": 0.5},
        {"name": "energy", "kind": "strain_energy"},
    ]
    data = PLATE | {"path": {"states": [0.25]}, "quantities": quantities}
    return build_case(data, "loaded", "loaded.toml")


def snapping_case() -> Case:
    """The displacement is given; the load turns at two of its values."""
    quantities = [
        displacement("rise", END, primary=True),
        {"name": "limit", "kind": "limit_point", "scale": 100},
        {"name": "limit_rise", "kind": "limit_point", "gives": "displacement", "unit": "m"},
        {"name": "valley", "kind": "limit_point", "number": 2, "scale": 100},
        {"name": "load_15", "kind": "load", "at": 15, "scale": 100},
    ]
    path = {"control": "displacement", "quantity": "rise", "until": END, "states": [FIRST, SECOND]}
    return build_case(PLATE | {"path": path, "quantities": quantities}, "snapping", "snapping.toml")


def load_at(w: float) -> float:
    """A load factor whose slope in w is (w - FIRST) (w - SECOND), times a constant."""
    return (w**3 / 3 - (FIRST + SECOND) / 2 * w**2 + FIRST * SECOND * w) / 1000


def rise(case: Case, mark: float) -> float:
    return mark**2 if case.path.quantity is None else mark


class SpringSolution:
    """The plate as far as a mark of its path."""

    parameters = 1
    storage_bytes = 8

    def __init__(self, case: Case, upto: float | None = None, spoilt: float | None = None) -> None:
        self.case = case
        self.upto = case.path.until if upto is None else upto
        self.spoilt = spoilt  # mark of a state that is not finite
        self.uncertainty: Mapping[str, float] = {}
        self.extrapolated: Mapping[str, float] = {}
        self.diagnostics: Mapping[str, Any] = {"reached": np.float64(self.upto), "bad": float("inf")}
        names = [q.name for q in case.quantities if q.kind == "displacement"]
        steps = np.linspace(0, case.path.until, 61)[1:]
        self.history = (
            Step(0, 0.1, -1.0, 10, quantities={case.primary.name: 0.9}),
            *(
                Step(
                    iteration=i,
                    seconds=0.1 * i,
                    energy=-float(mark),
                    unknowns=20,
                    at=float(mark if case.path.quantity is None else load_at(mark)),
                    quantities=dict.fromkeys(names, rise(case, float(mark))),
                    phase="path",
                    iterations=2 + i % 2,
                )
                for i, mark in enumerate(steps)
                if mark <= self.upto * (1 + 1e-12)
            ),
        )

    def _rise(self, at: float | None) -> float:
        mark = self.upto if at is None else at
        if mark > self.upto or mark == 0:
            raise InputError(f"{self.case.name}: solved at {self.upto:g}, not at {mark:g}")
        return math.nan if mark == self.spoilt else rise(self.case, mark)

    def displacement(self, points, at=None, material=None):
        xi = np.asarray(points, dtype=float)
        zero = np.zeros(xi.shape[:-1])
        return np.stack([zero, zero, zero + self._rise(at)], axis=-1)

    def energies(self, at=None):
        return self._rise(at), 2 * self._rise(at)

    def save(self, path: Path) -> Path:
        file = path.with_suffix(".txt")
        file.write_text(f"{self.upto}", encoding="utf-8")
        return file


class BreakingSolver:
    """Converges half of the way."""

    name = "breaking"
    capabilities = Capabilities(theories=("kirchhoff-love-nonlinear",), label="a spring that breaks")
    settings_type = Settings

    def declines(self, case):
        return None

    def solve(self, case, settings, start=None, progress=None):
        raise SolveFailure(REASON, SpringSolution(case, 0.5 * case.path.until))

    def load(self, path):
        raise NotImplementedError


class DecliningSolver(BreakingSolver):
    """Answers all but energies."""

    def declines_quantity(self, case, quantity):
        return "springs have one energy" if "energy" in quantity.kind else None

    def solve(self, case, settings, start=None, progress=None):
        return SpringSolution(case)
