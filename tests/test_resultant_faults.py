"""The gate of stress resultants: mistakes of either mechanics must turn it red, and the same path without one is green."""

import numpy as np

from shellbench.problems.shell.quantities import resultant_quantities
from shellbench.problems.shell.quantities.resultant_quantities import TensorResultant
from shellbench.solvers.fem.mechanics import resultants as fem
from shellbench.solvers.fem.mechanics.kinematics import elasticity
from shellbench.solvers.ndf.field import supports
from shellbench.solvers.ndf.linear import patches as ndf
from tests.test_faults import Fault, gate_tests, wrapped


def uncoupled(patch):
    patch.setattr(fem, "elasticities", lambda surface, _: np.stack([elasticity(surface, 0.0)] * 2, axis=1))


def square_of_thickness(patch):
    original = fem.stiffness_moduli
    patch.setattr(
        fem, "stiffness_moduli", lambda of, material, at: original(of, material, at) / [1.0, material.thickness]
    )


def exchanged(patch):
    other = {"principal_1": "principal_2", "principal_2": "principal_1"}
    original = TensorResultant.component_of
    patch.setattr(
        TensorResultant,
        "component_of",
        lambda self, values: original(self.model_copy(update={"component": other.get(self.component, self.component)}), values),
    )  # fmt: skip


def without_christoffel(surface, found):
    full = found[:, :, [[0, 2], [2, 1]]]
    return full[:, 1, :, 0] + full[:, 2, :, 1]


def one_slope_alone(patch):
    original = ndf._line
    patch.setattr(
        ndf, "_line", lambda case, axis, at: (original(case, axis, at)[0], original(case, axis, at)[1] * (1 - axis))
    )


def turned_inward(patch):
    """Take the coordinate's own direction for outward at the edges where it begins."""
    original = supports._from_local

    def local(case, vectors, points, running, outward=None):
        begins = outward is not None and outward.side == "min"
        return original(case, vectors * [1, -1, 1] if begins else vectors, points, running, outward)

    patch.setattr(supports, "_from_local", local)


def weighed_by_parameter(patch):
    original = resultant_quantities.along_edge

    def along(shell, edge):
        points, weights = original(shell, edge)
        lengths = np.linalg.norm(shell.surface.derivatives(points, order=1)[(1, 0) if edge.axis else (0, 1)], axis=-1)
        return points, weights / lengths

    patch.setattr(resultant_quantities, "along_edge", along)


FAULTS = (
    Fault("a moment's sign", "fem", "resultants_plate", wrapped(fem, "contravariant_resultants", np.negative)),
    Fault("nu's coupling dropped", "fem", "resultants_plate", uncoupled),
    Fault("moments with the square of the thickness", "fem", "resultants_plate", square_of_thickness),
    Fault("twisting moment counted twice", "fem", "resultants_plate", lambda patch: patch.setattr(fem, "HALF", np.ones(3))),
    Fault("principal values exchanged", "fem", "resultants_plate", exchanged),
    Fault("in the frame of the coordinates", "fem", "resultants_roof", lambda patch: patch.setattr(fem, "_frame_components", lambda surface: np.tile(np.eye(2), (len(surface.area), 1, 1)))),
    Fault("shear without Christoffel's symbols", "fem", "resultants_paraboloid", lambda patch: patch.setattr(fem, "_divergence", lambda surface, found: without_christoffel(surface, found))),
    Fault("a moment's sign", "ndf-ritz", "resultants_plate", wrapped(ndf, "_tensors", lambda tensors: -tensors)),
    Fault("a local edge load turned inward", "ndf-ritz", "pulled_ring", turned_inward),
    Fault("a mean weighed by the parameter", "fem", "pulled_ring", weighed_by_parameter),
    Fault("shear by one slope", "ndf-ritz", "resultants_plate", one_slope_alone),
)  # fmt: skip
test_a_fault_is_red, test_without_a_fault_it_is_green = gate_tests(FAULTS)
