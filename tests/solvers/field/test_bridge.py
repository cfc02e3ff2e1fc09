"""The bridge: a sheet of local structures comes to its shell as the square of their side."""

import numpy as np
import pytest

from derivations.bridge_plate import bridge_plate, levy
from shellbench.bench.catalogue import catalog
from shellbench.problems.field import structure
from shellbench.solvers.field.solver import GridSolver

SIDES = {"field_bridge_50": 0.05, "field_bridge_25": 0.025, "field_bridge_12": 0.0125}


def mean_bending(curvature, side):
    """Mean bending loss (22) of structures of a side on z = x K x / 2, over directions, by their corners."""
    angles = np.linspace(0, structure.TURN, 24, endpoint=False)
    at = structure.corners(np.full((24, 2), 0.5), angles, side) - 0.5
    z = np.einsum("nca,ab,ncb->nc", at, curvature, at) / 2
    return float(structure.bend(np.concatenate([at, z[..., None]], axis=2)).mean())


@pytest.mark.parametrize(
    "curvature", [[[1, 0], [0, 1]], [[1, 0], [0, -1]], [[1, 0], [0, 0]], [[0.2, 0.7], [0.7, -0.5]]]
)
def test_bending_of_small_structures_has_a_poissons_ratio_of_minus_a_third(curvature):
    """s^2 (3/4 tr^2 k - 2 det k) is B/2 ((1 - nu) tr k^2 + nu tr^2 k) with B = 3/2 s^2 and nu = -1/3."""
    k, side, stiffness, nu = 1e-3 * np.array(curvature), 0.1, 3 / 2 * 0.1**2, -1 / 3
    shell = stiffness / 2 * ((1 - nu) * np.trace(k @ k) + nu * np.trace(k) ** 2)
    assert shell == pytest.approx(side**2 * (3 / 4 * np.trace(k) ** 2 - 2 * np.linalg.det(k)))
    assert mean_bending(k, side) == pytest.approx(shell, rel=1e-6)


def test_sheets_and_plate_are_one_shell():
    material = catalog.named_case("bridge_plate").material
    for name, side in SIDES.items():
        cloth = catalog.named_case(name).cloth
        assert cloth.side == side
        assert cloth.strain * 9 / 4 == pytest.approx(material.membrane_stiffness)
        assert cloth.bend * side**2 * 3 / 2 == pytest.approx(material.bending_stiffness)
        assert side * np.sqrt(8 * cloth.bend / cloth.strain) == pytest.approx(material.thickness)


@pytest.mark.long
def test_the_distance_falls_as_the_square_of_the_side():
    """By the slope between sides, from the answer of the same grid that all of them tend to (Richardson)."""
    known, values = bridge_plate()["centre_deflection"].value, []
    for name in SIDES:
        answer = GridSolver().solve(catalog.named_case(name), {"resolution": 8, "points": 6})
        values.append([-answer.displacement(np.array([[0.5, 0.5], [0.5, 0.0]]))[:, 2]])
    coarse, middle, fine = (np.array(v)[0] for v in values)
    orders = np.log2((coarse - middle) / (middle - fine))
    assert orders == pytest.approx([2.0, 2.0], abs=0.1)
    limit = fine + (fine - middle) / 3
    assert limit == pytest.approx(levy(200)[0], rel=1e-4)
    assert limit[0] == pytest.approx(known, rel=1e-4)
