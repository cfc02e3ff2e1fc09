"""The bicubic Hermite basis."""

import numpy as np
import pytest
from skfem import Basis, MeshQuad
from skfem.element import ElementQuadBFS

from shellbench.solvers.fem.mesh.basis import CORNERS, KINDS, axis_functions, kind_scales, tabulate


def test_each_function_carries_one_nodal_value():
    corners = np.array(CORNERS, dtype=float)
    values = np.stack([tabulate(corners, kind) for kind in KINDS], axis=1)  # at corner, of kind: by corner and kind
    assert np.array_equal(values.reshape(16, 16), np.eye(16))


def test_derivatives_of_cubics_against_differences():
    x, step = np.linspace(0.1, 0.9, 7), 1e-5
    for order in (0, 1):
        slope = (axis_functions(x + step, order) - axis_functions(x - step, order)) / (2 * step)
        assert np.allclose(slope, axis_functions(x, order + 1), atol=1e-9)


@pytest.mark.parametrize("n", [1, 4, 32])
def test_scaled_functions_are_those_of_scikit_fem(n):
    lines = np.linspace(0, 1, n + 1)
    mesh = MeshQuad.init_tensor(lines, 2 * lines)
    element = ElementQuadBFS()
    basis = Basis(mesh, element, intorder=7)
    rounding = np.finfo(float).eps * np.linalg.cond(element.V).max()  # of the matrix that scikit-fem inverts
    origin, size = mesh.p[:, mesh.t[0]].T, (mesh.p[:, mesh.t[2]] - mesh.p[:, mesh.t[0]]).T
    at = np.moveaxis(np.asarray(basis.global_coordinates()), 0, -1)  # scikit-fem's unit cell has its axes exchanged
    points = (at - origin[:, None]) / size[:, None]
    scale = kind_scales(size)
    for a, _ in enumerate(CORNERS):
        for k, _ in enumerate(KINDS):
            theirs = basis.basis[4 * a + k][0]
            for kind, value in [((0, 0), np.asarray(theirs)), *zip(((1, 0), (0, 1)), theirs.grad, strict=True)]:
                ours = tabulate(points, kind)[..., a, k] * scale[:, None, k]
                ours = ours / (size[:, 0] ** kind[0] * size[:, 1] ** kind[1])[:, None]
                assert np.abs(ours - value).max() <= rounding * np.abs(value).max()
