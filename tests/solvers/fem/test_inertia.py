"""Mass and springs: integrals over the area that are known beforehand."""

import numpy as np
import pytest
from scipy.special import erf

from shellbench.solvers.fem.algebra.block_matrix import NODE_DOFS
from shellbench.solvers.fem.mechanics.assembly import mass_matrix, spring_matrix, weighted_products
from shellbench.solvers.fem.mesh.basis import KINDS
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.mesh.quadrature import Quadrature
from tests.solvers.fem.shells import HYPAR, LARGEST, MATERIAL, PolynomialField, shell

PANEL = {"kind": "cylinder", "axis": "y", "radius": 2.0, "xi1": [10, 100], "xi2": [0, 3]}
UNEVEN = ((0.0, 0.2, 0.3, 1.0), (0.0, 0.55, 1.0))  # mesh lines of the unit square


def moving(surface="plane", **fields):
    fields = {"theory": "kirchhoff-love-nonlinear", "supports": [], "dynamics": {"until": 1.0}, **fields}
    return shell(surface, quantities=[LARGEST | {"at": 1.0}], **fields)


def uneven(case, lines=UNEVEN):
    domain = case.surface.domain
    scaled = [low + size * np.array(x) for low, size, x in zip(domain.lower, domain.size, lines, strict=True)]
    return TensorMesh(domain, (scaled[0], scaled[1]))


def interpolant(mesh, values):
    nodal = np.stack([values[kind] for kind in KINDS], axis=-1) * mesh.node_scales[:, None, :]
    return nodal.reshape(mesh.node_count, NODE_DOFS)


def product(matrix, first, second):
    return float(np.sum(first * (matrix @ second[..., None])[..., 0]))


def test_the_kinetic_energy_of_polynomials_is_exact():
    """The area of a plane is 1 per coordinates, that of a cylinder R: products of bicubics have known integrals."""
    for surface, area in (("plane", 1.0), (PANEL, 2.0)):
        case = moving(surface)
        mesh = uneven(case)
        matrix = mass_matrix(case, mesh, Quadrature.of_order(mesh, 7))
        fields = [PolynomialField(case.surface, seed, 1.0) for seed in (0, 1)]
        first, second = (interpolant(mesh, f.derivatives(mesh.node_points)) for f in fields)
        expected = 0.0
        for c in range(3):
            one, other = (f.factors[..., c] for f in fields)
            both = np.zeros((7, 7))
            for i in range(4):
                for j in range(4):
                    both[i : i + 4, j : j + 4] += one[i, j] * other
            even = np.array([2 / (k + 1) if k % 2 == 0 else 0.0 for k in range(7)])  # of x^k from -1 to 1
            expected += even @ both @ even
        expected *= MATERIAL["areal_density"] * area * np.prod(fields[0].half)
        assert product(matrix, first, second) == pytest.approx(expected, rel=1e-12)


def test_total_mass_first_and_second_moments():
    density = MATERIAL["areal_density"]
    plane, tube = moving(), moving("cylinder")
    for case, mass in ((plane, density * 2), (tube, density * 2 * np.pi * 2 * 3)):
        lines = UNEVEN if case is plane else (np.linspace(0, 1, 25), UNEVEN[1])
        mesh = uneven(case, lines)
        matrix = mass_matrix(case, mesh, Quadrature.of_order(mesh, 7))
        points = mesh.domain.wrap(mesh.node_points)
        x = interpolant(mesh, case.surface.derivatives(points, order=2))
        unit = np.zeros((3, mesh.node_count, 3, 4))
        for c in range(3):
            unit[c, :, c, 0] = 1.0
        unit = unit.reshape(3, mesh.node_count, NODE_DOFS)
        totals = [[product(matrix, a, b) for a in unit] for b in unit]
        assert np.allclose(totals, mass * np.eye(3), rtol=1e-12, atol=1e-12 * mass)
        first = [product(matrix, a, x) / mass for a in unit]
        assert np.allclose(first, [1, 0.5, 0] if case is plane else [0, 1.5, 0], rtol=0, atol=1e-12)
        # |x|^2: 4/3 + 1/3 on the rectangle; R^2 + 3^2/3 on the tube, but for the interpolation of its circle
        second = product(matrix, x, x) / mass
        assert second == pytest.approx(5 / 3 if case is plane else 4 + 3, rel=1e-12 if case is plane else 1e-5)


@pytest.mark.parametrize("surface", ["plane", "hypar", "cylinder"])
def test_the_mass_matrix_is_symmetric_and_positive_definite(surface):
    case = moving(surface)
    mesh = uneven(case, (np.linspace(0, 1, 5), UNEVEN[1]))
    dense = mass_matrix(case, mesh, Quadrature.of_order(mesh, 7)).to_csr().toarray()
    assert np.abs(dense - dense.T).max() <= 1e-14 * np.abs(dense).max()
    assert np.linalg.eigvalsh(dense)[0] > 1e-8 * np.abs(dense).max()


def test_components_do_not_mix_and_have_their_own_weights():
    case = moving(HYPAR)
    mesh = uneven(case)
    rule = Quadrature.of_order(mesh, 7)
    weights = np.array([1.0, 2.0, 5.0])
    matrix = weighted_products(mesh, case.surface, rule, lambda points: np.tile(weights, (len(points), 1)))
    one = weighted_products(mesh, case.surface, rule, lambda points: np.ones((len(points), 3)))
    u = np.random.default_rng(0).normal(size=(mesh.node_count, 3, 4))
    for c in range(3):
        only = np.zeros_like(u)
        only[:, c] = u[:, c]
        flat = only.reshape(-1, NODE_DOFS)
        answer = (matrix @ flat[..., None])[..., 0].reshape(u.shape)
        assert not np.any(np.delete(answer, c, axis=1))
        assert product(matrix, flat, flat) == pytest.approx(weights[c] * product(one, flat, flat), rel=1e-13)


def sprung(stiffness, surface="plane", components=("x", "y", "z")):
    return moving(surface, springs=[{"name": "s", "stiffness": stiffness, "components": list(components)}])


def energy_of_translation(case, mesh, vector):
    q = np.zeros((mesh.node_count, 3, 4))
    q[:, :, 0] = vector
    flat = q.reshape(-1, NODE_DOFS)
    return product(spring_matrix(case, mesh), flat, flat) / 2


def test_springs_store_half_their_stiffness_times_the_square_of_what_they_hold():
    case = sprung("1 + xi1*xi2**2")  # integral over [0, 2] x [0, 1]: 2 + 2/3
    mesh = uneven(case)
    assert energy_of_translation(case, mesh, [1, 2, 3]) == pytest.approx(14 / 2 * (2 + 2 / 3), rel=1e-13)
    only = sprung("1 + xi1*xi2**2", components=("x", "z"))
    assert energy_of_translation(only, mesh, [1, 2, 3]) == pytest.approx(10 / 2 * (2 + 2 / 3), rel=1e-13)


def test_springs_are_spread_over_the_curved_area():
    case = sprung("1 + xi1**2", HYPAR)
    mesh = uneven(case)
    x, w = np.polynomial.legendre.leggauss(40)
    a, b = np.meshgrid(x, x, indexing="ij")
    tangents = np.stack([np.ones_like(a), 0 * a, b / 1.5], -1), np.stack([0 * a + 0.3, np.ones_like(a), a / 1.5], -1)
    area = np.linalg.norm(np.cross(*tangents), axis=-1)
    expected = np.einsum("i,j,ij->", w, w, (1 + a**2) * area) / 2
    assert energy_of_translation(case, mesh, [0, 1, 0]) == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("cells", [8, 12])
def test_an_elastic_pin_narrower_than_a_cell_is_integrated(cells):
    """The napkin's pin, exp(-r^2 / 2 s^2) at a corner, s = 0.05 m, on cells of 0.125 m and 0.083 m."""
    s, k = 0.05, 2e4
    surface = {"kind": "plane", "xi1": [0, 1], "xi2": [0, 1]}
    case = sprung(f"{k}*exp(-(xi1**2 + (xi2 - 1)**2)/(2*{s}**2))", surface)
    line = np.linspace(0, 1, cells + 1)
    expected = k / 2 * (s * np.sqrt(np.pi / 2) * erf(1 / (s * np.sqrt(2)))) ** 2
    found = energy_of_translation(case, TensorMesh(case.surface.domain, (line, line)), [0.6, 0, 0.8])
    assert found == pytest.approx(expected, rel=1e-8)


def test_springs_add_up():
    first, second = "1 + xi1", "2*xi2"
    springs = [{"name": n, "stiffness": k} for n, k in (("a", first), ("b", second))]
    both = moving(springs=springs)
    mesh = uneven(both)
    total = spring_matrix(both, mesh).blocks
    parts = sum(spring_matrix(sprung(k), mesh).blocks for k in (first, second))
    assert np.allclose(total, parts, rtol=0, atol=1e-14 * np.abs(total).max())
