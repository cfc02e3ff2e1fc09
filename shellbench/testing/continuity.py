"""Checks that an answer is a continuous field: no jumps along lines, at a closed surface's seam, or in time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from shellbench.problems.shell.case import Case
from shellbench.testing.examination import Examination, Findings, Verdict, failed, grid, not_applicable, scattered

LINES = 12  # at random through the domain
SAMPLES, TIMES = 257, 65  # points a line, and instants of a motion, at first
ZOOM, LOOKS = 8, 4  # each closer look has so many points between two, around the largest jump
PROPORTION = 0.75  # exponent of the spacing with which jumps must fall: 1 in a Lipschitz field, 0 across a jump
UNFELT = 1e-9  # of the largest displacement: jumps below are rounding
ROUNDING = 1e-9


def continuity(exam: Examination, case: Case) -> Verdict:
    """Check that along random lines the largest jump between neighbouring samples falls about as their spacing."""
    answer = exam.solve(case)
    ends = scattered(case, 2 * LINES, seed=4).reshape(LINES, 2, 2)
    tracks = [
        jumps(lambda s, a=a, b=b: answer.displacement(a + s[:, None] * (b - a)))  # type: ignore[misc]
        for a, b in ends
    ]
    return _judged(tracks, f"along {LINES} lines")


def course(exam: Examination, case: Case) -> Verdict:
    """Check that a motion starts from rest where it was, and is continuous in time."""
    if case.dynamics is None:
        return not_applicable("nothing moves")
    answer, until = exam.solve(case), case.dynamics.until
    points = scattered(case, LINES, seed=10)

    def at_times(shares: np.ndarray) -> np.ndarray:
        return np.array([answer.ask("displacement", points, float(s * until)) for s in shares]).reshape(len(shares), -1)

    size = float(np.abs(answer.displacement(points)).max())
    start = float(np.abs(at_times(np.zeros(1))).max())
    if start > UNFELT * size:
        return failed(f"at t = 0 it is displaced by {start:.1e} m already")
    return _judged([jumps(at_times, TIMES)], "in time")


def _judged(tracks: list[tuple[float, float, float]], where: str) -> Verdict:
    """Judge the steps along tracks: first and last, and the largest displacement; see `jumps`."""
    found = Findings()
    size = float(np.max([largest for *_, largest in tracks]))  # not a number if one of them is not
    seen = [(f, last) for f, last, _ in tracks if f > UNFELT * size and last > UNFELT * size]
    if not np.isfinite(size):
        found.faults.append(f"it is not finite {where}")
    elif size == 0:
        found.unseen.append(f"the displacement is zero {where}")
    elif not seen:
        found.figures.append(f"no steps above rounding {where}")
    else:
        exponent, step = min((np.log(f / last) / (LOOKS * np.log(ZOOM)), last) for f, last in seen)
        found.hold(
            exponent >= PROPORTION,
            f"it jumps {where}: looked at {ZOOM**LOOKS} times closer, a step of {step:.1e} m is still there"
            f" (steps fall as spacing^{exponent:.2f}; a continuous answer's as spacing^1)",
            f"steps {where} fall as spacing^{exponent:.2f} or faster",
        )
    return found.verdict()


def jumps(track: Callable[[np.ndarray], np.ndarray], samples: int = SAMPLES) -> tuple[float, float, float]:
    """Return the largest step between neighbours on a track, the largest after closer looks, and the largest size.

    `track` gives displacements (n, ...) at numbers (n,) from 0 to 1.
    """
    low, high, count = 0.0, 1.0, samples
    steps_seen: list[float] = []
    largest = 0.0
    for look in range(LOOKS + 1):
        s = np.linspace(low, high, count)
        u = track(s).reshape(count, -1)
        steps = np.linalg.norm(np.diff(u, axis=0), axis=-1)
        at = int(np.argmax(steps))
        steps_seen.append(float(steps[at]))
        if look == 0:
            largest = float(np.linalg.norm(u, axis=-1).max())
        low, high, count = float(s[at]), float(s[at + 1]), ZOOM + 1
    return steps_seen[0], steps_seen[-1], largest


def seam(exam: Examination, case: Case) -> Verdict:
    """Check that a closed surface's answer is the same on both sides of its seam."""
    domain = case.surface.domain
    if not any(domain.periodic):
        return not_applicable(f"{case.name} is not closed")
    found, answer = Findings(), exam.solve(case)
    for axis in range(2):
        if domain.periodic[axis]:
            points = scattered(case, 40, seed=5)
            sides = []
            for bound in (domain.lower[axis], domain.upper[axis], domain.upper[axis] - 1e-12 * domain.size[axis]):
                points[:, axis] = bound
                sides.append(answer.displacement(points))
            size = np.abs(answer.displacement(grid(case))).max()
            gap = float(max(np.abs(sides[0] - sides[1]).max(), np.abs(sides[0] - sides[2]).max()) / (size or 1.0))
            found.hold(
                gap <= ROUNDING,
                f"across the seam of xi{axis + 1} it gapes by {gap:.1e} of the largest displacement",
                f"gap {gap:.1e} of the largest displacement",
            )
    return found.verdict()
