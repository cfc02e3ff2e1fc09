"""A right solver of simply supported rectangular plates, and the same solver with one thing wrong.

Navier's double sine series, w_mn = q_mn / (B (alpha_m^2 + beta_n^2)^2) with q_mn = 16 q / (pi^2 m n) for odd m and n
(Timoshenko & Woinowsky-Krieger, section 30). It also carries plates along as rigid bodies where their supports do,
and answers closed cylinders with a smooth field, so that their seam can be looked at.

``NAVIER`` is right; ``WRONG_x`` has the fault x, by the names of `FAULTS`.
"""

import itertools
import json
import pickle
import time
from pathlib import Path

import numpy as np
from pydantic import ConfigDict, Field

from shellbench.errors import InputError
from shellbench.problem import FIELDS, Capabilities, Progress, SeededSettings, Settings, Step
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.loads import AreaLoad

LENGTH = 0.1  # m^2: of the fault that depends on the unit of length
LONG = 300.0  # m: of another such fault, which states so large an uncertainty that nothing would be a fault
SOLVES = itertools.count()
GOLDEN = 0.5 * (5**0.5 - 1)  # fractions of its multiples lie apart: n in a row by more than 0.4 / n
FAULTS = {
    "name": "protocol",
    "two_refinements": "protocol",
    "raises_when_asked": "declining",
    "other_theory": "declining",
    "loose_settings": "bad input",
    "solves_anything": "bad input",
    "any_engine": "bad input",
    "no_empty": "answers",
    "single": "answers",
    "array_in_diagnostics": "answers",
    "any_material": "answers",
    "any_name": "fields",
    "neighbours": "batching",
    "nearest": "continuity",
    "slit": "seam",
    "random": "determinism",
    "ignored_seed": "determinism",
    "metres": "units",
    "metres_excused": "units",
    "quadratic": "linearity",
    "upright": "placement",
    "held_still": "rigid motion",
    "stretched": "rigid motion",
    "bent": "rigid motion",
    "diverges": "convergence",
    "frozen": "convergence",
    "half": "energies",
    "soft": "work",
    "sign": "strains",
    "slope": "derivatives",
    "no_history": "history",
    "clock": "history",
    "progress": "history",
    "pickle": "saving",
    "single_file": "saving",
    "two_files": "saving",
    "constant": "parameters",
    "eight_bytes": "storage",
}


class NavierSettings(Settings):
    terms: int = Field(31, ge=1, le=200, description="highest m and n")


class SeededNavierSettings(SeededSettings):
    terms: int = Field(31, ge=1, le=200)


class LooseSettings(Settings):
    model_config = ConfigDict(extra="ignore")
    terms: int = Field(31, ge=1, le=200)


class EngineSettings(NavierSettings):
    engine: str = "an engine 1.0"


class NavierSolution:
    def __init__(self, case: Case, coefficients: np.ndarray, fault: str | None, history=()) -> None:
        self.case, self.coefficients, self.fault = case, coefficients, fault
        self.history = history
        self.diagnostics = {"terms": np.zeros(2)} if fault == "array_in_diagnostics" else {}
        self.extrapolated = {}
        self.uncertainty = {case.primary.name: 1e6} if fault == "metres_excused" else {}
        x = case.surface.derivatives(np.asarray(case.surface.domain.lower), order=1)
        self.normal = np.cross(x[1, 0], x[0, 1])

    @property
    def parameters(self):
        return 7 if self.fault == "constant" else self.coefficients.size

    @property
    def storage_bytes(self):
        return 8 if self.fault == "eight_bytes" else self.coefficients.nbytes

    def _series(self, xi, derivative):
        """The series derived so often in each coordinate."""
        domain = self.case.surface.domain
        number = np.arange(1, len(self.coefficients) + 1)
        factors = []
        for axis in (0, 1):
            k = number * np.pi / domain.size[axis]
            phase = derivative[axis] * np.pi / 2
            factors.append(k ** derivative[axis] * np.sin((xi[..., axis, None] - domain.lower[axis]) * k + phase))
        return np.sum((factors[0] @ self.coefficients) * factors[1], axis=-1)

    def displacement(self, points, at=None, material=None):
        if material is not None and self.fault != "any_material":
            raise InputError("it takes no other material")
        xi = np.asarray(points, dtype=float)
        if self.fault == "no_empty" and xi.size == 0:
            raise ValueError("no points")
        if any(self.case.surface.domain.periodic):
            return self._around(xi)
        if self.fault == "nearest":
            domain = self.case.surface.domain
            cell = np.asarray(domain.size) / 64
            xi = np.asarray(domain.lower) + np.rint((xi - domain.lower) / cell) * cell
        u = self._series(xi, (0, 0))[..., None] * self.normal
        if self.fault == "neighbours":
            u = u * (1 + 1e-8 * (xi.size // 2))
        motions = [self.case.motion(s, p, xi)[0, 0] for s, p in self.case.supported_places() if s.motion]
        if motions and self.fault != "held_still":
            u = u + motions[0]
        return u.astype(np.float32) if self.fault == "single" and xi.ndim == 3 else u

    def _around(self, xi):
        x = self.case.surface.derivatives(xi, order=1)[1, 0]
        turned = x * np.sin(xi[..., :1])
        return turned + 0.1 * x * xi[..., :1] if self.fault == "slit" else turned

    def derivative(self, quantity, parameter):
        material, power = self.case.material, 2 if self.fault == "slope" else 3
        slopes = {
            "material.youngs_modulus": -1 / material.youngs_modulus,
            "material.thickness": -power / material.thickness,
        }
        return slopes[parameter] * quantity.measure(self)

    def velocity(self, points, at=None):
        return np.zeros((*np.shape(points)[:-1], 3))

    def evaluate(self, name, points, at=None):
        xi = np.asarray(points, dtype=float)
        if name not in FIELDS:
            if self.fault == "any_name":
                return np.zeros(xi.shape[:-1])
            raise KeyError(name)
        kappa = -np.stack([self._series(xi, d) for d in ((2, 0), (0, 2), (1, 1))], axis=-1)
        nu, stiffness = self.case.material.poissons_ratio, self.case.material.bending_stiffness
        k1, k2, k12 = np.moveaxis(kappa, -1, 0)
        density = stiffness / 2 * (k1**2 + k2**2 + 2 * nu * k1 * k2 + 2 * (1 - nu) * k12**2)
        return {
            "membrane_strain": np.zeros_like(kappa),
            "bending_strain": -kappa if self.fault == "sign" else kappa,
            "membrane_energy_density": np.zeros_like(density),
            "bending_energy_density": density / 2 if self.fault == "half" else density,
        }[name]

    def energies(self, at=None):
        first, second = (np.arange(1, len(self.coefficients) + 1) * np.pi / s for s in self.case.surface.domain.size)
        if self.fault in ("stretched", "bent") and self.case.supports[0].motion:
            far = np.abs(self.displacement(self.case.surface.domain.grid(3, 3))).max()
            material, side = self.case.material, self.case.surface.domain.size[0]
            if self.fault == "stretched":
                return material.membrane_stiffness * (1e-2 * far) ** 2, 0.0
            return 0.0, material.bending_stiffness * (far / side) ** 2
        modes = (first[:, None] ** 2 + second**2) ** 2 * self.coefficients**2
        return 0.0, float(
            self.case.material.bending_stiffness * np.prod(self.case.surface.domain.size) / 8 * modes.sum()
        )

    def reaction(self, support, centre=(0.0, 0.0, 0.0), at=None):
        raise InputError("it finds no reactions")

    def save(self, path: Path) -> Path:
        data = self.case.model_dump(mode="json", exclude_unset=True) | {"name": self.case.name}
        if self.fault == "pickle":
            path.with_suffix(".pkl").write_bytes(pickle.dumps((data, self.coefficients)))
            return path.with_suffix(".pkl")
        if self.fault == "two_files":
            np.save(path.with_name("beside.npy"), self.coefficients)
        kept = self.coefficients.astype(np.float32) if self.fault == "single_file" else self.coefficients
        steps = np.zeros(1000)  # what no displacement needs
        np.savez(path.with_suffix(".npz"), coefficients=kept, words=np.asarray(json.dumps(data)), steps=steps)
        return path.with_suffix(".npz")


class NavierSolver:
    name = "navier"
    capabilities = Capabilities(theories=("kirchhoff-love-linear",), label="Navier's series")
    settings_type: type[Settings] = NavierSettings
    refinements = ({"terms": 3}, {"terms": 7}, {"terms": 15})

    def __init__(self, fault: str | None = None) -> None:
        self.fault = fault
        if fault == "name":
            self.name = "somebody else"
        if fault == "two_refinements":
            self.refinements = self.refinements[:2]
        if fault == "loose_settings":
            self.settings_type = LooseSettings
        if fault == "any_engine":
            self.settings_type = EngineSettings
        if fault == "ignored_seed":
            self.settings_type = SeededNavierSettings

    def declines(self, case):
        if self.fault == "raises_when_asked" and case.dynamics is not None:
            raise AttributeError("no [path]")
        if self.fault == "other_theory" and case.name == "square_plate_nonlinear":
            return None
        if case.theory not in self.capabilities.theories:
            return "it is linear, and of Kirchhoff's plate"
        if case.name.startswith("sleeve_torque"):
            return None
        domain, edges = case.surface.domain, {name for s in case.supports for name in s.on}
        x = case.surface.derivatives(domain.grid(3, 3), order=2)
        flat = all(np.abs(x[key]).max() == 0 for key in ((2, 0), (1, 1), (0, 2)))
        square = np.allclose(np.sum(x[1, 0] * x[0, 1], axis=-1), 0) and flat
        unit = np.allclose(np.linalg.norm([x[1, 0], x[0, 1]], axis=-1), 1)
        held = edges == {"xi1_min", "xi1_max", "xi2_min", "xi2_max"} and all(len(s.held) == 3 for s in case.supports)
        uniform = all(
            isinstance(load, AreaLoad) and not any(isinstance(f, str) for f in load.vector) for load in case.loads
        )
        return None if square and unit and held and uniform else "it is no simply supported rectangle"

    def solve(self, case, settings, start=None, progress=None):
        began = time.perf_counter()
        if self.fault != "solves_anything" and (reason := self.declines(case)):
            raise InputError(f"it can't take {case.name}: {reason}")
        terms = 31 if self.fault == "frozen" else settings.terms
        number = np.arange(1, terms + 1)
        k1, k2 = (number * np.pi / side for side in case.surface.domain.size)
        x = case.surface.derivatives(np.asarray(case.surface.domain.lower), order=1)
        normal = np.cross(x[1, 0], x[0, 1])
        load = sum(float(case.evaluate(one.vector, np.zeros(2))[0, 0] @ normal) for one in case.loads)
        odd = np.where(number % 2 == 1, 1 / number, 0.0)
        squares = (k1[:, None] ** 2 + k2**2) ** 2
        w = 16 * load / np.pi**2 * np.outer(odd, odd) / (case.material.bending_stiffness * squares)
        w = w * self._spoilt(case, settings, w, k1, normal)
        if self.fault == "frozen":
            w = np.pad(w, (0, settings.terms))
        if progress:
            progress(Progress(5 if self.fault == "progress" else 1, 1, "done"))
        now = time.perf_counter() - began
        history = (Step(0, 0.0, -1.0, w.size), Step(1, now, -1.0, w.size))
        if self.fault == "no_history":
            history = ()
        if self.fault == "clock":
            history = (Step(0, now, -1.0, w.size), Step(1, 0.0, -1.0, w.size))
        return NavierSolution(case, w, self.fault, history)

    def _spoilt(self, case, settings, w, k1, normal):
        match self.fault:
            case "random":
                return 1 + 1e-8 * (next(SOLVES) * GOLDEN % 1)
            case "metres":
                return 1 + LENGTH * k1[0] ** 2
            case "metres_excused":  # next to nothing in metres, a fifth in millimetres
                return 1 + 0.2 * np.exp(-((LONG * k1[0]) ** 2))
            case "quadratic":
                return 1 + 1e-3 * np.abs(w).sum() / case.material.thickness
            case "upright":
                return 1 + 1e-3 * normal[2] ** 2
            case "diverges":
                return 1 + 2e-4 * settings.terms
            case "soft":
                return 1.1
        return 1.0

    def load(self, path):
        try:
            if self.fault == "pickle":
                data, coefficients = pickle.loads(path.read_bytes())
            else:
                with np.load(path, allow_pickle=False) as file:
                    data, coefficients = json.loads(str(file["words"])), file["coefficients"].astype(float)
                if self.fault == "two_files":
                    coefficients = np.load(path.with_name("beside.npy"))
        except Exception:
            raise InputError(f"{path} is no solution of navier") from None
        return NavierSolution(Case.model_validate(data), coefficients, self.fault)


NAVIER = NavierSolver


def __getattr__(name: str) -> NavierSolver:
    fault = name.removeprefix("WRONG_")
    if fault == name or fault not in FAULTS:
        raise AttributeError(name)
    return NavierSolver(fault)
