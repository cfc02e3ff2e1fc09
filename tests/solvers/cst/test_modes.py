"""Modes of the triangle mesh agree with its own energies, which the computation of modes does not use."""

from dataclasses import replace

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.solvers.cst.mesh import TriangleMesh
from shellbench.solvers.cst.modes import find_modes
from shellbench.solvers.cst.problem import TriangleProblem
from shellbench.solvers.cst.settings import CstSettings
from shellbench.solvers.cst.solver import CstSolver
from shellbench.solvers.cst.solving import solve_linear


def problem(name, cells):
    case = catalog.named_case(name)
    return TriangleProblem.from_case(case, TriangleMesh(case.surface.domain, cells, "right"))


def test_a_frequency_is_that_of_the_energies_that_its_shape_stores():
    plate = problem("plate_modes", (9, 6))
    values, shapes = find_modes(plate, None, 3)
    assert np.all(np.diff(values) > 0)
    for value, shape in zip(values, shapes, strict=True):
        kinetic = np.sum(plate.loading.mass[:, None] * shape**2) / 2
        assert (2 * np.pi * value) ** 2 * kinetic == pytest.approx(plate.strain_energy(shape), rel=1e-9)


@pytest.mark.parametrize("name", ["strip_on_edge_1_20", "plate_compression"])
def test_the_tangent_of_large_displacements_is_singular_at_the_buckling_load(name):
    shell = problem(name, (12, 3))
    loaded = solve_linear(shell, (1.0,))[0].displacement
    (value,), (shape,) = find_modes(shell, loaded, 1)
    small = 1e-3  # of the load, far below which strains count for nothing beside stresses
    exact = replace(shell.elastic, linear=False)
    bent, flat = (
        shape.ravel()[shell.pattern.free]
        @ (shell.pattern.matrix(exact.tangent_values(u), np.zeros(len(shell.pattern.free)))
           @ shape.ravel()[shell.pattern.free])
        for u in (small * value * loaded, np.zeros_like(loaded))
    )  # fmt: skip
    assert bent == pytest.approx((1 - small) * flat, rel=1e-5)


def test_the_solver_takes_modes_of_shells_that_are_held_and_at_rest():
    declines = CstSolver().declines
    assert declines(catalog.named_case("plate_modes")) is None
    assert "about rest only" in declines(catalog.named_case("stretched_plate_modes"))
    assert "held only" in declines(catalog.named_case("free_plate_modes"))
    found = CstSolver().answer(catalog.named_case("plate_shear"), CstSettings(cells=(4, 4)), None, lambda step: None)
    assert sorted(found.mode_values) == [1, 2, 3]
