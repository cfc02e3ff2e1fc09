"""Contact of shells: faults of its mechanics turn the gate red, bad files are one sentence, others decline."""

import tomllib

import numpy as np
import pytest

from derivations import contact as derived
from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError, SolveFailure
from shellbench.problems import obstacle
from shellbench.problems.shell.case import build_case
from shellbench.solvers.cst.solver import CstSolver
from shellbench.solvers.fem.linear import contact
from shellbench.solvers.fem.mechanics import contact_points
from shellbench.solvers.fem.solver import FemSettings, FemSolver
from shellbench.solvers.ndf.trainer_solver import NdfSolver
from tests.injecting import shares_of_tolerances

STRIP, HILL = "contact_strip_hinged", "contact_hill"
CELLS = (20, 1)  # a part of a strip: fine enough where nothing is broken


def errors(name, cells=CELLS):
    """Solve a case on one coarse mesh, and return its errors in units of what is allowed, by quantity."""
    with np.errstate(all="ignore"):  # what is broken may overflow
        return shares_of_tolerances(FemSolver().solve(catalog.named_case(name), FemSettings(cells=cells)), "fem")


def pushed_apart(patch):
    """A penalty of the wrong sign."""
    patch.setattr(contact_points.ContactPoints, "penalty", property(lambda self: -self.stiffness.ravel()))


def turned_normal(patch):
    """A normal of the wrong side."""
    asked = contact.gaps
    patch.setattr(contact, "gaps", lambda *a: (asked(*a)[0], -asked(*a)[1]))


def ignored(patch):
    """No contact at all."""
    patch.setattr(contact, "gaps", lambda case, points, u, t: (np.full(len(points), 1.0), np.zeros((len(points), 3))))


def glued(patch):
    """Obstacles that pull: all points that the load alone would push in stay in contact."""

    def stuck(self, q, pressure, stiff, active, most):
        every = self.gap(self.solve(self.matrix, self.forces)[0]) < 0
        pushed = ((pressure - stiff * self.offset) * self.points.areas.ravel() * every)[:, None] * self.normal
        matrix = self.points.with_penalty(self.matrix, self.normal, stiff * every)
        found, answer = self.solve(matrix, self.forces + self.points.nodal_forces(pushed))
        return found, answer, True

    patch.setattr(contact._ShellAbovePlanes, "minimise", stuck)


def from_the_origin(patch):
    """Distances from the origin instead of the obstacle's centre."""
    patch.setattr(obstacle.Body, "at", lambda self, time: (np.zeros(3), np.zeros(3)))


def without_offset(patch):
    """A gap that is zero at rest."""
    asked = contact.gaps

    def gap(case, points, u, t):
        return asked(case, points, u, t)[0] - asked(case, points, 0 * u, t)[0], asked(case, points, u, t)[1]

    patch.setattr(contact, "gaps", gap)


def half_the_area(patch):
    """Pressures times half the area that their points stand for."""
    touch = contact_points.ContactPoints.touch
    patch.setattr(contact_points.ContactPoints, "touch", lambda self, forces: touch(self, forces / 2))


@pytest.mark.long
@pytest.mark.parametrize("name", [STRIP, HILL])
def test_one_coarse_mesh_is_green(name):
    assert max(errors(name).values()) < 1


@pytest.mark.long
@pytest.mark.parametrize(
    ("fault", "name"),
    [
        (pushed_apart, STRIP),
        (turned_normal, STRIP),
        (ignored, STRIP),
        (glued, STRIP),
        (from_the_origin, HILL),
        (without_offset, STRIP),
        (half_the_area, STRIP),
    ],
)
def test_a_fault_is_red(fault, name, monkeypatch):
    catalog.named_case(name)  # read before anything is broken
    monkeypatch.setattr(contact, "MOST_MULTIPLIERS", 6)  # what is right takes two
    fault(monkeypatch)
    try:
        found = errors(name)
    except (SolveFailure, ValueError):
        return  # no answer is red as well
    assert not max(found.values()) < 1


DATA = tomllib.loads((catalog.data_folder("cases") / f"{STRIP}.toml").read_text(encoding="utf-8"))
FLOOR = DATA["obstacles"][0]
WHOLE = {"name": "all", "on": ["surface"], "motion": {"kind": "value", "x": "0", "y": "0", "z": "-0.1*xi1"}}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"obstacles": [{**FLOOR, "centre": [0, 0, 0.001]}]}, "the shell starts in obstacle 1, of kind 'plane'"),
        ({"obstacles": [{**FLOOR, "kind": "cube"}]}, "cube"),
        ({"obstacles": [{**FLOOR, "friction": -0.1}]}, "friction"),
        ({"obstacles": [{**FLOOR, "friction": 0.1}]}, "without [dynamics] shells slide freely"),
        ({"obstacles": []}, "the case has no [[obstacles]]"),
        ({"supports": [WHOLE], "quantities": DATA["quantities"][:1]}, "not to modes, nor to a prescribed displacement"),
    ],
)
def test_a_bad_file_is_one_sentence(change, words):
    with pytest.raises(InputError, match=r"^x: [^\n]*$") as caught:
        build_case({**DATA, **change}, "x", "x")
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("solver", "words"), [(CstSolver, "it touches obstacles at rest"), (NdfSolver, "it touches obstacles, which")]
)
def test_others_decline_obstacles_at_rest(solver, words):
    assert solver().declines(catalog.named_case(STRIP)).startswith(words)


def test_a_box_is_as_far_as_its_nearest_place():
    box = obstacle.Box(kind="box", centre=(0, 0, 0), half_sides=(1.0, 2.0, 3.0))
    offsets = np.array([[2.0, 0, 0], [2.0, 3.0, 3.0], [0.5, 0, 0], [-4.0, -6.0, 0]])
    assert box.distance(offsets) == pytest.approx([1.0, 2**0.5, -0.5, 5.0])
    h = 1e-6
    for axis in range(3):
        step = h * np.eye(3)[axis]
        slope = (box.distance(offsets + step) - box.distance(offsets - step)) / (2 * h)
        assert box.gradient(offsets)[:, axis] == pytest.approx(slope, abs=1e-6)


def test_line_forces_are_those_of_the_closed_form():
    """q a / 2 at a hinge and q a / 3 at a clamp."""
    for clamped, share in ((False, 2), (True, 3)):
        found = derived.span(derived.floor, clamped, 0.5)
        assert found.line_force == pytest.approx(derived.LOAD * found.length / share, rel=1e-9)
        stiff = {2: 24, 3: 72}[share] * derived.B * derived.DEPTH / derived.LOAD
        assert found.length == pytest.approx(stiff**0.25, rel=1e-12)
