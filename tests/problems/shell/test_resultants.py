"""Stress resultants as a question: one sentence for each slip, components, means, and the question asked otherwise."""

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError
from shellbench.problem import declined_quantities
from shellbench.problems.shell.quantities.quantities import ResultantQuantity
from shellbench.solvers.cst.solver import CstSolver
from shellbench.solvers.fem.mechanics.resultants import patch_lines
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.solver import FemSolver
from shellbench.solvers.ndf.ritz_solver import RitzSolver
from tests.families import altered

PUSH = {"kind": "point", "on": ["aside"], "force": [0, 0, 1]}
PIN = {"name": "pin", "on": ["aside"], "components": ["z"]}
MOTION = {"until": 1.0}


SLIPS = {
    "load": (
        lambda d: d["loads"].append(PUSH),
        "a point load acts at its point 'aside', and forces and moments are infinite",
    ),
    "support": (lambda d: d["supports"].append(PIN), "support 'pin' acts at its point 'aside'"),
    "theory": (lambda d: d.update(theory="kirchhoff-love-nonlinear"), "kirchhoff-love-linear"),
    "nowhere": (lambda d: d["quantities"][0].update(on=["surface"]), "needs points, or edges"),
    "mixed": (lambda d: d["quantities"][0].update(on=["centre", "xi1_min"]), "needs points, or edges"),
    "component": (lambda d: d["quantities"][0].update(component="33"), "component"),
}


@pytest.mark.parametrize("slip", SLIPS)
def test_a_slip_is_one_sentence(slip):
    change, words = SLIPS[slip]
    with pytest.raises(InputError, match=words) as raised:
        altered(catalog.named_case("resultants_plate").data(), change)
    assert "\n" not in str(raised.value)


def test_a_point_load_on_an_edge_refuses_its_mean():
    def change(data):
        data["points"]["on_edge"] = [0.4, 1.0]
        data["loads"].append({**PUSH, "on": ["on_edge"]})

    with pytest.raises(InputError, match="has no value on 'xi2_max'"):
        altered(catalog.named_case("resultants_clamped_plate").data(), change)


def test_infinite_moments_at_an_obtuse_corner_are_refused():
    def change(data):
        data["surface"] = {
            "kind": "expression", "x": "xi1 + 0.6*xi2", "y": "0.8*xi2", "z": "0", "xi1": [0, 2], "xi2": [0, 1],
        }  # fmt: skip
        data["quantities"][0]["on"] = ["xi1_max,xi2_min"]

    case = altered(catalog.named_case("resultants_plate").data(), change)
    name = case.quantities[0].name
    assert "grow without bound toward the corner" in declined_quantities(FemSolver(), case)[name]
    assert "corner" in declined_quantities(RitzSolver(), case)[name]


def test_a_solver_without_resultants_declines():
    case = catalog.named_case("resultants_plate")
    declined = declined_quantities(CstSolver(), case)
    assert set(declined) == {q.name for q in case.quantities if isinstance(q, ResultantQuantity)}
    assert "stress resultants" in next(iter(declined.values()))


def test_principal_values_are_those_of_the_tensor():
    case = catalog.named_case("resultants_plate")
    tensors = np.random.default_rng(0).normal(size=(5, 2, 2))
    tensors = tensors + np.swapaxes(tensors, 1, 2)
    values = tensors.reshape(-1, 4)[:, [0, 3, 1]]
    found = [case.quantity(f"principal_moment_{k}").component_of(values) for k in (2, 1)]
    assert np.stack(found, axis=-1) == pytest.approx(np.linalg.eigvalsh(tensors))


def test_a_mean_along_an_arc_is_by_its_length():
    def change(data):
        data["quantities"][0]["on"] = ["xi2_min"]

    case = altered(catalog.named_case("resultants_roof").data(), change)
    points, weights = case.quantities[0].rule(case)
    assert weights.sum() == pytest.approx(1)
    assert weights @ points == pytest.approx([np.pi / 2, 0])


def test_axes_and_signs_in_other_coordinates():
    plate, roof = catalog.named_case("resultants_plate"), catalog.named_case("resultants_roof")
    converted = catalog.variant_of(plate, "units")
    assert converted.quantity("moment_11").factor == pytest.approx(1)  # N
    assert converted.quantity("shear_aside").factor == pytest.approx(1e3)  # N/mm to N/m
    for case, chart in ((plate, "flipped"), (plate, "swapped"), (roof, "swapped")):
        with pytest.raises(InputError, match="changes its sign with the normal"):
            catalog.variant_of(case, chart)

    def forces_alone(data):
        data["quantities"] = data["quantities"][:2]

    swapped = catalog.variant_of(altered(catalog.named_case("resultants_roof").data(), forces_alone), "swapped")
    assert swapped.quantity("edge_force").component == "11"
    assert catalog.variant_of(plate, "oblique").quantity("moment_11").component == "11"


def test_a_patch_stays_between_kinks_and_goes_on_over_a_seam():
    flat = catalog.named_case("resultants_plate").surface.domain
    closed = catalog.named_case("cylinder_modes").surface.domain
    mesh = TensorMesh(flat, (np.linspace(0, 2, 9), np.linspace(0, 1, 5)), 5)
    assert patch_lines(mesh, 0, 1.1, [1.0]) == pytest.approx([1.0, 1.25, 1.5, 1.75])
    assert patch_lines(mesh, 0, 2.0, []) == pytest.approx([1.25, 1.5, 1.75, 2.0])
    ring = TensorMesh(closed, (np.linspace(0, 2 * np.pi, 9), np.linspace(0, 2, 5)), 5)
    assert patch_lines(ring, 0, 0.1, []) == pytest.approx(np.array([-1, 0, 1, 2]) * np.pi / 4)
