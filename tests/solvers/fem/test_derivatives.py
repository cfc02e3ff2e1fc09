"""Derivatives by the adjoint: those of the answer on the same mesh, for every kind of load, support and parameter."""

import dataclasses
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError
from shellbench.problem import Step
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.question.parameters import changed, parameters_of
from shellbench.solvers.fem.derivatives.answer import FemAnswer
from shellbench.solvers.fem.linear import equilibrium, modes
from shellbench.solvers.fem.mechanics.kinematics import Deformation, Midsurface
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.path import large_displacement
from shellbench.solvers.fem.solver import FemSolver
from shellbench.testing.derivatives import sum_rule_weights

STEP = 2e-3  # of the parameter: the difference of sixth order has 1e-16 of truncation, and 1e-9 of rounding
SIXTH = {-3: -1 / 60, -2: 9 / 60, -1: -45 / 60, 1: 45 / 60, 2: -9 / 60, 3: 1 / 60}
SHELL = {
    "title": "A shell with everything",
    "theory": "kirchhoff-love-linear",
    "surface": {
        "kind": "expression",
        "x": "xi1",
        "y": "xi2*(1 + s*xi1)",
        "z": "H*xi1*(2 - xi1) + 0.3*xi2**2 + H*xi1**3/5",
        "xi1": [0, 1.3],
        "xi2": [0.1, 1],
        "constants": {"H": 0.4, "s": 0.1, "q": 2.0},
    },
    "material": {
        "youngs_modulus": 1e7,
        "poissons_ratio": 0.3,
        "thickness": 0.05,
        "areal_density": 3.0,
        "modulus_factor": "1 + q*xi1/5",
    },
    "points": {"a": [0.7, 0.4], "b": [0.5, 0.6]},
    "supports": [{"name": "wall", "on": ["xi1_min"], "clamped": True}],
    "springs": [{"name": "bed", "stiffness": "1e3*(1 + q*xi1)", "components": ["x", "z"]}],
    "loads": [
        {"kind": "area", "vector": ["1 + q*xi1*xi2", -3, "q"]},
        {"kind": "pressure", "value": "2 + q*xi2"},
        {"kind": "gravity", "acceleration": [1, 2, -9]},
        {"kind": "area", "frame": "local", "vector": [3, "q", 2]},
        {"kind": "edge", "on": ["xi2_max"], "vector": [1, "q*xi1", -2], "frame": "local"},
        {"kind": "moment", "on": ["xi1_max"], "axis": [0.1, 1, 0.2], "value": "q + xi2"},
        {"kind": "point", "on": ["b"], "force": [0, 0, 1]},
    ],
    "quantities": [
        {"name": "moved", "kind": "displacement", "points": ["a"], "direction": [1, 2, 3], "primary": True},
        {"name": "place", "kind": "position", "points": ["a", "b"], "direction": [1, 2, 3]},
        {"name": "membrane", "kind": "membrane_energy"},
        {"name": "energy", "kind": "strain_energy"},
        {"name": "potential", "kind": "potential_energy"},
        {"name": "force", "kind": "reaction", "support": "wall", "direction": [1, 1, 1]},
        {"name": "pulled", "kind": "membrane_force", "component": "12", "on": ["a"]},
        {"name": "bent", "kind": "moment", "component": "22", "on": ["a", "xi1_max,xi2_max"]},
    ],
}


def mesh_of(case, cells, degree):
    domain = case.surface.domain
    first, second = (
        low + size * np.linspace(0, 1, n + 1) for n, low, size in zip(cells, domain.lower, domain.size, strict=True)
    )
    return TensorMesh(domain, (first, second), degree)


def solved(case, cells=(2, 2), degree=4):
    mesh = mesh_of(case, cells, degree)
    if case.modal:
        return FemAnswer.of(modes.solve_modes(case, mesh, 2 * degree + 1, "auto").solution)
    if not case.linear:
        return FemAnswer.of(large_displacement.solve(case, mesh, 7, (1 / 8, 1e-6))[0].solution)
    found = equilibrium.solve(case, mesh, case.states, 2 * degree + 1, "auto")
    alone = Step(0, 0.0, found.potential_energy, 1, case.states[-1])
    return FemAnswer.of(dataclasses.replace(found.solution, history=(alone,)))


def largest_error(case, names, quantities=None, tolerance=None, **mesh):
    """Return the largest error of derivatives on a mesh against differences, relative to Q/p."""
    answer, known = solved(case, **mesh), parameters_of(case)
    asked = [q for q in case.quantities if quantities is None or q.name in quantities]
    found = np.array([answer.gradient(q, names) for q in asked])
    worst = 0.0
    for column, name in enumerate(names):
        p = known[name]
        size = abs(p.value) or 1.0
        runs = {k: solved(changed(case, p, p.value + k * STEP * size), **mesh) for k in SIXTH}
        for row, q in enumerate(asked):
            difference = sum(w * q.measure(runs[k]) for k, w in SIXTH.items()) / STEP
            worst = max(worst, abs(found[row, column] * size - difference) / abs(q.measure(answer)))
    return worst


@cache
def shell():
    return build_case(SHELL, name="shell", where="shell")


GROUPS = {
    "material": ("material.youngs_modulus", "material.thickness", "material.poissons_ratio", "material.areal_density"),
    "factors": ("loads.1", "loads.6", "loads.7", "springs.bed"),
    "surface": ("surface.H", "surface.s", "surface.q"),
    "bounds and points": ("surface.xi1_min", "surface.xi2_max", "points.a.xi1", "points.b.xi2"),
}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("group", GROUPS)
def test_a_derivative_is_that_of_the_answer_on_the_same_mesh(group):
    assert largest_error(shell(), GROUPS[group]) < 3e-8


@pytest.mark.long
@pytest.mark.parametrize("degree", [3, 5])
def test_derivatives_in_other_degrees(degree):
    names = [name for group in GROUPS.values() for name in group]
    assert largest_error(shell(), names, cells=(3, 2), degree=degree) < 3e-8  # no line of cells crosses a point


@settings(max_examples=4, deadline=None, derandomize=True)
@given(st.floats(0.1, 0.8), st.floats(-0.4, 0.4), st.floats(0.02, 0.1), st.floats(-0.3, 0.45), st.booleans())
def test_derivatives_of_random_small_shells(height, twist, thickness, ratio, clamped):
    data = SHELL | {"springs": [], "supports": [{"name": "wall", "on": ["xi1_min", "xi2_max"], "clamped": clamped}]}
    data["surface"] = SHELL["surface"] | {"constants": {"H": height, "s": twist, "q": 1.0}}
    data["material"] = {"youngs_modulus": 2e9, "poissons_ratio": ratio, "thickness": thickness, "areal_density": 1.0}
    case = build_case(data, name="random", where="random")
    assert largest_error(case, ("material.thickness", "surface.H"), {"moved", "energy", "pulled"}) < 1e-7


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("cylinder_modes", ("surface.radius", "material.areal_density")),
        ("stretched_plate_modes", ("loads.1", "surface.xi2_max")),
        ("plate_compression", ("loads.1", "material.poissons_ratio")),
    ],
)
def test_derivatives_of_modes(name, more):
    case = catalog.named_case(name)
    assert largest_error(case, ("material.thickness", *more), {case.quantities[0].name}, cells=(4, 4)) < 1e-7


def test_derivatives_of_a_path():
    case = catalog.named_case("cantilever_pressure")
    names = ("material.youngs_modulus", "material.thickness", "loads.1")
    assert largest_error(case, names, {"deflection_100", "strain_energy"}, cells=(6, 1), degree=3) < 1e-6


@pytest.mark.long
def test_derivatives_of_a_limit_load():
    case = catalog.named_case("hinged_roof_thick")
    names = ("material.youngs_modulus", "material.thickness", "surface.radius", "loads.1")
    asked = {"limit_load", "load_20", "free_edge_deflection"}
    assert largest_error(case, names, asked, cells=(4, 4), degree=3) < 1e-6
    answer, limit = solved(case, cells=(4, 4), degree=3), case.quantity("limit_load")
    by_modulus = answer.derivative(limit, "material.youngs_modulus")
    exact, off = limit.measure(answer) / case.material.youngs_modulus, answer.interpolation_error(limit)
    assert off < 1e-7
    assert by_modulus == pytest.approx(exact, rel=1e-9 + off)


@pytest.mark.parametrize("name", ["scordelis_lo", "square_plate", "pinched_cylinder_free"])
def test_the_sum_rule_holds_on_any_mesh(name):
    case = catalog.named_case(name)
    answer, weights, known = solved(case, cells=(4, 4)), sum_rule_weights(case), parameters_of(case)
    for q in (case.primary, case.quantity("strain_energy")):
        terms = answer.gradient(q, list(weights)) * [known[n].value * w for n, w in weights.items()]
        length, force = q.powers
        # rounding of a thin shell, in which large terms cancel
        assert sum(terms) == pytest.approx((length + 2 * force) * q.measure(answer), abs=1e-7 * np.abs(terms).max())


def test_variations_are_those_of_the_mechanics():
    from shellbench.solvers.fem.derivatives.variations import strained

    rng = np.random.default_rng(0)
    x = {key: rng.normal(size=(20, 3)) for key in ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))}
    u, v = 0.2 * rng.normal(size=(2, 20, 5, 3))
    deformed = Deformation.from_gradients(Midsurface.from_position(x), u)
    found = strained(x, {(0, 0): u, (1, 0): v}, 2).strains
    assert np.allclose(found[0, 0].T, deformed.strains, atol=1e-13)
    assert np.allclose(found[1, 0].T, np.einsum("nij,nj->ni", deformed.operator, v.reshape(20, -1)), atol=1e-13)
    stresses = rng.normal(size=(20, 6))
    second = np.einsum("na,nab,nb->n", v.reshape(20, -1), deformed.second_variation(stresses), v.reshape(20, -1))
    assert np.allclose(np.sum(stresses * 2 * found[2, 0].T, axis=1), second, atol=1e-12)


def asked(change):
    quantity = {"name": "d", "kind": "derivative", "derivative_of": "moved", "with_respect_to": "material.thickness"}
    data = SHELL | {"quantities": [*SHELL["quantities"], quantity | {"unit": "m/m"} | change]}
    return build_case(data, name="asked", where="asked")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"with_respect_to": "material.weight"}, "is no parameter of the case; known are material.youngs_modulus"),
        ({"derivative_of": "lost"}, "no quantity of the case"),
        ({"derivative_of": "d"}, "which has no derivative"),
        ({"unit": "m"}, "its unit is 'm', but must be 'm/m'"),
        ({"at": 0.5}, "has no 'at'"),
        ({"with_respect_to": "loads.9"}, "is no parameter of the case"),
    ],
)
def test_a_derivative_that_makes_no_sense_is_refused_in_one_sentence(change, words):
    with pytest.raises(InputError, match=words) as refused:
        asked(change)
    assert "\n" not in str(refused.value)


def test_a_table_shows_the_relative_derivative_beside_that_with_units():
    case = asked({})
    words = case.quantity("d").words(case, {"d": -6.0, "moved": 0.1}.get)
    assert words == "derivative of moved by material.thickness, relative -3"


def test_a_relative_derivative_has_no_unit():
    case = asked({"relative": True, "unit": ""})
    answer = solved(case)
    values = {q.name: q.measure(answer) for q in case.quantities}
    slope = answer.derivative(case.primary, "material.thickness")
    assert values["d"] == pytest.approx(slope * 0.05 / values["moved"], rel=1e-14)


@pytest.mark.long
@pytest.mark.parametrize("name", ["gradient_roof@turned", "gradient_roof@units", "gradient_cantilever@oblique"])
def test_variants_have_the_same_derivatives(name):
    case, known = catalog.find_case(name), catalog.known_values(name.partition("@")[0])
    answer = FemSolver().solve(case)
    for q in case.quantities:
        assert q.factor * q.measure(answer) == pytest.approx(known.judge(q.name, case.theory).value, rel=1e-5), q.name
