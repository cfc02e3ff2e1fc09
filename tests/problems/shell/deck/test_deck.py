"""Meshes with supports and loads for other programs, and the ladder of meshes that bounds their answers."""

import numpy as np
import pytest

import shellbench
from shellbench.errors import InputError, SolveFailure
from shellbench.problem import Capabilities
from shellbench.problems.shell.deck import nodal
from shellbench.problems.shell.deck.cells import PLACES, shapes_at
from shellbench.problems.shell.deck.deck import Deck
from shellbench.problems.shell.deck.grid import square_cells
from shellbench.problems.shell.deck.solver import MeshSettings, MeshSolution, MeshSolver
from shellbench.problems.shell.symmetry.symmetry import part_of, whole_of

PLATE, ROOF, CYLINDER = (shellbench.case(n) for n in ("square_plate", "scordelis_lo", "pinched_cylinder_free"))

MOTIONS = (([1, 0, 0], [0, 0, 0]), ([0, 0, 0], [0, 1, 0]), ([0, 0, 0], [0, 0, 1]))  # that nothing holds


@pytest.mark.parametrize("shape", PLACES)
def test_shape_functions_are_one_at_their_node_and_zero_at_the_others(shape):
    values, _ = shapes_at(shape, PLACES[shape])
    np.testing.assert_allclose(values, np.eye(len(values)), atol=1e-14)
    places = np.random.default_rng(0).random((20, 2)) / 2
    step = 1e-6 * np.eye(2)[:, None]
    found = [(shapes_at(shape, places + d)[0] - shapes_at(shape, places - d)[0]) / 2e-6 for d in step]
    np.testing.assert_allclose(shapes_at(shape, places)[1], np.stack(found, axis=-1), atol=1e-8)


@pytest.mark.parametrize("shape", PLACES)
@pytest.mark.parametrize("case", [PLATE, ROOF, CYLINDER], ids=lambda case: case.name)
def test_a_distorted_mesh_has_the_loads_of_the_shell_and_interpolates_what_its_cells_can(case, shape):
    for part in (part_of(case), whole_of(case)):
        deck = Deck.of(part, square_cells(part, 4), shape, 0.2 if part.mirrors or case is not CYLINDER else 0.0)
        total = part.copies * deck.forces.sum(axis=0)
        if part.mirrors:
            total *= [len({m.normal for m in part.mirrors} & {axis}) == 0 for axis in range(3)] + [0] * 3
        expected = Deck.of(whole_of(case), (24, 24)).forces.sum(axis=0)
        np.testing.assert_allclose(total, expected, atol=1e-7 * np.abs(deck.forces).sum())
        points = np.random.default_rng(1).uniform(part.lower, part.upper, (50, 2))
        mesh = deck.grid.mesh
        np.testing.assert_allclose(mesh.interpolate(mesh.xi @ [2.0, -3.0], points), points @ [2.0, -3.0], atol=1e-9)


def test_supports_hold_what_their_theory_says():
    hard, soft = (shellbench.case(f"scordelis_lo@{name}") for name in ("naghdi", "naghdi_soft"))
    counts = {}
    for case in (ROOF, hard, soft):
        deck = Deck.of(part_of(case), (2, 2))
        counts[case.name] = deck.held.sum(axis=0).tolist()
        assert not np.any(deck.prescribed)
    assert counts["scordelis_lo"] == counts["scordelis_lo@naghdi_soft"]
    more = np.subtract(counts["scordelis_lo@naghdi"], counts["scordelis_lo"])
    assert sorted(more) == [0, 0, 0, 0, 0, 2]  # turning about the axis, on the end; the mirror's node has it already


def test_rigid_motions_are_pinned_and_taken_out():
    part = whole_of(shellbench.case("bent_plate"))
    deck = Deck.of(part, (3, 3))
    motions = np.cross([0.3, 0.0, 0.0], deck.nodes) + np.array([0.0, 2.0, 3.0])
    pinned = deck.held & ~nodal.held(part.case, deck.grid)
    assert pinned.sum() == len(part.case.remove_rigid_motions) == 3
    assert np.linalg.matrix_rank(np.stack([(np.cross(a, deck.nodes) + b)[pinned[:, :3]] for a, b in MOTIONS])) == 3
    np.testing.assert_allclose(deck.without_rigid(motions), 0, atol=1e-12)


def test_a_point_beside_the_nodes_is_refused():
    with pytest.raises(InputError, match="'loaded' lies on no node of 3 x 3 cells"):
        _ = Deck.of(whole_of(shellbench.case("clamped_plate_point")), (3, 3)).forces


class Wavy(MeshSolver):
    """A program whose answer is that of a formula, but for an error of known size and rate."""

    name = "wavy"
    capabilities = Capabilities(theories=("kirchhoff-love-linear",), label="a formula")
    error, rate, fails_from = 0.5, 2.0, 1000

    def solve_mesh(self, deck, settings):
        if max(deck.grid.counts) >= self.fails_from:
            raise SolveFailure("the program has no more memory")
        size = 1 / deck.grid.counts[0]
        x = deck.nodes / np.ptp(deck.nodes, axis=0).max()
        return (1 + self.error * size**self.rate) * np.stack([0 * x[:, 0], 0 * x[:, 0], x[:, 0] + x[:, 1]], axis=-1)


def test_the_ladder_finds_limit_and_rate_and_its_uncertainty_covers_the_error(tmp_path):
    plate = PLATE.without([q.name for q in PLATE.quantities if not q.primary])
    answer = Wavy().solve(plate, MeshSettings(cells=(4, 8, 16, (32, 32))))
    name = plate.primary.name
    limit = Wavy().solve(plate, MeshSettings(cells=(128,))).history[-1].quantities[name] / (1 + 0.5 * 128**-2)
    value = answer.history[-1].quantities[name]
    assert answer.extrapolated[name] == pytest.approx(limit, rel=1e-6)
    assert answer.diagnostics["rates"][name] == pytest.approx(2, abs=0.01)
    assert abs(value - limit) <= answer.uncertainty[name] <= 2 * abs(value - limit)
    read = MeshSolution.load(answer.save(tmp_path / "a"))
    points = plate.surface.domain.grid(7, 5)
    np.testing.assert_array_equal(read.displacement(points), answer.displacement(points))
    own = type("Own", (Wavy,), {"solve_mesh": lambda self, *asked: (Wavy.solve_mesh(self, *asked), 7)})()
    assert own.solve(plate, MeshSettings(cells=(4,))).parameters == 7 != answer.parameters == read.parameters
    with pytest.raises(SolveFailure, match="memory") as failed:
        type("Small", (Wavy,), {"fails_from": 16})().solve(plate, MeshSettings())
    assert failed.value.partial.parameters > 0


def test_what_a_mesh_program_cannot_take_is_declined():
    solver = Wavy()
    energies = [q for q in PLATE.quantities if q.kind.endswith("energy")]
    assert energies
    assert all("displacements" in solver.declines_quantity(PLATE, q) for q in energies)
    for name, why in (("scordelis_lo@naghdi", "theory"), ("angle_frame", "folds"), ("cantilever_shear", "theory")):
        assert why in solver.declines(shellbench.case(name))
    stiffer = PLATE.model_copy(update={"material": PLATE.material.model_copy(update={"bending_factor": 1.5})})
    assert "homogeneous" in solver.declines(stiffer)
    assert type("Scaling", (Wavy,), {"scales_bending": True})().declines(stiffer) is None
