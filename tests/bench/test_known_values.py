"""Known values: every gated one is recomputed from two independent origins, and every source is in the bibliography."""

import math
import re
from functools import cache

import numpy as np
import pytest

import derivations as origins
from derivations import (
    ball_drape,
    benchmark_shells,
    bent_strip,
    clothing,
    contact,
    cylinder_modes,
    drape,
    elastica,
    fields,
    folds,
    garments,
    gradients,
    heavy_strip,
    identification,
    naghdi,
    passport,
    plane_strip,
    plate_modes,
    plate_modes_by_splines,
    pressed_column,
    resultants,
    roll_up,
    ropes,
    shapes_by_series,
    spiral,
    strip_on_edge,
    woven,
    woven_by_splines,
)
from derivations.annular_plate import annular_plate, deflection, rim_deflection_by_ritz
from derivations.discrete_catenary import hanging_chain
from derivations.exponential_shells import free_cylinder_by_exponentials, roof_by_exponentials
from derivations.navier_plate import square_plate_by_levy
from derivations.pinched_free import diaphragm_by_polynomials
from derivations.rolled_plate import sampled_plate, sampled_rotation
from derivations.sleeve_layers import sleeve_compression_thin_by_collocation
from derivations.sleeve_sector import sleeve_twist_thin_buckled_by_splines
from derivations.torsion import sleeve_torque, sleeve_twist_thin_by_torsion
from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.compare import near_zero

TWIST = math.radians(0.2)  # the relative twist that cases/sleeve_torque.toml prescribes


def torsion():
    values = sleeve_torque(TWIST)
    return {**values, "torque": values["torque_per_radian"], "factor": {"torque": TWIST}}


ORIGINS = {
    **{name: getattr(origins, name) for name in origins.__all__ if name.islower()},
    "hanging_chain": hanging_chain,
    "sleeve_torque": torsion,
    "sleeve_course": origins.sleeve_twist,
    **origins.HYPERBOLOIDS,
    **origins.HYPARS,
    **origins.MANUFACTURED,
    **shapes_by_series.JUDGES,
    **ropes.JUDGES,
    **clothing.JUDGES,
    **fields.JUDGES,
    **contact.JUDGES,
    **ball_drape.JUDGES,
    **garments.JUDGES,
    **passport.JUDGES,
    **plate_modes.JUDGES,
    **bent_strip.JUDGES,
    **cylinder_modes.JUDGES,
    "pressed_column": pressed_column.pressed_column,
    **strip_on_edge.JUDGES,
    **naghdi.JUDGES,
    **resultants.JUDGES,
    **folds.JUDGES,
    **benchmark_shells.JUDGES,
    **gradients.JUDGES,
    **identification.JUDGES,
    **woven.JUDGES,
}
MODES = {
    **plate_modes_by_splines.SECOND_FORMS,
    **bent_strip.SECOND_FORMS,
    **cylinder_modes.SECOND_FORMS,
    **strip_on_edge.SECOND_FORMS,
    **resultants.SECOND_FORMS,
    **benchmark_shells.SECOND_FORMS,
    **gradients.SECOND_FORMS,
    **identification.SECOND_FORMS,
    **woven_by_splines.SECOND_FORMS,
}
LONG = {
    "pressed_column",
    "gradient_cantilever",
    "gradient_diaphragm",
    "gradient_free_mode",
    "gradient_limit",
    "gradient_pinched",
    "gradient_roof",
    "identified_roof",
    "pressed_oval",
    *folds.LONG,
    *strip_on_edge.JUDGES,
    *drape.BODIES,
    "heavy_cantilever",
    "rhombic_plate_modes",
    "pendulum_strip",
    "napkin_plane",
    "napkin_course",
    "napkin_soft_pin",
    "napkin_corner",
    "napkin_corner_early",
    "napkin_moving_corners",
    "napkin_fixed_edges",
    "sleeve_twist",
    "sleeve_course",
    "sleeve_compression_thin",
    "sleeve_twist_thin",
    "sleeve_twist_thin_buckled",
    "slit_annular_plate",
    "cylinder_pull_out",
    "semi_cylinder",
    "pinched_cylinder_nonlinear",
    "hinged_roof_thick",
    "hinged_roof_thin",
    "scordelis_lo_nonlinear",
    "hemisphere_hole_nonlinear",
    *origins.HYPARS,
    *garments.JUDGES,
    *ball_drape.JUDGES,
    *resultants.LONG,
    *benchmark_shells.JUDGES,
    *(name for name in woven.JUDGES if "cantilever" in name or "bias" in name),
    *(name for name in naghdi.JUDGES if name.startswith("hypar") or name.endswith("_soft")),
    "square_plate_nonlinear",
    "guided_ring",
    "sleeve_compression",
    "manufactured_finite_strain",
}
LONG_SECOND = {"pressed_motion", "guided_plate", "guided_ring", "swung_cantilever", "bedded_plate", "hooked_cantilever"}
LONG_SECOND |= {
    name for name in naghdi.SECOND_FORMS if "scordelis_lo" in name or name.startswith("hypar") or name.endswith("_soft")
}
SECOND_FORMS = {
    "Levy's single series": square_plate_by_levy,
    "Fourier series along the axis, exact exponentials along the arc": roof_by_exponentials,
    "Fourier series along the arc, exact exponentials along the axis": free_cylinder_by_exponentials,
    "Fourier series along the arc, Legendre-Ritz along the axis, tail extrapolated": diaphragm_by_polynomials,
    "inextensible elastica in elliptic integrals": elastica.elastica,
    "inextensible column in elliptic integrals": pressed_column.elastica_of_column,
    "inextensible circle": roll_up.inextensible_circle,
    "arc of Kiepert's curve, inextensible": spiral.kiepert,
    "equilibrium of the meridian, by collocation": sleeve_compression_thin_by_collocation,
    "uniform torsion of the linear theory": sleeve_twist_thin_by_torsion,
    "quartic splines on one of eight waves, second derivatives by complex steps": sleeve_twist_thin_buckled_by_splines,
    "forms of the surface through sampled positions": lambda: {**sampled_plate(), **sampled_rotation()},
}
POLYNOMIALS = {
    "cantilever_shear": plane_strip.cantilever_shear,
    "cantilever_moment": plane_strip.cantilever_moment,
    "pressed_column": pressed_column.pressed_column_by_polynomials,
    "cantilever_pressure": plane_strip.cantilever_pressure,
}


@cache
def computed_values(name):
    return ORIGINS[name]()


OTHER_NAMES = {"load_deflection": "load_displacement"}
GATED = sorted({(name, q) for held in catalog.tolerances().values() for name in held for q in held[name]})
FOLDED = [name for name in folds.JUDGES if name in catalog.case_names()]
ELSEWHERE = ("conditioned_", "edit_")  # tests/test_conditioned_origins.py, tests/test_editing_origins.py
JUDGED = [
    pytest.param(name, marks=[pytest.mark.long] if name in LONG else [])
    for name in [*catalog.case_names(), *catalog.own_twins()]
    if any(value.role == "judge" for value in catalog.known_values(name).values)
    and not name.startswith(ELSEWHERE)
    and "thinness" not in name  # tests/test_thinness_cases.py
    and not name.endswith("_mesh")  # tests/problems/shell/test_mesh.py
]


# A test a case, not a quantity: pytest takes longer over a test than these over a quantity.
@pytest.mark.sampled(50)
@pytest.mark.parametrize("name", JUDGED)
def test_judges_are_what_their_origin_computes(name):
    values, theory = catalog.known_values(name), catalog.named_case(name).theory
    for quantity in {value.quantity for value in values.values if value.role == "judge"}:
        known = values.judge(quantity, theory)
        if quantity.startswith("total_energy"):
            assert known.value == 0, quantity  # conserved
            continue
        computed = computed_values(name)
        estimate, factor = of_quantity(computed, quantity), computed.get("factor", {}).get(quantity, 1.0)
        assert abs(known.value - estimate.value * factor) <= known.uncertainty + estimate.uncertainty * factor, quantity
    if name in shapes_by_series.JUDGES:  # a derivation names the quantities of its case
        assert {q.name for q in catalog.named_case(name).quantities} - {"largest_displacement"} <= computed_values(
            name
        ).keys()


def test_a_gated_value_has_two_origins_that_agree():
    for name, quantity in GATED:
        known, figure = catalog.known_values(name), f"{name}: {quantity}"
        judge = known.judge(quantity, catalog.named_case(name).theory)
        assert judge is not None, figure
        seconds = [v for v in known.of(quantity, "origin") if v.theory == judge.theory and v.uncertainty is not None]
        assert seconds, f"{figure}: a gated value needs a second origin"
        assert all(v.origin != judge.origin for v in seconds), figure
        for second in seconds:
            assert abs(second.value - judge.value) <= second.uncertainty + judge.uncertainty, figure


HELD = [
    (name, quantity, allowed)
    for name, quantity in GATED
    for held in catalog.tolerances().values()
    if (allowed := held.get(name, {}).get(quantity))
]


def test_tolerances_are_wider_than_what_is_known():
    for name, quantity, allowed in HELD:
        judge = catalog.known_values(name).judge(quantity, catalog.named_case(name).theory)
        size = allowed.absolute or allowed.relative * abs(judge.value)
        assert judge.uncertainty < 0.1 * size, f"{name}: {quantity}"


def test_a_tolerance_is_absolute_where_the_error_is():
    """A relative bound on an error that has no relative measure would be red whatever the answer."""
    for name, quantity, allowed in HELD:
        case = catalog.named_case(name)
        judge = catalog.known_values(name).judge(quantity, case.theory)
        assert allowed.is_absolute == near_zero(judge, case.quantity(quantity)), f"{name}: {quantity}"


@cache
def second_form(name, origin):
    if origin == "inextensible elastica of a heavy strip":
        return heavy_strip.elastica_of_weight()
    for forms in (MODES, *(m.SECOND_FORMS for m in (contact, clothing, passport, naghdi, shapes_by_series, folds))):
        if name in forms:
            return forms[name]()
    return (POLYNOMIALS[name] if origin.endswith("polynomials of the position") else SECOND_FORMS[origin])()


def of_quantity(values, quantity):
    return values[quantity] if quantity in values else values[OTHER_NAMES[quantity]]


@pytest.mark.sampled(25)
@pytest.mark.parametrize(
    "name",
    [
        "square_plate",
        "scordelis_lo",
        "pinched_cylinder_diaphragm",
        "pinched_cylinder_free",
        "cantilever_shear",
        pytest.param("cantilever_moment", marks=pytest.mark.long),
        "rolled_plate",
        "rigid_rotation",
        *(
            pytest.param(name, marks=pytest.mark.long if name in LONG_SECOND else ())
            for name in shapes_by_series.JUDGES
        ),
        "cantilever_pressure",
        pytest.param("pressed_column", marks=pytest.mark.long),
        *contact.JUDGES,
        *clothing.JUDGES,
        *(pytest.param(name, marks=pytest.mark.long if name in LONG else ()) for name in passport.JUDGES),
        *(pytest.param(name, marks=pytest.mark.long if name in LONG else ()) for name in MODES),
        *(pytest.param(name, marks=pytest.mark.long if name in LONG else ()) for name in FOLDED),
        "sleeve_compression_thin",
        "sleeve_twist_thin",
        pytest.param("sleeve_twist_thin_buckled", marks=pytest.mark.long),
        *(pytest.param(name, marks=pytest.mark.long if name in LONG_SECOND else ()) for name in naghdi.SECOND_FORMS),
    ],
)
def test_second_forms_are_what_they_compute(name):
    known = [v for v in catalog.known_values(name).values if v.role == "origin"]
    assert {v.quantity for v in known} >= {quantity for case, quantity in GATED if case == name}
    for value in (v for v in known if v.source == "shellbench"):
        estimate = of_quantity(second_form(name, value.origin), value.quantity)
        assert abs(value.value - estimate.value) <= 0.1 * value.uncertainty + 1e-15 * abs(value.value)
        assert estimate.uncertainty <= value.uncertainty


def test_every_source_is_in_the_bibliography():
    text = (catalog.data_folder("references") / "bibliography.bib").read_text()
    keys = set(re.findall(r"@\w+\{(\w+),", text))
    used = {v.source for name in catalog.case_names() for v in catalog.known_values(name).values}
    assert used <= keys


def test_files_of_known_values_name_quantities_of_their_cases():
    for path in catalog.data_folder("references").glob("*.toml"):
        names = {q.name for q in catalog.named_case(path.stem).quantities}
        assert {v.quantity for v in catalog.known_values(path.stem).values} <= names


def test_the_annular_plate_by_two_forms():
    assert rim_deflection_by_ritz() == pytest.approx(annular_plate()["rim_deflection"].value, rel=1e-9)
    r = np.linspace(1.0, 2.0, 2001)
    slopes = np.gradient(deflection(r), r, edge_order=2)
    assert abs(slopes[0]) < 1e-5 * np.abs(slopes).max()
    assert np.argmax(deflection(r)) == len(r) - 1
