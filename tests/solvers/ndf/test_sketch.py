"""Gauss-Newton in random directions: what a sketch is, its model against all weights, and its steps."""

from dataclasses import replace
from itertools import pairwise

import pytest
import torch

from shellbench.bench.catalogue import catalog
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.solvers.ndf.ritz_solver import RitzSettings, RitzSolver
from shellbench.solvers.ndf.trainer_solver import NdfSolver, TrainerSettings
from shellbench.solvers.ndf.training.gauss_newton import flatten, quadratic_model, unflatten
from shellbench.solvers.ndf.training.sketch import Sketch, shared
from shellbench.solvers.ndf.training.training import train
from tests.solvers.ndf.test_trainer import network_and_points


def drawn(network, directions, seed=0):
    return Sketch.draw(network, directions, torch.Generator().manual_seed(seed))


@pytest.mark.parametrize("directions", [3, 40, 200, 100_000])
def test_directions_are_no_more_than_asked_for_and_small_layers_move_in_all(directions):
    shapes = [(8, 3), (64, 9), (64, 65)]
    sizes = [a * b for a, b in shared(directions, shapes)]
    assert sum(sizes) <= directions
    assert all(1 <= size <= m * n for size, (m, n) in zip(sizes, shapes, strict=True))
    if directions == 100_000:
        assert sizes == [m * n for m, n in shapes]


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


def test_the_model_in_directions_is_that_of_all_weights_along_them():
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
    sketch = Sketch.steepest(network, slope, 2 * each)
    moved = sketch.extend(torch.ones(sketch.count, dtype=torch.float64)).nonzero()[:, 0].tolist()
    steep = [before + unit * each + k for unit in (3, 7) for k in range(each)]
    assert moved == [*range(before), *steep]


def test_the_matrix_in_directions_is_that_of_differences_of_strains():
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


def test_certified_steps_in_directions_lower_the_energy_and_move_every_layer():
    problem, plan, state, points = network_and_points("scordelis_lo", width=20)
    states = [state]
    with torch.no_grad():
        sketched = replace(plan, iterations=4, directions=60)
        train(problem, sketched, state, points, lambda _, new: states.append(new))
    assert len(states) > 2
    for old, new in pairwise(states):
        assert new.train.gain > old.train.gain
        assert new.check.gain > old.check.gain
        assert new.evaluations > old.evaluations
    for old, new in zip(states[0].network.weights, states[-1].network.weights, strict=True):
        assert bool((old != new).any())


@pytest.mark.long
def test_a_deep_field_of_equal_width_agrees_with_ritz_on_the_plate():
    case = catalog.named_case("square_plate")
    settings = TrainerSettings(inner=(64, 64), widths=(64,), directions=600, iterations=5)
    deep = measure_all(NdfSolver().solve(case, settings))
    ritz = measure_all(RitzSolver().solve(case, RitzSettings()))
    assert deep[case.primary.name] == pytest.approx(ritz[case.primary.name], rel=1e-4)
