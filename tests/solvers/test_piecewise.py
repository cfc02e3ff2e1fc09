"""Piecewise loads, springs and stiffnesses against closed forms of beams, and what is refused."""

import numpy as np
import pytest
from scipy.integrate import quad

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.solvers.cst.solver import CstSolver
from shellbench.solvers.fem.mesh.grading import graded_mesh
from shellbench.solvers.fem.solver import FemSettings, FemSolver
from shellbench.solvers.ndf.published_solver import PublishedSolver
from shellbench.solvers.ndf.ritz_solver import RitzSettings, RitzSolver
from tests.solvers.fem.shells import CYLINDER, shell

YOUNG, HEIGHT, LOAD = 1.2e7, 0.1, 100.0
BENDING = YOUNG * HEIGHT**3 / 12  # of a strip with Poisson's ratio 0, per width
STRIP = {"kind": "plane", "xi1": [0, 1], "xi2": [0, 0.5]}
MATERIAL = {"youngs_modulus": YOUNG, "poissons_ratio": 0.0, "thickness": HEIGHT}
WALL = {"name": "wall", "on": ["xi1_min"], "clamped": True}
ENDS = [{"name": "ends", "on": ["xi1_min", "xi1_max"], "components": ["z"]},
        {"name": "inside", "on": ["xi1_min"], "components": ["x", "y"]}]  # fmt: skip


def strip(**fields):
    point = {"name": "w", "kind": "displacement", "primary": True, "points": ["at"], "direction": [0, 0, 1]}
    common = {"material": MATERIAL, "points": {"at": [1, 0.25]}, "quantities": [point], "supports": [WALL]}
    return shell(STRIP, **{**common, **fields})


def pressed(formula, **fields):
    return strip(**{"loads": [{"kind": "pressure", "value": formula}], **fields})


def by_fem(case, **settings):
    return measure_all(FemSolver().solve(case, FemSettings(**settings)))["w"]


def by_field(case):
    return measure_all(RitzSolver().solve(case, RitzSettings(neurons=150)))["w"]


# --- what is found in formulas -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("formula", "lines"),
    [
        ("where(xi1 < 0.3, 1, 2)", (0.3,)),
        ("max(0, xi1 - 0.3)", (0.3,)),
        ("abs(xi1 - 0.5) + min(1, 2*xi1, 3*xi1 - 0.75)", (7 / 12, 0.5)),  # at 3/4 neither is the least
        ("abs(xi1**2)", ()),  # touches zero
        ("min(xi1, 2)", ()),
        ("max(xi1, -xi2)", ()),  # depends on both, and never changes over
        ("where(sin(pi*xi1/L) >= sqrt(0.5), 1, 0)", (0.25, 0.75)),
        ("xi1**2 - exp(xi2)", ()),
    ],
)
def test_kinks_are_where_formulas_change_over(formula, lines):
    surface = {"kind": "expression", "x": "xi1", "y": "xi2", "z": "0*L", "xi1": [0, 1], "xi2": [0, 0.5],
               "constants": {"L": 1.0}}  # fmt: skip
    case = shell(surface, loads=[{"kind": "pressure", "value": formula}])
    assert case.kinks[0] == pytest.approx(sorted(lines), abs=1e-12)
    assert case.kinks[1] == ()


def test_a_closed_shell_has_a_kink_at_its_seam_too():
    case = shell(CYLINDER, loads=[{"kind": "pressure", "value": "abs(xi1 - 2)"}])
    assert case.kinks == (pytest.approx((0, 2)), ())
    assert np.abs(graded_mesh(case, (6, 2), 2.0).lines[0][:, None] - [0, 2]).min(axis=0) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"loads": [{"kind": "pressure", "value": "max(xi1, xi2)"}]}, "where xi1 - xi2 is zero, which is no coordinate line"),
        ({"loads": [{"kind": "pressure", "value": "where(t < 0.5, 1, 0)"}]}, "changes over at some t"),
        ({"loads": [{"kind": "point", "on": ["at"], "force": [0, 0, "min(t, 0.1)"]}]}, "changes over at some t"),
        ({"loads": [{"kind": "pressure", "value": "abs(sin(200*xi1))"}]}, "more than 32 values of xi1"),
        ({"loads": [{"kind": "pressure", "value": "where(xi1, 1, 0)"}]}, "one comparison"),
        ({"loads": [{"kind": "pressure", "value": "where(0 < xi1 < 1, 1, 0)"}]}, "one comparison"),
        ({"loads": [{"kind": "pressure", "value": "where(xi1 == 1, 1, 0)"}]}, "one comparison"),
        ({"loads": [{"kind": "pressure", "value": "1 if xi1 < 1 else 0"}]}, "not a formula"),
        ({"loads": [{"kind": "pressure", "value": "xi1 < 1"}]}, "not a formula"),
        ({"loads": [{"kind": "pressure", "value": "max(xi1)"}]}, "'max' in a way that is not allowed"),
        ({"material": {**MATERIAL, "modulus_factor": "where(xi1 < 0.5, 1, 2)"}}, "modulus_factor' jumps at xi1 = 0.5"),
        ({"surface": {"kind": "expression", "x": "xi1", "y": "xi2", "z": "abs(xi1 - 0.5)", "xi1": [0, 1], "xi2": [0, 1]}},
         "its tangent turns by 90 degrees"),
        ({"supports": [{**WALL, "motion": {"kind": "value", "z": "max(xi2, 0.1)"}}]}, "'wall' is piecewise"),
    ],
)  # fmt: skip
def test_what_can_not_be_resolved_is_one_sentence(change, words):
    surface = change.get("surface", STRIP)
    others = {key: value for key, value in change.items() if key != "surface"}
    point = {"points": {"at": [1, 0.25]}, "material": MATERIAL, "supports": [WALL]}
    with pytest.raises(InputError, match=words) as caught:
        shell(surface, **{**point, **others})
    assert "\n" not in str(caught.value)


# --- closed forms ------------------------------------------------------------------------------------------------


def test_half_a_load_bends_a_strip_as_a_beam():
    # Roark: a simply supported beam with q on one half: 5 q L^4 / (768 E I) at the middle
    case = pressed(f"where(xi1 < 0.5, {LOAD}, 0)", supports=ENDS, points={"at": [0.5, 0.25]})
    closed = 5 * LOAD / (768 * BENDING)
    # cubic Hermite elements are exact at the nodes of a beam, but only if the jump is at one of them
    assert by_fem(case, cells=(3, 2)) == pytest.approx(closed, rel=1e-9)
    assert by_field(case) == pytest.approx(closed, rel=1e-4)


def test_a_line_of_load_within_a_cantilever():
    # q on [a, b] of a clamped beam: the tip goes by the integral of q s^2 (3 L - s) / (6 E I)
    a, b = 1 / 3, 0.71
    closed = quad(lambda s: LOAD * s**2 * (3 - s) / (6 * BENDING), a, b)[0]
    case = pressed(f"where(xi1 > {a}, where(xi1 < {b}, {LOAD}, 0), 0)")
    assert by_fem(case, cells=(3, 2)) == pytest.approx(closed, rel=1e-9)
    assert by_field(case) == pytest.approx(closed, rel=1e-4)


def test_a_strip_that_tapers_from_its_middle_on():
    # w'' = M / (B f^3), M = q (1 - x)^2 / 2; the tip goes by the integral of M (1 - x) / (B f^3)
    def stiffness(x):
        return BENDING * min(1, 1.5 - x) ** 3

    closed = quad(lambda x: LOAD * (1 - x) ** 3 / 2 / stiffness(x), 0, 1, points=[0.5], epsabs=0, epsrel=1e-12)[0]
    case = pressed(LOAD, material={**MATERIAL, "thickness_factor": "min(1, 1.5 - xi1)"})
    assert case.kinks == (pytest.approx((0.5,)), ())
    assert by_fem(case, max_unknowns=8000) == pytest.approx(closed, rel=1e-5)
    assert by_field(case) == pytest.approx(closed, rel=1e-3)


def test_springs_under_half_of_a_strip():
    # a rigid strip that rests on springs under its first half alone, with its weight there: it sinks by q / k
    springs = [{"name": "bed", "stiffness": "where(xi1 < 0.5, 1e4, 0)", "components": ["z"]}]
    case = pressed("where(xi1 <= 0.5, 100, 0)", springs=springs, supports=[],
                   remove_rigid_motions=["translation_x", "translation_y", "rotation_z"])  # fmt: skip
    assert by_fem(case, cells=(3, 2)) == pytest.approx(0.01, rel=1e-9)
    assert by_field(case) == pytest.approx(0.01, rel=1e-6)


@pytest.mark.long
def test_the_field_knows_how_sure_it_is_beside_a_jump():
    """A roof bends within a layer along the line where its load jumps."""
    roof = {"kind": "cylinder", "axis": "y", "radius": 1.0, "xi1": [30, 150], "xi2": [0, 1]}
    point = {"name": "w", "kind": "displacement", "primary": True, "points": ["at"], "direction": [0, 0, 1]}
    case = shell(
        roof, material={**MATERIAL, "thickness": 0.02}, points={"at": [90, 0.4]}, quantities=[point],
        supports=[{"name": "walls", "on": ["xi1_min", "xi1_max"]}],
        loads=[{"kind": "pressure", "value": "where(xi2 < 0.4, -100, -300)"}],
    )  # fmt: skip
    field, fem = RitzSolver().solve(case), FemSolver().solve(case, FemSettings(max_unknowns=20_000))
    error = abs(measure_all(field)["w"] - measure_all(fem)["w"])
    assert error <= 2 * (field.uncertainty["w"] + fem.uncertainty["w"])
    assert error <= 1e-3 * abs(measure_all(fem)["w"])


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", ["flipped", "swapped", "stretched", "warped", "units", "turned"])
def test_variants_carry_kinks(name):
    case = pressed(f"where(xi1 < 0.3, {LOAD}, 0)")
    variant = catalog.variant_of(case, name)
    assert sum(map(len, variant.kinks)) == 1
    one, other = (by_fem(c, cells=(8, 4)) * c.primary.factor for c in (case, variant))
    assert other == pytest.approx(one, rel=1e-4)
    with pytest.raises(InputError, match="kinks across these coordinates"):
        catalog.variant_of(case, "oblique")


@pytest.mark.parametrize("solver", [CstSolver(), PublishedSolver()])
def test_other_solvers_decline(solver):
    case = pressed("max(xi1, 0.5)")
    assert solver.declines(case) == "a formula of it has kinks or jumps, and this solver takes smooth ones only"
