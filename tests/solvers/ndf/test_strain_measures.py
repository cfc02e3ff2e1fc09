"""Strain measures at any size of displacement: what they are, what they vary by, and what rotates for free."""

import numpy as np
import pytest
import torch
from numpy.polynomial.legendre import leggauss
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from shellbench.solvers.ndf.field.geometry import apply_rows, strain_rows
from shellbench.solvers.ndf.field.jets import Placement, from_derivatives
from shellbench.solvers.ndf.strains.strain_measures import MEASURES, Reference, Undeformed, gradients_through, stresses
from tests.solvers.ndf.shells import SURFACES, differences, inner_points, shell

PLACEMENT = Placement()
MEASURE_NAMES = ("exact", "published", "linear")
TENSOR = np.array([1, 1, 0.5, 1, 1, 0.5])  # components 12 enter the strains twice


def wave(points):
    """A smooth displacement (N, 3) of the size of the shells themselves."""
    a, b = points[..., 0], points[..., 1]
    return np.stack([np.sin(a) * b, np.cos(a + b), a * b**2 / 9 - np.sin(b)], axis=-1)


def positions(case, points):
    return from_derivatives(case.surface.derivatives(points, 2), PLACEMENT)


def rotated(x, rotation):
    """Jet of the displacement that turns positions with jet x (6, N, 3) about the origin."""
    return PLACEMENT.tensor(x.numpy() @ (rotation.as_matrix() - np.eye(3)).T)


def strained(measure, case, points, u):
    """Strained points of a displacement with jet u (6, N, 3)."""
    surface = Undeformed.at_points(case.surface, points, PLACEMENT)
    return surface.strained(measure, surface.gradients(PLACEMENT.tensor(np.asarray(u))))


def fundamental_forms(y):
    """(N, 6): a_11, a_22, a_12 and b_11, b_22, b_12 of a surface with jet y (6, N, 3)."""
    normal = np.cross(y[1], y[2])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    pairs = [(y[1], y[1]), (y[2], y[2]), (y[1], y[2]), *((y[k], normal) for k in (3, 5, 4))]
    return np.stack([(p * q).sum(-1) for p, q in pairs], axis=-1)


@pytest.mark.parametrize("surface", SURFACES)
def test_exact_strains_are_changes_of_the_fundamental_forms(surface):
    """eps = (a - abar) / 2 and kappa = bbar - b of the deformed surface (Kairanda et al. 2023, eqs. (15, 16))."""
    case = shell(surface)
    points = inner_points(case)
    x, u = positions(case, points).numpy(), differences(wave, points)
    change = fundamental_forms(x + u) - fundamental_forms(x)
    expected = change * [0.5, 0.5, 0.5, -1, -1, -1]
    found = strained("exact", case, points, u).strains.numpy() * TENSOR
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize("surface", SURFACES)
def test_rigid_rotations_strain_nothing(surface):
    """Any axis, any angle up to a whole turn, with the metric and the curvature itself as the natural scale."""
    case = shell(surface)
    points = inner_points(case)
    x = positions(case, points)
    natural = np.abs(fundamental_forms(x.numpy())).max()
    generator = np.random.default_rng(1)
    for angle in (1e-6, 0.1, 1.0, np.pi / 2, 3.0, np.pi, 4.0, 6.0, 2 * np.pi):
        axis = generator.normal(size=3)
        turn = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
        strains = strained("exact", case, points, rotated(x, turn)).strains
        assert strains.abs().max() < 1e-10 * natural


def test_the_published_bending_strain_of_a_rotated_cylinder():
    """Turned by theta about its axis, a roof keeps its curvature; eq. (30) takes (1 - cos theta)^2 / 2 of it for strain.

    d_11 = bbar_11 (n - a3), so that - d_11 . a3 = bbar_11 (1 - cos theta); with phi_1 = u,1 . a3 and a_11 = R^2,
    phi^1 d_11 . a_1 = -bbar_11 sin^2 theta and phi^1 bbar_11 phi_1 / 2 is half of that with the other sign.
    """
    case = shell("roof")
    points = inner_points(case)
    x = positions(case, points)
    bbar = fundamental_forms(x.numpy())[:, 3]
    for theta in (0.05, 0.7, 2.0, np.pi):
        turn = Rotation.from_rotvec([0, 0, theta])
        strains = strained("published", case, points, rotated(x, turn)).strains.numpy()
        expected = bbar * ((1 - np.cos(theta)) - np.sin(theta) ** 2 / 2)
        np.testing.assert_allclose(strains[:, 3], expected, rtol=1e-9)
        np.testing.assert_allclose(expected, bbar * (1 - np.cos(theta)) ** 2 / 2, rtol=1e-9)
        assert np.abs(np.delete(strains, 3, axis=1)).max() < 1e-11 * np.abs(bbar).max()


@pytest.mark.parametrize("surface", ["roof", "hypar", "helicoid", "torus"])
def test_the_published_bending_strain_sees_rigid_rotations(surface):
    case = shell(surface)
    points = inner_points(case)
    x = positions(case, points)
    turn = Rotation.from_rotvec(np.array([1.0, 2.0, 3.0]) / np.sqrt(14))
    published, exact = (strained(m, case, points, rotated(x, turn)).strains.abs() for m in ("published", "exact"))
    curvature = np.abs(fundamental_forms(x.numpy())[:, 3:]).max()
    assert published[:, 3:].max() > 0.02 * curvature
    assert published[:, 3:].max() > 1e8 * exact[:, 3:].max()


@pytest.mark.parametrize("measure", MEASURE_NAMES)
def test_variations_match_automatic_differentiation(measure):
    generator = torch.Generator().manual_seed(0)

    def draw(*shape):
        return torch.randn(shape, generator=generator, dtype=torch.float64)

    count = 5
    base = draw(count, 2, 3)
    normal = torch.linalg.cross(base[:, 0], base[:, 1], dim=-1)
    normal = normal / normal.norm(dim=-1, keepdim=True)
    reference = Reference(base, normal, torch.linalg.inv(base @ base.mT), draw(count, 3))
    gradients, weights = draw(count, 5, 3), draw(count, 6)
    found = MEASURES[measure](reference, gradients)
    second = found.second_variation(weights)
    for k in range(count):
        here = Reference(base[[k]], normal[[k]], reference.inverse[[k]], reference.curvature[[k]])

        def strains(g, here=here):
            return MEASURES[measure](here, g[None]).strains[0]

        first = torch.func.jacrev(strains)(gradients[k]).reshape(6, 15)
        torch.testing.assert_close(found.variation[k], first, rtol=1e-10, atol=1e-10)
        hessian = torch.func.hessian(lambda g, k=k: weights[k] @ strains(g))(gradients[k]).reshape(15, 15)
        torch.testing.assert_close(second[k], hessian, rtol=1e-10, atol=1e-10 * float(hessian.abs().max() + 1))


@pytest.mark.parametrize("surface", SURFACES)
def test_all_measures_agree_for_small_displacements(surface):
    """At an amplitude of 1e-10 they differ by terms of second order alone: nothing cancels."""
    case = shell(surface)
    points = inner_points(case)
    u = 1e-10 * differences(wave, points)
    exact, published, linear = (strained(m, case, points, u).strains for m in MEASURE_NAMES)
    rows = strain_rows(Undeformed.at_points(case.surface, points, PLACEMENT).geometry)
    torch.testing.assert_close(linear, apply_rows(rows, PLACEMENT.tensor(u)), rtol=1e-10, atol=1e-21)
    for part in (slice(0, 3), slice(3, 6)):
        scale = linear[:, part].abs().max()
        for found in (exact, published):
            assert (found - linear)[:, part].abs().max() < 1e-8 * scale
    assert (exact - linear)[:, :3].abs().max() > 0  # they are the same to first order only


def test_strains_through_a_matrix_are_those_of_the_product():
    case = shell("helicoid")
    points = inner_points(case)
    surface = Undeformed.at_points(case.surface, points, PLACEMENT)
    matrix = PLACEMENT.tensor(differences(lambda p: wave(p)[:, :, None] * np.cos(wave(p))[:, None, :], points))
    field = PLACEMENT.tensor(differences(lambda p: wave(p[:, ::-1]), points))
    product = differences(
        lambda p: ((wave(p)[:, :, None] * np.cos(wave(p))[:, None, :]) @ wave(p[:, ::-1])[..., None])[..., 0], points
    )
    through = gradients_through(surface.geometry, matrix)
    found = (through @ field.permute(1, 2, 0).reshape(-1, 18, 1)).view(-1, 5, 3)
    expected = surface.gradients(PLACEMENT.tensor(product))
    torch.testing.assert_close(found, expected, rtol=1e-6, atol=1e-6 * float(expected.abs().max()))


LENGTH = 2.0  # of the plate along xi1
ROOT = (1 - np.sqrt(5)) / 2  # of cos theta + sin^2 theta = 1 + c - c^2


def rolled(points, curvature):
    """Jet of the displacement that rolls the plate of SURFACES to this curvature from xi1 = 0."""
    a, k = points[:, 0], curvature
    zero, sine, cosine = np.zeros_like(a), np.sin(k * a), np.cos(k * a)
    planes = [
        (sine / k - a, (1 - cosine) / k),
        (cosine - 1, sine),
        (zero, zero),
        (-k * sine, k * cosine),
        (zero, zero),
        (zero, zero),
    ]
    return np.stack([np.stack([x, zero, z], axis=-1) for x, z in planes])


def bending(measure, curvature, points):
    """kappa_11 (N,) of the rolled plate, the other strains being zero."""
    strains = strained(measure, shell("plane"), points, rolled(points, curvature)).strains.numpy()
    assert np.abs(strains[:, [0, 1, 2, 4, 5]]).max() < 1e-13
    return strains[:, 3]


def test_a_rolled_plate_has_cos_plus_sin_squared_of_its_curvature_by_the_published_measure():
    """kappa = -k by the exact measure (a3 is on the inside); by eq. (30) cos theta + sin^2 theta of it.

    At the angle theta = arccos((1 - sqrt 5) / 2), 128.17 degrees, the published strain itself vanishes, whatever the
    curvature, and its sign is the wrong one beyond; it is largest, 5/4 of the truth, at 60 degrees.
    """
    points = np.stack([np.linspace(0, LENGTH, 41), np.linspace(-1, 1, 41)], axis=-1)
    for k in (0.01, 0.7, 1.5):
        theta = k * points[:, 0]
        np.testing.assert_allclose(bending("exact", k, points), -k, rtol=1e-13)
        share = np.cos(theta) + np.sin(theta) ** 2
        np.testing.assert_allclose(bending("published", k, points), -k * share, atol=1e-13)

    def at(degrees, k=1.5):
        return float(bending("published", k, np.array([[np.radians(degrees) / k, 0.0]]))[0]) / -k

    root = brentq(at, 90, 170, xtol=1e-12)
    assert root == pytest.approx(np.degrees(np.arccos(ROOT)), abs=1e-9)
    assert root == pytest.approx(128.17, abs=0.005)
    assert at(root - 5) > 0.05
    assert at(root + 5) < -0.05
    assert at(60) == pytest.approx(1.25, rel=1e-12)


def test_what_vanishes_on_a_rolled_plate_is_the_published_strain_and_not_its_rate():
    """kappa = -k s(k x) with s = cos + sin^2 has the rate s + theta s', which vanishes before s does.

    At 128.17 degrees the published energy density and all its forces vanish, while curvature still raises the strain.
    """
    case, k, step = shell("plane"), 1.5, 1e-4

    def rate(theta):
        point = np.array([[theta / k, 0.0]])
        return -float((bending("published", k + step, point) - bending("published", k - step, point))[0]) / (2 * step)

    def expected(theta):
        return np.cos(theta) + np.sin(theta) ** 2 + theta * (np.sin(2 * theta) - np.sin(theta))

    angles = np.linspace(0.1, 3.0, 12)
    np.testing.assert_allclose([rate(a) for a in angles], [expected(a) for a in angles], atol=1e-6)
    root = np.arccos(ROOT)
    assert brentq(rate, 0.1, root) < root - 0.3
    assert abs(rate(root)) > 1
    point = np.array([[root / k, 0.0]])
    surface = Undeformed.at_points(case.surface, point, PLACEMENT)
    sizes = {}
    for measure in ("exact", "published"):
        found = surface.strained(measure, surface.gradients(PLACEMENT.tensor(rolled(point, k))))
        conjugate = stresses(surface.elasticity(case.material), found.strains)
        sizes[measure] = float((conjugate[:, None] @ found.variation).norm())
    assert sizes["published"] < 1e-12 * sizes["exact"]


@pytest.mark.parametrize("degrees", [45, 128.17, 180, 270])
def test_the_published_energy_of_a_rolled_plate(degrees):
    """B/2 k^2 times the mean of (cos + sin^2)^2 over the angles of the arc, by quadrature."""
    theta = np.radians(degrees)
    k = theta / LENGTH
    nodes, weights = leggauss(24)
    points = np.stack([(nodes + 1) / 2 * LENGTH, 0 * nodes], axis=-1)
    case = shell("plane")
    surface = Undeformed.at_points(case.surface, points, PLACEMENT)
    energy = {}
    for measure in ("exact", "published"):
        strains = surface.strained(measure, surface.gradients(PLACEMENT.tensor(rolled(points, k)))).strains
        density = (strains * stresses(surface.elasticity(case.material), strains))[:, 3:].sum(1) / 2
        energy[measure] = float(density @ PLACEMENT.tensor(weights / 2))
    assert energy["exact"] == pytest.approx(case.material.bending_stiffness * k**2 / 2, rel=1e-12)
    # 1 + 2c - c^2 - 2c^3 + c^4 integrated from 0 to theta
    s, s2, s4 = np.sin(theta), np.sin(2 * theta), np.sin(4 * theta)
    squared = theta / 2 + s2 / 4
    fourth = 3 * theta / 8 + s2 / 4 + s4 / 32
    share = (theta + 2 * s - squared - 2 * (s - s**3 / 3) + fourth) / theta
    assert energy["published"] == pytest.approx(share * energy["exact"], rel=1e-10)
