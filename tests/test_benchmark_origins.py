"""The derivations of benchmarks by name: strains on any surface, orthogonal factors, and coarse levels of both forms."""

import numpy as np
import pytest

from derivations import benchmark_shells, corner_functions
from derivations.covariant_polynomials import Geometry
from derivations.least_squares import factors, minimiser
from derivations.orthogonal_splines import OrthogonalShell
from derivations.patch import ring
from derivations.surface_strains import DERIVATIVES
from shellbench.bench.catalogue import catalog
from tests.test_doubly_curved_origins import derivatives, exact, waves


@pytest.mark.parametrize("surface", [benchmark_shells.twisted, benchmark_shells.skew, ring])
def test_covariant_derivatives_have_the_strains_of_the_exact_theory(surface):
    one, two = 0.7, 1.3

    def at(a, b, *order):
        return surface(np.array([a]), np.array([b]), *(order or (0, 0)))[0]

    def covariant(a, b):
        tangents = np.array([at(a, b, 1, 0), at(a, b, 0, 1)])
        normal = np.cross(*tangents)
        return np.array([*tangents, normal / np.linalg.norm(normal)]) @ waves(a, b)

    operator = Geometry.at(surface, np.array([one]), np.array([two])).strains[0]
    expected = exact(at, waves, one, two)
    found = np.einsum("rck,kc->r", operator, derivatives(covariant, one, two))
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("surface", [benchmark_shells.twisted, benchmark_shells.skew])
def test_derivatives_of_surfaces_and_frames(surface):
    for function in (surface, benchmark_shells.along_lines(surface)):
        found = derivatives(lambda a, b, f=function: f(np.array([a]), np.array([b]), 0, 0)[0], 0.7, 0.3)[1:]
        expected = [function(np.array([0.7]), np.array([0.3]), *order)[0] for order in DERIVATIVES]
        np.testing.assert_allclose(found, expected, atol=1e-7)


def test_orthogonal_factors_minimise_the_energy():
    rng = np.random.default_rng(0)
    pieces = [[(np.arange(3), (5, 3)), (np.array([2, 3, 4]), (4, 3))], [(np.array([3, 5, 6]), (6, 3))]]
    strips = [[(columns, rng.normal(size=shape)) for columns, shape in strip] for strip in pieces]
    whole = np.zeros((15, 7))
    row = 0
    for columns, rows in (piece for strip in strips for piece in strip):
        whole[row : row + len(rows), columns] = rows
        row += len(rows)
    load = rng.normal(size=7)
    assert minimiser(factors(strips, 7), load) == pytest.approx(np.linalg.solve(whole.T @ whole, load))


@pytest.mark.parametrize("name", benchmark_shells.CASES)
def test_coarse_levels_of_both_forms_are_near_what_judges(name):
    case, known = benchmark_shells.CASES[name], catalog.known_values(name)
    coarse = [benchmark_shells.values_of(case, benchmark_shells.polynomial_shell(case, ((3, 1), 6, 1)))]
    if case.clamped:
        shell = OrthogonalShell(benchmark_shells.spline_shell(case, ((8, 3), 5, 2)))
        coarse.append(benchmark_shells.values_of(case, shell))
    for found in coarse:
        assert set(found) == {q.name for q in catalog.named_case(name).quantities} - {"largest_displacement"}
        for quantity, value in found.items():
            judge = known.judge(quantity, "kirchhoff-love-linear").value
            assert value == pytest.approx(judge, rel=4e-3), quantity
        energy = known.judge("strain_energy", "kirchhoff-love-linear").value
        assert found["strain_energy"] < energy * (1 + 1e-9)  # Ritz's energies are below the limit


def test_roots_of_corners_meet_their_equation_and_come_with_their_conjugates():
    for omega in (np.pi / 3, 2 * np.pi / 3):
        roots = corner_functions.corner_roots(omega, 0.31, 12)
        left = 3.31 * np.sin(2 * roots * omega) + 0.69 * roots * np.sin(2 * omega)
        assert np.abs(left).max() < 1e-6
        assert np.all(np.diff(roots.real) >= 0)
    assert corner_functions.corner_roots(2 * np.pi / 3, 0.31, 1) == pytest.approx([0.718927577])


def test_a_skew_plate_is_free_and_held_where_it_should_be():
    trial = corner_functions.Trial(16, 10, 0.31)
    middle = np.array(
        [corner_functions.HALF * np.exp(1j * np.pi / 3), -corner_functions.HALF]
    )  # of a held and a free side
    w = np.abs(middle) ** 4 + trial.deflection(middle) @ trial.coefficients
    assert abs(w[0]) < 1e-8 * abs(w[1])
