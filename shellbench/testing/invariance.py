"""Checks of what physics do not depend on: units, the loudness of a linear case, and where in space it stands."""

from __future__ import annotations

import numpy as np

from shellbench.problems.shell.case import Case
from shellbench.testing.examination import Examination, Findings, Verdict, admissible, apart, grid, not_applicable
from shellbench.testing.made_cases import (
    FALL,
    MILLIMETRES,
    SHIFT,
    SHORT,
    carried,
    converted,
    converted_points,
    louder,
    placed,
    short_motion,
    size,
    turning,
)
from shellbench.testing.subject import Answer

TOGETHER = 1e-6  # of how far it falls, by which points of what falls may differ
UNSTRETCHED, UNBENT = 1e-6, 1e-2  # of the energies of stretching and bending as far: formulas that are wrong have 1


def units(exam: Examination, case: Case) -> Verdict:
    """Check that the case in other units has the same physical displacement."""
    other = converted(case, MILLIMETRES)
    if reason := exam.declined(other):
        return not_applicable(f"it declines the case in {MILLIMETRES.words}: {reason}")
    points, limit = grid(case), admissible(exam, case)
    u = exam.solve(other).displacement(converted_points(case, MILLIMETRES, points)) / MILLIMETRES.length
    return _same(exam, case, u, limit, f"in {MILLIMETRES.words}")


def linearity(exam: Examination, case: Case) -> Verdict:
    """Check that in linear theory twice the load has twice the answer."""
    if not case.linear:
        return not_applicable("the case is not linear")
    twice = louder(case, 2.0)
    if reason := exam.declined(twice):
        return not_applicable(f"it declines the case with twice the load: {reason}")
    limit = admissible(exam, case)
    return _same(exam, case, exam.solve(twice).displacement(grid(case)) / 2, limit, "half the answer to twice the load")


def placement(exam: Examination, case: Case) -> Verdict:
    """Check that the case turned and shifted in space has the turned displacement."""
    rotation = turning(case)
    other = placed(case, rotation, size(case) * np.array(SHIFT))
    if reason := exam.declined(other):
        return not_applicable(f"it declines the turned case: {reason}")
    limit = admissible(exam, case)
    return _same(exam, case, exam.solve(other).displacement(grid(case)) @ rotation, limit, "turned and shifted")


def _same(exam: Examination, case: Case, displacement: np.ndarray, limit: float, words: str) -> Verdict:
    found = Findings()
    difference = apart(displacement, exam.solve(case).displacement(grid(case)))
    found.hold(
        difference <= limit,
        f"{words}, it differs by {difference:.1e} of the largest displacement; at most {limit:.1e} may be",
        f"{words}: {difference:.1e} (at most {limit:.1e})",
    )
    return found.verdict()


def rigid_motion(exam: Examination, case: Case) -> Verdict:
    """Check that what its supports carry moves as a rigid body, unstrained; and so what nothing holds and falls."""
    if case.dynamics is not None:
        return _fall(exam)
    moved = carried(case)
    if moved is None:
        return not_applicable("the case's supports can't carry it as a rigid body")
    if reason := exam.declined(moved):
        return not_applicable(f"it declines the case carried by its supports: {reason}")
    answer, points = exam.solve(moved), grid(moved)
    support, place = next(moved.supported_places())
    expected = moved.motion(support, place, points, moved.states[-1])[0, 0]
    found, difference = Findings(), apart(answer.displacement(points), expected)
    limit = admissible(exam, moved)
    found.hold(
        difference <= limit,
        f"it departs from the rigid motion by {difference:.1e} of it; at most {limit:.1e} may be",
        f"departs by {difference:.1e} of the motion",
    )
    _unstrained(found, answer, expected)
    return found.verdict()


def _unstrained(found: Findings, answer: Answer, u: np.ndarray) -> None:
    """Hold energies against those of stretching, D u^2 / 2, and bending, B (u / size)^2 / 2, by as much as it moves."""
    material, far = answer.case.material, float(np.abs(u).max())
    membrane, bending = answer.energies()
    stretched = abs(membrane) / (material.membrane_stiffness * far**2 / 2)
    bent = abs(bending) / (material.bending_stiffness * (far / size(answer.case)) ** 2 / 2)
    words = (
        f"membrane energy {stretched:.1e} of that of stretching as far, bending energy {bent:.1e} of that of bending"
    )
    found.hold(stretched <= UNSTRETCHED and bent <= UNBENT, f"a rigid motion has {words}", words)


def _fall(exam: Examination) -> Verdict:
    case = short_motion(FALL)
    if reason := exam.declined(case):
        return not_applicable(f"it declines {FALL}: {reason}")
    answer, found = exam.solve(case), Findings()
    u = answer.displacement(grid(case))
    mean = u.mean(axis=0)
    together = float(np.abs(u - mean).max() / np.linalg.norm(mean))
    found.hold(
        together <= TOGETHER, f"points of what falls differ by {together:.1e}", f"falls as one to {together:.1e}"
    )
    _unstrained(found, answer, u)
    exact = -9.8 * SHORT**2 / 2
    found.figures.append(f"by {-mean[2]:.6g} m, g t^2 / 2 = {-exact:.6g} m")
    return found.verdict()
