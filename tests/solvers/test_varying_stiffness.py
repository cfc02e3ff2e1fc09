"""Modulus and thickness that vary over the shell, against closed forms, in both solvers' own mechanics."""

import math

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.quantities.measure import measure
from shellbench.problems.shell.symmetry.symmetry import part_of
from shellbench.problems.shell.variants.variants import VARIANTS
from shellbench.solvers.cst.solver import CstSolver
from shellbench.solvers.fem.solver import FemSolver
from shellbench.solvers.ndf.published_solver import PublishedSolver
from shellbench.solvers.ndf.ritz_solver import RitzSolver

LENGTH, YOUNG, HEIGHT = 2.0, 1e7, 0.02
BENDING = YOUNG * HEIGHT**3 / 12  # at nu = 0, where a strip is a beam of its width
TAPERED = "1 - 0.25*xi1"  # half as thick at its end
SOLVERS = {"fem": (FemSolver(), 1e-5), "ndf-ritz": (RitzSolver(), 1e-3)}  # chosen before any answer was seen


def strip(load, quantities, theory="linear", **factors):
    """A strip without lateral contraction, clamped at xi1 = 0 and loaded at xi1 = 2."""
    data = {
        "title": "Strip",
        "theory": f"kirchhoff-love-{theory}",
        "surface": {"kind": "plane", "xi1": [0, LENGTH], "xi2": [0, 1]},
        "material": {"youngs_modulus": YOUNG, "poissons_ratio": 0.0, "thickness": HEIGHT, **factors},
        "points": {"end": [LENGTH, 0.3]},
        "supports": [{"name": "wall", "on": ["xi1_min"], "clamped": True}],
        "loads": [{"on": ["xi1_max"], **load}],
        "quantities": [{"primary": n == 0, **q} for n, q in enumerate(quantities)],
    }
    return build_case(data, "strip", "strip")


def moved(direction):
    return {"name": "moved", "kind": "displacement", "points": ["end"], "direction": direction}


def energy(kind):
    return {"name": kind, "kind": kind}


def answers(case, solver):
    solution = SOLVERS[solver][0].solve(case)
    return {q.name: measure(solution, q) for q in case.quantities}, SOLVERS[solver][1]


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_tapered_cantilever_bends_as_a_beam_of_its_own_height(solver):
    """B w'' = P (L - x) with B = B0 (1 - x/2L)^3: w(L) = P L^3 / B0 (8 ln 2 - 5), where a prism has 1/3."""
    force = 0.01
    case = strip(
        {"kind": "edge", "vector": [0, 0, -force]},
        [moved([0, 0, -1]), energy("bending_energy"), energy("membrane_energy")],
        thickness_factor=TAPERED,
    )
    found, allowed = answers(case, solver)
    expected = force * LENGTH**3 / BENDING * (8 * math.log(2) - 5)
    assert found["moved"] == pytest.approx(expected, rel=allowed)
    assert found["bending_energy"] == pytest.approx(force * expected / 2, rel=allowed)
    assert abs(found["membrane_energy"]) < 1e-9 * force * expected


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_bar_stretches_as_its_modulus_and_its_section_say(solver):
    """E h u' = N: with E0 (1 + x/L) and h0 (1 - x/2L), u(L) = N L / (E0 h0) 2/3 ln 4, and 1 in a prism."""
    force = 5.0
    case = strip(
        {"kind": "edge", "vector": [force, 0, 0]},
        [moved([1, 0, 0]), energy("membrane_energy")],
        modulus_factor="1 + xi1/2",
        thickness_factor=TAPERED,
    )
    found, allowed = answers(case, solver)
    expected = force * LENGTH / (YOUNG * HEIGHT) * 2 / 3 * math.log(4)
    assert found["moved"] == pytest.approx(expected, rel=allowed)
    assert found["membrane_energy"] == pytest.approx(force * expected / 2, rel=allowed)


@pytest.mark.long
@pytest.mark.parametrize("solver", SOLVERS)
def test_a_tapered_strip_rolls_up_by_its_own_curvature(solver):
    """Under an end moment B theta' = M: theta(L) = 3 M L / B0, and the bending energy is M theta / 2."""
    moment = BENDING / LENGTH / 3  # one radian; the stretch by h^2/12 theta'^2 is 2e-4 of the energy at most
    case = strip(
        {"kind": "moment", "axis": [0, -1, 0], "value": f"{moment!r}*t"},
        [energy("bending_energy")],
        theory="nonlinear",
        thickness_factor=TAPERED,
    )
    found, _ = answers(case, solver)
    assert found["bending_energy"] == pytest.approx(moment / 2, rel=1e-3)


def scaled(name, factors, youngs_modulus=1.0, thickness=1.0):
    """Two cases: one with factors, the other with the modulus and the thickness that they make."""
    data = catalog.named_case(name).data()
    one = data | {"name": "one", "material": data["material"] | factors}
    changed = {k: data["material"][k] * f for k, f in (("youngs_modulus", youngs_modulus), ("thickness", thickness))}
    other = data | {"name": "other", "material": data["material"] | changed}
    return [type(catalog.named_case(name)).model_validate(d) for d in (one, other)]


@pytest.mark.parametrize(
    "name", ["hypar_clamped_1e_2", pytest.param("manufactured_oblique_cylinder", marks=pytest.mark.long)]
)
@pytest.mark.parametrize("solver", SOLVERS)
def test_constant_factors_are_another_shell(solver, name):
    """Clamps on curved edges have terms with the stiffness in them, which must be the same one.

    Features of the field are scaled by the thickness itself, so that another factor of it is another field.
    """
    settings = {"fem": {"cells": (6, 6), "max_unknowns": 100}, "ndf-ritz": {"neurons": 40}}[solver]
    thicker = 1.5 if solver == "fem" else 1.0
    pair = scaled(name, {"modulus_factor": "2.0 + 0*xi1", "thickness_factor": thicker}, 2.0, thicker)
    solutions = [SOLVERS[solver][0].solve(case, settings) for case in pair]
    for quantity in pair[0].quantities:
        one, other = (measure(solution, quantity) for solution in solutions)
        assert one == pytest.approx(other, rel=1e-6)


@pytest.mark.parametrize(
    "variant", [*(pytest.param(name, marks=pytest.mark.long) for name in ("swapped", "units", "warped")), "turned"]
)
def test_variants_carry_the_factors_along(variant):
    case = strip(
        {"kind": "edge", "vector": [0, 0, -0.01]}, [moved([0, 0, -1])], thickness_factor="1 - xi1/4 + 0.1*sin(xi2)"
    )
    data = VARIANTS[variant].make(case)
    other = build_case({k: v for k, v in data.items() if k != "name"}, "strip", "strip")
    one, found = (
        c.quantities[0].factor * measure(FemSolver().solve(c, {"cells": (16, 16)}), c.quantities[0])
        for c in (case, other)
    )
    assert found == pytest.approx(one, rel=1e-4)


def test_a_stiffness_without_symmetry_leaves_no_plane_of_symmetry():
    for formula, copies in (("1 + xi2*(1 - xi2)", 2), ("1 + xi2", 1)):
        load = {"kind": "edge", "vector": [0, 0, -0.01]}
        assert part_of(strip(load, [energy("strain_energy")], modulus_factor=formula)).copies == copies


@pytest.mark.parametrize("solver", [CstSolver(), PublishedSolver()])
def test_other_solvers_decline(solver):
    case = strip({"kind": "edge", "vector": [0, 0, -1]}, [energy("strain_energy")], thickness_factor=TAPERED)
    assert solver.declines(case) == "its modulus or thickness varies, and this solver takes the same everywhere"


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        ("1 - xi1", "field 'material.thickness_factor' is not finite, or not positive, on the shell"),
        ("1/xi1", "field 'material.thickness_factor' is not finite"),
        ("1 + t", "a factor of the material: '1 + t' uses the unknown name 't'"),
    ],
)
def test_what_is_no_thickness_is_refused(factor, words):
    with pytest.raises(InputError, match="strip: ") as error:
        strip({"kind": "edge", "vector": [0, 0, -1]}, [energy("strain_energy")], thickness_factor=factor)
    assert words in str(error.value)


def test_cases_that_have_no_factors_have_the_digest_that_they_had():
    physics = catalog.named_case("square_plate").physics()
    assert not {"modulus_factor", "thickness_factor"} & physics["material"].keys()
    tapered = strip({"kind": "edge", "vector": [0, 0, -1]}, [energy("strain_energy")], thickness_factor=TAPERED)
    plain = strip({"kind": "edge", "vector": [0, 0, -1]}, [energy("strain_energy")])
    assert tapered.digest() != plain.digest()
    np.testing.assert_allclose(tapered.material.factors([[0.0, 0.0], [2.0, 1.0]], {}), [[1, 1], [1, 0.5]])
