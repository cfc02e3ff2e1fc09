"""Gauss panels: exactness, grading, seams, and convergence at a plate's logarithm."""

import math

import numpy as np
import pytest

from shellbench.problems.shell.question.places import Edge
from shellbench.problems.shell.question.surface import Domain
from shellbench.solvers.ndf.field.quadrature import RuleSpec, area_rule, edge_rule, line_rule, panel_ends

SQUARE = Domain((0.0, -1.0), (2.0, 1.0), (False, False), (False, False))
RING = Domain((0.0, 0.0), (2 * math.pi, 1.0), (True, False), (True, False))


def ends(focal, panels=8, grading=2.0, cuts=0, periodic=False):
    return panel_ends(0.0, 2.0, focal, RuleSpec((panels, panels), 4, grading, cuts), 0, periodic)


@pytest.mark.parametrize("focal", [[], [0.7], [0.0], [2.0], [0.0, 2.0], [0.3, 0.3 + 1e-13, 1.1]])
@pytest.mark.parametrize("cuts", [0, 2])
def test_panels_cover_the_side_once_and_end_at_every_focal_point(focal, cuts):
    e = ends(focal, cuts=cuts)
    assert e[0] == 0.0
    assert e[-1] == pytest.approx(2.0)
    assert np.all(np.diff(e) > 0)
    assert all(np.abs(e - f).min() < 1e-12 for f in focal)


@pytest.mark.parametrize("focal", [[0.7], [0.0], [2.0]])
def test_panels_narrow_toward_a_focal_point(focal):
    e = ends(focal)
    sizes, nearness = np.diff(e), np.abs((e[1:] + e[:-1]) / 2 - focal[0])
    for side in ((e[:-1] >= focal[0] - 1e-12), (e[1:] <= focal[0] + 1e-12)):
        order = np.argsort(nearness[side])
        assert np.all(np.diff(sizes[side][order]) > 0)


def test_a_focal_point_on_a_seam_grades_both_of_its_sides():
    e = ends([0.0], periodic=True)
    np.testing.assert_allclose(e, (2.0 - e)[::-1], atol=1e-14)
    assert np.diff(e)[0] < np.diff(e)[len(e) // 2]


def test_rules_integrate_polynomials_of_their_degree_exactly():
    rule = area_rule(SQUARE, np.array([[0.5, 0.2]]), RuleSpec((3, 4), 4, 2.0, 1))
    x, y = rule.points.T
    assert rule.weights @ (x**7 * y**6) == pytest.approx(2**8 / 8 * 2 / 7, rel=1e-13)
    edge = edge_rule(SQUARE, Edge("xi1_max", 0, "max"), np.zeros((0, 2)), RuleSpec((1, 1), 4))
    assert np.all(edge.points[:, 0] == 2.0)
    assert edge.weights @ edge.points[:, 1] ** 6 == pytest.approx(2 / 7, rel=1e-13)


def test_periodic_rules_integrate_a_turn():
    rule = area_rule(RING, np.array([[1.0, 0.5]]), RuleSpec((8, 2), 6, 1.5))
    assert rule.weights @ np.cos(rule.points[:, 0]) ** 2 == pytest.approx(math.pi, rel=1e-9)


def test_grading_and_cuts_pay_at_a_logarithm():
    """Integral of log^2 from 0 to 1 is 2: the curvature energy of r^2 log r along a line."""

    def error(grading, cuts):
        e = panel_ends(0.0, 1.0, [0.0], RuleSpec((8, 8), 6, grading, cuts), 0, periodic=False)
        x, w = line_rule(e, 6)
        return abs(w @ np.log(x) ** 2 - 2)

    assert error(2.0, 0) < 0.2 * error(1.0, 0)
    assert error(2.0, 2) < 0.1 * error(2.0, 0)


def reciprocal(*sides):
    """Return the integral of 1/r over rectangles with r = 0 at a corner, from their sides (p, q)."""
    return sum(p * math.asinh(q / p) + q * math.asinh(p / q) for p, q in sides)


def test_cells_around_a_point_integrate_its_singularity():
    at = np.array([[0.7, -0.4]])
    exact = reciprocal((0.7, 0.6), (0.7, 1.4), (1.3, 0.6), (1.3, 1.4))
    cut = area_rule(SQUARE, at, RuleSpec((4, 4), 6, 1.5, point_cuts=1))
    lines = area_rule(SQUARE, at, RuleSpec((4, 4), 6, 1.5, cuts=1))

    def error(rule):
        return abs(rule.weights @ (1 / np.hypot(*(rule.points - at).T)) / exact - 1)

    assert cut.weights.sum() == pytest.approx(4, rel=1e-12)
    assert len(cut.points) < 1.5 * len(lines.points)
    assert error(cut) < 1e-3 * error(lines)


def test_cells_around_a_point_on_a_seam_lie_on_both_its_sides():
    rule = area_rule(RING, np.array([[0.0, 1.0]]), RuleSpec((8, 2), 6, 1.5, point_cuts=1))
    near = np.minimum(rule.points[:, 0], 2 * math.pi - rule.points[:, 0])
    exact = 2 * reciprocal((math.pi, 1.0))
    assert rule.weights @ (1 / np.hypot(near, rule.points[:, 1] - 1)) == pytest.approx(exact, rel=1e-5)
