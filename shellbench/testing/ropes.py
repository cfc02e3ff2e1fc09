"""Checks of ropes: the form of their states, turned and scaled chains, and the balance of energy.

The checks derive two cases from a case: the same rope at another place, and in other units.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.bench.catalogue.catalog import named_case
from shellbench.problem import Problem
from shellbench.problems.moving import moved
from shellbench.problems.rope.case import RopeCase
from shellbench.problems.rope.quantities import energies
from shellbench.problems.rope.solving import start_of
from shellbench.testing.examination import Examination, Findings, Verdict, allowed_deviation, deviation, not_applicable
from shellbench.testing.subject import RemoteSolution

Array = NDArray[np.float64]

CHEAP = ("rope_pendulum", "rope_nine_links", "hanging_chain", "rope_drop", "rope_ball")
"""Cases of which a solver is examined on the first that it takes."""

REPEATED = 1e-9  # relative: lengths and places that a state repeats
TURN, HALF_TURN = 0.7, np.pi  # about the vertical, rad; the other one keeps the plane (x, z)
SHIFT = np.array([0.3, -0.2, 0.5])  # m; solvers of a plane are given no y
LENGTHS, MASSES = 1000.0, 1000.0  # mm in a metre, g in a kilogram
GAINED = 0.01  # largest gain of energy of a chain without wind, relative to weight times length
FIELDS = ("nodes", "velocities", "tensions", "stretch")


def cheap_cases() -> tuple[RopeCase, ...]:
    """Return the cases that a solver can be checked on."""
    return tuple(case for case in map(named_case, CHEAP) if isinstance(case, RopeCase))


def states(answer: RemoteSolution) -> dict[float, Mapping[str, Array]]:
    """Return the states of an answer by time."""
    return {at: {name: np.asarray(value) for name, value in answer.state(at).items()} for at in answer.case.states}


def all_states(answer: RemoteSolution, name: str) -> Array:
    """Return an array of all states in order; differences are relative to the largest of all values."""
    return np.concatenate([state[name] for state in states(answer).values()])


def links(exam: Examination, case: Problem) -> Verdict:
    """Check the form of each state: places and velocities of all nodes, the prescribed root, and tension only."""
    assert isinstance(case, RopeCase)
    found, answer = Findings(), exam.solve(case)
    found.faults += answer.facts["faults"]
    count = len(case.masses) + (2 if case.chain else case.chains)
    for at, state in states(answer).items():
        when = f"at t = {at:g}"
        lacking = [name for name in FIELDS if name not in state]
        if not found.hold(not lacking, f"{when} a state has no {', '.join(lacking)}"):
            break
        shapes = {"nodes": (count, 3), "velocities": (count, 3), "tensions": (case.links,)}
        wrong = [
            f"{name} {state[name].shape}, not {shape}" for name, shape in shapes.items() if state[name].shape != shape
        ]
        if not found.hold(not wrong, f"{when} it has {'; '.join(wrong)}"):
            break
        whole = all(bool(np.isfinite(state[name]).all()) for name in FIELDS)
        found.hold(whole, f"{when} it is not finite")
        found.hold(
            bool(np.all(state["tensions"] >= 0)), f"{when} a link pushes by {-state['tensions'].min(initial=0.0):.2g} N"
        )
        if case.rope:
            _of_rope(found, case, at, state, when)
    found.figures.append(f"{len(case.states)} states of {count} nodes, links that pull")
    return found.verdict()


def _of_rope(found: Findings, case: RopeCase, at: float, state: Mapping[str, Array], when: str) -> None:
    assert case.rope is not None
    lengths = np.array(case.rope.link_lengths)
    off = float(np.abs(state["nodes"][0] - moved(case.rope.root, at)[0]).max())
    found.hold(off <= REPEATED * lengths.sum(), f"{when} the root is {off:.2g} m from where it is led")
    long = float((np.linalg.norm(np.diff(state["nodes"], axis=0), axis=1) / lengths).max()) - 1
    found.hold(
        long <= float(state["stretch"]) + REPEATED,
        f"{when} a link is stretched by {long:.1e} of its length, and {float(state['stretch']):.1e} is stated",
    )


def placement(exam: Examination, case: Problem) -> Verdict:
    """Check that the rope, turned about the vertical and shifted, has the turned and shifted motion."""
    assert isinstance(case, RopeCase)
    words = []
    for angle in (TURN, HALF_TURN):
        turn = about_the_vertical(angle)
        shift = SHIFT * [1.0, angle == TURN, 1.0]
        other = relocated(case, turn, shift)
        if other is None:
            return not_applicable("its root moves, or wind or obstacles stand about it")
        if reason := exam.declined(other):
            words.append(f"it declines the case turned by {angle:.2g} rad: {reason}")
            continue
        first, second = exam.solve(case), exam.solve(other)
        limit, found = allowed_deviation(exam, case), Findings()
        off = deviation((all_states(second, "nodes") - shift) @ turn, all_states(first, "nodes"))
        pulled = deviation(all_states(second, "tensions"), all_states(first, "tensions"))
        for what, difference in (("places", off), ("tensions", pulled)):
            found.hold(
                difference <= limit,
                f"turned by {angle:.2g} rad and shifted, {what} differ by {difference:.1e}; at most {limit:.1e} may",
                f"{what} of the turned rope: {difference:.1e}",
            )
        return found.verdict()
    return not_applicable("; ".join(words))


def units(exam: Examination, case: Problem) -> Verdict:
    """Check that the rope in millimetres and grams has the same motion as in metres and kilograms."""
    assert isinstance(case, RopeCase)
    other = rescaled(case)
    if other is None:
        return not_applicable("it has parts that are not converted: formulas, wind or obstacles")
    if reason := exam.declined(other):
        return not_applicable(f"it declines the case in mm and g: {reason}")
    first, second = exam.solve(case), exam.solve(other)
    limit, found = allowed_deviation(exam, case), Findings()
    factors = {"nodes": LENGTHS, "velocities": LENGTHS, "tensions": LENGTHS * MASSES}
    for name, factor in factors.items():
        off = deviation(all_states(second, name) / factor, all_states(first, name))
        found.hold(
            off <= limit,
            f"in mm and g its {name} differ by {off:.1e}; at most {limit:.1e} may",
            f"{name} in mm and g: {off:.1e}",
        )
    return found.verdict()


def energy(exam: Examination, case: Problem) -> Verdict:
    """Check that a rope with a fixed root and without wind gains no energy, also at quarters of its time."""
    assert isinstance(case, RopeCase)
    if case.rope is None or case.wind or any(isinstance(formula, str) for formula in case.rope.root):
        return not_applicable("something works on its masses, or there is no rope")
    whole = case.gravity * float(case.masses.sum()) * sum(case.rope.link_lengths)

    moves, before = energies(case, *start_of(case))
    scale = max(whole, moves)
    before += moves
    followed = states(exam.solve(at_quarters(case)))
    gained = max(sum(energies(case, state["nodes"], state["velocities"])) - before for state in followed.values())
    found = Findings()
    found.hold(
        gained <= GAINED * scale,
        f"it gains {gained:.2g} J, {gained / scale:.1e} of its weight times its length; at most {GAINED:g} may be",
        f"changes by {gained / scale:.1e} of its weight times its length at most",
    )
    return found.verdict()


def at_quarters(case: RopeCase) -> RopeCase:
    """Return the case with energies at quarters of its time, so that states are also kept during fast motion."""
    data = case.model_dump(mode="json", exclude_unset=True)
    times = [case.states[-1] * part for part in (0.25, 0.5, 0.75)]
    data["quantities"] += [
        {"name": f"energy_{number}", "kind": "energy", "at": at} for number, at in enumerate(times, 1) if at > 0
    ]
    return RopeCase.model_validate(data | {"name": f"{case.name[:60]}_quarters", "suites": []})


def about_the_vertical(angle: float) -> Array:
    """Return the rotation (3, 3) about z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _movable(case: RopeCase) -> dict[str, Any] | None:
    """Return a rope's data with its start node by node; None if it has obstacles or formulas."""
    if case.rope is None or case.wind or case.obstacles or any(isinstance(f, str) for f in case.rope.root):
        return None
    data = case.model_dump(mode="json", exclude_unset=True)
    data["rope"].pop("angle", None)
    places, velocities = start_of(case)
    data["rope"] |= {"start": places[1:].tolist(), "velocities": velocities[1:].tolist(), "root": places[0].tolist()}
    return data


def relocated(case: RopeCase, turn: Array, shift: Array) -> RopeCase | None:
    """Return the rope turned about the vertical and shifted; None if it can't be derived."""
    data = _movable(case)
    if data is None:
        return None
    places, velocities = start_of(case)
    there, going = places @ turn.T + shift, velocities @ turn.T
    there[:, 1][np.abs(there[:, 1]) < REPEATED] = 0.0  # a half turn keeps the plane
    going[:, 1][np.abs(going[:, 1]) < REPEATED] = 0.0
    data["rope"] |= {"root": there[0].tolist(), "start": there[1:].tolist(), "velocities": going[1:].tolist()}
    return RopeCase.model_validate(data | {"name": f"{case.name[:60]}_turned", "suites": []})


def rescaled(case: RopeCase) -> RopeCase | None:
    """Return the rope in millimetres and grams, with the same times; None if it can't be derived."""
    data = _movable(case)
    if data is None or case.rope is None:
        return None
    rope = data["rope"]
    for name in ("root", "start", "velocities", "link_lengths"):
        rope[name] = (np.array(rope[name], dtype=float) * LENGTHS).tolist()
    rope["masses"] = [mass * MASSES for mass in case.rope.masses]
    rope["gravity"] = case.gravity * LENGTHS
    return RopeCase.model_validate(data | {"name": f"{case.name[:60]}_mm", "suites": [], "units": "mm, g, s"})
