"""The recipe `ndf-ritz` end to end, and the solution that it gives."""

import json
from contextlib import suppress

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors import safe_open
from safetensors.torch import load_file, save_file

from shellbench.bench.catalogue.catalog import known_values, named_case, tolerance
from shellbench.errors import InputError, SolveFailure
from shellbench.problem import FIELDS
from shellbench.problems.shell.quantities.measure import measure, measure_all
from shellbench.solvers.ndf.ritz_solver import RitzSettings, RitzSolver
from tests.alike import REPEATED, alike, same_tensors
from tests.solvers.ndf.shells import FREE, inner_points, shell, support

SOLVER = RitzSolver()
ALL = ("xi1_min", "xi1_max", "xi2_min", "xi2_max")
DOWN = {"kind": "area", "vector": [0, 0, -1]}
CENTRE = {"points": {"centre": [1, 0]}}


def deflection(direction, *points):
    return {"name": "w", "kind": "displacement", "points": list(points), "direction": direction, "primary": True}


def plate(**data):
    given = {"supports": [support("rim", *ALL)], "loads": [DOWN], "quantities": [deflection([0, 0, -1], "centre")]}
    return shell("plane", **{**CENTRE, **given, **data})


def solve(case, **choices):
    return SOLVER.solve(case, RitzSettings(**choices))


@pytest.fixture(scope="module")
def roof():
    case = named_case("scordelis_lo")
    return solve(case)


@pytest.mark.long
@pytest.mark.parametrize("name", ["square_plate", "scordelis_lo", "sleeve_torque"])
def test_gated_quantities_are_within_their_tolerance(name):
    case = named_case(name)
    solution = solve(case, seed=1)
    gated = [q for q in case.quantities if tolerance(name, q.name, SOLVER.name)]
    assert len(gated) >= 2
    for quantity in gated:
        known = known_values(name).judge(quantity.name, case.theory).value
        allowed = tolerance(name, quantity.name, SOLVER.name)
        assert measure(solution, quantity) == pytest.approx(known, rel=allowed.relative)


def test_clamped_plate():
    """Timoshenko & Woinowsky-Krieger, table 35: w = .00126532 q a^4 / B (to its digits) for a square plate."""
    case = plate(supports=[support("rim", *ALL, clamped=True)])
    expected = 0.00126532 * 2**4 / case.material.bending_stiffness
    assert measure(solve(case), case.primary) == pytest.approx(expected, rel=5e-5)


def test_a_linear_case_at_several_states_is_declined():
    """A field has one state in linear theory; it would be the last one at all of them."""
    asked = [
        deflection([0, 0, -1], "centre") | {"name": f"w_{at}", "at": at / 100, "primary": at == 50} for at in (50, 100)
    ]
    case = plate(loads=[{"kind": "area", "vector": [0, 0, "-t"]}], quantities=asked)
    assert case.states == (0.5, 1.0)
    assert SOLVER.declines(case) == "it answers a linear case at its last state alone"
    assert SOLVER.declines(case.model_copy(update={"quantities": case.quantities[1:]})) is None


@pytest.mark.long
def test_plate_under_a_point_load():
    """The same, section 34: w = .0116008 P a^2 / B at the centre (Navier's series summed)."""
    case = plate(loads=[{"kind": "point", "on": ["centre"], "force": [0, 0, -1]}])
    expected = 0.01160084 * 2**2 / case.material.bending_stiffness
    assert measure(solve(case), case.primary) == pytest.approx(expected, rel=2e-5)


@pytest.mark.long
def test_a_quarter_with_planes_of_symmetry_gives_the_whole():
    whole = plate()
    quarter = shell(
        {"kind": "plane", "xi1": [0, 1], "xi2": [-1, 0]},
        points={"centre": [1, 0]}, loads=[DOWN], quantities=whole.model_dump(mode="json")["quantities"],
        supports=[support("rim", "xi1_min", "xi2_min"), support("x", "xi1_max", symmetry="x"),
                  support("y", "xi2_max", symmetry="y")],
    )  # fmt: skip
    found, expected = (measure(solve(case), case.primary) for case in (quarter, whole))
    assert found == pytest.approx(expected, rel=1e-5)


@pytest.mark.long
def test_cantilever_strip_under_an_edge_load():
    """u = F L^3 / (3 B) per width for nu = 0, by the edge load and by the reaction at the wall."""
    reaction = {"name": "force", "kind": "reaction", "support": "wall", "direction": [0, 0, 1]}
    torque = {"name": "moment", "kind": "torque", "support": "wall", "axis": [0, 1, 0]}
    case = shell(
        "plane", {"poissons_ratio": 0.0}, points={"tip": [2, 0]}, supports=[support("wall", "xi1_min", clamped=True)],
        loads=[{"kind": "edge", "on": ["xi1_max"], "vector": [0, 0, 3]}],
        quantities=[deflection([0, 0, 1], "tip"), reaction, torque],
    )  # fmt: skip
    values = measure_all(solve(case))
    assert values["w"] == pytest.approx(3 * 2**3 / (3 * case.material.bending_stiffness), rel=1e-6)
    assert values["force"] == pytest.approx(-6, rel=1e-9)
    assert values["moment"] == pytest.approx(12, rel=1e-6)  # arm 2 m x 6 N upward turns about -y, the wall about +y


def test_pressure_widens_a_free_tube():
    """A free tube of nu = 0 widens by p R^2 / (E h (1 + h^2 / 12 R^2)): it is stretched, and bent a little as well."""
    case = shell(
        "tube", {"poissons_ratio": 0.0}, loads=[{"kind": "pressure", "value": -2}]
    )  # a3 points inward on this cylinder
    solution = solve(case)
    points = inner_points(case)
    u = solution.displacement(points)
    x = case.surface.position(points)
    radial = (u[:, 0] * x[:, 0] + u[:, 2] * x[:, 2]) / 3.0
    expected = 2 * 3**2 / (1e7 * 0.05) / (1 + 0.05**2 / (12 * 3**2))
    np.testing.assert_allclose(radial, expected, rtol=5e-4)  # a thin ring ovalises at next to no cost


def test_a_plate_pulled_by_its_edge_stretches_evenly():
    """Prescribed values by formula: u_x = 0.01 xi1 solves the pulled strip exactly for nu = 0."""
    pulled = {"kind": "value", "x": "0.005*xi1", "y": 0.0, "z": 0.0}
    case = shell(
        "plane", {"poissons_ratio": 0.0},
        supports=[support("wall", "xi1_min"), support("jaw", "xi1_max", motion=pulled)],
    )  # fmt: skip
    solution = solve(case, neurons=120)  # challengers exploit the rule by 1e-6 of the energy
    points = inner_points(case)
    np.testing.assert_allclose(solution.displacement(points)[:, 0], 0.005 * points[:, 0], atol=1e-9)
    force, _ = solution.reaction("jaw")
    np.testing.assert_allclose(force, [1e7 * 0.05 * 0.005 * 2, 0, 0], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(solution.reaction("wall")[0], -force, rtol=1e-6, atol=1e-6)


def test_reactions_at_feet_carry_the_load():
    corners = [f"xi1_{a},xi2_{b}" for a in ("min", "max") for b in ("min", "max")]
    case = plate(
        supports=[support("feet", *corners, components=["z"])],
        remove_rigid_motions=["translation_x", "translation_y", "rotation_z"],
    )
    solution = solve(case)
    force, moment = solution.reaction("feet", centre=(1, 0, 0))
    np.testing.assert_allclose(force, [0, 0, 4], atol=1e-5)
    np.testing.assert_allclose(moment, 0, atol=1e-4)
    np.testing.assert_allclose(solution.displacement(np.array([[0, -1], [2, 1]]))[:, 2], 0, atol=1e-12)


@pytest.mark.long
def test_a_symmetric_load_gives_a_symmetric_answer(roof):
    points = inner_points(roof.case)
    domain = roof.case.surface.domain
    for axis, mirror in ((0, [-1, 1, 1]), (1, [1, 1, -1])):
        mirrored = points.copy()
        mirrored[:, axis] = domain.lower[axis] + domain.upper[axis] - points[:, axis]
        here, there = roof.displacement(points), roof.displacement(mirrored)
        assert np.abs(here - there * mirror).max() < 1e-4 * np.abs(here).max()


@pytest.mark.long
def test_consistent_units_give_the_same_answer():
    """Metres to millimetres and newtons to kilonewtons: displacements scale with the length, energies with both."""
    surface = {"kind": "cylinder", "axis": "z", "radius": 3000, "xi1": [50, 130], "xi2": [0, 5000]}
    small, large = (
        shell(s, m, supports=[support("d", "xi2_min", "xi2_max", components=["x", "y"])],
              remove_rigid_motions=FREE[2:3], loads=[{"kind": "area", "vector": [0, -load, 0]}])
        for s, m, load in (
            ("roof", {}, 5.0),
            (surface, {"youngs_modulus": 1e7 * 1e-9, "thickness": 50}, 5.0 * 1e-9),
        )
    )  # fmt: skip
    first, second = solve(small, neurons=80), solve(large, neurons=80)
    points = inner_points(small)
    np.testing.assert_allclose(
        second.displacement(points * [1, 1000]), 1000 * first.displacement(points), rtol=1e-5, atol=1e-9
    )
    np.testing.assert_allclose(second.energies(), np.array(first.energies()), rtol=1e-7)


@pytest.mark.long
def test_certified_energy_is_a_lower_bound_that_rises_with_the_width(roof):
    """Nested spaces: each wider field stores at least as much, and none more than the true 4826.577 J."""
    wider = solve(roof.case, neurons=320)
    known = known_values("scordelis_lo").judge("strain_energy", roof.case.theory).value
    energies = [-step.energy for step in wider.history]
    assert len(energies) == 3
    assert energies == sorted(energies)
    assert wider.diagnostics["certified_energy"] >= -known * (1 + 1e-9)
    assert wider.history[-1].unknowns == wider.parameters
    assert wider.history[-1].quantities["edge_deflection"] == pytest.approx(measure(wider, wider.case.primary))


@pytest.mark.long
def test_seeds_are_reproducible_and_differ():
    case = plate()
    first, again, other = (solve(case, neurons=40, seed=seed) for seed in (0, 0, 1))
    points = inner_points(case)
    one, same, new = (solution.displacement(points) for solution in (first, again, other))
    alike(same, one, REPEATED)
    assert np.abs(new - one).max() > 10 * REPEATED * np.abs(one).max()


@pytest.mark.long
@pytest.mark.parametrize("activation", ["sine", "gelu", "tanh"])
@pytest.mark.parametrize("components", ["cartesian", "covariant"])
def test_ablations_solve_as_well(activation, components):
    case = named_case("scordelis_lo")
    found = measure(solve(case, neurons=240, activation=activation, components=components), case.primary)
    assert found == pytest.approx(0.3005924566, rel=5e-3)


@pytest.mark.long
def test_a_slit_tube_is_softer():
    """Without periodic inputs nothing closes the tube: it can only be softer than the closed one."""
    case = shell("tube", supports=[support("end", "xi2_min", clamped=True)],
                 loads=[{"kind": "edge", "on": ["xi2_max"], "vector": ["-sin(xi1)", 0, "cos(xi1)"]}])  # fmt: skip
    closed, slit = (sum(solve(case, neurons=120, periodic_input=p).energies()) for p in ("both", "none"))
    assert slit > 1.5 * closed


def test_the_energies_are_the_integrals_of_the_densities():
    """Without powers about corners, whose curvatures are infinite there, one rule of high order integrates a field."""
    roof = solve(named_case("scordelis_lo"), neurons=120)
    domain = roof.case.surface.domain
    x, w = np.polynomial.legendre.leggauss(40)
    share, weight = (x + 1) / 2, w / 2
    points = np.stack(np.meshgrid(share, share, indexing="ij"), -1) * domain.size + domain.lower
    area = 25.0 * domain.size[0] * domain.size[1]
    for name, energy in zip(FIELDS[2:], roof.energies(), strict=True):
        density = roof.evaluate(name, points)
        assert density.shape == (40, 40)
        assert area * weight @ density @ weight == pytest.approx(energy, rel=1e-8)


def test_strains_are_those_of_the_displacement(roof):
    """The roof is orthogonal: eps_12 = (u,1 . a_2 + u,2 . a_1) / 2 by differences of the displacement."""
    points = inner_points(roof.case)
    steps = np.eye(2) * 1e-5
    slopes = [(roof.displacement(points + s) - roof.displacement(points - s)) / 2e-5 for s in steps]
    x = roof.case.surface.derivatives(points, 1)
    shear = ((slopes[0] * x[0, 1]).sum(-1) + (slopes[1] * x[1, 0]).sum(-1)) / 2
    found = roof.evaluate("membrane_strain", points)
    np.testing.assert_allclose(found[:, 2], shear, atol=1e-6 * np.abs(found).max())
    with pytest.raises(KeyError):
        roof.evaluate("stress", points)


def test_queries_of_any_shape_agree(roof):
    grid = roof.case.surface.domain.grid(70, 90)
    all_at_once = roof.displacement(grid)
    assert all_at_once.shape == (70, 90, 3)
    alone = np.array([roof.displacement(grid[i, j]) for i, j in ((0, 0), (13, 57), (69, 89))])
    together = all_at_once[[0, 13, 69], [0, 57, 89]]
    assert np.abs(alone - together).max() < 1e-12 * np.abs(all_at_once).max()
    assert roof.displacement(np.zeros((0, 2)) + grid[0, 0]).shape == (0, 3)


def test_a_saved_solution_comes_back_the_same(roof, tmp_path):
    path = roof.save(tmp_path / "roof")
    assert path == tmp_path / "roof.safetensors"
    again = SOLVER.load(path)
    points = inner_points(roof.case)
    same_tensors(again.tensors(), roof.tensors())
    alike(again.displacement(points), roof.displacement(points))
    assert again.case == roof.case
    assert again.history == roof.history
    assert again.diagnostics == roof.diagnostics
    assert again.energies() == roof.energies()
    assert again.storage_bytes == roof.storage_bytes
    assert again.reaction("diaphragms")[0] == pytest.approx(roof.reaction("diaphragms")[0], rel=1e-12)
    assert path.stat().st_size >= roof.storage_bytes


def test_damaged_files_give_one_sentence(roof, tmp_path):
    path = roof.save(tmp_path / "roof")
    whole = path.read_bytes()
    tensors = load_file(path)
    damaged = tmp_path / "damaged.safetensors"

    def refuse(match):
        with pytest.raises(InputError, match=match) as caught:
            SOLVER.load(damaged)
        assert "\n" not in str(caught.value)
        assert str(damaged) in str(caught.value)

    for cut in (0, 7, len(whole) // 2, len(whole) - 1):
        damaged.write_bytes(whole[:cut])
        refuse("damaged")
    damaged.write_bytes(b"\x80\x04" + whole[2:])
    refuse("damaged")
    save_file(tensors, damaged)
    refuse("damaged")
    with safe_open(path, framework="pt") as file:
        facts = json.loads(file.metadata()["shellbench"])
    for change in (
        {"solver": "ndf"}, {"format": "other"}, {"case": {}}, {"activation": "step"}, {"history": [{"x": 1}]},
        {"spec": {"layer": -1}}, {"rule": {"panels": 3}}, {"parameters": "many"}, {"diagnostics": None},
    ):  # fmt: skip
        save_file(tensors, damaged, metadata={"shellbench": json.dumps({**facts, **change})})
        refuse("is damaged|was written by")
    bad_shape = {**tensors, "output": tensors["output"][:, 1:].contiguous()}
    not_finite = {**tensors, "bias.0": torch.full_like(tensors["bias.0"], torch.nan)}
    fewer = {k: v for k, v in tensors.items() if k != "rigid"}
    for broken in (bad_shape, not_finite, fewer):
        save_file(broken, damaged, metadata={"shellbench": json.dumps(facts)})
        refuse("damaged")
    with pytest.raises(InputError, match="can't be read"):
        SOLVER.load(tmp_path / "absent.safetensors")


@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_any_flipped_byte_gives_a_solution_or_one_sentence(data, tmp_path_factory):
    folder = tmp_path_factory.getbasetemp()
    path = folder / "flipped.safetensors"
    if not (folder / "whole.safetensors").exists():
        solve(plate(), neurons=4, largest_gap=1.0).save(folder / "whole")
    content = bytearray((folder / "whole.safetensors").read_bytes())
    content[data.draw(st.integers(0, len(content) - 1))] ^= data.draw(st.integers(1, 255))
    path.write_bytes(content)
    with suppress(InputError):  # any other exception is a traceback for the user; a changed digit loads
        assert SOLVER.load(path).displacement(np.array([0.5, 0.5])).shape == (3,)


def test_what_fails_says_why_and_keeps_what_it_found():
    case = plate()
    with pytest.raises(SolveFailure, match="exploits its quadrature") as caught:
        solve(case, neurons=60, panels=(1, 1), order=2)
    assert caught.value.partial.case == case
    assert caught.value.partial.diagnostics["energy_gap"] > 5e-4
    if not torch.cuda.is_available():
        with pytest.raises(InputError, match="not available"):
            solve(case, device="cuda")
    bent = [support("a", "xi1_min", clamped=True, motion={"kind": "value", "z": "t*xi2**2"})]
    case = plate(theory="kirchhoff-love-nonlinear", supports=bent, loads=[])
    with pytest.raises(InputError, match="can't take test"):
        solve(case)
    with pytest.raises(InputError, match="not in balance"):
        solve(shell("tube", loads=[DOWN]))


def test_an_unloaded_shell_rests():
    solution = solve(plate(loads=[]))
    assert np.all(solution.displacement(inner_points(solution.case)) == 0)
    assert solution.energies() == (0.0, 0.0)


@pytest.mark.long
@pytest.mark.parametrize("thickness", [0.025, 0.125, 0.5])
def test_thin_and_thick_roofs_with_the_same_settings(thickness):
    """Refined fields agree with default ones to 1e-3, and the certificate with the training energy."""
    base = named_case("scordelis_lo")
    case = base.model_copy(update={"material": base.material.model_copy(update={"thickness": thickness})})
    usual, refined = solve(case), solve(case, neurons=480, seed=7)
    assert measure(usual, case.primary) == pytest.approx(measure(refined, case.primary), rel=1e-3)
    assert usual.diagnostics["energy_gap"] < 1e-5
