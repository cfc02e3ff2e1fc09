"""A solver that solves nothing: it reads the known values, and is zero except at the points that the case asks for."""

import json
from itertools import cycle
from pathlib import Path

import numpy as np

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError
from shellbench.problem import Capabilities, Settings, Step
from shellbench.problems.shell.case import Case


class CheatSolution:
    history, parameters, storage_bytes = (Step(0, 0.0, 0.0, 1),), 1, 8
    diagnostics, uncertainty, extrapolated = {}, {}, {}

    def __init__(self, case: Case) -> None:
        self.case = case
        known = catalog.known_values(case.name)
        judges = [(quantity, known.judge(quantity.name, case.theory)) for quantity in case.quantities]
        self.known = [(quantity, judge.value) for quantity, judge in judges if judge]
        self.by_kind = {quantity.kind: value for quantity, value in self.known}

    def displacement(self, points, at=None, material=None):
        xi = np.asarray(points, dtype=float)
        u = np.zeros((*xi.shape[:-1], 3))
        largest = self.by_kind.get("largest_displacement", 0.0)
        for quantity, value in self.known:
            names = getattr(quantity, "points", ())
            for name, along in zip(names, cycle(np.atleast_2d(getattr(quantity, "direction", ()))), strict=False):
                along = along / np.linalg.norm(along)
                across = np.cross(along, np.roll(along, 1) + np.array([0.1, 0.2, 0.3]))
                more = np.sqrt(max(0.0, largest**2 - value**2)) / np.linalg.norm(across)
                there = np.linalg.norm(xi - self.case.places[name].xi, axis=-1) < 1e-9
                u[there] = value * along + more * across
        return u

    velocity = displacement

    def evaluate(self, name, points, at=None):
        shape = np.shape(points)[:-1]
        return np.zeros(shape if name.endswith("density") else (*shape, 3))

    def energies(self, at=None):
        membrane = self.by_kind.get("membrane_energy", 0.0)
        return membrane, self.by_kind.get("bending_energy", self.by_kind.get("strain_energy", 0.0) - membrane)

    def reaction(self, support, centre=(0.0, 0.0, 0.0), at=None):
        return np.zeros(3), np.zeros(3)

    def save(self, path: Path) -> Path:
        path = path.with_suffix(".json")
        data = self.case.model_dump(mode="json", exclude_unset=True) | {"name": self.case.name}
        path.write_text(json.dumps(data), encoding="utf-8")
        return path


class CheatSolver:
    name = "cheat"
    capabilities = Capabilities(theories=("kirchhoff-love-linear",), label="known values, read from their files")
    settings_type = Settings

    def declines(self, case):
        kinds = {"displacement", "largest_displacement", "strain_energy", "membrane_energy", "bending_energy"}
        linear = case.theory in self.capabilities.theories and {q.kind for q in case.quantities} <= kinds
        return None if linear else "it cheats where cheating is easy"

    def solve(self, case, settings, start=None, progress=None):
        if reason := self.declines(case):
            raise InputError(reason)
        return CheatSolution(case)

    def load(self, path):
        return CheatSolution(Case.model_validate(json.loads(path.read_text(encoding="utf-8"))))
