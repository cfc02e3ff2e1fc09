"""Supports and loads on parts of edges: changes within an edge, and independence of the form of the case."""

import numpy as np
import pytest

from derivations.partly_clamped_plate import partly_clamped_plate
from shellbench.bench.catalogue import catalog
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.solvers.cst.solver import CstSolver
from shellbench.solvers.fem.mechanics.corners import Rim, bending_exponent, break_exponents, membrane_exponent
from shellbench.solvers.fem.mesh.grading import graded_mesh
from shellbench.solvers.fem.solver import FemSettings, FemSolver
from shellbench.solvers.ndf.published_solver import PublishedSolver
from shellbench.solvers.ndf.ritz_solver import RitzSettings, RitzSolver
from shellbench.solvers.ndf.trainer_solver import NdfSolver
from tests.solvers.fem.shells import CYLINDER, EVERY_EDGE, shell

SQUARE = {"kind": "plane", "xi1": [0, 1], "xi2": [0, 1]}
UNIT = {"youngs_modulus": 12 * 0.91, "poissons_ratio": 0.3, "thickness": 0.1}  # B = 1e-3
PRESSED = [{"kind": "pressure", "value": 1.0}]
CENTRE = [{"name": "w", "kind": "displacement", "primary": True, "points": ["centre"], "direction": [0, 0, 1]}]
SIMPLE = {"name": "simple", "on": EVERY_EDGE, "components": ["z"]}
INSIDE = {"name": "inside", "on": ["xi1_max"], "components": ["x", "y"]}


def square(**fields):
    """A square plate of side one under uniform load."""
    common = {"points": {"centre": [0.5, 0.5]}, "loads": PRESSED, "quantities": CENTRE, "material": UNIT}
    return shell(SQUARE, **{**common, **fields})


def partly_clamped():
    """A simply supported plate that is clamped on the middle half of one edge."""
    parts = {"middle": {"edge": "xi1_min", "between": [0.25, 0.75]}}
    clamp = {"name": "clamp", "on": ["middle"], "components": [], "clamped": True}
    return square(edge_parts=parts, supports=[SIMPLE, INSIDE, clamp])


def solved(case, **settings):
    return FemSolver().solve(case, FemSettings(**settings))


@pytest.mark.parametrize("kinds", [("clamped", "free"), ("clamped", "supported"), ("free", "supported")])
def test_moments_are_infinite_as_an_inverse_square_root_where_supports_change(kinds):
    # Williams (1952), table for an angle of 180 degrees
    assert bending_exponent(np.pi, *kinds, 0.3) == pytest.approx(0.5, abs=1e-9)
    assert membrane_exponent(np.pi, Rim(held=(2, 0.0)), Rim(), 0.3) == pytest.approx(0.5, abs=1e-9)


def test_a_partly_clamped_plate_is_as_its_dual_series_says():
    known = partly_clamped_plate(1.0, 1e-3)
    assert known.uncertainty < 1e-10
    case = partly_clamped()
    assert list(break_exponents(case).values()) == pytest.approx([0.5, 0.5], abs=1e-9)
    solution = solved(case, max_unknowns=12_000)
    found = measure_all(solution)["w"]
    assert abs(found - known.value) <= 2 * solution.uncertainty["w"]
    assert found == pytest.approx(known.value, rel=1e-4)


@pytest.mark.long
def test_an_edge_is_the_sum_of_its_parts():
    parts = {"a": {"edge": "xi1_min", "between": [0, 0.3]}, "b": {"edge": "xi1_min", "between": [0.3, 1]}}
    others = EVERY_EDGE[1:]
    whole = square(supports=[{"name": "rim", "on": EVERY_EDGE, "clamped": True}])
    split = square(edge_parts=parts, supports=[{"name": "rim", "on": ["a", "b", *others], "clamped": True}])
    assert break_exponents(split) == {}
    one, other = (measure_all(solved(case))["w"] for case in (whole, split))
    assert other == pytest.approx(one, rel=2e-6)


def test_a_part_ends_on_a_mesh_line_and_holds_its_nodes_alone():
    case = partly_clamped()
    mesh = graded_mesh(case, (4, 4), 2.0)
    part = case.places["middle"]
    held = mesh.node_points[mesh.edge_nodes(part)]
    assert np.all(held[:, 0] == 0)
    assert (held[0, 1], held[-1, 1]) == (0.25, 0.75)
    assert np.sum(mesh.sizes[mesh.edge_cells(part), 1]) == pytest.approx(0.5)


@pytest.mark.parametrize("theory", ["kirchhoff-love-linear", "kirchhoff-love-nonlinear"])
def test_what_a_part_is_loaded_with_is_what_holds_the_shell(theory):
    forces = [{"name": f"f{c}", "kind": "reaction", "support": "wall", "direction": d, "primary": not i}
              for i, (c, d) in enumerate(zip("xyz", np.eye(3).tolist(), strict=True))]  # fmt: skip
    parts = {"wall": {"edge": "xi1_min", "between": [0.1, 0.8]}, "lip": {"edge": "xi1_max", "between": [0.4, 0.7]}}
    load = {"kind": "edge", "on": ["lip"], "vector": [f"{x}*t" for x in (2e-6, -1e-6, 3e-6)]}
    wall = {"name": "wall", "on": ["wall"], "clamped": True}
    case = square(theory=theory, edge_parts=parts, supports=[wall], loads=[load], quantities=forces)
    found = measure_all(solved(case, cells=(6, 6)))
    expected = {"fx": -0.6e-6, "fy": 0.3e-6, "fz": -0.9e-6}
    assert found == pytest.approx(expected, rel=1e-6)


def test_the_seam_of_a_closed_shell_may_be_anywhere():
    """A tube held on a third of its rim, the seam beside the part, and far away from it."""
    found = []
    for start in (0, 200):
        surface = CYLINDER | {"xi1": [start, start + 360]}
        if start == 200:
            parts = {"held": {"edge": "xi2_min", "between": [360 + 40, 360 + 160]}}
        else:
            parts = {"held": {"edge": "xi2_min", "between": [40, 160]}}
        wall = {"name": "wall", "on": ["held"], "clamped": True}
        load = [{"kind": "area", "vector": [1, 0.5, 2]}]
        case = shell(surface, edge_parts=parts, supports=[wall], loads=load)
        assert len(break_exponents(case)) == 2
        found.append(measure_all(solved(case, cells=(5, 8)))["largest"])
    assert found[1] == pytest.approx(found[0], rel=1e-6)  # rounding; the search for the largest begins elsewhere


@pytest.mark.parametrize("name", ["flipped", "swapped", "stretched", "turned", "units"])
def test_variants_carry_parts(name):
    case = partly_clamped()
    variant = catalog.variant_of(case, name)
    assert "middle" in variant.edge_parts
    one, other = (measure_all(solved(c, cells=(6, 6)))["w"] * c.primary.factor for c in (case, variant))
    assert other == pytest.approx(one, rel=1e-6)  # rounding


def test_the_field_answers_for_loaded_parts_as_fem_does():
    parts = {"lip": {"edge": "xi1_max", "between": [0.35, 0.6]}}
    load = {"kind": "edge", "on": ["lip"], "vector": [0, 0, "1 + xi2"]}
    rim = {"name": "rim", "on": ["xi1_min", "xi2_min", "xi2_max"], "components": ["z"]}
    inside = {"name": "inside", "on": ["xi1_min"], "components": ["x", "y"]}
    case = square(edge_parts=parts, supports=[rim, inside], loads=[load])
    field, fem = RitzSolver().solve(case, RitzSettings(neurons=200)), solved(case, max_unknowns=6000)
    one, other = measure_all(field)["w"], measure_all(fem)["w"]
    assert abs(one - other) <= 2 * (field.uncertainty["w"] + fem.uncertainty["w"])
    assert one == pytest.approx(other, rel=2e-3)


OTHERS = (CstSolver(), PublishedSolver(), NdfSolver(), RitzSolver())


@pytest.mark.parametrize("solver", OTHERS, ids=lambda solver: solver.name)
def test_other_solvers_decline_supported_parts(solver):
    said = solver.declines(partly_clamped())
    assert said == "a support holds a part of an edge, and this solver takes whole edges only"
