"""The gate of orthotropic shells: mistakes of either mechanics must turn it red, and the same path without one is green."""

import numpy as np

from shellbench.problems.shell.question.orthotropic import OrthotropicMaterial
from shellbench.solvers.fem.mechanics import kinematics as fem
from shellbench.solvers.fem.mechanics import orthotropic as stiffening
from shellbench.solvers.ndf.field import geometry as ndf
from shellbench.solvers.ndf.strains import strain_measures
from tests.injecting import given, wrapped
from tests.test_faults import Fault, gate_tests


def read_as(change):
    """Inject into each mechanics a material whose fields are read wrongly."""

    def of_fem(*geometry_and_material):
        *geometry, material = geometry_and_material
        return *geometry, material.model_copy(update=change(material))

    def changed(geometry, material):
        wrong = isinstance(material, OrthotropicMaterial)
        return geometry, material.model_copy(update=change(material)) if wrong else material

    def of_ndf(patch):
        for module in (ndf, strain_measures):
            given(module, "elasticity_tensors", changed)(patch)

    return {"fem": given(fem, "orthotropic_elasticity", of_fem), "ndf-ritz": of_ndf}


def by_nu21(patch):
    """Take nu21 for nu12: Q12 = nu21 Q22."""
    original = OrthotropicMaterial.stiffnesses.fget

    def stiffnesses(self):
        found = [matrix.copy() for matrix in original(self)]
        for matrix in found:
            matrix[0, 1] = matrix[1, 0] = matrix[0, 1] * self.youngs_modulus[1] / self.youngs_modulus[0]
        return tuple(found)

    patch.setattr(OrthotropicMaterial, "stiffnesses", property(stiffnesses))


def read_curves(change):
    """Read the curves of a membrane that stiffens wrongly: `change` makes three of them from warp, weft and shear."""
    original = OrthotropicMaterial.curves.fget

    def curves(self):
        own = self.stiffening
        changed = change(own.warp, own.weft, own.shear)
        return tuple((new, *rest) for new, (_, *rest) in zip(changed, original(self), strict=True))

    return lambda patch: patch.setattr(OrthotropicMaterial, "curves", property(curves))


def each(change):
    return read_curves(lambda *own: [curve.model_copy(update=change(curve)) for curve in own])


def exchanged(rows):
    return np.asarray(rows)[np.ix_([1, 0, 2], [1, 0, 2])].tolist()


READ = {
    "warp and weft exchanged": ("woven_plate", lambda m: {"angle": m.angle + 90}),
    "the angle's sign": ("woven_swatch", lambda m: {"angle": -m.angle}),
    "shear modulus doubled": ("woven_swatch", lambda m: {"shear_modulus": 2 * m.shear_modulus}),
    "bending by the wrong direction": ("woven_plate_modes", lambda m: {"bending": exchanged(m.bending)}),
    "always from the line of xi1": ("woven_tube", lambda m: {"along": "xi1"}),
}
CURVES = {
    "curves of warp and weft exchanged": ("cotton_weft", read_curves(lambda warp, weft, shear: (weft, warp, shear))),
    "the signs of mu lost": ("canvas_bias", each(lambda curve: {"mu": tuple(map(abs, curve.mu))})),
    "the range ignored": ("silk_warp", each(lambda _: {"until": 10.0})),
}
SHEAR = 0.059  # the end of canvas's range in shear
FAULTS = (
    *(Fault(name, solver, case, inject) for name, (case, change) in READ.items() for solver, inject in read_as(change).items()),
    *(Fault(name, solver, case, inject) for name, (case, inject) in CURVES.items() for solver in ("fem", "ndf-ritz")),
    Fault("the curve of E12 for that of its square", "fem", "canvas_bias", given(stiffening, "eta_with_derivatives", lambda curve, x: (curve, np.sqrt(x) if curve.until == SHEAR else x))),
    Fault("nu21 for nu12", "fem", "woven_swatch", by_nu21),
    Fault("nu21 for nu12", "ndf-ritz", "woven_swatch", by_nu21),
    Fault("shear strain taken once", "ndf-ritz", "woven_plate", wrapped(ndf, "direction_products", lambda found: found * found.new_tensor([1, 1, 0.5])[:, None, None])),
)  # fmt: skip
test_a_fault_is_red, test_without_a_fault_it_is_green = gate_tests(FAULTS)
