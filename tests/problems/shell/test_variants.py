"""Variants ask the same question: the same shell in space, with the same loads and supports, in another form.

Nothing is solved here. The data of a variant are compared with the case at the same material points.
"""

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError
from shellbench.problem import VARIANT
from shellbench.problems.expression import Expression
from shellbench.problems.shell.field import RESULTANTS
from shellbench.problems.shell.quantities.measure import area_rule, load_density
from shellbench.problems.shell.question.contact import gaps
from shellbench.problems.shell.question.loads import AreaLoad, GravityLoad, PressureLoad
from shellbench.problems.shell.question.surface import COORDINATES
from shellbench.problems.shell.variants.placing import ABOUT, ASKEW, CYCLE, turning
from shellbench.problems.shell.variants.reparametrisation import flipped, helical, oblique, stretched, swapped, warped
from shellbench.problems.shell.variants.units import MILLIMETRES_TONNES, converted_points
from shellbench.problems.shell.variants.variants import VARIANTS, size
from tests.families import shells, with_something_new

SHELLS = shells()
CASES = (
    "square_plate",
    "scordelis_lo",
    "pinched_cylinder_free",
    "annular_plate",
    "sleeve_torque",
    "napkin_corner",
    "manufactured_oblique_cylinder",
    "sheared_sleeve",  # whose points are named a turn away
)
CHARTS = {
    "flipped": flipped,
    "swapped": swapped,
    "stretched": stretched,
    "warped": warped,
    "oblique": oblique,
    "helical": helical,
}


def variants_of(case):
    """Return the variants of a case by name, or why it can't be asked so."""
    found = {}
    for name in VARIANTS:
        try:
            found[name] = catalog.variant_of(case, name)
        except InputError as error:
            found[name] = str(error)
    return found


def variants(name):
    """Return the variants that a case can be asked in."""
    return [found for found in variants_of(catalog.named_case(name)).values() if not isinstance(found, str)]


def distances(points):
    """Return the distances (n, n) between points (n, 3)."""
    return np.linalg.norm(points[:, None] - points[None], axis=-1)


def invariants(case):
    """Return values that no variant changes, up to units: area, and sums of the loads and of their squares."""
    points, weights = area_rule(case)
    at = case.states[-1]
    spread = [load for load in case.loads if isinstance(load, AreaLoad | PressureLoad | GravityLoad)]
    density = load_density(case.model_copy(update={"loads": tuple(spread)}), points, at)
    force = weights @ density
    return weights.sum(), np.linalg.norm(force), weights @ np.sum(density**2, axis=-1)


@pytest.mark.parametrize("name", with_something_new(SHELLS))
def test_every_shell_can_be_asked_otherwise(name):
    """All variants are whole cases. Helices need a closed surface, units a path by loads; local loads, kinks stay on lines.

    Moments and shear forces change their signs with the normal, and factors have none.
    """
    case = catalog.named_case(name)
    if case.surface.kind == "mesh":
        assert all("mesh" in found or name == "helical" for name, found in variants_of(case).items())
        return
    refused = {name for name, found in variants_of(case).items() if isinstance(found, str)}
    lines = any(quantity.kind == "contact_point" for quantity in case.quantities)  # along coordinates
    lines |= getattr(case.material, "along", "xi1") == "xi2"
    local = any(getattr(load, "frame", "global") == "local" for load in case.loads)
    kinked = any(case.kinks)
    signed = any(quantity.kind in RESULTANTS for quantity in case.quantities)
    if any(q.kind == "derivative" and q.parameter(case).group == "surface" for q in case.quantities):
        return  # other coordinates have other bounds and constants
    assert refused <= {"helical", "units", "kilometres"} | ({"swapped"} if local else set()) | (
        {"oblique"} if kinked or lines else set()
    ) | ({"flipped", "swapped"} if signed else set())


def length_of(variant):
    """Units of length of a variant in a metre."""
    return {"units": 1000.0, "kilometres": 1e-3}.get(variant.name.partition("@")[2], 1.0)


def test_obstacles_turn_and_are_converted_with_their_shell():
    case = catalog.named_case("contact_hill")
    grid = case.surface.domain.grid(4, 3).reshape(-1, 2)
    gap, _ = gaps(case, grid, np.zeros((len(grid), 3)))
    for name in ("axes", "turned", "units"):
        variant = variants_of(case)[name]
        points, length = (converted_points(case, MILLIMETRES_TONNES, grid), 1000) if name == "units" else (grid, 1)
        assert gaps(variant, points, np.zeros((len(grid), 3)))[0] == pytest.approx(gap * length, abs=1e-10 * length)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", CASES)
def test_area_and_loads_stay(name):
    case = catalog.named_case(name)
    area, force, square = invariants(case)
    for variant in variants(name):
        length = length_of(variant)
        found = invariants(variant)
        assert found[0] == pytest.approx(area * length**2, rel=2e-6)
        assert found[1] == pytest.approx(force, rel=2e-6, abs=1e-9 * max(1.0, np.sqrt(square * area)))
        assert found[2] == pytest.approx(square / length**2, rel=2e-6)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", CASES)
def test_points_of_quantities_stay_where_they_are(name):
    """In charts they are the same points in space; turned ones have the same distances from each other."""
    case = catalog.named_case(name)
    names = [place for place in case.places if hasattr(case.places[place], "xi")]
    before = case.surface.position(np.reshape([case.places[place].xi for place in names], (-1, 2)))
    for variant in variants(name):
        chart = variant.name.partition(VARIANT)[2] in CHARTS
        if not chart:
            after = variant.surface.position(np.reshape([variant.places[place].xi for place in names], (-1, 2)))
            unit = length_of(variant)
            np.testing.assert_allclose(distances(after), unit * distances(before), atol=1e-9 * unit)
        for asked, other in zip(case.quantities, variant.quantities, strict=True):
            if chart and hasattr(asked, "points"):
                old = case.surface.position([case.places[p].xi for p in asked.points])
                new = variant.surface.position([variant.places[p].xi for p in other.points])
                np.testing.assert_allclose(new, old, atol=1e-11 * size(case))


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("make", CHARTS.values(), ids=CHARTS)
def test_a_chart_and_its_inverse_agree(name, make):
    """The formulas map the result of `to_new` back, and the new rectangle is the image of the old one."""
    domain = catalog.named_case(name).surface.domain
    try:
        chart = make(domain)
    except InputError:
        assert make is helical
        assert not any(domain.periodic)
        return
    rng = np.random.default_rng(0)
    for _ in range(20):
        xi = tuple(float(x) for x in rng.uniform(domain.lower, domain.upper))
        new = chart.to_new(xi)
        old = [Expression(formula, COORDINATES).derivatives(new, 0)[0, 0] for formula in chart.formulas]
        back = domain.wrap(old)
        np.testing.assert_allclose(back, domain.wrap(xi), atol=1e-9 * max(domain.size))
        inside = [chart.lower[k] - 1e-12 <= new[k] <= chart.upper[k] + 1e-12 for k in (0, 1)]
        assert all(inside)


@pytest.mark.parametrize("name", ["scordelis_lo@oblique", "pinched_cylinder_free@helical"])
def test_oblique_coordinates_are_oblique(name):
    """Their metric has an off-diagonal part, and their curvature a twist: what only right-angled lines hide."""
    variant = catalog.named_case(name)
    xi = variant.surface.domain.grid(9, 9)
    x = variant.surface.derivatives(xi, order=2)
    cosine = np.sum(x[1, 0] * x[0, 1], -1) / np.linalg.norm(x[1, 0], axis=-1) / np.linalg.norm(x[0, 1], axis=-1)
    assert np.abs(cosine).max() > 0.1
    normal = np.cross(x[1, 0], x[0, 1])
    twist = np.sum(x[1, 1] * normal, -1) / np.linalg.norm(normal, axis=-1)
    assert (
        np.abs(twist).max() > 1e-3 * np.abs(np.sum(x[2, 0] * normal, -1)).max() / np.linalg.norm(normal, axis=-1).max()
    )


@pytest.mark.parametrize("rotation", [CYCLE, ASKEW, *ABOUT])
def test_rotations_are_rotations(rotation):
    matrix = np.array(rotation)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(matrix) == pytest.approx(1)


def test_what_holds_cartesian_components_is_turned_about_their_axis():
    """A roof on diaphragms follows a rotation about its axis only; a sleeve whose ends are held whole, any."""
    assert turning(catalog.named_case("sleeve_torque")) is ASKEW
    roof = catalog.named_case("scordelis_lo")  # held in x and y at its ends, free along z
    assert turning(roof) is ABOUT[2]


def test_pressure_pushes_to_the_same_side_in_every_chart():
    data = catalog.named_case("scordelis_lo").data() | {"suites": []}
    data["loads"] = [{"kind": "pressure", "value": "100*(1 + 0.3*cos(xi1)*xi2)"}]
    case = catalog.find_kind("shell").problem.model_validate(data)
    points, weights = area_rule(case)
    expected = weights @ load_density(case, points, 1.0)
    for name in set(CHARTS) - {"helical"}:
        variant = catalog.variant_of(case, name)
        points, weights = area_rule(variant)
        np.testing.assert_allclose(weights @ load_density(variant, points, 1.0), expected, rtol=1e-6, atol=1e-6)


def test_values_in_other_units_come_back_in_metres():
    """A displacement, an energy, a force and a torque, each by its dimension."""
    factors = {q.kind: q.factor for name in ("scordelis_lo", "sleeve_torque", "annular_plate")
               for q in catalog.named_case(f"{name}@units").quantities}  # fmt: skip
    assert factors["displacement"] == pytest.approx(1e-3)
    assert factors["strain_energy"] == pytest.approx(1e-3)
    assert factors["torque"] == pytest.approx(1e-3)
    assert factors["reaction"] == 1.0


def test_the_draw_is_the_same_everywhere_and_never_empty():
    """A hash draws, so that it is known beforehand what is asked."""
    assert catalog.variants_asked("obstacle_course") == (
        "square_plate@swapped",
        "scordelis_lo@oblique",
        "pinched_cylinder_diaphragm@axes",
        "pinched_cylinder_free@units",
    )
    assert len(catalog.variants_asked("variants")) > 50


def test_a_variant_keeps_known_values_and_tolerances():
    name = "scordelis_lo@oblique"
    assert catalog.known_values(name) == catalog.known_values("scordelis_lo")
    assert catalog.tolerance(name, "edge_deflection", "fem") == catalog.tolerance(
        "scordelis_lo", "edge_deflection", "fem"
    )
    assert catalog.named_case(name).digest() != catalog.named_case("scordelis_lo").digest()


def test_what_is_no_variant_is_refused_in_one_sentence():
    with pytest.raises(
        InputError, match="unknown variant 'nonsense' of case 'square_plate': variants are axes, turned"
    ):
        catalog.find_case("square_plate@nonsense")
    with pytest.raises(InputError, match="has no variant 'helical': no coordinate closes on itself"):
        catalog.find_case("square_plate@helical")
    with pytest.raises(InputError, match="problems of kind 'rope' have none"):
        catalog.find_case("hanging_chain@axes")


def test_a_users_own_case_has_variants_too(tmp_path):
    (tmp_path / "mine.toml").write_text((catalog.data_folder("cases") / "square_plate.toml").read_text())
    variant = catalog.find_case(f"{tmp_path}/mine.toml@oblique")
    assert variant.name == "mine@oblique"
    assert catalog.is_own(variant)


def test_every_variant_says_what_it_is():
    assert len({variant.words for variant in VARIANTS.values()}) == len(VARIANTS)
