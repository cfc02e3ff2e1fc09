"""The gate of ropes is tested: mistakes that solvers really make are injected, and each must turn a figure red.

A fault is put into the mechanics of `rope-exact`, a case is solved, and its values are judged as the gate does: by the
known value and the frozen tolerance. The same path without a fault is green.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.solvers.pendulum.solver import PendulumSolver
from shellbench.solvers.rope import contact, pulls, stepping
from shellbench.solvers.rope.solver import ExactSolver, PrintedSolver
from shellbench.solvers.rope.stepping import Stepper
from tests.injecting import exceeded, given, wrapped


class Fault(NamedTuple):
    """A fault, and the place where it must show."""

    name: str
    case: str
    inject: Callable[[pytest.MonkeyPatch], None]


def no_root_acceleration(stepper, places, velocities, external, root):
    return stepper, places, velocities, external, (root[0], root[1], np.zeros(3))


def no_centripetal(stepper, places, velocities, external, root):
    return stepper, places, np.zeros_like(velocities), external, (root[0], np.zeros(3), root[2])


def no_push_of_the_root(stepper, places, velocities, external, root):
    return stepper, places, velocities, external, (root[0], np.zeros(3), root[2])


def schemed(method, **changes):
    """Call a method of the stepper with another scheme."""
    return given(Stepper, method, lambda own, *rest: (replace(own, scheme=replace(own.scheme, **changes)), *rest))


def pulls_may_push(patch):
    patch.setattr(pulls, "direct_pulls", lambda rows: pulls.eliminate(rows, rows.taut))


undamped = given(Stepper, "external", lambda own, *rest: (replace(own, chains=replace(own.chains, damping=0.0)), *rest))


def one_sided(patch):
    undamped(patch)
    original = Stepper.external

    def external(stepper, places, velocities, root):
        damped = stepper.chains.damping / stepper.chains.masses[..., None] * stepping.link_vectors(velocities, root)
        return original(stepper, places, velocities, root) - damped

    patch.setattr(Stepper, "external", external)


def friction_times(factor):
    return given(contact, "rebound", lambda v, body, normals, friction: (v, body, normals, factor * friction))


FAULTS = (
    Fault("tensions push", "rope_static", wrapped(stepping.pulls, "direct_pulls", lambda found: -found)),
    Fault("tensions are twice as large", "rope_wind", wrapped(stepping.pulls, "direct_pulls", lambda found: 2 * found)),
    Fault("pulls may push", "rope_jerk", pulls_may_push),
    Fault("tensions as printed", "rope_falling_root", schemed("tensions", printed=True)),
    Fault("tensions as printed, in motion", "rope_unequal_links", schemed("tensions", printed=True)),
    Fault("masses upside down", "rope_jerk", given(pulls, "mass_rows", lambda d, m, *rest: (d, m[::-1], *rest))),
    Fault("all masses are 1 kg", "rope_unequal_links", given(pulls, "mass_rows", lambda d, m, *rest: (d, m * 0 + 1, *rest))),
    Fault("no centripetal term", "rope_circle", given(Stepper, "tensions", no_centripetal)),
    Fault("no centripetal term, nine links", "rope_nine_links", given(Stepper, "tensions", no_centripetal)),
    Fault("the root's acceleration is left out", "rope_falling_root", given(Stepper, "tensions", no_root_acceleration)),
    Fault("the root's velocity is left out", "rope_unequal_links", given(Stepper, "tensions", no_push_of_the_root)),
    Fault("taut without a tolerance", "rope_pendulum", schemed("links", taut=0.0)),
    Fault("no impulses", "rope_jerk", lambda patch: patch.setattr(Stepper, "apply_impulses", lambda self, x, v, *_: v)),
    Fault("no impulses at the catch", "rope_catch", lambda patch: patch.setattr(Stepper, "apply_impulses", lambda self, x, v, *_: v)),
    Fault("directions of neighbours do not couple", "rope_nine_links", wrapped(pulls, "cosines", lambda c: (0 * c[0], 0 * c[1]))),
    Fault("gravity is half", "rope_drop", wrapped(Stepper, "external", lambda given: 0.5 * given)),
    Fault("places are a micrometre off", "rope_drop", wrapped(stepping, "move_nodes", lambda x: x + 1e-6)),
    Fault("nodes are not turned", "rope_nine_links", lambda patch: patch.setattr(
        stepping, "move_nodes", lambda x, v, before, lengths, step, how: x + step * v)),
    Fault("the wind drags the other way", "rope_wind", wrapped(Stepper, "external", lambda a: a * [-1.0, 1.0, 1.0])),
    Fault("friction is cut by half", "rope_incline_slides", friction_times(0.5)),
    Fault("friction is left out", "rope_incline_sticks", friction_times(0.0)),
    Fault("the push is along the wrong normal", "rope_ball", given(
        contact, "rebound", lambda v, body, normals, friction: (v, body, normals[:, [1, 0, 2]], friction))),
    Fault("the ball's velocity is left out", "rope_ball", given(
        contact, "rebound", lambda v, body, normals, friction: (v, 0 * body, normals, friction))),
    Fault("ways are looked at by their ends only", "rope_plate", lambda patch: patch.setattr(
        contact, "entry_share", lambda obstacle, start, way: np.where(obstacle.distance(start + way) < 0, 0.99, 1.0))),
    Fault("springs push where they should pull", "rope_lateral_rest", wrapped(stepping, "spring_forces", lambda f: -f)),
    Fault("springs have no length of their own", "rope_lateral", given(
        stepping, "spring_forces", lambda places, rest, stiffness: (places, 0 * rest, stiffness))),
    Fault("springs pull one chain only", "rope_lateral", wrapped(stepping, "spring_forces", lambda f: f * [[[1.0], [0.0]]])),
    Fault("links are not damped", "rope_decay", undamped),
    Fault("dampers without reaction", "rope_damped", one_sided),
)  # fmt: skip
CASES = sorted(catalog.tolerances()["rope-exact"])


def test_every_case_has_a_fault():
    assert {fault.case for fault in FAULTS} == set(CASES)


@pytest.mark.sampled(6)
@pytest.mark.parametrize("case", CASES)
def test_without_a_fault_it_is_green(case):
    assert exceeded(case, ExactSolver()) == set()


@pytest.mark.sampled(3)
@pytest.mark.parametrize("case", sorted(catalog.tolerances()["pendulum-ode"]))
def test_angles_are_green(case):
    assert exceeded(case, PendulumSolver()) == set()


@pytest.mark.sampled(5)
@pytest.mark.parametrize("case", CASES)
def test_the_print_exceeds_what_its_open_findings_say(case):
    found = catalog.tolerances()["rope-printed"][case]
    said = {name for name, allowed in found.items() if "uncertain" not in (allowed.open_finding or "uncertain")}
    assert exceeded(case, PrintedSolver()) == said


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: f"{fault.case}: {fault.name}")
def test_a_fault_is_red(fault, monkeypatch):
    fault.inject(monkeypatch)
    with np.errstate(all="ignore"):
        assert exceeded(fault.case, ExactSolver())
