import numpy as np
import pytest
from shellbench_kratos.nurbs import Chart, RationalBasis, midsurface_of

from shellbench.problems.shell.symmetry.symmetry import part_of
from tests.problems.shell.stated_shells import known

ARC = Chart(0.4, 2.3, arc=True)
LINE = Chart(-1.0, 3.0, arc=False)


def basis(chart, degree=3, spans=5, grading=1.0):
    lines = chart.lower + (chart.upper - chart.lower) * np.linspace(0, 1, spans + 1) ** grading
    return RationalBasis(chart, degree, (chart.lower, *lines[1:-1].tolist(), chart.upper))


@pytest.mark.parametrize("chart", [ARC, LINE])
@pytest.mark.parametrize("degree", [2, 3, 4, 5])
@pytest.mark.parametrize("grading", [1.0, 2.0])
def test_functions_add_up_to_one(chart, degree, grading):
    some = basis(chart, degree, grading=grading)
    values = some.matrices(np.linspace(chart.lower, chart.upper, 40)).sum(axis=2)
    np.testing.assert_allclose(values[0], 1, atol=1e-14)
    np.testing.assert_allclose(
        values[1:] / np.abs(some.matrices([chart.lower])).max(axis=(1, 2))[1:, None], 0, atol=1e-13
    )
    assert np.all(some.matrices(some.greville)[0] >= 0)


@pytest.mark.parametrize("chart", [ARC, LINE])
def test_derivatives_are_those_of_the_values(chart):
    """Central differences, whose error is of second order in their width."""
    some, width = basis(chart), 1e-5
    xi = chart.lower + (chart.upper - chart.lower) * np.array([0.113, 0.31, 0.55, 0.77, 0.93])
    low, middle, high = (some.matrices(xi + k * width) for k in (-1, 0, 1))
    np.testing.assert_allclose(middle[1], (high[0] - low[0]) / (2 * width), atol=1e-7)
    np.testing.assert_allclose(middle[2], (high[1] - low[1]) / (2 * width), atol=1e-6)


def test_an_edge_is_made_by_the_first_row_and_its_slope_by_two():
    values = basis(ARC).matrices([ARC.lower])
    np.testing.assert_allclose(values[0, 0], [1, *np.zeros(7)], atol=1e-15)
    assert values[1, 0, 0] == pytest.approx(-values[1, 0, 1])
    np.testing.assert_allclose(values[1, 0, 2:], 0, atol=1e-15)


@pytest.mark.parametrize("chart", [ARC, LINE])
def test_gauss_rule_integrates_over_the_coordinate(chart):
    nodes, weights = basis(chart).gauss(8)
    assert weights @ np.cos(nodes) == pytest.approx(np.sin(chart.upper) - np.sin(chart.lower), rel=1e-12)


@pytest.mark.parametrize(
    "name", ["square_plate", "scordelis_lo", "pinched_cylinder_free", "annular_plate", "hinged_roof_thick"]
)
@pytest.mark.parametrize("degree", [2, 3, 5])
def test_lines_and_arcs_are_exact_with_their_derivatives(name, degree):
    case = known(name)
    part = part_of(case)
    lines = tuple(
        tuple(low + (high - low) * np.linspace(0, 1, 6) ** 1.3)
        for low, high in zip(part.lower, part.upper, strict=True)
    )
    surface = midsurface_of(case.surface, lines, degree, case.surface.domain.angle)
    assert surface.error == 0
    points = part.lower + np.random.default_rng(0).random((50, 2)) * np.subtract(part.upper, part.lower)
    found = surface.patch.derivatives(surface.control_points, points)
    wanted = case.surface.derivatives(points, order=2)
    size = np.abs(wanted[0, 0]).max()
    for (i, j), value in wanted.items():
        scale = size / np.prod(np.subtract(part.upper, part.lower) ** (i, j))
        np.testing.assert_allclose(found[i, j], value, atol=1e-11 * scale)
    ends = [np.array([line[0], line[2], line[-1]]) for line in lines]
    grid = surface.patch.on_grid(surface.control_points, *ends)[1, 1]
    at_once = surface.patch.derivatives(
        surface.control_points, np.stack(np.meshgrid(*ends, indexing="ij"), -1).reshape(-1, 2)
    )
    np.testing.assert_allclose(grid.reshape(-1, 3), at_once[1, 1], atol=1e-11 * size)


def test_other_surfaces_are_interpolated_with_the_order_of_the_splines():
    """A whole turn is no single arc: its error falls by 2^(degree + 1) as the spans are halved."""
    case = known("slit_annular_plate")
    domain = case.surface.domain
    errors = []
    for spans in (32, 64):
        lines = tuple(
            tuple(np.linspace(a, b, n)) for a, b, n in zip(domain.lower, domain.upper, (spans + 1, 3), strict=True)
        )
        errors.append(midsurface_of(case.surface, lines, 3, domain.angle).error)
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.3)
