"""Splines as trial functions: their properties, the order of their answers, symmetry, and files."""

import numpy as np
import pytest

from shellbench.errors import InputError
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.solvers.ndf.bspline.bspline import rule_of
from shellbench.solvers.ndf.bspline.bspline_solution import SplineSolution, splines_of
from shellbench.solvers.ndf.bspline.splines import Line, Splines
from shellbench.solvers.ndf.bspline_solver import SplineSettings, SplineSolver
from shellbench.solvers.ndf.field.jets import Placement
from tests.solvers.ndf.shells import differences, shell, support

GRADED = np.array([0.0, 0.1, 0.3, 0.6, 0.6, 1.2, 2.0])
SOLVER = SplineSolver()


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize("degree", [2, 3, 4])
def test_splines_add_up_to_one_and_have_exact_derivatives(degree, closed):
    line = Line(GRADED, degree, closed)
    x = np.random.default_rng(0).uniform(0, 2, 30)
    x = x[np.abs(x[:, None] - GRADED).min(axis=1) > 0.02]

    def whole(at):
        numbers, values = line.nonzero_at(at)
        found = np.zeros((3, len(at), line.count))
        np.put_along_axis(found, np.broadcast_to(numbers, values.shape), values, axis=2)
        return found

    assert np.allclose(whole(x).sum(axis=2), [[1.0], [0.0], [0.0]], atol=1e-12)
    assert whole(x)[0].min() >= 0
    step = 1e-4
    for order in (1, 2):
        slopes = (whole(x + step)[order - 1] - whole(x - step)[order - 1]) / (2 * step)
        assert np.allclose(whole(x)[order], slopes, atol=1e-5 * np.abs(slopes).max())


def test_a_closed_line_meets_itself_with_two_derivatives():
    line = Line(GRADED, 3, True)
    (first, start), (last, end) = (line.nonzero_at(np.array([at])) for at in (0.0, 2.0 - 1e-12))
    sums = [np.zeros((3, line.count)) for _ in range(2)]
    for found, numbers, values in ((sums[0], first, start), (sums[1], last, end)):
        found[:, numbers[0]] = values[:, 0]
    assert np.allclose(sums[0], sums[1], atol=1e-8 * np.abs(sums[0]).max())


def test_products_have_the_jets_of_their_values():
    splines = Splines((Line(GRADED, 3, False), Line(np.linspace(-1, 1, 6), 3, False)), Placement())
    points = np.array([[0.2, -0.5], [0.9, 0.11], [1.7, 0.75]])
    jets = splines.jets(points).numpy()
    expected = differences(lambda p: splines.values(p).numpy(), points)
    assert np.allclose(jets, expected, atol=1e-7 * np.abs(jets).max())


def plate(**data):
    """A supported plate under a load that is no polynomial, and has no plane of symmetry."""
    return shell(
        "plane",
        supports=[support("rim", "xi1_min", "xi1_max", "xi2_min", "xi2_max")],
        loads=[{"kind": "area", "vector": [0, 0, "-exp(xi1)*sin(1 + xi2)"]}],
        quantities=[{"name": "strain_energy", "kind": "strain_energy", "primary": True}],
        **data,
    )


@pytest.mark.parametrize(("degree", "order"), [(2, 2), (3, 4)])
def test_energies_converge_as_their_degree_says(degree, order):
    """2 (p - 1) of the cells' width, by the slope between two levels."""
    history = SOLVER.solve(plate(), {"cells": 12, "degree": degree}).history
    energies = [step.energy for step in history]
    assert energies[0] > energies[1] > energies[2]  # nested grids, exact quadrature
    assert np.log2((energies[0] - energies[1]) / (energies[1] - energies[2])) == pytest.approx(order, abs=0.5)


def roof(**data):
    """A quarter of it is solved where symmetry is used."""
    return shell(
        "roof",
        supports=[{"name": "ends", "on": ["xi2_min", "xi2_max"], "components": ["x", "y"]}],
        remove_rigid_motions=["translation_z"],
        loads=[{"kind": "area", "vector": [0, -90, 0]}],
        points={"side": [50, 2.5]},
        quantities=[
            {"name": "edge", "kind": "displacement", "points": ["side"], "direction": [0, -1, 0], "primary": True},
            {"name": "push", "kind": "reaction", "support": "ends", "direction": [0, 1, 0]},
            {"name": "bending", "kind": "bending_energy"},
        ],
        **data,
    )


def test_a_part_and_its_images_are_the_whole(tmp_path):
    part, whole = (SOLVER.solve(roof(), {"cells": n, "symmetry": s}) for n, s in ((4, True), (8, False)))
    assert part.parameters < whole.parameters / 2
    ours, theirs = measure_all(part), measure_all(whole)
    assert theirs["push"] == pytest.approx(90 * 3 * np.radians(80) * 5, rel=1e-3)
    assert dict(ours) == pytest.approx(dict(theirs), rel=1e-2)  # coarse grids: their boundary factors differ
    points = roof().surface.domain.grid(5, 5).reshape(-1, 2)
    moved = whole.displacement(points)
    assert np.allclose(part.displacement(points), moved, atol=1e-2 * np.abs(moved).max())
    again = SOLVER.load(part.save(tmp_path / "roof"))
    np.testing.assert_allclose(again.displacement(points), part.displacement(points), rtol=1e-12)
    other = tmp_path / "other"
    other.write_text("x")
    with pytest.raises(InputError, match="is damaged, or not a solution of bspline-ritz"):
        SOLVER.load(other)


def test_a_bilinear_grid_is_declined_with_the_reason():
    with pytest.raises(InputError, match="a bilinear grid has no curvature, so that bending would cost it nothing"):
        SOLVER.solve(plate(), {"degree": 1})
    assert SOLVER.declines(shell("plane", theory="kirchhoff-love-nonlinear")) is not None


def test_second_derivatives_jump_where_the_thickness_has_a_kink():
    case = plate(material={"thickness_factor": "1 + 0.5*abs(xi1 - 0.7)"})
    splines = splines_of(case, rule_of(case, 8, SplineSettings()), 3)
    assert np.count_nonzero(np.isclose(splines.lines[0].ends, 0.7)) == 2
    assert isinstance(SOLVER.solve(case, {"cells": 4}), SplineSolution)
