"""Gauss-Newton in a part of the weights: what a sketch is, and its model against that of all weights."""

import pytest
import torch

from shellbench.solvers.ndf.training.gauss_newton import flatten, quadratic_model, unflatten
from shellbench.solvers.ndf.training.sketch import Sketch
from tests.solvers.ndf.test_trainer import network_and_points


def drawn(network, directions, seed=0):
    """Return a sketch of some units of the last hidden layer, by a random slope."""
    slope = torch.randn(network.parameters, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return Sketch.from_steepest(network, slope, directions)


def test_extending_keeps_lengths_and_restricting_is_its_transpose():
    with torch.no_grad():
        network = network_and_points("square_plate")[2].network
    sketch = drawn(network, 40)
    generator = torch.Generator().manual_seed(2)
    change, gradient = (
        torch.randn(size, generator=generator, dtype=torch.float64) for size in (sketch.count, network.parameters)
    )
    assert float(sketch.extend(change).norm()) == pytest.approx(float(change.norm()))
    assert float(sketch.extend(change) @ gradient) == pytest.approx(float(change @ sketch.restrict(gradient)))


def test_the_model_of_some_weights_is_that_of_all_weights_along_them():
    with torch.no_grad():
        _, _, state, points = network_and_points("scordelis_lo")
        sketch = drawn(state.network, 30)
        given = points.train, points.tips, points.check, state.network, state.output
        everything, few = quadratic_model(*given), quadratic_model(*given, sketch)
        spread = torch.stack([sketch.extend(unit) for unit in torch.eye(sketch.count, dtype=torch.float64)], dim=1)
    torch.testing.assert_close(few.slope, spread.T @ everything.slope, rtol=1e-9, atol=0.0)
    whole = spread.T @ everything.matrix @ spread
    torch.testing.assert_close(few.matrix, whole, rtol=0.0, atol=1e-8 * float(whole.abs().max()))


def test_the_steepest_units_and_all_layers_before_are_the_ones_that_move():
    with torch.no_grad():
        network = network_and_points("square_plate")[2].network
    each = network.weights[-1].shape[1] + 1
    before = network.parameters - network.width * each
    slope = torch.zeros(network.parameters, dtype=torch.float64)
    slope[before + 3 * each], slope[before + 7 * each + 1] = -2.0, 1.0
    sketch = Sketch.from_steepest(network, slope, 2 * each)
    moved = sketch.extend(torch.ones(sketch.count, dtype=torch.float64)).nonzero()[:, 0].tolist()
    steep = [before + unit * each + k for unit in (3, 7) for k in range(each)]
    assert moved == [*range(before), *steep]


def test_the_matrix_of_some_weights_is_that_of_differences_of_strains():
    # J C by central differences of the strains at fixed output layer; without the projection, the floor is diag J^T J.
    with torch.no_grad():
        _, _, state, points = network_and_points("scordelis_lo")
        sketch = drawn(state.network, 20)
        model = quadratic_model(points.train, points.tips, points.check, state.network, state.output, sketch)
        theta, table = flatten(state.network), points.check.table

        def strains(change):
            network = unflatten(theta + sketch.extend(change), state.network)
            return torch.einsum(
                "nrcp,pnc->nr", table.rows.view(len(table.rows), 6, 3, 6), points.check.jets(network) @ state.output.T
            )

        step = 1e-5 * torch.eye(sketch.count, dtype=torch.float64)
        squares = torch.stack([((strains(s) - strains(-s)) / 2e-5).square().sum() for s in step])
    torch.testing.assert_close(model.floor, squares, rtol=1e-6, atol=0.0)
