"""Products of placed waves: the same fields as by a table of all of them, and features that are added on the way."""

import numpy as np
import pytest
import torch

from shellbench.errors import InputError
from shellbench.solvers.ndf import ritz
from shellbench.solvers.ndf.field.build import build_inputs
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.jets import Placement
from shellbench.solvers.ndf.motion import integration, motion
from shellbench.solvers.ndf.motion.motion_parts import Table
from shellbench.solvers.ndf.motion.products import Products, product_features, why_no_products
from shellbench.solvers.ndf.ritz_solver import RitzSettings, RitzSolver
from shellbench.solvers.ndf.strains.smooth import LONG_SHARE
from tests.alike import alike, same_tensors
from tests.solvers.ndf.shells import shell, support
from tests.solvers.ndf.test_motion import GRID, PIN, RHO, mean_displacement, moving

SPEC = FieldSpec(stretched=False, multipliers=0, strain="exact")
PULLED = [{"kind": "gravity", "acceleration": [0, -9.8, 2.0]}]
CORNER = support("corner", "xi1_min,xi2_max")
INSIDE = np.array([[0.0, 0.0], [0.31, 0.72], [1.0, 0.8], [0.5, 0.123]])


def products(case, degree):
    return product_features(case, build_inputs(case, SPEC), degree, Placement())


def equations(case, degree, of=None):
    """The equations of motion of products up to a degree, of those up to `of`."""
    rung = motion.MotionLevel(of or degree, products(case, of or degree), share=LONG_SHARE)
    return motion.motion_of_products(case, SPEC, rung, motion.POINTS_A_DEGREE, degree)


def drawn(count, seed=0, size=0.02):
    generator = torch.Generator().manual_seed(seed)
    return size * torch.randn(count, generator=generator, dtype=torch.float64)


def follow(case, degree, tail, monkeypatch, **choices):
    monkeypatch.setattr(motion, "TAIL", tail)
    monkeypatch.setattr(motion, "FIRST_DEGREE", 5)
    return RitzSolver().solve(case, RitzSettings(hidden="placed", degrees=(degree,), grow=True, **choices))


def test_sums_over_one_coordinate_after_the_other_are_those_of_a_table_of_all_products():
    found = equations(moving(springs=[PIN]), 9)
    jets = found.features.jets(found.sampled.points)[[0, 1, 2, 3, 5, 4]]  # the grid has u,12 last
    dense = Table(jets.permute(1, 0, 2).reshape(-1, found.features.count))
    w = drawn(3 * found.features.count)
    alike(found._table.fields(w.view(3, -1)), dense.fields(w.view(3, -1)), 1e-10)
    conjugate = drawn(len(found.areas) * 18).view(-1, 6, 3)
    alike(found._table.pull_back(conjugate), dense.pull_back(conjugate), 1e-10)


HELD = [support("edges", "xi1_min", "xi2_min"), support("other", "xi2_max")]


def test_at_held_edges_products_vanish_and_remain_orthonormal():
    case = moving(supports=HELD)
    features, domain = products(case, 7), case.surface.domain
    first, second = (np.linspace(low, high, 5) for low, high in zip(domain.lower, domain.upper, strict=True))
    for axis, side in ((0, domain.lower[0]), (1, domain.lower[1]), (1, domain.upper[1])):
        points = np.stack([first, second], axis=-1)
        points[:, axis] = side
        assert float(features.values(points).abs().max()) == 0.0
        assert float(features.jets(points)[1 + axis].abs().max()) > 1.0
    x, weights = np.polynomial.legendre.leggauss(40)
    u = (x + 1) / 2
    size = np.asarray(domain.size)
    points = np.asarray(domain.lower) + np.stack(np.meshgrid(u, u, indexing="ij"), axis=-1).reshape(-1, 2) * size
    values = features.values(points)
    gram = values.T @ (torch.as_tensor(np.outer(weights, weights).ravel() / 4 * size.prod())[:, None] * values)
    torch.testing.assert_close(gram, torch.eye(features.count, dtype=torch.float64), rtol=0, atol=1e-5)


def test_with_held_edges_both_ways_follow_the_same_motion(monkeypatch, tmp_path):
    case = moving(0.04, supports=HELD[:1], loads=PULLED)
    fast = RitzSolver().solve(case, RitzSettings(hidden="placed", degrees=(9,)))
    assert isinstance(fast.features, Products)
    assert fast.spec.vanishing
    back = RitzSolver().load(fast.save(tmp_path / "motion"))
    alike(back.displacement(GRID, 0.03), fast.displacement(GRID, 0.03))
    alike(back.evaluate("bending_strain", GRID, 0.03), fast.evaluate("bending_strain", GRID, 0.03))
    monkeypatch.setattr(ritz, "why_no_products", lambda *_: "")
    dense = RitzSolver().solve(case, RitzSettings(hidden="placed", degrees=(9,)))
    assert not isinstance(dense.features, Products)
    moved = np.abs(dense.displacement(GRID, 0.04)).max()
    apart = np.abs(fast.displacement(GRID, 0.04) - dense.displacement(GRID, 0.04)).max()
    assert moved > 5e-3
    assert apart < 0.03 * moved  # a lattice's waves and products of waves are not the same functions
    assert sum(fast.energies(0.04)) == pytest.approx(sum(dense.energies(0.04)), rel=0.02)


@pytest.mark.parametrize("supports", [[], HELD], ids=["free", "held"])
def test_jets_are_derivatives_of_the_values(supports):
    features, step = products(moving(supports=supports), 6), 1e-5
    inside = INSIDE[1:2]
    jets = features.jets(inside)[:, 0]
    across = [np.array([step, 0.0]), np.array([0.0, step])]
    for axis, (first, second) in enumerate(((1, 3), (2, 5))):
        ahead, here, back = (features.values(inside + side * across[axis])[0] for side in (1, 0, -1))
        np.testing.assert_allclose(jets[first], (ahead - back) / (2 * step), atol=1e-5)
        np.testing.assert_allclose(jets[second], (ahead - 2 * here + back) / step**2, atol=1e-2)
    ahead, back = (features.jets(inside + side * across[1])[1, 0] for side in (1, -1))
    np.testing.assert_allclose(jets[4], (ahead - back) / (2 * step), atol=1e-4)


@pytest.mark.long
def test_products_are_orthonormal_and_come_near_to_polynomials():
    """In the area, on a side of length 1 by one of .8; the smoothest is the constant."""
    missed = []
    for degree in (12, 24):
        found = equations(moving(), degree)
        values = found.features.values(found.sampled.points)
        gram = values.T @ (found.areas[:, None] * values)
        np.testing.assert_allclose(gram, np.eye(found.features.count), atol=1e-4)
        np.testing.assert_allclose(values[:, 0] / values[0, 0], 1.0, atol=1e-9)
        x, y = found.sampled.points.T
        wanted = torch.as_tensor(np.stack([x * y**2, x**3 - y, (x - y) ** 4], axis=1))
        missed.append(float((values @ (values.T @ (found.areas[:, None] * wanted)) - wanted).abs().max()))
    assert missed[0] < 1e-2
    assert missed[1] < missed[0] / 10


@pytest.mark.parametrize("supports", [[], [CORNER]], ids=["free", "held"])
def test_forces_are_the_slope_of_the_energy(supports):
    """On the unknowns; with gravity left out, mass times acceleration is all that the energy exerts."""
    found = equations(moving(springs=[PIN], supports=supports, loads=[]), 6)
    y, direction, step = drawn(found.basis.size), drawn(found.basis.size, 1, 1.0), 1e-5
    force, power = found.accelerate(y, torch.zeros_like(y), 0.0)

    def strain(at):
        return found.energies(found.weights(at, 0.0), torch.zeros(3 * found.features.count).to(at), 0.0).strain

    slope = (strain(y + step * direction) - strain(y - step * direction)) / (2 * step)
    assert float(force @ direction) == pytest.approx(-slope, rel=1e-6)
    assert power == 0


def test_unknowns_are_orthonormal_in_mass_and_hold_points():
    found = equations(moving(supports=[CORNER]), 6)
    assert found.basis.size == 3 * found.features.count - 3
    y, rate = drawn(found.basis.size), drawn(found.basis.size, 1, 1.0)
    w = found.weights(y, 0.0)
    alike(found.unknowns(w), y, 1e-10)
    at = found.features.values(np.array([[0.0, 0.8]]))[0]
    assert float((w.view(3, -1) @ at).abs().max()) < 1e-12
    kinetic = found.energies(w, found.weights(rate, 0.0, 1), 0.0).kinetic
    assert kinetic == pytest.approx(float(rate @ rate) / 2, rel=1e-6)
    unit = found.basis.held[:, 1].view(3, -1) @ at
    np.testing.assert_allclose(unit, [0, 1, 0], atol=1e-10)
    assert float(found.basis.gather(found.inertia(found.basis.held[:, 1])).abs().max()) < 1e-10


def test_components_held_everywhere_do_not_move():
    found = equations(moving(supports=[support("flat", "surface", components=["z"])]), 5)
    assert found.basis.size == 2 * found.features.count
    assert float(found.weights(drawn(found.basis.size), 0.0).view(3, -1)[2].abs().max()) == 0


@pytest.mark.parametrize("supports", [[], [CORNER]], ids=["free", "held"])
def test_features_that_are_added_change_neither_displacement_nor_velocity_nor_energy(supports):
    case = moving(springs=[PIN], supports=supports)
    coarse, fine = (equations(case, degree, of=16) for degree in (12, 16))
    assert fine.features.count > 1.5 * coarse.features.count
    count = coarse.basis.size
    # Displacements of low degree: what a coarse rule can't integrate of the others is no matter of the features.
    smooth = coarse.features.degrees < 5
    parts = [coarse.unknowns((drawn(3 * len(smooth), k, 1e-3).view(3, -1) * smooth).reshape(-1)) for k in (0, 1)]
    z = np.concatenate([*parts, [0.7]])
    carried = integration.extended_state(coarse, fine, z, 0.1)
    assert len(carried) == 2 * fine.basis.size + 1
    assert carried[-1] == 0.7
    states = []
    for run, state, r in ((coarse, z, count), (fine, carried, fine.basis.size)):
        w, rate = (run.weights(torch.as_tensor(state[k * r : (k + 1) * r]), 0.1, k) for k in (0, 1))
        values = run.features.values(INSIDE)
        states.append((values @ w.view(3, -1).T, values @ rate.view(3, -1).T, run.energies(w, rate, 0.1)))
    (u, v, before), (u_fine, v_fine, after) = states
    assert float(u.abs().max()) > 1e-4
    alike(u_fine, u, 1e-10)
    alike(v_fine, v, 1e-10)
    for part in ("kinetic", "membrane", "bending", "springs"):
        assert getattr(after, part) == pytest.approx(getattr(before, part), rel=1e-3)  # of two rules


def test_a_motion_that_adds_features_on_the_way_conserves_energy_and_survives_its_file(monkeypatch, tmp_path):
    found = follow(moving(0.1, springs=[PIN], loads=PULLED), 9, 1e-6, monkeypatch)
    degrees, times = zip(*found.diagnostics["growth"], strict=True)
    assert degrees == (5, 7, 9)
    assert 0 < times[1] < times[2] < 0.1
    unknowns = [step.unknowns for step in found.history if step.phase == "time"]
    assert unknowns == sorted(unknowns)
    assert unknowns[0] < unknowns[-1] == found.parameters
    total = found.balance(0.1).total
    assert found.diagnostics["energy_drift"] < 1e-5 * total
    assert found.diagnostics["energy_gap"] < 1e-3
    for t in times[1:]:  # nothing jumps where features are added
        before, after = (found.displacement(GRID, t + side * 1e-9) for side in (-1, 1))
        assert np.abs(after - before).max() < 1e-7
    back = RitzSolver().load(found.save(tmp_path / "motion"))
    same_tensors(back.tensors(), found.tensors())
    for t in (0.0, times[1], 0.077, 0.1):
        alike(back.displacement(GRID, t), found.displacement(GRID, t))
        alike(back.velocity(GRID, t), found.velocity(GRID, t))
        alike(back.evaluate("bending_strain", GRID, t), found.evaluate("bending_strain", GRID, t))
    assert back.energies(0.05) == pytest.approx(found.energies(0.05), rel=1e-9)
    rounded, size = found.rounded("float32")
    assert size < 0.6 * found.storage_bytes
    np.testing.assert_allclose(rounded.displacement(GRID, 0.1), found.displacement(GRID, 0.1), atol=1e-4)


def test_a_field_that_asks_for_nothing_keeps_its_features(monkeypatch):
    found = follow(moving(0.02, springs=[PIN], loads=PULLED), 9, 1.0, monkeypatch)
    assert found.diagnostics["growth"] == [[5, 0.0]]
    assert found.diagnostics["degree"] == 5


def test_what_products_are_not_made_for_goes_the_usual_way(monkeypatch):
    held = moving(0.01, supports=[support("edge", "xi1_min", clamped=True)])
    reason = "its edges are clamped, or held in parts or in some components"
    assert why_no_products(held, SPEC, build_inputs(held, SPEC)) == reason
    some = moving(0.01, supports=[support("edge", "xi1_min", components=["x", "y"])])
    assert why_no_products(some, SPEC, build_inputs(some, SPEC)) == reason
    lifted = {"kind": "translation", "vector": [0, 0, "t**3"]}
    moved = moving(0.01, supports=[support("edge", "xi1_min", motion=lifted)])
    assert why_no_products(moved, SPEC, build_inputs(moved, SPEC)) == "its edges are moved"
    roof = shell("roof", {"areal_density": RHO})
    assert (
        why_no_products(roof, SPEC, build_inputs(roof, SPEC)) == "its coordinates are not straight and at right angles"
    )
    found = follow(held, 4, 1e-5, monkeypatch)
    assert "growth" not in found.diagnostics
    assert not isinstance(found.features, Products)
    tube = shell("tube", {"areal_density": RHO}, theory="kirchhoff-love-nonlinear", supports=[],
                 dynamics={"until": 0.01}, quantities=[{"name": "z", "kind": "centre_of_mass", "direction": [0, 0, 1],
                                                        "at": 0.01, "primary": True}])  # fmt: skip
    with pytest.raises(InputError, match="two coordinates that are not periodic"):
        follow(tube, 4, 1e-5, monkeypatch)


def test_a_file_whose_products_do_not_fit_is_refused_in_one_sentence(monkeypatch):
    features = products(moving(), 4)
    tensors = features.tensors()
    inputs = features.inputs
    beyond = {**tensors, "pairs": tensors["pairs"] + 50}
    with pytest.raises(ValueError, match="do not fit their functions"):
        Products.from_tensors(inputs, features.network, beyond)
    with pytest.raises(ValueError, match="do not fit their functions"):
        Products.from_tensors(inputs, features.network, {**tensors, "degrees": tensors["degrees"][1:]})


def test_products_follow_a_plane_that_lies_elsewhere():
    """Sides of other lengths, in other coordinates: fields are orthonormal in the area all the same."""
    wide = {"kind": "plane", "xi1": [2, 3], "xi2": [-1, 1]}
    energy = {"name": "energy", "kind": "kinetic_energy", "at": 1.0, "primary": True}
    moved = {"theory": "kirchhoff-love-nonlinear", "dynamics": {"until": 1.0}, "quantities": [energy]}
    case = shell(wide, {"areal_density": RHO}, **moved, supports=[])
    found = equations(case, 8)
    values = found.features.values(found.sampled.points)
    np.testing.assert_allclose(values.T @ (found.areas[:, None] * values), np.eye(found.features.count), atol=1e-4)
    assert int(found.features.pairs[:, 1].max()) > int(found.features.pairs[:, 0].max())


def test_a_point_that_is_moved_is_followed_and_its_work_is_what_the_shell_has(monkeypatch):
    lifted = {"kind": "translation", "vector": [0, 0, "2*t**3"]}
    case = moving(0.1, supports=[support("corner", "xi1_min,xi2_max", motion=lifted)], loads=PULLED)
    found = follow(case, 6, 1e-6, monkeypatch)
    at = found.displacement(np.array([[0.0, 0.8]]), 0.1)[0]
    np.testing.assert_allclose(at, [0, 0, 2e-3], atol=1e-9)
    assert found.diagnostics["energy_drift"] < 1e-4 * found.balance(0.1).total
    step = 2e-3  # the support exerts what moves the centre of mass, less gravity
    before, now, after = (mean_displacement(found, 0.08 + side * step) for side in (-1, 0, 1))
    pushed = 0.8 * RHO * ((before - 2 * now + after) / step**2 - np.array([0, -9.8, 2.0]))
    assert np.linalg.norm(pushed) > 0.05
    np.testing.assert_allclose(found.reaction("corner", at=0.08)[0], pushed, atol=0.005)
