"""The solution along a path: its marks, its file, and its reactions on the deformed shell."""

import json
from contextlib import suppress

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors import safe_open
from safetensors.torch import load_file, save_file

from shellbench.errors import InputError
from shellbench.problem import FIELDS
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.solvers.ndf.linear.solution import PathSolution
from shellbench.solvers.ndf.ritz_solver import RitzSettings, RitzSolver
from shellbench.solvers.ndf.trainer_solver import NdfSolver, TrainerSettings
from tests.alike import alike, same_tensors
from tests.solvers.ndf.shells import inner_points, shell, support

SOLVER = RitzSolver()
NONLINEAR = "kirchhoff-love-nonlinear"
WALL = support("wall", "xi1_min", clamped=True)
WIDTH, MARKS = 0.5, (0.25, 0.5, 1.0)
STRIP = {"neurons": 60, "scale": 2.0, "panels": (7, 2)}


def solve(case, **choices):
    return SOLVER.solve(case, RitzSettings(**{**STRIP, **choices}))


def strip(load, **data):
    """A strip of length and bending stiffness 1, nu = 0, clamped at xi1 = 0."""
    deflection = {"name": "up", "kind": "displacement", "points": ["tip"], "direction": [0, 0, 1], "primary": True}
    return shell(
        {"kind": "plane", "xi1": [0, 1], "xi2": [0, WIDTH]},
        {"youngs_modulus": 12 / 0.02**3, "poissons_ratio": 0.0, "thickness": 0.02},
        **{"theory": NONLINEAR, "points": {"tip": [1, WIDTH / 2]}, "supports": [WALL], "loads": [load],
           "path": {"states": [0.25, 0.5]}, "quantities": [deflection], **data},
    )  # fmt: skip


@pytest.fixture(scope="module")
def sheared():
    return solve(strip({"kind": "edge", "on": ["xi1_max"], "vector": ["t", 0, "4*t"]}))


def test_every_mark_is_kept_and_no_other(sheared):
    assert isinstance(sheared, PathSolution)
    assert sheared.marks == MARKS
    points = inner_points(sheared.case)
    at = {mark: sheared.displacement(points, at=mark) for mark in MARKS}
    alike(sheared.displacement(points), at[1.0])
    assert np.abs(at[0.25]).max() < np.abs(at[0.5]).max() < np.abs(at[1.0]).max()
    energies = [sum(sheared.energies(at=mark)) for mark in MARKS]
    assert energies == sorted(energies)
    for ask in (
        lambda at: sheared.displacement(points, at=at),
        lambda at: sheared.evaluate("bending_strain", points, at=at),
        lambda at: sheared.energies(at=at),
        lambda at: sheared.reaction("wall", at=at),
    ):
        with pytest.raises(InputError, match=r"solved at 0\.25, 0\.5, 1, not at 0\.3") as caught:
            ask(0.3)
        assert "\n" not in str(caught.value)
    with pytest.raises(KeyError):
        sheared.evaluate("stress", points)


def test_marks_are_told_apart_however_small():
    """Displacements of a nanometre are as good as loads of one."""
    case = strip({"kind": "edge", "on": ["xi1_max"], "vector": [0, 0, "t"]}, path={"until": 1e-9, "states": [5e-10]},
                 quantities=[{"name": "energy", "kind": "strain_energy", "primary": True, "at": 1e-9}])  # fmt: skip
    solution = solve(case, neurons=8, largest_gap=1.0)
    points = inner_points(case)
    half, whole = (solution.displacement(points, at=at) for at in (5e-10, 1e-9))
    np.testing.assert_allclose(2 * half, whole, rtol=0, atol=1e-6 * np.abs(whole).max())
    with pytest.raises(InputError, match="not at 6e-10"):
        solution.displacement(points, at=6e-10)


@pytest.mark.long
def test_diaphragms_balance_the_load_on_a_deformed_roof():
    """They hold two components alone, and are free to slide along the third."""
    ends = support("ends", "xi2_min", "xi2_max", components=["x", "y"])
    case = shell("roof", theory=NONLINEAR, supports=[ends], remove_rigid_motions=["translation_z"],
                 loads=[{"kind": "area", "vector": [0, "-60*t", 0]}])  # fmt: skip
    solution = SOLVER.solve(case, RitzSettings(neurons=120))
    nodes, w = np.polynomial.legendre.leggauss(20)
    lower, size = np.array(case.surface.domain.lower), case.surface.domain.size
    grid = lower + np.stack(np.meshgrid((nodes + 1) / 2, (nodes + 1) / 2, indexing="ij"), axis=-1) * size
    weights = np.outer(w, w) / 4 * 3 * np.prod(size)
    position = case.surface.position(grid) + solution.displacement(grid)
    load = np.array([0.0, -60.0, 0.0])
    force, moment = solution.reaction("ends")
    np.testing.assert_allclose(force, -weights.sum() * load, atol=1e-6)
    expected = -np.einsum("ij,ijc->c", weights, np.cross(position, load))
    np.testing.assert_allclose(moment, expected, atol=2e-5 * np.abs(expected).max())


def test_states_of_the_history_are_those_of_the_solution(sheared):
    path = {s.at: s for s in sheared.history if s.phase == "path"}
    for mark in MARKS:
        tip = sheared.displacement(np.array([1.0, WIDTH / 2]), at=mark)
        assert path[mark].quantities["up"] == pytest.approx(tip[2], rel=1e-9)
        assert path[mark].iterations >= 1
    assert sheared.diagnostics["certified_energy"] == pytest.approx(path[1.0].energy, rel=1e-5)


@pytest.mark.parametrize("at", MARKS)
def test_the_energies_are_the_integrals_of_the_densities(sheared, at):
    x, w = np.polynomial.legendre.leggauss(40)
    points = np.stack(np.meshgrid((x + 1) / 2, (x + 1) / 2 * WIDTH, indexing="ij"), -1)
    for name, energy in zip(FIELDS[2:], sheared.energies(at=at), strict=True):
        density = sheared.evaluate(name, points, at=at)
        assert WIDTH / 4 * w @ density @ w == pytest.approx(energy, rel=1e-6)


def test_strains_are_changes_of_metric_and_curvature(sheared):
    """eps_11 = (|x,1|^2 - 1) / 2 and kappa_11 = -x,11 . n of the deformed strip, by differences of its positions."""
    points, step = inner_points(sheared.case), 1e-4
    one, two = np.array([step, 0]), np.array([0, step])

    def position(p):
        return sheared.case.surface.position(p) + sheared.displacement(p)

    first, other = ((position(points + e) - position(points - e)) / (2 * step) for e in (one, two))
    second = (position(points + one) - 2 * position(points) + position(points - one)) / step**2
    normal = np.cross(first, other)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    bend, stretch = (sheared.evaluate(f"{kind}_strain", points) for kind in ("bending", "membrane"))
    np.testing.assert_allclose(bend[:, 0], -(second * normal).sum(-1), atol=2e-5 * np.abs(bend).max())
    np.testing.assert_allclose(stretch[:, 0], ((first**2).sum(-1) - 1) / 2, atol=1e-6)


@pytest.mark.parametrize("at", MARKS)
def test_the_wall_balances_a_dead_force_on_the_deformed_strip(sheared, at):
    """Force and moment about any centre, the arms being those of the deformed edge that carries the load."""
    load = at * np.array([1.0, 0, 4])
    x, w = np.polynomial.legendre.leggauss(12)
    edge = np.stack([np.ones(12), (x + 1) / 2 * WIDTH], axis=-1)
    position = sheared.case.surface.position(edge) + sheared.displacement(edge, at=at)
    for centre in ((0.0, 0.0, 0.0), (0.3, -1.0, 2.0)):
        force, moment = sheared.reaction("wall", centre, at=at)
        np.testing.assert_allclose(force, -load * WIDTH, atol=2e-6)
        expected = -np.einsum("n,nc->c", w / 2 * WIDTH, np.cross(position - np.array(centre), load))
        np.testing.assert_allclose(moment, expected, atol=2e-5)


def test_the_wall_balances_a_moment_about_a_fixed_axis():
    moment_load = {"kind": "moment", "on": ["xi1_max"], "axis": [0, -1, 0], "value": "3*t"}
    solution = solve(strip(moment_load))
    for at in MARKS:
        force, moment = solution.reaction("wall", at=at)
        np.testing.assert_allclose(force, 0, atol=1e-5)
        np.testing.assert_allclose(moment, [0, 3 * at * WIDTH, 0], atol=1e-5)
        again = solution.reaction("wall", (1.0, 2.0, 3.0), at=at)[1]
        np.testing.assert_allclose(again, moment, atol=1e-4)  # a couple has no arm


@pytest.fixture(scope="module")
def footed():
    """A strip that a foot under its tip pushes upward, and a load beside it downward."""
    push = {"kind": "translation", "vector": [0, 0, "0.2*t"]}
    return solve(
        strip({"kind": "area", "vector": [0, 0, "-t"]}, supports=[WALL, support("foot", "tip", components=["z"],
              motion=push)])
    )  # fmt: skip


def test_feet_and_walls_balance_the_load_together(footed):
    nodes, w = np.polynomial.legendre.leggauss(16)
    grid = np.stack(np.meshgrid((nodes + 1) / 2, (nodes + 1) / 2 * WIDTH, indexing="ij"), axis=-1)
    weights = np.outer(w, w) * WIDTH / 4
    for at in MARKS:
        tip = footed.displacement(np.array([1.0, WIDTH / 2]), at=at)
        assert tip[2] == pytest.approx(0.2 * at, rel=1e-8)
        (foot, foot_moment), (wall, wall_moment) = (footed.reaction(name, at=at) for name in ("foot", "wall"))
        np.testing.assert_allclose(foot + wall, [0, 0, at * WIDTH], atol=2e-4)
        assert np.array_equal(foot[:2], [0, 0])
        np.testing.assert_allclose(foot_moment, np.cross([1 + tip[0], WIDTH / 2 + tip[1], tip[2]], foot), atol=1e-9)
        position = footed.case.surface.position(grid) + footed.displacement(grid, at=at)
        load = np.einsum("ij,ijc->c", weights, np.cross(position, [0, 0, -at]))
        np.testing.assert_allclose(foot_moment + wall_moment, -load, atol=2e-4)


@pytest.mark.long
def test_the_force_of_a_foot_is_the_slope_of_the_energy():
    """Nothing else works on the strip than the foot, which moves 0.2 m upward: dU = F dz; the wall holds against it."""
    push = {"kind": "translation", "vector": [0, 0, "0.2*t"]}
    feet = [WALL, support("foot", "tip", components=["z"], motion=push)]
    solution = solve(strip({"kind": "edge", "on": ["xi1_max"], "vector": [0, 0, 0]}, supports=feet,
                           path={"states": [0.99, 1.0, 1.01], "until": 1.01}))  # fmt: skip
    energy = {step.at: step.energy for step in solution.history if step.phase == "path"}
    slope = (energy[1.01] - energy[0.99]) / (0.02 * 0.2)
    force, _ = solution.reaction("foot", at=1.0)
    assert force[2] == pytest.approx(slope, rel=2e-4)
    np.testing.assert_allclose(solution.reaction("wall", at=1.0)[0], -force, atol=1e-3 * slope)


@pytest.mark.parametrize("name", ["sheared", pytest.param("footed", marks=pytest.mark.long)])
def test_a_saved_path_comes_back_the_same(name, request, tmp_path):
    solution = request.getfixturevalue(name)
    path = solution.save(tmp_path / "path")
    assert path == tmp_path / "path.safetensors"
    again = SOLVER.load(path)
    assert isinstance(again, PathSolution)
    points = inner_points(solution.case)
    assert again.case == solution.case
    assert again.marks == solution.marks
    for at in (*MARKS, None):
        same_tensors(again.state(at).tensors(), solution.state(at).tensors())
        alike(again.displacement(points, at=at), solution.displacement(points, at=at))
        assert again.energies(at=at) == solution.energies(at=at)
        for field in FIELDS:
            alike(again.evaluate(field, points, at=at), solution.evaluate(field, points, at=at))
        for support_ in solution.case.supports:
            alike(again.reaction(support_.name, at=at), solution.reaction(support_.name, at=at), 1e-9)
    assert again.history == solution.history
    assert again.diagnostics == solution.diagnostics
    assert again.parameters == solution.parameters
    assert again.storage_bytes == solution.storage_bytes
    assert measure_all(again) == pytest.approx(measure_all(solution), rel=1e-9)


def test_planes_of_symmetry_come_back_from_a_file(tmp_path):
    middle = support("middle", "xi2_min", symmetry="y")
    case = strip({"kind": "edge", "on": ["xi1_max"], "vector": [0, 0, "t"]}, supports=[WALL, middle])
    solution = solve(case, neurons=10, largest_gap=1.0)
    again = SOLVER.load(solution.save(tmp_path / "half"))
    assert again.case == case
    alike(again.displacement([0.4, 0.1], at=0.5), solution.displacement([0.4, 0.1], at=0.5))


def test_storage_counts_every_state(sheared, tmp_path):
    kept = load_file(sheared.save(tmp_path / "path"))
    assert sheared.storage_bytes == sum(t.numel() * t.element_size() for t in kept.values())
    assert kept["output"].shape == (3, 3, sheared.diagnostics["features"])
    one = sheared.states[-1].storage_bytes
    assert one < sheared.storage_bytes < 3 * one


def test_damaged_paths_give_one_sentence(sheared, tmp_path):
    path = sheared.save(tmp_path / "path")
    tensors = load_file(path)
    with safe_open(path, framework="pt") as file:
        facts = json.loads(file.metadata()["shellbench"])
    damaged = tmp_path / "damaged.safetensors"

    def refuse(kept, said, match="damaged"):
        save_file(kept, damaged, metadata={"shellbench": json.dumps(said)})
        with pytest.raises(InputError, match=match) as caught:
            SOLVER.load(damaged)
        assert "\n" not in str(caught.value)
        assert str(damaged) in str(caught.value)

    for name in ("output", "rigid"):
        whole = tensors[name]
        for broken in (whole[:2], whole[0], whole[..., 1:], torch.cat([whole, whole[:1]]), whole * torch.nan):
            refuse({**tensors, name: broken.contiguous()}, facts)
        refuse({k: v for k, v in tensors.items() if k != name}, facts)
    state = facts["states"][0]
    refuse(tensors, {**facts, "states": facts["states"][:2]})
    refuse(tensors, {**facts, "states": []})
    refuse(tensors, {**facts, "states": [*facts["states"], state]})
    for change in ({"t": None}, {"mark": "first"}, {"membrane": None}, {"point_forces": 3}, {"more": 1}):
        refuse(tensors, {**facts, "states": [{**state, **change}, *facts["states"][1:]]})
    refuse(tensors, {**facts, "solver": "ndf"}, "was written by solver 'ndf'")
    content = path.read_bytes()
    for cut in (0, 7, len(content) // 2, len(content) - 1):
        damaged.write_bytes(content[:cut])
        with pytest.raises(InputError, match="damaged"):
            SOLVER.load(damaged)


@settings(max_examples=20, deadline=None)
@given(data=st.data())
def test_any_flipped_byte_gives_a_path_or_one_sentence(data, tmp_path_factory):
    folder = tmp_path_factory.getbasetemp()
    path, whole = folder / "flipped_path.safetensors", folder / "whole_path.safetensors"
    if not whole.exists():
        load = {"kind": "edge", "on": ["xi1_max"], "vector": [0, 0, "0.1*t"]}
        solve(strip(load), neurons=3, panels=(2, 2), largest_gap=1.0).save(whole)
    content = bytearray(whole.read_bytes())
    content[data.draw(st.integers(0, len(content) - 1))] ^= data.draw(st.integers(1, 255))
    path.write_bytes(content)
    with suppress(InputError):  # any other exception is a traceback for the user; a changed digit loads
        assert SOLVER.load(path).displacement(np.array([0.5, 0.2])).shape == (3,)


def test_a_deep_network_keeps_its_path_as_well(tmp_path):
    case = strip({"kind": "edge", "on": ["xi1_max"], "vector": [0, 0, "0.4*t"]})
    solver = NdfSolver()
    solution = solver.solve(case, TrainerSettings(widths=(16,), iterations=0, largest_gap=1.0))
    again = solver.load(solution.save(tmp_path / "deep"))
    points = inner_points(case)
    for at in MARKS:
        same_tensors(again.state(at).tensors(), solution.state(at).tensors())
        alike(again.displacement(points, at=at), solution.displacement(points, at=at))
    with pytest.raises(InputError, match="was written by solver 'ndf'"):
        SOLVER.load(tmp_path / "deep.safetensors")
