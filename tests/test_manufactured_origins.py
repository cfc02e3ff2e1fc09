"""Manufactured solutions: the declared load is that of the prescribed displacement, by the strong form and by the weak."""

import numpy as np
import pytest

from derivations.manufactured import FINITE, NAMES, exact_formulas, load_formulas, manufactured, manufactured_load
from derivations.manufactured_splines import (
    finite_strain_by_splines,
    frame_of,
    manufactured_by_splines,
    residuals,
    spline_shell,
    surface_of,
)
from shellbench.bench.catalogue import catalog
from shellbench.problem import VARIANT
from shellbench.problems.shell.quantities.measure import measure
from shellbench.problems.shell.variants.variants import VARIANTS
from shellbench.solvers.fem.solver import FemSettings, FemSolver
from tests.test_doubly_curved_origins import derivatives

LOAD_ERROR = 1e-10  # of a polynomial, relative to the largest load: ten times what is cut off
BUBBLE = "(1 - xi1**2)**2*(1 - xi2**2)**2"  # vanishes with its slopes at all edges of [-1, 1] x [-1, 1]
VIRTUAL = [
    (BUBBLE, "0", "0"),
    ("0", BUBBLE, "0"),
    ("0", "0", BUBBLE),
    (f"{BUBBLE}*exp(xi1)", f"{BUBBLE}*xi1*cos(2*xi2)", f"{BUBBLE}*sin(3*xi1 + xi2)"),
    (f"{BUBBLE}*cos(4*xi1*xi2)", f"-{BUBBLE}*xi2", f"{BUBBLE}*(xi1 - xi2)**3"),
]


def points_of(case, count=60, seed=0):
    """Random points of a shell, (count, 2)."""
    domain = case.surface.domain
    return np.random.default_rng(seed).uniform(domain.lower, domain.upper, (count, 2))


def with_displacement(case, exact, **fields):
    """The case with another prescribed displacement, whose load is not asked for."""
    data = case.data() | fields
    next(q for q in data["quantities"] if "exact" in q)["exact"] = exact
    return type(case).model_validate(data)


def distance(case):
    """Largest difference of the declared load and that of the strong form, relative to the largest load."""
    points = points_of(case)
    expected = manufactured_load(case, points)
    return np.abs(case.evaluate(case.loads[0].vector, points)[0, 0] - expected).max() / np.abs(expected).max()


# --- the strong form -----------------------------------------------------------------------------


def test_a_clamped_strip_in_bending_and_stretching_has_the_loads_of_textbooks():
    """On a plane f_x = -D u'' and f_z = B w'''' for displacements of xi1 alone."""
    plane = {"kind": "plane", "xi1": [-1, 1], "xi2": [-1, 1]}
    case = with_displacement(catalog.named_case(NAMES[0]), ["xi1**3", 0, "xi1**6"], surface=plane)
    points = points_of(case)
    material = case.material
    expected = np.zeros((len(points), 3))
    expected[:, 0] = -6 * material.membrane_stiffness * points[:, 0]
    expected[:, 2] = 360 * material.bending_stiffness * points[:, 0] ** 2
    np.testing.assert_allclose(manufactured_load(case, points), expected, atol=1e-10 * np.abs(expected).max())


def test_a_cylinder_that_breathes_needs_the_pressure_of_the_boiler_formula():
    """A ring of radius R that grows by w holds D w / R^2; by kappa of the theory, B w / R^4 more."""
    breath = ["sin((xi1 + s*xi2)/R)", 0, "cos((xi1 + s*xi2)/R)"]
    case = with_displacement(catalog.named_case("manufactured_oblique_cylinder"), breath)
    points, radius = points_of(case), 2.0
    angle = (points[:, 0] + 0.6 * points[:, 1]) / radius
    outward = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=-1)
    pressure = case.material.membrane_stiffness / radius**2 + case.material.bending_stiffness / radius**4
    np.testing.assert_allclose(manufactured_load(case, points), pressure * outward, atol=1e-9 * pressure)


@pytest.mark.parametrize("name", NAMES)
def test_a_rigid_motion_needs_no_load(name):
    x, y, z = catalog.named_case(name).surface.formulas
    turned = [f"1 + 2*({z}) - ({y})", f"({x}) - 3*({z})", f"3*({y}) - 2*({x})"]
    case = with_displacement(catalog.named_case(name), turned)
    load = manufactured_load(case, points_of(case))
    assert np.abs(load).max() < 1e-10 * case.material.membrane_stiffness


@pytest.mark.parametrize("name", NAMES)
def test_the_declared_load_is_that_of_the_displacement(name):
    assert distance(catalog.named_case(name)) < LOAD_ERROR


@pytest.mark.parametrize("name", NAMES)
def test_the_declared_load_is_what_is_printed(name):
    case = catalog.named_case(name)
    points = points_of(case)
    printed, declared = (case.evaluate(v, points)[0, 0] for v in (load_formulas(case), case.loads[0].vector))
    np.testing.assert_allclose(declared, printed, atol=1e-11 * np.abs(declared).max())


@pytest.mark.parametrize("variant", [v for v in VARIANTS if v != "helical"])
def test_variants_carry_load_and_displacement_along(variant):
    """Turned, in other units and in other coordinates, the load is still that of the displacement."""
    for name in NAMES:
        case = catalog.named_case(f"{name}{VARIANT}{variant}")
        assert distance(case) < LOAD_ERROR


# --- the exact theory ----------------------------------------------------------------------------

CLAMPED = [{"name": "rim", "on": ["xi1_min", "xi1_max", "xi2_min", "xi2_max"], "clamped": True}]
EXACT = {"theory": "kirchhoff-love-nonlinear", "supports": CLAMPED, "loads": [{"kind": "area", "vector": [0, 0, "t"]}]}


@pytest.mark.parametrize("name", NAMES)
def test_a_large_rotation_needs_no_load(name):
    """By 90 degrees about z, and shifted: u = (-x - y + 1, x - y, 2)."""
    x, y, _ = catalog.named_case(name).surface.formulas
    case = with_displacement(catalog.named_case(name), [f"1 - ({x}) - ({y})", f"({x}) - ({y})", 2], **EXACT)
    assert np.abs(manufactured_load(case, points_of(case))).max() < 1e-10 * case.material.membrane_stiffness


def test_a_rolled_plate_needs_the_pressure_of_its_bending():
    """Rolled to the radius r without stretching, its moment B/r is constant, and n,11 = -n/r^2: f = (B/r^3) n outward."""
    rolled = ["0.5*sin(2*xi1) - xi1", 0, "0.5*cos(2*xi1)"]  # r = 1/2
    plane = {"kind": "plane", "xi1": [-1, 1], "xi2": [-1, 1]}
    case = with_displacement(catalog.named_case(NAMES[0]), rolled, surface=plane, **EXACT)
    points = points_of(case)
    outward = np.stack([np.sin(2 * points[:, 0]), 0 * points[:, 0], np.cos(2 * points[:, 0])], axis=-1)
    pressure = 8 * case.material.bending_stiffness
    np.testing.assert_allclose(manufactured_load(case, points), pressure * outward, atol=1e-9 * pressure)


@pytest.mark.parametrize("name", NAMES)
def test_a_large_displacement_is_in_balance_with_its_load(name):
    """Slopes of a half: by the weak form of the exact theory, with the first variation of the exact strains."""
    exact = [f"0.05*{BUBBLE}*(1 + xi2)", f"0.05*{BUBBLE}*xi1", f"0.3*{BUBBLE}*(1 + 0.3*xi1 - 0.2*xi2)"]
    case = with_displacement(catalog.named_case(name), exact, **EXACT)
    assert np.abs(residuals(case, VIRTUAL, by_strong_form=True)).max() < 1e-9
    linear = with_displacement(catalog.named_case(name), exact)
    assert np.abs(residuals(linear, VIRTUAL, by_strong_form=True)).max() < 1e-9
    apart = manufactured_load(case, points_of(case)) - manufactured_load(linear, points_of(case))
    assert np.abs(apart).max() > 0.1 * np.abs(manufactured_load(linear, points_of(case))).max()


# --- the weak form -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*NAMES, FINITE])
def test_the_prescribed_displacement_is_in_balance_with_the_declared_load(name):
    """Strains are the variation of the exact ones, and integrals are Gauss's: nothing of the strong form is used."""
    case = catalog.named_case(name)
    assert np.abs(residuals(case, VIRTUAL)).max() < 1e-11
    data = case.data()
    data["loads"][0]["vector"][2] = f"1.001*({data['loads'][0]['vector'][2]})"
    assert np.abs(residuals(type(case).model_validate(data), VIRTUAL)).max() > 1e-5


@pytest.mark.parametrize("name", NAMES)
def test_the_frame_of_the_splines_has_the_derivatives_of_its_values(name):
    case = catalog.named_case(name)
    for field in (surface_of(case), frame_of(case)):
        found = derivatives(lambda a, b, f=field: f(np.array([a]), np.array([b]), 0, 0)[0], 0.3, 0.2)[1:]
        expected = [field(np.array([0.3]), np.array([0.2]), *o)[0] for o in ((1, 0), (0, 1), (2, 0), (0, 2), (1, 1))]
        np.testing.assert_allclose(found, expected, atol=1e-7)


def test_splines_meet_what_supports_prescribe():
    """On every edge the displacement is that of the motion, and the normal turns nowhere about the edge."""
    case = catalog.named_case("manufactured_oblique_cylinder")
    answer = spline_shell(case, 3).solve()
    motion = case.supports[0].motion.vector
    for s in (-1.0, -0.4, 0.3, 1.0):
        for xi in ((-1.0, s), (1.0, s), (s, -1.0), (s, 1.0)):
            np.testing.assert_allclose(answer.displacement(*xi), case.evaluate(motion, xi)[0, 0], atol=1e-16)


@pytest.mark.long
@pytest.mark.parametrize("name", [*NAMES, FINITE])
def test_second_forms_are_what_they_compute_and_agree(name):
    found = (finite_strain_by_splines if name == FINITE else manufactured_by_splines)(name)
    first, known, case = manufactured(name), catalog.known_values(name), catalog.named_case(name)
    assert set(found) == set(first) == {q.name for q in case.quantities}
    for quantity, estimate in found.items():
        (second,) = known.of(quantity, "origin")
        judge = known.judge(quantity, case.theory)
        assert abs(second.value - estimate.value) <= 0.5 * second.uncertainty
        assert abs(second.value - judge.value) <= second.uncertainty + judge.uncertainty


@pytest.mark.parametrize("name", [*NAMES, FINITE])
def test_both_parts_of_the_energy_count(name):
    known = manufactured(name)
    share = known["bending_energy"].value / known["strain_energy"].value
    assert 0.1 < share < 0.9


@pytest.mark.parametrize("name", [*NAMES, FINITE])
def test_the_prescribed_displacement_meets_the_supports(name):
    """On the edges it is the motion, and u,n . a3 = 0 with the conormal n."""
    case = catalog.named_case(name)
    support = case.supports[0]
    s = np.linspace(-1, 1, 9)
    for edge in (case.places[on] for on in support.on):
        points = edge.points(case.surface.domain, s)
        u = case.evaluate(exact_formulas(case), points, order=1)
        x = case.surface.derivatives(points, 1)
        held = case.motion(support, edge, points)[0, 0]
        np.testing.assert_allclose(u[0, 0], held, atol=1e-18)
        tangents = np.stack([x[1, 0], x[0, 1]], axis=-2)
        inverse = np.linalg.inv(tangents @ np.swapaxes(tangents, 1, 2))
        slopes = np.stack([u[1, 0], u[0, 1]], axis=-2)
        across = np.einsum("nb,nbk->nk", inverse[:, edge.axis], slopes)
        np.testing.assert_allclose(np.sum(across * np.cross(x[1, 0], x[0, 1]), axis=-1), 0.0, atol=1e-16)


# --- solvers -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*NAMES, pytest.param(FINITE, marks=pytest.mark.long)])
def test_the_error_of_the_field_falls_with_the_fourth_power_of_the_mesh(name):
    case = catalog.named_case(name)
    errors = [
        measure(FemSolver().solve(case, FemSettings(cells=(n, n), degree=3)), case.quantity("field_error"))
        for n in (4, 8)
    ]
    assert 12 < errors[0] / errors[1] < 24


@pytest.mark.sampled(2)
@pytest.mark.parametrize("variant", ["turned", "units", "flipped", "swapped", "stretched"])
def test_a_variant_has_the_error_of_the_case(variant):
    """The mesh is the same one, and so is what it leaves."""
    name = "manufactured_oblique_cylinder"
    cases = catalog.named_case(name), catalog.named_case(f"{name}{VARIANT}{variant}")
    one, other = (measure(FemSolver().solve(c, FemSettings(cells=(5, 5))), c.quantity("field_error")) for c in cases)
    assert other == pytest.approx(one, rel=1e-5)
