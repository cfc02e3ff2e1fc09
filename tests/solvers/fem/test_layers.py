"""Layers along held edges: as long as theory says, the same in other coordinates, and resolved by graded meshes."""

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.solvers.fem.mechanics.layers import SHARE, THIN, layer_gradings, relative_layer
from shellbench.solvers.fem.mesh.grading import axis_lines
from shellbench.solvers.fem.solver import FemSettings, FemSolver


def cylinder(radius=2.0, length=6.0, thickness=1e-3, held=("xi2_min",), clamped=True):
    return Case.model_validate(
        {
            "name": "tube", "title": "Tube", "kind": "shell", "theory": "kirchhoff-love-linear",
            "surface": {
                "kind": "expression", "x": f"{radius}*cos(xi1)", "y": f"{radius}*sin(xi1)", "z": "xi2",
                "xi1": [0, 90], "xi2": [0, length], "angles": ["xi1"],
            },
            "material": {"youngs_modulus": 2e11, "poissons_ratio": 0.3, "thickness": thickness},
            "supports": [{"name": "rim", "on": list(held), "clamped": clamped}],
            "loads": [{"kind": "pressure", "value": "1"}],
            "quantities": [{"name": "strain_energy", "kind": "strain_energy", "primary": True}],
        }
    )  # fmt: skip


def test_the_layer_at_the_rim_of_a_cylinder_is_as_long_as_its_equation_says():
    # B w'''' + E h w / R^2 = 0 has the solutions exp(-b x) cos(b x), 4 b^4 = E h / (B R^2)
    case = cylinder()
    bending = 2e11 * 1e-9 / 12 / (1 - 0.3**2)
    length = (4 * bending * 2.0**2 / (2e11 * 1e-3)) ** 0.25
    assert relative_layer(case, case.places["xi2_min"], True) == pytest.approx(length / 3.0, rel=1e-12)


def test_along_straight_lines_of_a_cylinder_there_is_no_edge_effect():
    case = cylinder(held=("xi1_min",))  # only what dies out between its ends, 6 / pi
    assert relative_layer(case, case.places["xi1_min"], True) == pytest.approx(6 / np.pi / (2.0 * np.pi / 4))


def test_what_holds_the_end_of_a_slender_plate_dies_out_within_its_width():
    case = catalog.named_case("strip_plate_1_50")
    assert relative_layer(case, case.places["xi1_max"], False) == pytest.approx(1 / np.pi / 25)


@pytest.mark.parametrize("variant", ["turned", "stretched", "units", "helical"])
def test_the_layer_is_as_thin_in_other_coordinates(variant):
    case, other = (
        catalog.named_case(name) for name in ("hyperboloid_clamped_1e_3", f"hyperboloid_clamped_1e_3@{variant}")
    )
    assert layer_gradings(other)[1] == pytest.approx(layer_gradings(case)[1], rel=1e-9)
    assert layer_gradings(case)[1][0] > 1


def test_meshes_grade_toward_thin_layers_at_clamped_edges_and_opposite_them():
    thin, thick, hinged = cylinder(thickness=1e-4), cylinder(thickness=1e-1), cylinder(thickness=1e-4, clamped=False)
    (first, second) = layer_gradings(thin)
    assert first == (1.0, 1.0)
    cells = 200
    lines = axis_lines(thin, 1, cells, 2.5, second)
    layer = relative_layer(thin, thin.places["xi2_min"], True) * 3.0  # m; a free edge has one as thin
    assert len(lines) == 2 * cells + 1
    for distances in (lines, 6.0 - lines):
        assert np.count_nonzero(distances < layer) / cells == pytest.approx(SHARE, abs=2 / cells)
    assert relative_layer(thick, thick.places["xi2_min"], True) > THIN
    assert layer_gradings(thick) == layer_gradings(hinged) == ((1.0, 1.0), (1.0, 1.0))


def test_meshes_do_not_grade_toward_planes_of_symmetry():
    slender = cylinder(thickness=1e-4, length=60.0)
    data = slender.model_dump(mode="json", exclude_unset=True)
    data["supports"] += [{"name": "mirror", "on": ["xi2_max"], "symmetry": "z"}]
    (near, far) = layer_gradings(Case.model_validate(data))[1]
    assert (near, near) == layer_gradings(slender)[1]
    assert near > far == 1


@pytest.mark.long
def test_a_tube_with_one_free_end_is_as_sure_as_it_says():
    data = cylinder(thickness=3e-4).model_dump(mode="json", exclude_unset=True)
    data["loads"] = [{"kind": "pressure", "value": "cos(4*xi1)"}]
    data["supports"] += [{"name": n, "on": [f"xi1_{side}"], "symmetry": n} for n, side in (("y", "min"), ("x", "max"))]
    case = Case.model_validate(data)
    assert min(layer_gradings(case)[1]) > 1
    found, finer = (FemSolver().solve(case, FemSettings(cells=cells)) for cells in (None, (16, 16)))
    known = measure_all(finer)["strain_energy"]
    assert abs(measure_all(found)["strain_energy"] - known) < found.uncertainty["strain_energy"] < 6e-6 * known


def test_of_meshes_with_as_many_cells_the_graded_one_comes_nearer_to_the_least_energy():
    case = cylinder(thickness=1e-4, held=("xi2_min", "xi2_max"))
    graded, uniform = (
        FemSolver().solve(case, FemSettings(cells=(2, 6), grading=grading)).history[0].energy for grading in (None, 1.0)
    )
    assert graded < uniform < 0
