"""Checks of a solver's parts, of the cases and settings that it refuses, and of the form of its answers.

The checks of an answer are:

- shapes, types and names, and the independence of points from each other;
- its history and its progress reports;
- the same answer in another process, and nearly the same with another seed;
- a continuous field: no jumps along lines, at a closed surface's seam, or in time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from shellbench.bench.plugins.subject import Lost, NoAnswer, Raised, Refused, SolveFailed, UnknownName
from shellbench.bench.store.task import case_data
from shellbench.problem import FIELDS, Problem
from shellbench.problems.shell.case import Case
from shellbench.protocol.engine import ENGINE
from shellbench.testing.examination import (
    Examination,
    Findings,
    Verdict,
    deviation,
    failed,
    fingerprint,
    grid,
    not_applicable,
    scattered,
    seed_difference,
)
from shellbench.testing.subject import RemoteSolution, solve_in

SLOW = 10.0  # seconds of processor time to decline a case, because a table asks for every pair
LONGEST_CLAUSE = 300  # characters: it stands in a line of a list
NO_SETTING = "no_solver_has_this_setting"
NO_VALUE = {"no_setting": "takes this table"}
NO_ENGINE = "an engine of another version 0.0"
BOUNDS = {"exclusiveMinimum": 0.0, "minimum": -1.0, "exclusiveMaximum": 0.0, "maximum": 1.0}
"""Keys of a JSON schema that bound a number, each with the step from it that is out of bounds."""
SUMMATION = 1e-9  # relative: effect of another order of summation, also in single precision within a field
SHAPES: tuple[tuple[int, ...], ...] = ((), (7,), (4, 3), (0,))
COMPONENTS = {name: (3,) if name.endswith("strain") else () for name in FIELDS}
NO_MATERIAL = {"no_material_has_this_constant": 1.0}
NO_FIELD = "no_solver_knows_this_field"
SLACK = 1.5  # largest time in a history, as a multiple of the solve's measured wall time
SAME = 1e-10  # relative difference of two runs with one seed
NEAR = 0.1  # largest difference of two runs with different seeds; beyond it they answer different questions
LINES = 12  # at random through the domain
LINE_SAMPLES, TIMES = 257, 65  # points a line, and instants of a motion, at first
ZOOM, LOOKS = 8, 4  # points between two neighbours in each refinement around the largest jump
PROPORTION = 0.75  # exponent of the spacing with which jumps must fall: 1 in a Lipschitz field, 0 across a jump
UNFELT = 1e-9  # of the largest displacement: smaller jumps are rounding


def protocol(exam: Examination) -> Verdict:
    """Check that the solver has the parts of the protocol, each of its type, and the name of its entry point."""
    found, facts = Findings(faults=list(exam.facts["faults"])), exam.facts
    found.hold(facts["name"] == exam.entry.name, f"it is called '{facts['name']}', its entry point '{exam.entry.name}'")
    settings = f"{len(facts['defaults'])} settings{', seeded' if facts['seeded'] else ''}"
    optional = ", ".join(facts["optional"]) or "none"
    found.figures.append(f"{', '.join(facts['theories'])}; {settings}; optional parts: {optional}")
    return found.verdict()


def declining(exam: Examination) -> Verdict:
    """Check that each shipped case is taken, or declined in one clause, quickly, and at least one is taken."""
    found, cases = Findings(), exam.cases
    taken: list[str] = []
    slowest = 0.0
    for case, (kind, answer, seconds) in zip(cases, exam.refusals(cases), strict=True):
        slowest = max(slowest, seconds)
        if kind != "ok":
            found.faults.append(f"declines({case.name}) {answer}")
        elif answer is None:
            taken.append(case.name)
            stated = case.theory in exam.facts["theories"]
            found.hold(stated, f"it takes {case.name}, whose theory {case.theory} it does not state")
        else:
            short = answer.strip() and "\n" not in answer and len(answer) <= LONGEST_CLAUSE
            found.hold(bool(short), f"it declines {case.name} with {answer[:60]!r}, which is not one clause")
        found.hold(seconds <= SLOW, f"declines({case.name}) took {seconds:.0f} s of processor time")
    found.hold(bool(taken), "it declines every case, so nothing can be shown")
    found.figures.append(f"takes {len(taken)} of {len(cases)} cases; slowest answer {slowest:.2f} s")
    return found.verdict()


def bad_input(exam: Examination) -> Verdict:
    """Check that unknown or invalid settings are refused, and that a declined case is not solved."""
    found = Findings()
    fault = _not_refused(exam, {NO_SETTING: 1}, "a setting that it does not have")
    found.hold(fault is None, fault or "", "unknown setting refused")
    tried = list(_impossible(exam.facts["schema"]))
    for setting in tried:
        fault = _not_refused(exam, setting, f"{next(iter(setting))} = {next(iter(setting.values()))!r}")
        found.hold(fault is None, fault or "")
    if tried:
        found.figures.append(f"{len(tried)} impossible values refused")
    else:
        found.unseen.append("it has no settings to give impossible values")
    _declined_case(exam, found)
    return found.verdict()


def _not_refused(exam: Examination, setting: Mapping[str, Any], what: str) -> str | None:
    try:
        exam.subject.call("settings", dict(setting))
    except Refused:
        return None
    except NoAnswer as trouble:
        return f"{what}: {trouble}"
    return f"its settings take {what}"


def _impossible(schema: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield invalid settings: numbers out of each bound, tables, and an engine that is not installed."""
    for name, field in schema.get("properties", {}).items():
        if name == ENGINE:
            yield {name: NO_ENGINE}
        for option in (field, *field.get("anyOf", ())):
            for bound, step in BOUNDS.items():
                if bound in option:
                    yield {name: option[bound] + step}
        typed = [option.get("type") for option in (field, *field.get("anyOf", ()))]
        if any(typed) and "object" not in typed:
            yield {name: NO_VALUE}


def _declined_case(exam: Examination, found: Findings) -> None:
    case = _first_declined(exam)
    if case is None:
        found.unseen.append("it declines no case that could be given to it anyway")
        return
    try:
        data = {**case_data(case), "name": case.name}
        exam.subject.call("solve", "declined", data, dict(exam.settings))
    except (Refused, SolveFailed):
        found.figures.append(f"{case.name}, which it declines, refused")
    except (Raised, UnknownName, Lost) as trouble:
        found.faults.append(f"{case.name}, which it declines, given to it anyway: {trouble}")
    else:
        found.faults.append(f"it answers {case.name}, which it declines")


def _first_declined(exam: Examination) -> Problem | None:
    cases = exam.cases
    for case, (kind, answer, _) in zip(cases, exam.refusals(cases), strict=True):
        if kind == "ok" and answer is not None:
            return case
    return None


def displacements(exam: Examination, case: Case) -> Verdict:
    """Check that displacement and velocity take points of any shape and are finite on the closed domain."""
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
    try:
        answer.ask("displacement", everywhere[:1], None, NO_MATERIAL)
        found.faults.append("displacement answers for a material constant that nobody has declared")
    except Refused:
        pass
    found.figures.append(f"points of {len(SHAPES)} shapes; finite at {len(everywhere)} points of the closed domain")
    if answer.facts["unsettled"]:
        found.figures.append(f"it has not settled: {answer.facts['unsettled']}")
    return found.verdict()


def fields(exam: Examination, case: Case) -> Verdict:
    """Check that strains and energy densities take points of any shape and are finite on the closed domain."""
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


def _shape_fault(answer: RemoteSolution, what: str, points: np.ndarray, expected: tuple[int, ...]) -> str | None:
    """Return the faults of an answer's form, if any."""
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
    """Check that a point's value depends neither on the other points of the same call nor on their order."""
    found, answer = Findings(), exam.solve(case)
    points = np.concatenate([scattered(case, 60, seed=2), grid(case, 4)])
    together = answer.displacement(points)
    order = np.random.default_rng(3).permutation(len(points))
    shuffled = deviation(answer.displacement(points[order]), together[order])
    alone = deviation(np.stack([answer.displacement(p) for p in points[:20]]), together[:20])
    again = deviation(answer.displacement(points), together)
    for words, difference in (("in another order", shuffled), ("one by one", alone), ("asked again", again)):
        found.hold(difference <= SUMMATION, f"{words}, points move by {difference:.1e} of the largest displacement")
    found.figures.append(f"largest relative difference {max(shuffled, alone, again):.1e}")
    return found.verdict()


def history(exam: Examination, case: Problem) -> Verdict:
    """Check that the history has steps with increasing seconds, and that reported progress makes sense."""
    found, answer = Findings(), exam.solve(case)
    steps = answer.facts["history"]
    if not found.hold(bool(steps), "its history is empty"):
        return found.verdict()
    for phase in dict.fromkeys(step["phase"] for step in steps):
        own = [step for step in steps if step["phase"] == phase]
        seconds = [step["seconds"] for step in own]
        rising = all(a <= b for a, b in pairwise(seconds))
        found.hold(
            rising and min(seconds) >= 0 and all(map(math.isfinite, seconds)),
            f"seconds of its steps of phase '{phase}' fall, or are negative",
        )
        found.hold(all(math.isfinite(step["energy"]) for step in own), f"a step '{phase}' has no finite energy")
        found.hold(all(step["unknowns"] >= 0 for step in own), f"a step '{phase}' has negative unknowns")
    longest = max(step["seconds"] for step in steps)
    took = answer.facts["took"]
    found.hold(longest <= SLACK * took + 1, f"its history claims {longest:.3g} s, but the solve took {took:.3g} s")
    told = answer.facts["progress"]
    for step, total, message in told:
        whole = isinstance(step, int) and step >= 0 and (total is None or (isinstance(total, int) and total >= step))
        if not whole or not isinstance(message, str):
            found.faults.append(f"it tells of progress as step {step!r} of {total!r}: {message!r}")
            break
    found.figures.append(f"{len(steps)} steps in {longest:.3g} s; {len(told)} words on progress")
    return found.verdict()


def determinism(exam: Examination, case: Problem) -> Verdict:
    """Check that two processes with one seed give the same numbers, and another seed different but near ones."""
    found, first = Findings(), fingerprint(exam.solve(case))
    with exam.fresh() as other:
        again = deviation(first, fingerprint(solve_in(other, "again", case, exam.settings)))
    found.hold(again <= SAME, f"solved again in another process, it differs by {again:.1e}", f"again: {again:.1e}")
    if not exam.facts["seeded"]:
        found.figures.append("no seed")
        return found.verdict()
    seeded = seed_difference(exam, case)
    found.hold(seeded > 0, "another seed gives the same numbers, so the seed is not used")
    found.hold(seeded <= NEAR, f"with another seed it differs by {seeded:.1e}", f"another seed: {seeded:.1e}")
    return found.verdict()


def continuity(exam: Examination, case: Case) -> Verdict:
    """Check that along random lines the largest jump between neighbouring samples falls about like their spacing."""
    answer = exam.solve(case)
    ends = scattered(case, 2 * LINES, seed=4).reshape(LINES, 2, 2)
    tracks = [
        jumps(lambda s, a=a, b=b: answer.displacement(a + s[:, None] * (b - a)))  # type: ignore[misc]
        for a, b in ends
    ]
    return _judged(tracks, f"along {LINES} lines")


def course(exam: Examination, case: Case) -> Verdict:
    """Check that a motion starts from rest at the reference position, and is continuous in time."""
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


def jumps(track: Callable[[np.ndarray], np.ndarray], samples: int = LINE_SAMPLES) -> tuple[float, float, float]:
    """Return the largest step between neighbours on a track, the largest after refinement, and the largest size.

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
                gap <= SUMMATION,
                f"across the seam of xi{axis + 1} it gapes by {gap:.1e} of the largest displacement",
                f"gap {gap:.1e} of the largest displacement",
            )
    return found.verdict()
