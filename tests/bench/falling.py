"""Free fall in closed form: solutions of the suite's own case, by Newton's law and as the published functional has it."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from shellbench.errors import InputError, SolveFailure
from shellbench.problem import Capabilities, Settings, Step
from shellbench.problems.shell.case import Case

GRAVITY = np.array([0.0, 0.0, -9.8])
STEPS = 48
REASON = "no equilibrium of the step from 0.604 s was found; the time step was cut to 1e-7 s"


class FallSolution:
    """u = g t^2 / 2 as far as a time; with `reversed_inertia` u = g (T t - t^2 / 2), the stationary point of the sum."""

    parameters = 3
    storage_bytes = 24

    def __init__(self, case: Case, upto: float | None = None, reversed_inertia: bool = False) -> None:
        assert case.dynamics is not None
        self.case = case
        self.until = case.dynamics.until
        self.upto = self.until if upto is None else upto
        self.reversed_inertia = reversed_inertia
        self.asked: list[tuple[str, float]] = []
        self.uncertainty: Mapping[str, float] = {}
        self.extrapolated: Mapping[str, float] = {}
        self.diagnostics: Mapping[str, Any] = {"energy_drift": 1e-12}
        times = np.linspace(0, self.until, STEPS + 1)[1:]
        self.history = (
            Step(0, 0.1, 0.0, 3),
            *(
                Step(i, 0.1 * i, 1e-12, 3, at=float(t), phase="time", iterations=1)
                for i, t in enumerate(times, start=1)
                if t <= self.upto * (1 + 1e-12)
            ),
        )

    def _time(self, what: str, at: float | None) -> float:
        t = self.upto if at is None else at
        if not 0 <= t <= self.upto * (1 + 1e-12):
            raise InputError(f"{self.case.name}: solved up to {self.upto:g} s, not to {t:g} s")
        self.asked.append((what, t))
        return t

    def displacement(self, points, at=None, material=None):
        t = self._time("displacement", at)
        fallen = self.until * t - t**2 / 2 if self.reversed_inertia else t**2 / 2
        return np.zeros((*np.shape(points)[:-1], 3)) + fallen * GRAVITY

    def velocity(self, points, at=None):
        t = self._time("velocity", at)
        return np.zeros((*np.shape(points)[:-1], 3)) + (self.until - t if self.reversed_inertia else t) * GRAVITY

    def evaluate(self, name, points, at=None):
        shape = np.shape(points)[:-1]
        return np.zeros(shape if name.endswith("density") else (*shape, 3))

    def energies(self, at=None):
        self._time("energies", at)
        return 0.0, 0.0

    def reaction(self, support, centre=(0.0, 0.0, 0.0), at=None):
        return np.zeros(3), np.zeros(3)

    def save(self, path: Path) -> Path:
        file = path.with_suffix(".json")
        data = {"case": self.case.model_dump(mode="json", exclude_unset=True), "upto": self.upto}
        file.write_text(json.dumps(data), encoding="utf-8")
        return file


class FallingSolver:
    """Free fall by Newton's law."""

    name = "falling"
    capabilities = Capabilities(theories=("kirchhoff-love-nonlinear",), label="free fall in closed form")
    settings_type = Settings

    def declines(self, case):
        return None if case.dynamics is not None and not case.supports else "it lets things fall only"

    def solve(self, case, settings, start=None, progress=None):
        return FallSolution(case)

    def load(self, path):
        data = json.loads(path.read_text(encoding="utf-8"))
        return FallSolution(Case.model_validate(data["case"]), data["upto"])


class StoppingSolver(FallingSolver):
    """Stops a little behind the middle."""

    def solve(self, case, settings, start=None, progress=None):
        raise SolveFailure(REASON, FallSolution(case, case.dynamics.until * 29 / STEPS))
