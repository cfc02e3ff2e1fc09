"""Sequences of meshes whose first ones do not follow the path to its end."""

from dataclasses import replace
from itertools import count

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.errors import SolveFailure
from shellbench.problem import Step
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.solvers.fem.mesh.grading import graded_mesh
from shellbench.solvers.fem.path import large_displacement
from shellbench.solvers.fem.refinement import MOVING, levels
from tests.solvers.fem.test_large_displacement import on_mesh

STRIP = catalog.named_case("cantilever_shear")


@pytest.fixture(scope="module")
def whole():
    return on_mesh(STRIP, (2, 1))[0]


def ending(whole, ends):
    """Return a solver whose paths end at these load factors, mesh by mesh; at None the path is whole."""
    left = iter(ends)

    def solve(cells):
        if (end := next(left)) is None:
            return whole
        step = Step(0, 0.0, 0.0, 1, end)
        raise SolveFailure(f"ended at {end}", partial=replace(whole.solution, history=(step,)))

    return solve


def first_level(whole, ends, forgiven=1):
    meshes = ((n, 1) for n in count(2))
    return next(levels(STRIP, meshes, ending(whole, ends), measure_all, forgiven))


def test_paths_that_end_elsewhere_on_each_mesh_are_followed_on_finer_ones(whole):
    assert first_level(whole, [0.41, 0.5, 0.45, 0.7, None]).equilibrium is whole


def test_a_limit_point_that_two_meshes_agree_on_is_the_shells(whole):
    with pytest.raises(SolveFailure, match=r"ended at 0\.502"):
        first_level(whole, [0.5, 0.502, None])


def test_only_so_many_meshes_are_tried(whole):
    ends = [0.3 + 0.1 * k for k in range(MOVING + 2)]
    with pytest.raises(SolveFailure, match=f"ended at {ends[MOVING + 1]}"):
        first_level(whole, [*ends, None])


def test_a_failure_without_a_path_is_forgiven_once(whole):
    def lost(cells):
        raise SolveFailure("lost")

    with pytest.raises(SolveFailure, match="lost"):
        next(levels(STRIP, ((n, 1) for n in count(2)), lost, measure_all, 1))


@pytest.mark.long
def test_the_semi_cylinder_deflects_as_published():
    """Sze, Liu & Lo 2004: to 0.4 % from a fifth of the load on, and 2.5 % less before, where a point load is felt."""
    case = catalog.named_case("semi_cylinder")
    published = catalog.known_values("semi_cylinder").curves[0]
    path = case.path.model_copy(update={"states": (0.05, 0.1, 0.2, 0.4, 0.5, 0.8)})
    case = case.model_copy(update={"path": path})
    found, _ = large_displacement.solve(case, graded_mesh(case, (8, 8), 2.0), 7, (1 / 8, 1e-4))
    for t in case.states:
        said = published.values[published.loads.index(t)]
        deflection = -found.solution.displacement(case.places["A"].xi, at=t)[2]
        assert deflection == pytest.approx(said, rel=4e-3 if t >= 0.2 else 2.5e-2), t
