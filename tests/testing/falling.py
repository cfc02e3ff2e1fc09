"""A right solver of what falls freely, u = -g t^2/2 e_z, and the same solver with one thing wrong."""

import json

import numpy as np

from shellbench.errors import InputError
from shellbench.problem import FIELDS, Capabilities, Settings, Step
from shellbench.problems.shell.case import Case

GRAVITY = 9.8  # m/s^2
FRAMES = 40
FAULTS = {"frames": "course", "displaced": "course", "turns": "rigid motion"}


class Fall:
    parameters, storage_bytes = 3, 24

    def __init__(self, case, fault):
        self.case, self.fault = case, fault
        self.history = (Step(0, 0.0, 0.0, 3, 0.0, phase="time"), Step(1, 1e-3, 0.0, 3, self._until, phase="time"))
        self.diagnostics = self.uncertainty = self.extrapolated = {}

    @property
    def _until(self):
        return self.case.dynamics.until

    def displacement(self, points, at=None, material=None):
        if material is not None:
            raise InputError("it takes no other material")
        t = self._until if at is None else at
        if self.fault == "frames":
            t = round(t / self._until * FRAMES) / FRAMES * self._until
        u = np.zeros((*np.shape(points)[:-1], 3))
        down = self.case.loads[0].acceleration  # in the units and along the axes of the case
        u[...] = np.array(down) * t**2 / 2
        if self.fault == "displaced":
            u += 1e-3 * np.array(down) * self._until**2
        if self.fault == "turns":
            x, corner = self.case.surface.derivatives(points, 1), self.case.surface.domain.lower
            angle, arm = 1e-3 * (t / self._until) ** 2, x[0, 0] - self.case.surface.position(corner)
            once = np.cross(x[1, 0], arm)  # about the first base vector, which is a unit vector along an edge
            u += np.sin(angle) * once + (1 - np.cos(angle)) * np.cross(x[1, 0], once)
        return u

    def velocity(self, points, at=None):
        t = self._until if at is None else at
        return np.zeros((*np.shape(points)[:-1], 3)) + np.array(self.case.loads[0].acceleration) * t

    def evaluate(self, name, points, at=None):
        if name not in FIELDS:
            raise KeyError(name)
        return np.zeros((*np.shape(points)[:-1], *((3,) if name.endswith("strain") else ())))

    def energies(self, at=None):
        return 0.0, 0.0

    def reaction(self, support, centre=(0.0, 0.0, 0.0), at=None):
        raise InputError("nothing is held")

    def save(self, path):
        file = path.with_suffix(".json")
        file.write_text(json.dumps(self.case.model_dump(mode="json", exclude_unset=True) | {"name": self.case.name}))
        return file


class FallingSolver:
    name = "falling"
    capabilities = Capabilities(theories=("kirchhoff-love-nonlinear",), label="closed form of a free fall")
    settings_type = Settings

    def __init__(self, fault=None):
        self.fault = fault

    def declines(self, case):
        free = case.dynamics is not None and not case.supports and not case.springs
        return None if free else "something holds it, or nothing moves"

    def solve(self, case, settings, start=None, progress=None):
        if reason := self.declines(case):
            raise InputError(f"it can't take {case.name}: {reason}")
        return Fall(case, self.fault)

    def load(self, path):
        try:
            return Fall(Case.model_validate(json.loads(path.read_text())), self.fault)
        except ValueError:
            raise InputError(f"{path} is no fall") from None


FALLING = FallingSolver()


def __getattr__(name):
    fault = name.removeprefix("WRONG_")
    if fault == name or fault not in FAULTS:
        raise AttributeError(name)
    return FallingSolver(fault)
