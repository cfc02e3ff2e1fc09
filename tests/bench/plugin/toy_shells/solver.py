"""Solvers that answer a strip exactly, or in the way that their settings ask for."""

from __future__ import annotations

import contextlib
import inspect
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Literal

import numpy as np
import psutil
from pydantic import Field

from shellbench.errors import InputError, SolveFailure
from shellbench.problem import Capabilities, Progress, SeededSettings, Settings, Step
from shellbench.problems.shell.case import Case
from toy_shells import strip

Behaviour = Literal[
    "exact", "fail", "fail_with_partial", "refuse", "raise", "exit", "crash", "hang", "nan", "print", "leave_child",
    "disk_full", "allocate", "resumed", "edit_source", "kill_worker", "unsettled", "garble", "remove_folder",
    "none", "pipe",
]  # fmt: skip


class ToySettings(Settings):
    behaviour: Behaviour = "exact"
    factor: float = 1.0
    seconds: float = 0.0
    gate: str = ""  # a file: it waits, after its first word on progress, until there is one
    dtype: Literal["float64", "float32"] = "float64"


class NoisySettings(SeededSettings):
    noise: float = 1e-7
    checkpoint: str | None = Field(None, exclude=True)
    behaviour: Behaviour = "exact"


class StripSolution:
    def __init__(self, case: Case, factor: float) -> None:
        self.case = case
        self.factor = factor
        self.history = (Step(0, 0.1, -2.0, 4), Step(1, 0.2, float("nan"), 8))
        self.parameters = 4
        self.storage_bytes = 8
        self.diagnostics = {"residual": np.float64(1e-12), "energy_gap": float("nan")}
        self.uncertainty = {"centre": 1e-12}
        self.extrapolated = {"centre": 1.0}

    def _strip(self) -> tuple[float, float, float]:
        load = -sum(load.vector[2] for load in self.case.loads) * self.factor
        return load, self.case.material.bending_stiffness, self.case.surface.domain.size[0]

    def displacement(self, points, at=None, material=None):
        xi = np.asarray(points, dtype=float)
        zero = np.zeros(xi.shape[:-1])
        return np.stack([zero, zero, -strip.deflection(xi[..., 0], *self._strip())], axis=-1)

    def evaluate(self, name, points, at=None):
        xi = np.asarray(points, dtype=float)
        kappa = np.zeros((*xi.shape[:-1], 3))
        kappa[..., 0] = -strip.curvature(xi[..., 0], *self._strip())
        density = 0.5 * self._strip()[1] * kappa[..., 0] ** 2
        zero = np.zeros_like(kappa)
        return {
            "membrane_strain": zero,
            "bending_strain": kappa,
            "membrane_energy_density": zero[..., 0],
            "bending_energy_density": density,
        }[name]

    def energies(self, at=None):
        return 0.0, strip.energy(*self._strip(), self.case.surface.domain.size[1])

    def reaction(self, support, centre=(0.0, 0.0, 0.0), at=None):
        load, _, length = self._strip()
        return np.array([0.0, 0.0, load * length / 2]), np.zeros(3)

    def save(self, path: Path) -> Path:
        file = path.with_suffix(".json")
        data = {"case": self.case.model_dump(mode="json", exclude_unset=True), "factor": self.factor}
        file.write_text(json.dumps(data), encoding="utf-8")
        return file


def load(path: Path) -> StripSolution:
    data = json.loads(path.read_text(encoding="utf-8"))
    return StripSolution(Case.model_validate(data["case"]), data["factor"])


def misbehave(behaviour: Behaviour, case: Case) -> None:
    match behaviour:
        case "fail":
            raise SolveFailure("the strip would not converge")
        case "fail_with_partial":
            raise SolveFailure("the strip stopped half way", StripSolution(case, 0.5))
        case "refuse":
            raise InputError("setting 'behaviour' does not fit the case")
        case "raise":
            raise ZeroDivisionError("a bug in\nthe solver")
        case "exit":
            sys.exit(3)
        case "crash":
            os.kill(os.getpid(), signal.SIGSEGV)
        case "hang":
            time.sleep(3600)
        case "print":
            print("chatter on standard output")
            print("chatter on standard error", file=sys.stderr)
        case "leave_child":
            for apart in (False, True):
                sleep = [sys.executable, "-c", "import time; time.sleep(3600)"]
                subprocess.Popen(sleep, start_new_session=apart, env={})
        case "garble":  # all streams that this process has, that on which its server speaks among them
            for number in range(3, 64):
                with contextlib.suppress(OSError):
                    os.write(number, b'{"event": "ended"}\n')
        case "remove_folder":
            places = [frame.frame.f_locals.get("folder") for frame in inspect.stack()]
            shutil.rmtree(next(place for place in places if place is not None))
        case "pipe":  # where its record should be
            places = [frame.frame.f_locals.get("folder") for frame in inspect.stack()]
            os.mkfifo(next(place for place in places if place is not None) / "record.json")
            os._exit(0)
        case "edit_source":
            file = Path(strip.__file__)
            file.write_text(file.read_text(encoding="utf-8") + "\nEDITED = True\n", encoding="utf-8")
        case "allocate":
            np.ones(25_000_000)
        case "kill_worker":  # of a cluster: the parent of the keeper of the server that has forked this process
            os.kill(psutil.Process(os.getppid()).parent().ppid(), signal.SIGKILL)
        case "disk_full":
            raise OSError(28, "No space left on device")


class ExactSolver:
    name = "toy"
    capabilities = Capabilities(theories=("kirchhoff-love-linear",), label="closed form of a strip")
    settings_type = ToySettings

    def declines(self, case):
        return None if case.surface.kind == "plane" else "it solves planes only"

    def solve(self, case, settings, start=None, progress=None):
        for i in range(3):
            if progress:
                progress(Progress(i, 3, "a step"))
            while settings.gate and not Path(settings.gate).exists():
                time.sleep(0.02)
            time.sleep(settings.seconds / 3)
        misbehave(settings.behaviour, case)
        if settings.behaviour == "none":
            return None
        solution = StripSolution(case, float("nan") if settings.behaviour == "nan" else settings.factor)
        if settings.behaviour == "unsettled":
            solution.unsettled = "centre still moves\nby 2e-3"
        return solution

    def load(self, path):
        return load(path)


class NoisySolver:
    name = "toy-noisy"
    capabilities = Capabilities(
        theories=("kirchhoff-love-linear",), label="closed form with noise of a seed", devices=("cpu", "cuda")
    )
    settings_type = NoisySettings

    def declines(self, case):
        return None

    def solve(self, case, settings, start=None, progress=None):
        misbehave(settings.behaviour, case)
        factor = 1 + settings.noise * np.random.default_rng(settings.seed).standard_normal()
        solution = StripSolution(case, factor)
        solution.uncertainty = {"centre": 1e-9}
        solution.diagnostics = {"checkpoint": settings.checkpoint}
        if settings.behaviour == "resumed":
            solution.history = (Step(0, 1000.0, -1.0, 4),)
        return solution

    def load(self, path):
        return load(path)
