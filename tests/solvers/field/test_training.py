"""Training: fields and losses of tensors agree with those of arrays, Adam is Adam, and samples follow their density."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.stats import chi2

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError
from shellbench.problems.field.case import FieldCase
from shellbench.problems.field.structure import bend, corners, lattice, strain, unit_normals
from shellbench.solvers.field.field import LayeredField
from shellbench.solvers.field.losses import Losses, MeshLosses
from shellbench.solvers.field.sampling import Cells, jittered, positive, relaxed, relaxed_on_a_line
from shellbench.solvers.field.solver import MlpSolver, PrintedGridSolver
from shellbench.solvers.field.training import Adam, Choice, Sampler, Weights, sampled

RANDOM = np.random.default_rng(9)
POINTS = RANDOM.random((30, 2))
LEVEL = 1e-4  # of tests of samples: one right sampler of ten thousand would fail
CLOTH = {"side": 0.1, "strain": 0.5, "bend": 0.3, "gravity": 2.0, "mass_gravity": 0.1}


def choice(case, cells=(), frequencies=0, layers=4, activation="relu", degree=1, held=(), **sampler):
    form = {"cells": list(cells), "degree": degree, "frequencies": frequencies, "layers": layers}
    form |= {"activation": activation, "held": list(held), "confined": []}
    how = Sampler(
        **({"kind": "adaptive", "weighted": False, "share": 0.5, "kept": 0.9, "cells": 8, "lloyd": 0} | sampler)
    )
    return Choice(form, 3, 8, 1, 20, 1e-2, 0, "cpu", True, how, 1)


@pytest.mark.parametrize(
    "form",
    [
        {},
        {"activation": "sine"},
        {"frequencies": 3},
        {"cells": (6, 3)},
        {"cells": (6, 3), "layers": 0, "held": ["v_max", "u_min"]},
        {"cells": (4,), "degree": 3},
    ],
)
def test_tensors_displace_as_arrays_do(form):
    case = catalog.named_case("field_sine")
    weights = Weights(choice(case, **form))
    found = LayeredField(case, weights.arrays(), weights.form)
    assert weights.displacement(POINTS).detach().numpy() == pytest.approx(found.displacement(POINTS), abs=1e-14)
    for edge in form.get("held", ()):
        axis, end = "uv".index(edge[0]), float(edge.endswith("max"))
        on = POINTS.copy()
        on[:, axis] = end
        assert np.abs(found.displacement(on)).max() == 0


def test_losses_of_tensors_are_those_of_the_kind():
    data = catalog.named_case("field_hang").data()
    case = FieldCase.model_validate(data | {"cloth": CLOTH})
    weights, angles = Weights(choice(case, cells=(6, 3))), RANDOM.random(len(POINTS))
    field = LayeredField(case, weights.arrays(), weights.form)

    def of(count):
        at = corners(POINTS, angles, 0.1, count).reshape(-1, 2)
        return (case.rest(at) + field.displacement(at)).reshape(-1, count, 3), case.rest(at).reshape(-1, count, 3)

    heights = case.rest(POINTS)[:, 2] + field.displacement(POINTS)[:, 2]
    exact = 0.5 * strain(*of(3)) + 0.3 * bend(of(6)[0]) + 2.0 * 0.1 * heights
    asked = Losses(case, weights.tensor, POINTS, angles)
    assert asked.weighted(weights.displacement(asked.places)).numpy() == pytest.approx(exact, rel=1e-10)


@pytest.mark.parametrize("activation", ["relu", "sine"])
@pytest.mark.parametrize("pinned", [[], [[0.5, 0.5], [0.0, 0.25]]])
def test_slopes_of_a_drape_are_limits_of_differences(activation, pinned):
    """Through layers, levels, pins and a body."""
    torch.manual_seed(20)
    case = catalog.named_case("field_drape")
    own = choice(case, cells=(6, 3), activation=activation)
    weights = Weights(replace(own, form={**own.form, "pinned": pinned}))
    angles = np.random.default_rng(20).random(len(POINTS))
    weights.tensors["grid_0"] += 0.1 * torch.rand(weights.tensors["grid_0"].shape)
    asked = Losses(case, weights.tensor, POINTS, angles)

    def loss():
        return 1e3 * asked.weighted(weights.displacement(asked.places)).sum()

    moved = weights.displacement(asked.places).requires_grad_()
    (slope,) = torch.autograd.grad(1e3 * asked.weighted(moved).sum(), [moved])
    found = dict(zip(weights.tensors, weights.slopes(slope), strict=True))
    for name, tensor in weights.tensors.items():
        # rounding of the loss, a few hundred, is 1e-8 of this difference; a kink of relu is seldom so near
        way, step = torch.rand(tensor.shape, dtype=torch.float64) - 0.5, 1e-6
        tensor += step * way
        up = loss()
        tensor -= 2 * step * way
        down = loss()
        tensor += step * way
        assert float((found[name] * way).sum()) == pytest.approx(float((up - down) / (2 * step)), rel=1e-4, abs=1e-7)


def test_adam_is_that_of_pytorch_s_documentation():
    """Its first step has the size of the rate, whatever the slope; later ones go with the mean of slopes."""
    tensor = torch.tensor([1.0, -20.0], dtype=torch.float64)
    adam = Adam([tensor], 1e-2)
    adam.step([4 * tensor**3])
    assert tensor.detach().numpy() == pytest.approx([0.99, -19.99], abs=1e-9)
    first = np.array([4.0, -32_000.0])
    second = 4 * tensor.detach().numpy() ** 3
    mean = (0.9 * 0.1 * first + 0.1 * second) / (1 - 0.9**2)
    square = (0.999 * 0.001 * first**2 + 0.001 * second**2) / (1 - 0.999**2)
    expected = tensor.detach().numpy() - 1e-2 * mean / (np.sqrt(square) + 1e-8)
    adam.step([4 * tensor**3])
    assert tensor.detach().numpy() == pytest.approx(expected, rel=1e-12)


SHARES = np.array([[0.0, 2.0, 1.0], [0.0, 0.0, 0.0], [3.0, 1.0, 5.0]])


def statistic(points, shares):
    size = np.array(shares.shape)
    rows, columns = (points * size).astype(int).T
    counts = np.bincount(rows * size[1] + columns, minlength=size.prod()).reshape(size)
    assert (counts[shares == 0] == 0).all()
    expected = shares[shares > 0] / shares.sum() * len(points)
    return np.sum((counts[shares > 0] - expected) ** 2 / expected), len(expected) - 1


def test_draws_follow_the_density_within_cells_too():
    found, freedom = statistic(Cells(SHARES).draw(100_000, RANDOM), SHARES)
    assert found < chi2.isf(LEVEL, freedom)
    within = (Cells(SHARES).draw(100_000, RANDOM) * 3) % 1
    found, freedom = statistic(within, np.ones((5, 5)))
    assert found < chi2.isf(LEVEL, freedom)


def test_half_of_adaptive_samples_follow_the_density_and_weights_undo_it():
    case, shares = catalog.named_case("field_hang"), 1 + np.arange(16.0).reshape(4, 4)
    drawn = choice(case)
    drawn = Choice(**{**drawn.__dict__, "samples": 300})
    points, ones = sampled(drawn, Cells(shares), RANDOM)
    assert (ones == 1).all()
    mixed = 0.5 * shares / shares.sum() + 0.5 / 16
    found, freedom = statistic(points, mixed)
    assert found < chi2.isf(LEVEL, freedom)
    weighed = Choice(**{**drawn.__dict__, "sampler": Sampler("adaptive", True, 0.5, 0.9, 8, 0)})
    points, ones = sampled(weighed, Cells(shares), RANDOM)
    for values, exact in ((np.ones(len(points)), 1), (points[:, 0], 1 / 2), (points[:, 1] ** 2, 1 / 3)):
        error = np.std(ones * values) / np.sqrt(len(points))
        assert abs(np.mean(ones * values) - exact) < 4 * error  # one right sampler of 16,000 would fail


def test_a_density_moves_toward_fresh_losses():
    found = Cells(np.ones((2, 2))).mixed(np.array([[4.0, 0.0], [0.0, 0.0]]), 0.75).shares
    assert found == pytest.approx(np.array([[0.4375, 0.1875], [0.1875, 0.1875]]))
    assert positive(np.array([-1.0, 3.0])) == pytest.approx([0.0, 4.0])
    assert positive(np.zeros(2)) == pytest.approx([1.0, 1.0])


def test_jitter_has_one_point_in_each_cell():
    assert sorted(map(tuple, (jittered(5, RANDOM) * 5).astype(int))) == sorted(map(tuple, (lattice(5) * 5).astype(int)))


def test_relaxation_spaces_points_and_ends_at_even_ones():
    before = RANDOM.random((50, 2)) ** 2

    def nearest(points):
        return (np.linalg.norm(points[:, None] - points[None], axis=2) + np.eye(50)).min()

    assert nearest(relaxed(before, 20)) > 4 * nearest(before)
    assert relaxed_on_a_line(np.array([0.01, 0.02, 0.5]), 500) == pytest.approx([1 / 6, 1 / 2, 5 / 6], abs=1e-12)


@pytest.mark.long
def test_the_order_of_networks_is_that_of_table_1():
    """After as many epochs the grid is nearer than both networks; which of these is nearer is not said."""
    case = catalog.named_case("field_sine")
    rms = case.quantities[0]
    grid = rms.measure(PrintedGridSolver().solve(case, {"epochs": 80, "every": 80}))
    spent = {"epochs": 80, "every": 80, "precision": "float32", "learning_rate": 1e-3}
    plain, positional = (rms.measure(MlpSolver().solve(case, spent | {"encoding": e})) for e in ("plain", "positional"))
    assert grid < 2e-3 < min(plain, positional)


def test_losses_of_a_mesh_are_those_of_its_triangles_and_of_all_pairs_that_share_an_edge():
    case = catalog.named_case("field_drape")
    weights, cloth = Weights(choice(case, cells=(6, 3))), case.cloth
    weights.tensors["grid_0"] += 0.1 * torch.rand(weights.tensors["grid_0"].shape)
    mesh = MeshLosses(case, weights.tensor, 9)
    moved = weights.displacement(mesh.places)
    rest = case.rest(mesh.places)[mesh.triangles]
    places = rest + moved.numpy()[mesh.triangles]
    depth = np.minimum(case.body.distance(places.reshape(-1, 3)).reshape(-1, 3), 0)
    exact = cloth.strain * strain(places, rest) + 2 * cloth.collision * np.sum(depth**2, axis=1)
    exact += cloth.gravity * cloth.mass_gravity * places[..., 2].mean(axis=1)
    shared = [set(mesh.triangles[one]) & set(mesh.triangles[other]) for one, other in mesh.pairs]
    assert {len(corners) for corners in shared} == {2}
    assert len(set(map(frozenset, shared))) == len(shared) == (3 * len(rest) - 4 * 8) / 2
    one, other = (unit_normals(places[mesh.pairs[:, side]], (0, 1, 2)) for side in (0, 1))
    bending = 2 * cloth.bend * np.sum((one - other) ** 2) / len(rest)
    assert mesh.weighted(moved).numpy() == pytest.approx(exact + bending, rel=1e-9)


def test_a_training_ends_when_its_energy_has_settled_or_says_that_it_has_not():
    case = catalog.named_case("field_drape")
    own = {"samples": 4, "resolution": 8, "width": 8, "sampler": "uniform", "every": 100, "epochs": 400}
    loose, tight = (PrintedGridSolver().solve(case, own | {"settled": share}) for share in (0.999, 1e-9))
    assert loose.diagnostics["epochs"] < 400
    assert loose.unsettled is None
    assert "changes by" in tight.unsettled
    before, now = (step.quantities["energy"] for step in tight.history[-3::2])
    assert f"{abs(now - before) / abs(now):.2g} of it in 200 epochs" in tight.unsettled
    with pytest.raises(InputError, match="multiple of 'every'"):
        PrintedGridSolver().solve(case, own | {"settled": 0.5, "every": 150})
    with pytest.raises(InputError, match="losses of a square cloth"):
        PrintedGridSolver().solve(catalog.named_case("field_disc"), {"sampler": "mesh"})
