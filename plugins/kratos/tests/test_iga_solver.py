import numpy as np
import pytest

pytest.importorskip("KratosMultiphysics", reason="needs Kratos: python -m pip install ./plugins/kratos")

from shellbench_kratos import iga_solver, iga_solving
from shellbench_kratos.iga_solver import KratosIgaSettings, KratosIgaSolver

from derivations.elastica import Cantilever, extensible
from derivations.navier_plate import SquarePlate, navier
from shellbench.errors import InputError, SolveFailure
from shellbench.problems.shell.symmetry.symmetry import part_of
from tests.problems.shell.stated_shells import LARGEST, RIM, STEEL, known, plate, ring, strip

SOLVER = KratosIgaSolver()
LENGTH, WIDTH, EH = 2.0, 0.5, STEEL["youngs_modulus"] * STEEL["thickness"]
B = EH * STEEL["thickness"] ** 2 / 12


def test_a_strip_bends_as_a_beam():
    """Without Poisson's effect: w = q x^2 (3 L - x) / (6 B), a cubic, which the splines hold exactly."""
    solution = SOLVER.solve(strip((0, 0, 3.0)), {"cells": (3, 2)})
    x = np.linspace(0, LENGTH, 7)
    points = np.stack([x, np.full_like(x, 0.2)], axis=-1)
    np.testing.assert_allclose(solution.displacement(points)[:, 2], 3.0 * x**2 * (3 * LENGTH - x) / (6 * B), rtol=1e-8)
    kappa = solution.evaluate("bending_strain", points)
    np.testing.assert_allclose(kappa[:, 0], -3.0 * (LENGTH - x) / B, atol=1e-7 * 3 * LENGTH / B)
    membrane, bending = solution.energies()
    assert membrane == pytest.approx(0, abs=1e-12 * bending)
    assert bending == pytest.approx(3.0**2 * LENGTH**3 * WIDTH / (6 * B), rel=1e-8)


def test_a_strip_stretches_as_a_bar():
    """u = q x / (E h), exactly."""
    solution = SOLVER.solve(strip((5.0, 0, 0)), {"cells": (2, 3), "degree": 2})
    assert solution.displacement([1.3, 0.1])[0] == pytest.approx(5.0 * 1.3 / EH, rel=1e-10)
    np.testing.assert_allclose(solution.evaluate("membrane_strain", [1.3, 0.1]), [5.0 / EH, 0, 0], atol=1e-12)


def test_the_wall_carries_force_and_moment():
    solution = SOLVER.solve(strip((5.0, 0, 3.0)), {"cells": (4, 2)})
    force, moment = solution.reaction("wall")
    np.testing.assert_allclose(force, [-5.0 * WIDTH, 0, -3.0 * WIDTH], atol=1e-8)
    # the end's force about the origin is (L, WIDTH/2, 0) x (5, 0, 3) WIDTH
    wanted = -np.cross([LENGTH, WIDTH / 2, 0], [5.0, 0, 3.0]) * WIDTH
    np.testing.assert_allclose(moment, wanted, atol=1e-7)


@pytest.mark.parametrize("radius", [3.0, 0.05])
def test_a_ring_widens_under_pressure(radius):
    """Membrane strain u/R and change of curvature u/R^2: u = p R^2 / (E h (1 + h^2 / (12 R^2))), without Poisson."""
    solution = SOLVER.solve(ring(2.0, radius), {"cells": (8, 2), "degree": 4})
    points = np.random.default_rng(3).random((40, 2)) * [2 * np.pi, 4.0]
    u = 2.0 * radius**2 / (EH * (1 + STEEL["thickness"] ** 2 / (12 * radius**2)))
    normal = np.stack([np.cos(points[:, 0]), np.zeros(40), np.sin(points[:, 0])], axis=-1)
    x = solution.case.surface.derivatives([0.3, 0.2], 1)
    outward = np.sign(np.cross(x[1, 0], x[0, 1]) @ [np.cos(0.3), 0, np.sin(0.3)])
    np.testing.assert_allclose(solution.displacement(points), outward * u * normal, atol=1e-8 * u)


def test_the_plate_converges_to_naviers_series_with_order_four():
    """Cubic splines: displacements of a problem of fourth order converge with h^min(p + 1, 2 (p - 1)) = h^4."""
    case, centre = known("square_plate"), navier(SquarePlate(), 500)[0]
    errors = []
    for cells in (4, 8, 16):
        solution = SOLVER.solve(case, {"cells": (cells, cells)})
        errors.append(abs(solution.history[0].quantities["centre_deflection"] / centre - 1))
    assert np.log2(errors[0] / errors[2]) / 2 == pytest.approx(4, abs=0.3)
    assert errors[2] < 1e-6


@pytest.mark.parametrize("name", ["square_plate", "scordelis_lo"])
def test_the_part_gives_what_the_whole_gives(name):
    """Four copies of a mesh of 6 x 6 are a mesh of 12 x 12 of the whole."""
    case = known(name)
    if case.remove_rigid_motions:
        held = [*case.supports, {"name": "middle", "on": ["xi2_min"], "components": ["z"]}]
        case = plate(
            surface=case.surface, material=case.material, loads=case.loads, points={}, quantities=[LARGEST],
            supports=[s if isinstance(s, dict) else s.model_dump(exclude_unset=True) for s in held],
        )  # fmt: skip
    part = SOLVER.solve(case, {"cells": (6, 6) if name == "square_plate" else (6, 12)})
    domain = case.surface.domain
    whole = SOLVER.solve(case, {"cells": (12, 12), "symmetry": False})
    assert (part.part.copies > 1, whole.part.copies) == (True, 1)
    points = np.asarray(domain.lower) + np.random.default_rng(5).random((30, 2)) * domain.size
    scale = np.abs(whole.displacement(points)).max()
    # on an arc the halves have other weights than the whole, and other functions with them
    close = 1e-9 if name == "square_plate" else 2e-3
    np.testing.assert_allclose(part.displacement(points), whole.displacement(points), atol=close * scale)
    np.testing.assert_allclose(part.energies(), whole.energies(), rtol=close, atol=close * sum(whole.energies()))
    for field in ("membrane_strain", "bending_strain"):
        one, other = part.evaluate(field, points), whole.evaluate(field, points)
        np.testing.assert_allclose(one, other, atol=max(100 * close, 1e-8) * np.abs(other).max() + 1e-18)
    support = case.supports[0].name
    for one, other in zip(part.reaction(support), whole.reaction(support), strict=True):
        np.testing.assert_allclose(one, other, atol=max(close, 1e-8) * max(1.0, np.abs(other).max()) * 10)


def test_supports_together_carry_the_load():
    case = known("scordelis_lo")
    force, _ = SOLVER.solve(case, {"cells": (4, 4)}).reaction("diaphragms")
    area = np.radians(80) * 25 * 50
    np.testing.assert_allclose(force, [0, 90 * area, 0], atol=1e-7 * 90 * area)


def test_kratos_is_in_balance_by_a_rule_of_our_own():
    """Internal forces come from the theory, not from Kratos: what Kratos found balances the loads to rounding."""
    for case in (known("pinched_cylinder_free"), known("annular_plate")):
        assert SOLVER.solve(case, {"cells": (6, 5)}).diagnostics["residual"] < 1e-9


def test_what_rounding_takes_is_known_and_given_back():
    """Crowded knots make an ill-conditioned matrix: the loads' work is off by what the diagnostics say."""
    case = known("pinched_cylinder_free")
    rough, fine = (
        SOLVER.solve(case, {"cells": (12, 12), "degree": 4, "grading": 3.0, "rounding": r}) for r in (1e-3, 1e-10)
    )
    one, other = (s.history[0].quantities["load_deflection"] for s in (rough, fine))
    assert fine.diagnostics["rounding"] <= 1e-10 < rough.diagnostics["rounding"]
    assert abs(one / other - 1) == pytest.approx(rough.diagnostics["rounding"], rel=0.05)


def test_each_load_factor_of_a_linear_case_has_its_own_answer():
    """A load t (1, 2): twice the answer at twice the factor, however many solves came before."""
    case = plate(
        loads=[{"kind": "area", "vector": [0, 0, "-t/1000"]}],
        quantities=[LARGEST, {"name": "half", "kind": "largest_displacement", "at": 0.5}],
    )
    values = SOLVER.solve(case, {"cells": (3, 3)}).history[0].quantities
    assert values["largest"] == pytest.approx(2 * values["half"], rel=1e-9)


@pytest.mark.parametrize("grading", [1.0, 2.0])
def test_the_pinched_cylinder_rises_toward_its_limit(grading):
    """Conforming displacements of a minimum of energy under one load: each refinement lets it give way more."""
    case = known("pinched_cylinder_diaphragm")
    values = [
        SOLVER.solve(case, {"cells": (n, n), "grading": grading}).history[0].quantities["load_deflection"]
        for n in (2, 4, 8)
    ]
    assert values[0] < values[1] < values[2] < 1.8281952e-5  # derivations/pinched_diaphragm.py


def test_a_strip_bends_far_as_the_elastica():
    """The plane problem with stretching (derivations/elastica.py), at the largest force of the case."""
    case = known("cantilever_shear")
    solution = SOLVER.solve(case, {"cells": (12, 1), "load_steps": 4})
    exact = extensible(Cantilever(), 4.0)
    values = solution.history[0].quantities
    assert values["deflection_4"] == pytest.approx(exact.deflection, rel=2e-4)
    assert values["shortening_4"] == pytest.approx(exact.shortening, rel=5e-4)
    assert values["bending_energy"] == pytest.approx(exact.bending, rel=5e-4)
    path = [step for step in solution.history if step.phase == "path"]
    assert [step.at for step in path][-1] == 1.0
    assert {0.25, 0.5, 0.75, 1.0} <= {step.at for step in path}


def test_a_point_of_the_path_that_is_not_passed_is_said_to_be_missing():
    """At 5 mm the load still grows."""
    case = known("hinged_roof_thick")
    short = case.path.model_copy(update={"until": 5.0, "states": ()})
    asked = (case.quantity("limit_load"), case.quantity("deflection").model_copy(update={"at": 5.0}))
    with pytest.raises(SolveFailure, match="turning points") as failure:
        SOLVER.solve(case.model_copy(update={"path": short, "quantities": asked}), {"cells": (2, 2), "load_steps": 5})
    assert failure.value.partial is not None


@pytest.mark.long
def test_the_hinged_roof_passes_its_limit_point():
    case = known("hinged_roof_thick")
    values = SOLVER.solve(case, {"cells": (6, 6), "grading": 1.0, "load_steps": 30}).history[0].quantities
    assert values["limit_load"] == pytest.approx(2225.337, rel=2e-4)  # derivations/hinged_roof.py


OBLIQUE = {"kind": "expression", "x": "xi1", "y": "xi2 + 0.7*xi1", "z": "0", "xi1": [0, 2], "xi2": [0, 1]}
SLIDE = {"name": "slide", "on": ["xi1_max"], "components": ["x", "y"], "clamped": True}


@pytest.mark.parametrize("taken", [
    {"surface": OBLIQUE, "supports": [{"name": "wall", "on": ["xi1_min"]}, SLIDE | {"components": ["x", "y", "z"]}]},
    {"supports": [{"name": "wall", "on": ["xi1_min"]}, SLIDE]},
])  # fmt: skip
def test_a_clamp_is_taken_where_one_component_states_it(taken):
    assert iga_solver.reason(plate(points={}, **taken)) is None


def nonlinear(**changes):
    return plate(theory="kirchhoff-love-nonlinear", loads=[{"kind": "area", "vector": [0, 0, "-t/1000"]}], **changes)


@pytest.mark.parametrize(
    ("case", "word"),
    [
        (lambda: known("napkin_corner"), "Newton's law"),
        (lambda: known("rolled_plate"), "whole surface"),
        (lambda: known("cantilever_moment"), "moments"),
        (lambda: known("cantilever_pressure"), "pressure follows"),
        (lambda: known("hinged_roof_thin"), "arc length"),
        (lambda: known("sleeve_compression"), "move"),
        (lambda: plate(material=STEEL | {"bending_factor": 0.5}), "bending stiffness"),
        (lambda: ring(loads=[{"kind": "area", "vector": ["sin(3*xi1 - 1)", 0, "cos(3*xi1 - 1)"]}]), "closed"),
        (lambda: plate(supports=[], remove_rigid_motions=["translation_x", "translation_y", "translation_z",
            "rotation_x", "rotation_y", "rotation_z"], loads=[{"kind": "area", "vector": [0, 0, "xi1 - 1/2"]}]),
         "rigid motion"),
        (lambda: plate(supports=[RIM | {"on": ["xi1_min"]}, {"name": "pin", "on": ["centre"]}]), "corner"),
        (lambda: nonlinear(path={"after_buckling": "follow"}), "buckling"),
        (lambda: nonlinear(path={"control": "displacement", "quantity": "sag", "until": 1.0}, quantities=[LARGEST, {
            "name": "sag", "kind": "displacement", "points": ["centre"], "direction": [0, 0, -1]}]), "point load"),
        (lambda: plate(surface={"kind": "cylinder", "axis": "y", "radius": 1, "xi1": [10, 50], "xi2": [0, 1]}, points={},
            supports=[{"name": "clamp", "on": ["xi2_min"], "clamped": True}]), "Cartesian"),
        (lambda: plate(surface=OBLIQUE, points={}, supports=[{"name": "wall", "on": ["xi1_min"]}, SLIDE]), "oblique"),
    ],
)  # fmt: skip
def test_what_it_can_not_take_it_declines_in_a_clause(case, word):
    reason = iga_solver.reason(case())
    assert reason is not None
    assert word in reason
    assert reason[0].islower()
    assert not reason.endswith(".")
    with pytest.raises(InputError, match="can't take"):
        SOLVER.solve(case(), {})


@pytest.mark.parametrize(
    "bad", [{"degree": 1}, {"degree": 6}, {"cells": [0, 4]}, {"grading": 0.5}, {"load_steps": 0}, {"mesh": 3}]
)
def test_settings_that_make_no_sense_are_refused(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        KratosIgaSettings.model_validate(bad)


def test_a_path_that_newton_can_not_follow_fails_with_what_was_reached(monkeypatch):
    """Its steps can not be shortened here, and a load of a thousand million times the first is too much for one."""
    monkeypatch.setattr("shellbench_kratos.iga_solving.SHORTEST_STEP", 0.6)
    case = nonlinear(path={"until": 1e9, "states": [1e-6]})
    with pytest.raises(SolveFailure, match="Newton") as failure:
        SOLVER.solve(case, {"cells": (2, 2), "load_steps": 1})
    assert failure.value.partial is not None
    assert failure.value.partial.states == (1e-6, 1.0)


def test_knot_lines_crowd_where_the_load_acts():
    case = known("pinched_cylinder_free")
    part = part_of(case)
    even, graded = (iga_solving.knot_lines(part, KratosIgaSettings(cells=(4, 4), grading=g)) for g in (1.0, 2.0))
    for lines, low, high in zip(even, part.lower, part.upper, strict=True):
        np.testing.assert_allclose(lines, np.linspace(low, high, 5))
    for lines in graded:  # the load is at the upper end of both
        np.testing.assert_allclose(np.diff(lines) / (lines[-1] - lines[0]), np.array([7, 5, 3, 1]) / 16)
    plate = part_of(known("square_plate"))
    for lines, low, high in zip(
        iga_solving.knot_lines(plate, KratosIgaSettings(cells=(4, 4), grading=2.0)),
        plate.lower,
        plate.upper,
        strict=True,
    ):
        np.testing.assert_allclose(lines, np.linspace(low, high, 5))  # no force acts at a point there
