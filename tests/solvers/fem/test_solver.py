"""Answers of `fem`: known problems, symmetry, units, balance, and its own estimate of its error."""

import numpy as np
import pytest
from pydantic import ValidationError

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError, SolveFailure
from shellbench.problems.shell.case import build_case
from shellbench.solvers.fem import solving
from shellbench.solvers.fem.algebra import direct_solve
from shellbench.solvers.fem.linear import equilibrium
from shellbench.solvers.fem.mesh.grading import graded_mesh
from shellbench.solvers.fem.refinement import first_level, level_cells
from shellbench.solvers.fem.solver import FemSettings, FemSolver
from tests.solvers.fem.shells import EVERY_EDGE, EVERY_MOTION, LARGEST, MATERIAL, shell

DOWN = {"kind": "area", "vector": [0, 0, -1.0]}
CENTRE = {"name": "w", "kind": "displacement", "primary": True, "points": ["c"], "direction": [0, 0, -1]}
PLATE = {"kind": "plane", "xi1": [0, 1], "xi2": [0, 1]}


def plate(supports, **fields):
    return shell(PLATE, supports=supports, points={"c": [0.5, 0.5]}, quantities=[CENTRE], loads=[DOWN], **fields)


def solve(case, **settings):
    return FemSolver().solve(case, FemSettings(**settings))


def value(solution):
    return solution.history[-1].quantities[solution.case.primary.name]


def bending_stiffness():
    return MATERIAL["youngs_modulus"] * MATERIAL["thickness"] ** 3 / 12 / (1 - MATERIAL["poissons_ratio"] ** 2)


def test_clamped_square_plate():
    # w = 0.0012653191 q L^4 / B: Taylor & Govindjee (2004), Comm. Numer. Meth. Eng. 20, 757-765
    solution = solve(plate([{"name": "rim", "on": EVERY_EDGE, "clamped": True}]))
    assert solution.diagnostics["converged"]
    assert value(solution) * bending_stiffness() == pytest.approx(0.0012653191, rel=6e-7)
    assert solution.uncertainty["w"] < 6e-7 * value(solution)


def test_cylindrical_bending_of_a_strip():
    """A strip between two clamps and two planes of symmetry is a beam of stiffness B: w = q L^4 / 384 B."""
    supports = [
        {"name": "walls", "on": ["xi1_min", "xi1_max"], "clamped": True},
        {"name": "sides", "on": ["xi2_min", "xi2_max"], "symmetry": "y"},
    ]
    solution = solve(plate(supports), cells=(3, 2))
    # a quartic: its values at the nodes are those of the exact beam
    assert solution.displacement([1 / 3, 0.7])[2] == pytest.approx(
        -((1 / 3) ** 2) * (2 / 3) ** 2 / 24 / bending_stiffness(), rel=1e-10
    )
    moment = solution.reaction("walls", centre=(0.5, 0.5, 0))[1]
    force = solution.reaction("walls")[0]
    assert np.allclose(force, [0, 0, 1], atol=1e-10)
    assert np.allclose(moment, 0, atol=1e-10)


@pytest.mark.parametrize("clamped", [False, True])
def test_a_quarter_with_planes_of_symmetry_is_the_whole_plate(clamped):
    whole = solve(plate([{"name": "rim", "on": EVERY_EDGE, "clamped": clamped}]), cells=(6, 6))
    supports = [
        {"name": "rim", "on": ["xi1_min", "xi2_min"], "clamped": clamped},
        {"name": "x", "on": ["xi1_max"], "symmetry": "x"},
        {"name": "y", "on": ["xi2_max"], "symmetry": "y"},
    ]
    half = {"kind": "plane", "xi1": [0, 0.5], "xi2": [0, 0.5]}
    quarter = solve(
        shell(half, supports=supports, points={"c": [0.5, 0.5]}, quantities=[CENTRE], loads=[DOWN]), cells=(3, 3)
    )
    points = 0.5 * np.random.default_rng(0).uniform(size=(30, 2))
    assert np.allclose(quarter.displacement(points), whole.displacement(points), rtol=1e-9, atol=1e-9 * value(whole))
    assert sum(quarter.energies()) == pytest.approx(sum(whole.energies()) / 4, rel=1e-9)


def test_an_eighth_of_the_pinched_cylinder_is_the_whole():
    data = catalog.named_case("pinched_cylinder_diaphragm").model_dump(
        mode="json", exclude_unset=True, exclude={"name"}
    )
    whole = solve(build_case(data, "whole", "test"), cells=(6, 5))
    eighth = data | {
        "surface": data["surface"] | {"closed": False, "xi1": [0, 90], "xi2": [0, 300]},
        "points": {"top": [90, 300]},
        "supports": [
            {"name": "diaphragm", "on": ["xi2_min"], "components": ["x", "z"]},
            {"name": "y", "on": ["xi2_max"], "symmetry": "y"},
            {"name": "z", "on": ["xi1_min"], "symmetry": "z"},
            {"name": "x", "on": ["xi1_max"], "symmetry": "x"},
        ],
        "remove_rigid_motions": [],
        "loads": [{"kind": "point", "on": ["top"], "force": [0, 0, -0.25]}],
        "quantities": [CENTRE | {"points": ["top"]}],
    }
    part = solve(build_case(eighth, "part", "test"), cells=(6, 5))
    assert value(part) == pytest.approx(value(whole), rel=2e-6)


def test_a_symmetric_load_gives_a_symmetric_answer():
    case = catalog.named_case("pinched_cylinder_free")
    solution = solve(case, cells=(6, 4))
    rng = np.random.default_rng(0)
    angle, along = rng.uniform(-1.5, 1.5, 20), rng.uniform(0, 300, 20)
    mirrored = [
        (np.pi / 2 + s * angle, 300 + t * along, np.array([s, t, 1])) for s in (1, -1) for t in (1, -1)
    ]  # fmt: skip
    fields = [solution.displacement(np.stack(p[:2], axis=-1)) * p[2] for p in mirrored]
    opposite = solution.displacement(np.stack([-np.pi / 2 + angle, 300 + along], axis=-1)) * [-1, 1, -1]
    largest = np.abs(fields[0]).max()
    for other in (*fields[1:], opposite):
        assert np.allclose(fields[0], other, atol=1e-7 * largest)


def test_the_answer_holds_no_removed_rigid_motion():
    solution = solve(catalog.named_case("pinched_cylinder_free"), cells=(6, 4))
    n = 200
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    y, w = np.polynomial.legendre.leggauss(60)
    points = np.stack(np.meshgrid(angle, 300 + 300 * y, indexing="ij"), axis=-1)
    u, x = solution.displacement(points), solution.case.surface.position(points) - [0, 300, 0]
    weights = np.broadcast_to(w / w.sum() / n, u.shape[:2])
    largest = np.abs(u).max()
    assert np.abs(np.einsum("ij,ijc->c", weights, u)).max() < 1e-6 * largest
    assert np.abs(np.einsum("ij,ijc->c", weights, np.cross(x, u))).max() < 1e-6 * largest * 300


def test_units_do_not_matter():
    metre, newton = 7.0, 3.0
    supports = [{"name": "wall", "on": ["xi1_min"], "clamped": True}]
    surface = {"kind": "cylinder", "axis": "x", "radius": 1.0, "xi1": [0, 100], "xi2": [0, 2]}
    answers = []
    for length, force in ((1.0, 1.0), (metre, newton)):
        case = shell(
            surface | {"radius": length, "xi2": [0, 2 * length]},
            supports=supports,
            material={"youngs_modulus": 1e4 * force / length**2, "poissons_ratio": 0.3, "thickness": 0.05 * length},
            loads=[{"kind": "pressure", "value": force / length**2}],
            quantities=[LARGEST, {"name": "energy", "kind": "strain_energy"}],
        )
        quantities = solve(case, cells=(4, 4)).history[-1].quantities
        answers.append((quantities["largest"] / length, quantities["energy"] / (length * force)))
    assert answers[0] == pytest.approx(answers[1], rel=1e-9)


@pytest.mark.parametrize("method", ["superlu", "pardiso"])
def test_direct_solvers_agree(method):
    if method == "pardiso":
        pytest.importorskip("pypardiso")
    case = catalog.named_case("pinched_cylinder_free")
    ours, theirs = (solve(case, cells=(5, 4), direct_solver=name) for name in ("dissection", method))
    assert value(ours) == pytest.approx(value(theirs), rel=1e-8)


def test_loads_out_of_balance_are_refused():
    case = shell(loads=[DOWN], remove_rigid_motions=EVERY_MOTION)
    with pytest.raises(SolveFailure, match="not in balance"):
        solve(case)


def test_loads_that_are_not_finite_everywhere_are_refused():
    load = {"kind": "pressure", "value": "sqrt((xi1 - 0.05)**2*(xi1 - 0.07)*(xi1 - 0.02))"}
    with pytest.raises(InputError, match="'pressure' is not finite"):
        shell(PLATE, supports=[{"name": "rim", "on": EVERY_EDGE}], loads=[load])


def roof(thickness):
    data = catalog.named_case("scordelis_lo").model_dump(mode="json", exclude_unset=True, exclude={"name"})
    return build_case(data | {"material": data["material"] | {"thickness": thickness}}, "thin", "test")


def test_a_shell_too_thin_for_its_meshes_is_a_failure_that_says_so():
    with pytest.raises(SolveFailure, match="do not resolve the shell") as failure:
        solve(roof(1e-9), max_unknowns=6000)
    assert "\n" not in str(failure.value)
    assert failure.value.partial.uncertainty["edge_deflection"] > 0


def strip(thickness):
    surface = {"kind": "plane", "xi1": [0, 50], "xi2": [0, 1]}
    tip = {"name": "tip", "kind": "displacement", "points": ["tip"], "direction": [0, 0, -1], "primary": True}
    material = {"youngs_modulus": 2e11, "poissons_ratio": 0, "thickness": thickness}
    return shell(surface, material=material, points={"tip": [50, 0.5]}, quantities=[tip],
                 supports=[{"name": "wall", "on": ["xi1_min"], "clamped": True}],
                 loads=[{"kind": "area", "vector": [0, 0, -1]}])  # fmt: skip


@pytest.mark.parametrize("thickness", [0.02, 2e-4, 5e-6])
def test_a_thin_strip_bends_as_a_beam(thickness):
    # q L^4 / (8 E I) without Poisson's effect; h / L down to 1e-7
    case = strip(thickness)
    solution = solve(case)
    exact = 50**4 / (8 * 2e11 * thickness**3 / 12)
    assert value(solution) == pytest.approx(exact, rel=1e-9)
    assert abs(value(solution) - exact) <= 2 * solution.uncertainty["tip"]


def test_strains_form_a_residual_that_mends_the_rounding_of_the_matrix(monkeypatch):
    # cubics bend as the beam does at the nodes: all of the tip's error is rounding
    case, exact = strip(2e-4), 50**4 / (8 * 2e11 * 2e-4**3 / 12)
    mesh = graded_mesh(case, (32, 4), 2.0, ((2.6, 1.0), (2.6, 2.6)))

    def error():
        found = equilibrium.solve(case, mesh, [1.0], 7, "auto")
        return abs(found.solution.displacement([[50, 0.5]])[0, 2] / -exact - 1)

    careful = error()
    monkeypatch.setattr(direct_solve, "CAREFUL", np.inf)
    monkeypatch.setattr(direct_solve, "LARGEST_CORRECTION", np.inf)
    assert careful < 1e-10
    assert error() > 1e3 * careful


def test_a_trial_that_fails_is_no_failure_of_the_run(monkeypatch):
    honest = solving.balanced_share

    def lost(trial, *rest):
        def fails(cells):
            raise SolveFailure("lost")

        return honest(fails, *rest)

    monkeypatch.setattr(solving, "balanced_share", lost)
    assert solve(plate([{"name": "rim", "on": EVERY_EDGE}])).diagnostics["converged"] is True


def test_a_mesh_that_is_lost_in_rounding_ends_a_run_and_not_its_answer(monkeypatch):
    honest = equilibrium.solve

    def limited(case, mesh, *rest):
        if mesh.dof_count > 10_000:
            raise direct_solve.RoundingError("lost")
        return honest(case, mesh, *rest)

    monkeypatch.setattr(solving.equilibrium, "solve", limited)
    solution = solve(plate([{"name": "rim", "on": EVERY_EDGE}]), symmetry=False, tolerance=1e-12)
    assert solution.mesh.dof_count <= 10_000
    assert solution.diagnostics["converged"] is False
    assert solution.uncertainty["w"] > 0


def test_a_limit_on_unknowns_gives_an_answer_that_is_not_called_converged():
    solution = solve(plate([{"name": "rim", "on": EVERY_EDGE}]), max_unknowns=1000)
    assert solution.diagnostics["converged"] is False
    assert solution.parameters <= 1000


def rippled(load, waves):
    """Return a simply supported plate under half waves of pressure that asks for energies, and the energy, J.

    Navier's series has one term: w = q / (B k^4) sin sin, and the energy is q w / 8 of an area of 1.
    """
    m, n = waves
    case = shell(
        PLATE,
        supports=[{"name": "rim", "on": EVERY_EDGE}],
        quantities=[
            {"name": "strain_energy", "kind": "strain_energy", "primary": True},
            {"name": "bending_energy", "kind": "bending_energy"},
        ],
        loads=[{"kind": "pressure", "value": f"{load}*sin({m}*pi*xi1)*sin({n}*pi*xi2)"}],
    )
    return case, load**2 / (8 * bending_stiffness() * np.pi**4 * (m**2 + n**2) ** 2)


@pytest.mark.parametrize("load", [1e-6, 1e2])
def test_energies_are_as_sure_as_convergence_says_however_small_the_load(load):
    case, energy = rippled(load, (7, 5))
    solution = solve(case)
    found = solution.history[-1].quantities["strain_energy"]
    assert solution.diagnostics["converged"]
    assert solution.uncertainty["strain_energy"] <= 10 * 6e-7 * energy  # energies have a leeway of ten
    assert abs(found - energy) <= solution.uncertainty["strain_energy"]
    assert solution.diagnostics["not_converged"] == []


def test_an_energy_that_is_not_sure_is_named():
    case, energy = rippled(1e-6, (23, 17))
    solution = solve(case, max_unknowns=3000)
    assert abs(solution.history[-1].quantities["strain_energy"] / energy - 1) > 10 * 6e-7
    assert solution.diagnostics["converged"] is False
    assert solution.diagnostics["not_converged"] == ["strain_energy", "bending_energy"]


def test_what_converged_before_a_failure_comes_with_it(monkeypatch):
    honest = equilibrium.solve

    def limited(case, mesh, *rest):
        if mesh.dof_count > 4800:
            raise MemoryError
        return honest(case, mesh, *rest)

    monkeypatch.setattr(solving.equilibrium, "solve", limited)
    with pytest.raises(SolveFailure, match="memory") as failure:
        solve(plate([{"name": "rim", "on": EVERY_EDGE}]), symmetry=False)
    assert 0 < failure.value.partial.mesh.dof_count <= 4800


def test_history_progress_and_differences_tell_of_every_mesh():
    told = []
    solution = FemSolver().solve(plate([{"name": "rim", "on": EVERY_EDGE}]), FemSettings(), progress=told.append)
    unknowns = [step.unknowns for step in solution.history]
    assert len(told) == len(unknowns) == len(solution.diagnostics["mesh_differences"]) + 1
    assert unknowns == sorted(unknowns)
    assert solution.parameters == unknowns[-1]
    assert all(a.seconds < b.seconds for a, b in zip(solution.history, solution.history[1:], strict=False))
    differences = [d["largest_difference"] for d in solution.diagnostics["mesh_differences"]]
    assert differences == sorted(differences, reverse=True)


def test_ritz_energies_only_fall_on_nested_meshes():
    energies = [solve(plate([{"name": "rim", "on": EVERY_EDGE}]), cells=(n, n)).history[0].energy for n in (2, 4, 8)]
    assert energies == sorted(energies, reverse=True)


def test_a_shell_that_may_turn_is_declined_at_finite_strain():
    case = shell(theory="kirchhoff-love-nonlinear")
    assert "it needs supports against rotation_x" in FemSolver().declines(case)
    assert FemSolver().declines(shell()) is None
    with pytest.raises(InputError, match="can't take"):
        solve(case)


@pytest.mark.parametrize("bad", [{"cells": (0, 3)}, {"tolerance": 0}, {"grading": 4}, {"direct_solver": "magic"}])
def test_settings_out_of_range_are_refused(bad):
    with pytest.raises(ValidationError):
        FemSettings(**bad)


def test_cells_go_where_the_energy_asks_for_them():
    """A sleeve that is only twisted changes around its rim's circle in x and z, and hardly along its axis."""
    solution = solve(catalog.named_case("sleeve_torque"), tolerance=1e-3)
    around, along = solution.mesh.cells
    assert around >= 4 * along
    assert level_cells(0, 0) == (8, 8)
    assert level_cells(2, 2) == (32, 8)
    assert first_level(lambda cells: 4 * cells[0] * cells[1]) == 0
    assert first_level(lambda cells: 400 * cells[0] * cells[1]) < 0


@pytest.mark.parametrize(("degree", "rounding"), [(3, 1e-9), (5, 1e-7)])
@pytest.mark.parametrize("axis", [0, 1])
def test_surfaces_closed_in_either_coordinate(axis, degree, rounding):
    """The same pinched ring with its coordinates exchanged."""
    ring = {"kind": "expression", "constants": {"R": 1.0}}
    swap = (lambda pair: pair) if axis == 0 else (lambda pair: pair[::-1])
    around, along = swap(("xi1", "xi2"))
    # exchanging the coordinates turns a3 round; the loads are vectors
    ring |= {"x": f"R*cos({around})", "y": along, "z": f"R*sin({around})", "periodic": [around], "angles": [around]}
    ring |= {around: [0, 360], along: [0, 0.5]}
    case = shell(
        ring,
        points={"c": list(swap((90, 0.25))), "d": list(swap((270, 0.25)))},
        remove_rigid_motions=EVERY_MOTION,
        loads=[{"kind": "point", "on": ["c"], "force": [0, 0, -1]}, {"kind": "point", "on": ["d"], "force": [0, 0, 1]}],
        quantities=[CENTRE],
    )
    solution = solve(case, cells=swap((8, 4)), degree=degree)
    reference = solve(
        shell(
            {"kind": "cylinder", "axis": "y", "radius": 1.0, "closed": True, "xi1": [0, 360], "xi2": [0, 0.5]},
            points={"c": [90, 0.25], "d": [270, 0.25]},
            remove_rigid_motions=EVERY_MOTION,
            loads=case.model_dump(mode="json")["loads"],
            quantities=[CENTRE],
        ),
        cells=(8, 4),
        degree=degree,
    )
    assert value(solution) == pytest.approx(value(reference), rel=rounding)
