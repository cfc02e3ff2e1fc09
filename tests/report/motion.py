"""A synthetic store of cloth: records measured from formulas. No solver ran; no figure is a result."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.reference import KnownValue, KnownValues
from shellbench.bench.judge.compare import row_of
from shellbench.bench.judge.row import Row
from shellbench.bench.store.current import CurrentRun
from shellbench.bench.store.measuring import measured
from shellbench.bench.store.record import Record
from shellbench.errors import InputError
from shellbench.problem import Step
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.records import sampling, self_intersection
from tests.report.conftest import Store, identity, keep, known_value, missing_row

THEORY = "kirchhoff-love-nonlinear"
REASON = "no equilibrium of the step from 0.604 s was found"
G = 9.8
BROKEN = 0.604  # s, where the failed run ends
OFFSET = 2e-3  # m: by how much the napkin of the seeded solver is beside the other at the end, everywhere
CRITICAL = 0.08  # twist at which the sleeve buckles
STEPS = 40
SECOND_ORDER = 1e-6  # s, of a difference quotient in time

Field = Callable[[np.ndarray, float], np.ndarray]


def fall(xi: np.ndarray, t: float) -> np.ndarray:
    return np.zeros((*xi.shape[:-1], 3)) + np.array([0, 0, -G * t**2 / 2])


def published_fall(xi: np.ndarray, t: float) -> np.ndarray:
    return np.zeros((*xi.shape[:-1], 3)) + np.array([0, 0, -G * (t - t**2 / 2)])


def swing(xi: np.ndarray, t: float) -> np.ndarray:
    angle = 0.5 * np.pi * np.sin(2.2 * t) ** 2
    x = xi[..., 0]
    return np.stack([x * (np.cos(angle) - 1), 0 * x, -x * np.sin(angle)], axis=-1)


def sway(xi: np.ndarray, t: float) -> np.ndarray:
    far = 1 - np.exp(-np.hypot(xi[..., 0], 1 - xi[..., 1]) / 0.2)
    y = -G * t**2 / 2 * 0.6 * far
    return np.stack([-0.2 * t * xi[..., 0] * far, y, 0 * y], axis=-1)


def beside_it(xi: np.ndarray, t: float) -> np.ndarray:
    return sway(xi, t) + np.array([OFFSET * t / 0.5, 0, 0])


def twist(xi: np.ndarray, t: float) -> np.ndarray:
    theta, y = xi[..., 0], xi[..., 1]
    turned = theta - t * (y - 0.5)
    r = 0.25 * (1 - (0.2 * np.sqrt(t - CRITICAL) * np.cos(5 * turned) * np.sin(np.pi * y) if t > CRITICAL else 0))
    x = np.stack([r * np.cos(turned), y, r * np.sin(turned)], axis=-1)
    return x - np.stack([0.25 * np.cos(theta), y, 0.25 * np.sin(theta)], axis=-1)


def torque(t: float) -> float:
    return 0.9 * t if t <= CRITICAL else 0.9 * CRITICAL + 0.25 * (t - CRITICAL)


class Formula:
    """A motion, or a path, by a formula, as far as a time."""

    parameters = 1000
    storage_bytes = 8000
    uncertainty: Mapping[str, float] = {}
    extrapolated: Mapping[str, float] = {}
    diagnostics: Mapping[str, Any] = {}

    def __init__(self, case: Case, field: Field, upto: float | None = None, drift: float = 0.0) -> None:
        self.case, self.field = case, field
        until = case.path.until if case.dynamics is None else case.dynamics.until
        self.upto = until if upto is None else upto
        phase = "path" if case.dynamics is None else "time"
        times = [float(t) for t in np.linspace(0, until, STEPS + 1)[1:] if t < self.upto] + [self.upto]
        steps = [
            Step(i, 0.1 * i, drift * t, 3000, at=t, phase=phase, iterations=3, quantities=self._torques(t))
            for i, t in enumerate(times, start=1)
        ]
        if case.dynamics is None:
            steps.append(Step(99, 9.0, 0.0, 3000, at=CRITICAL, phase="critical", quantities=self._torques(CRITICAL)))
        self.history = tuple(steps)

    def _torques(self, t: float) -> dict[str, float]:
        return {q.name: torque(t) for q in self.case.quantities if q.kind == "torque"}

    def _time(self, at: float | None) -> float:
        t = self.upto if at is None else at
        if t > self.upto * (1 + 1e-9):
            raise InputError(f"{self.case.name}: solved up to {self.upto:g} s, not to {t:g} s")
        return t

    def displacement(self, points, at=None, material=None):
        return self.field(np.asarray(points, dtype=float), self._time(at))

    def velocity(self, points, at=None):
        xi, t, h = np.asarray(points, dtype=float), self._time(at), SECOND_ORDER
        return (self.field(xi, t + h) - self.field(xi, t - h)) / (2 * h)

    def energies(self, at=None):
        t = self._time(at)
        return 0.3 * t**2, 0.01 * t

    def reaction(self, support, centre=(0.0, 0.0, 0.0), at=None):
        t = self._time(at)
        return np.array([0.3 * t, 0.0, 0.2]), np.array([0.0, torque(t), 0.0])

    def save(self, path: Path) -> Path:
        file = path.with_suffix(".txt")
        file.write_text("formula", encoding="utf-8")
        return file


def make_record(
    folder: Path, case: Case, solver: str, solution: Formula, seed: int | None = None, reason: str | None = None
) -> Record:
    run_id = f"{case.name}-{solver}-{seed}"
    parts = folder / f"parts-{run_id}"
    parts.mkdir()
    found, _ = measured(solution, case, parts)
    (parts / "fields.npz").rename(folder / f"{run_id}.fields.npz")
    found |= {"fields_file": f"{run_id}.fields.npz", "solution_file": None}
    status = "ok" if reason is None else "failed"
    return keep(
        folder, run_id, case, identity(case, solver, {}, seed), status=status, reason=reason, seconds=2.5, **found
    )


def judge(quantity: str, value: float, uncertainty: float) -> KnownValue:
    return known_value(quantity, value, uncertainty=uncertainty, theory=THEORY)


def synthetic_known() -> dict[str, KnownValues]:
    facts = {"uncertainty": 0.01, "theory": THEORY, "origin": "synthetic splines"}
    second = known_value("corner_x_200ms", 0.97, "origin", **facts)
    fallen = (judge("fall_500ms", G / 8, 0.0), judge("fall_1000ms", G / 2, 0.0), judge("strain_energy_500ms", 0.0, 0.0))
    critical = (judge("critical_twist", CRITICAL, 1e-4), judge("critical_torque", torque(CRITICAL), 1e-4))
    return {
        "free_fall": KnownValues(values=fallen),
        "pendulum_strip": KnownValues(),
        "napkin_plane": KnownValues(values=(judge("corner_x_200ms", 0.96, 2e-3), second)),
        "sleeve_twist": KnownValues(values=(*critical, judge("torque_300mrad", torque(0.3), 1e-3))),
    }


def make_motion_store(folder: Path) -> Store:
    """Free fall by three solvers, a pendulum of which one run failed and one is missing, a napkin, a twisted sleeve."""
    folder.mkdir(parents=True, exist_ok=True)
    falling, pendulum, napkin, sleeve = map(
        catalog.named_case, ("free_fall", "pendulum_strip", "napkin_plane", "sleeve_twist")
    )
    with pytest.MonkeyPatch.context() as coarse:
        coarse.setattr(sampling, "PICTURE", 13)
        coarse.setattr(sampling, "RESOLUTIONS", (10,))
        coarse.setattr(self_intersection, "crossings", lambda points, triangles: ())  # no report shows it
        records = [
            make_record(folder, falling, "fem", Formula(falling, fall)),
            make_record(folder, falling, "ndf", Formula(falling, fall), 0),
            make_record(folder, falling, "ndf-published", Formula(falling, published_fall), 0),
            make_record(folder, pendulum, "fem", Formula(pendulum, swing, drift=1e-5)),
            make_record(folder, pendulum, "ndf", Formula(pendulum, swing, BROKEN), 0, REASON),
            make_record(folder, napkin, "fem", Formula(napkin, sway, drift=3e-5)),
            make_record(folder, napkin, "ndf", Formula(napkin, beside_it, drift=-2e-4), 0),
            make_record(folder, sleeve, "fem", Formula(sleeve, twist)),
        ]
    known = synthetic_known()
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(catalog, "known_values", lambda name: known[name])
        rows: list[Row] = []
        for record in records:
            case = catalog.named_case(record.case_name)
            rows += [row_of(CurrentRun(record, case, {}, {"cloth": ""}), q) for q in case.quantities]
    rows.append(missing_row(pendulum, "ndf-published", 0, suite="cloth", suites=("cloth",)))
    return Store(folder, tuple(records), tuple(rows), known)
