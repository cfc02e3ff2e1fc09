"""Checks of the answers' form: shapes, types, names, and that points do not know of each other."""

from __future__ import annotations

import numpy as np

from shellbench.problem import FIELDS
from shellbench.problems.shell.case import Case
from shellbench.testing.examination import Examination, apart, grid, scattered
from shellbench.testing.subject import Answer, Lost, NoAnswer, UnknownName
from shellbench.testing.verdict import Findings, Verdict

ROUNDING = 1e-9  # relative: what another order of summation may do, in single precision within a field too
SHAPES: tuple[tuple[int, ...], ...] = ((), (7,), (4, 3), (0,))
COMPONENTS = {name: (3,) if name.endswith("strain") else () for name in FIELDS}
NO_FIELD = "no_solver_knows_this_field"


def displacements(exam: Examination, case: Case) -> Verdict:
    """Check that displacement and velocity answer at points of any shape, finite on the closed domain."""
    found, answer = Findings(), exam.solve(case)
    found.faults += answer.facts["faults"]
    for shape in SHAPES:
        for what in ("displacement", "velocity"):
            fault = _shape_fault(answer, what, _points(case, shape), (*shape, 3))
            found.hold(fault is None, f"{what} {fault}")
    everywhere = grid(case)
    _finite(found, "displacement", everywhere, answer.displacement(everywhere))
    if case.dynamics is None:
        speed = np.abs(np.asarray(answer.ask("velocity", everywhere))).max()
        found.hold(speed == 0, f"a static case has a velocity of {speed:.2g} m/s")
    found.figures.append(f"points of {len(SHAPES)} shapes; finite at {len(everywhere)} points of the closed domain")
    return found.verdict()


def fields(exam: Examination, case: Case) -> Verdict:
    """Check that strains and energy densities answer at points of any shape, finite on the closed domain."""
    found, answer = Findings(), exam.solve(case)
    everywhere = grid(case)
    faults: dict[str, list[str]] = {}
    for name in FIELDS:
        for shape in SHAPES:
            fault = _shape_fault(answer, name, _points(case, shape), (*shape, *COMPONENTS[name]))
            if fault is not None:
                faults.setdefault(fault, []).append(name)
        _finite(found, name, everywhere, answer.field(name, everywhere))
    found.faults += [f"{', '.join(names)} {fault}" for fault, names in faults.items()]
    try:
        answer.field(NO_FIELD, everywhere[:1])
        found.faults.append("evaluate answers to a name that is none of the fields'")
    except UnknownName:
        pass
    energies = answer.energies()
    found.hold(bool(np.all(np.isfinite(energies))), f"its energies are {energies}")
    found.figures.append(f"{len(FIELDS)} fields at points of {len(SHAPES)} shapes, finite at {len(everywhere)} points")
    return found.verdict()


def _points(case: Case, shape: tuple[int, ...]) -> np.ndarray:
    return scattered(case, int(np.prod(shape, dtype=int)), seed=1).reshape(*shape, 2)


def _finite(found: Findings, what: str, points: np.ndarray, values: np.ndarray) -> None:
    broken = np.argwhere(~np.isfinite(values.reshape(len(points), -1)).all(axis=1))
    if broken.size:
        where = np.round(points[broken[0, 0]], 6).tolist()
        words = f"{what} is not finite at {broken.size} of {len(points)} points of the closed domain, such as {where}"
        found.faults.append(words)


def _shape_fault(answer: Answer, what: str, points: np.ndarray, expected: tuple[int, ...]) -> str | None:
    """Say what is wrong with an answer's form, if anything."""
    try:
        values = answer.ask("evaluate", what, points) if what in FIELDS else answer.ask(what, points)
    except Lost:
        raise
    except NoAnswer as trouble:
        return f"at points {points.shape}: {trouble}"
    if not isinstance(values, np.ndarray | np.generic):
        return f"answers with a {type(values).__name__}, not an array"
    if values.dtype != np.float64:
        return f"at points {points.shape} is of type {values.dtype}, not float64"
    return None if values.shape == expected else f"at points {points.shape} has shape {values.shape}, not {expected}"


def batching(exam: Examination, case: Case) -> Verdict:
    """Check that a point's answer does not depend on the points that it is asked with, or on their order."""
    found, answer = Findings(), exam.solve(case)
    points = np.concatenate([scattered(case, 60, seed=2), grid(case, 4)])
    together = answer.displacement(points)
    order = np.random.default_rng(3).permutation(len(points))
    shuffled = apart(answer.displacement(points[order]), together[order])
    alone = apart(np.stack([answer.displacement(p) for p in points[:20]]), together[:20])
    again = apart(answer.displacement(points), together)
    for words, difference in (("in another order", shuffled), ("one by one", alone), ("asked again", again)):
        found.hold(difference <= ROUNDING, f"{words}, points move by {difference:.1e} of the largest displacement")
    found.figures.append(f"largest relative difference {max(shuffled, alone, again):.1e}")
    return found.verdict()
