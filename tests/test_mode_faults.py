"""The gate of modes and buckling: mistakes of either mechanics must turn it red, and the same path without one is green."""

from dataclasses import replace

import numpy as np

from shellbench.problems.shell.question.conditions import Material
from shellbench.solvers.fem.linear import modes as fem
from shellbench.solvers.ndf.path import equilibrium
from shellbench.solvers.ndf.strains import sampled
from tests.test_faults import Fault, gate_tests, wrapped


def wrong_bending(patch):
    patch.setattr(Material, "bending_stiffness", property(lambda self: self.youngs_modulus * self.thickness**3 / 12))


def counted_from_zero(patch):
    original = fem._Modes.eigenpairs

    def shifted(self, count):
        values, rounded, shapes = original(self, count + 1)
        return values[1:], rounded[1:], shapes[..., 1:]

    patch.setattr(fem._Modes, "eigenpairs", shifted)


def rigid_counted(patch):
    patch.setattr(
        fem, "free_motions", lambda case: np.zeros((6, 0)) if case.name == "plate_modes" else np.eye(6)[:, :5]
    )


def scaled(factor):
    return lambda matrix: replace(matrix, blocks=factor * matrix.blocks)


def twice_the_load(patch):
    original = fem.solve

    def loaded(case, *given):
        loads = tuple(load.model_copy(update={"vector": tuple(2 * v for v in load.vector)}) for load in case.loads)
        return original(case.model_copy(update={"loads": loads}), *given)

    patch.setattr(fem, "solve", loaded)


def unloaded_shear(patch):
    patch.setattr(
        equilibrium,
        "stresses",
        lambda c, e: (c @ e.view(-1, 2, 3, 1)).reshape(-1, 6) * e.new_tensor([1, 1, 0.5, 1, 1, 1]),
    )


FAULTS = (
    Fault("mass without thickness", "fem", "plate_modes", wrapped(fem, "product_matrix", scaled(100.0))),
    Fault("half of the density", "fem", "plate_modes", wrapped(fem, "product_matrix", scaled(0.5))),
    Fault("geometric stiffness of the wrong sign", "fem", "plate_compression", wrapped(fem, "geometric_stiffness", scaled(-1.0))),
    Fault("numbers from zero", "fem", "plate_modes", counted_from_zero),
    Fault("a rigid motion counted", "fem", "free_plate_modes", rigid_counted),
    Fault("stresses of another load", "fem", "plate_compression", twice_the_load),
    Fault("bending without 1 - nu^2", "fem", "plate_modes", wrong_bending),
    Fault("tension left out", "fem", "stretched_plate_modes", wrapped(fem, "geometric_stiffness", scaled(0.0))),
    Fault("tension taken for pressure", "fem", "stretched_plate_modes", wrapped(fem, "geometric_stiffness", scaled(-0.2))),
    Fault("mass without density", "ndf", "plate_modes", wrapped(sampled.Sampled, "products", lambda m, *_: 80.0 * m)),
    Fault("mass without density", "ndf-ritz", "plate_modes", wrapped(sampled.Sampled, "products", lambda m, *_: 80.0 * m)),
    Fault("shear stress by half", "ndf-ritz", "plate_shear", unloaded_shear),
)  # fmt: skip
test_a_fault_is_red, test_without_a_fault_it_is_green = gate_tests(FAULTS)
