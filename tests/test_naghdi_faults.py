"""Mistakes in the theory of `pinn-naghdi` and `p-naghdi`, each made on purpose: the known values find every one.

Training is left out: the solver's own strains, stiffness, loads and supports are minimised over polynomials, which
takes milliseconds and leaves the error of the theory alone.
"""

import numpy as np
import pytest
import torch
from numpy.polynomial.legendre import legval

from shellbench.bench.catalogue import catalog
from shellbench.solvers.naghdi import equilibrium, network, solution, strains
from shellbench.solvers.naghdi.network import Fields
from shellbench.solvers.naghdi.p_solver import GridSettings, PNaghdiSolver
from shellbench.solvers.naghdi.solution import NaghdiSolution, Rule, gauss_points
from shellbench.solvers.naghdi.strains import Frame
from tests.injecting import exceeded, shares_of_tolerances

PLATE, ROOF = "thick_plate_naghdi", "scordelis_lo_naghdi"
DEGREES = {PLATE: (8, 8), ROOF: (12, 8)}
SIDE = 14


class Polynomials:
    """Stands where a network does: weights are coefficients of Legendre polynomials of both inputs."""

    def __init__(self, degrees):
        self.degrees = degrees
        self.parameters = 5 * (degrees[0] + 1) * (degrees[1] + 1)

    def functions(self, inputs, rates):
        inputs, rates = inputs / network.REACH, np.array(rates) / network.REACH
        first, second = (
            [legval(inputs[:, axis], np.polynomial.legendre.legder(np.eye(degree + 1), m, axis=0)) if m else
             legval(inputs[:, axis], np.eye(degree + 1)) for m in (0, 1)]
            for axis, degree in enumerate(self.degrees)
        )  # fmt: skip
        pairs = [(first[0], second[0]), (first[1] * rates[0], second[0]), (first[0], second[1] * rates[1])]
        return np.stack([np.einsum("in,jn->nij", f, s).reshape(len(inputs), -1) for f, s in pairs], axis=1)

    def outputs(self, weights, inputs, rates):
        table = torch.as_tensor(self.functions(inputs.numpy(), rates))
        return torch.einsum("ndf,fk->ndk", table, weights.reshape(-1, 5))


def minimised(name):
    """The minimiser of the solver's own energy over polynomials."""
    case, shape = catalog.named_case(name), Polynomials(DEGREES[name])
    xi, at = gauss_points(case, SIDE)
    fields, rule = Fields.at(case, shape, xi), Rule.at(case, xi, at)
    table = shape.functions(fields.inputs.numpy(), fields.rates)
    factors, size = fields.factors.numpy(), table.shape[-1]
    z = np.zeros((len(xi), 3, 5, size, 5))
    for k in range(5):
        f = factors[:, :, k, None]
        z[:, 0, k, :, k] = f[:, 0] * table[:, 0]
        z[:, 1:, k, :, k] = f[:, :1] * table[:, 1:] + f[:, 1:] * table[:, :1]
    z = z.reshape(len(xi), 15, size * 5)
    strained = np.einsum("nrz,nzw->nrw", rule.whole.numpy(), z).reshape(-1, size * 5)
    right = np.einsum("nz,nzw->w", rule.forces.numpy(), z)
    length = np.linalg.norm(strained, axis=0)
    scale = 1 / np.where(length > 1e-12 * length.max(), length, length.max())  # a translation strains nothing
    matrix = (strained * scale).T @ (strained * scale)
    weights = scale * np.linalg.lstsq(matrix, scale * right, rcond=1e-13)[0]
    return NaghdiSolution(
        case, shape, weights, solution.Check.of(case, shape).mean_translation(torch.as_tensor(weights))
    )


def reds(name):
    """Quantities outside their tolerance."""
    return {q for q, share in shares_of_tolerances(minimised(name), "pinn-naghdi").items() if not share <= 1}


def without_shear_factor(patch):
    """k = 1 instead of 5/6."""
    patch.setattr(strains, "SHEAR_FACTOR", 1.0)


def bending_by_the_square(patch):
    """B with h^2."""
    usual = Frame.stiffness
    patch.setattr(
        Frame,
        "stiffness",
        lambda self, case: tuple(
            part / (case.material.thickness if k == 1 else 1) for k, part in enumerate(usual(self, case))
        ),
    )


def _operator(patch, change):
    usual = Frame.operator

    def wrong(self):
        operator = usual(self)
        change(self, operator)
        return operator

    patch.setattr(Frame, "operator", wrong)


def shear_of_the_wrong_sign(patch):
    """gamma_1 = a3 . u,1 - a_1 . d."""

    def change(frame, operator):
        operator[:, 6, 3:5] *= -1

    _operator(patch, change)


def normals_that_slide(patch):
    """gamma without a3's own turn: u,a replaced by the slope of u . a3."""

    def change(frame, operator):
        operator[:, 6:, :3] += frame.normal_slopes

    _operator(patch, change)


def soft_supports(patch):
    """A support leaves normals free."""
    usual = network.held_fields
    patch.setattr(network, "held_fields", lambda case: [*usual(case)[:3], set(), set()])


def shear_by_youngs_modulus(patch):
    """E h k instead of G h k."""
    usual = Frame.stiffness
    patch.setattr(
        Frame,
        "stiffness",
        lambda self, case: (*usual(self, case)[:2], usual(self, case)[2] * 2 * (1 + case.material.poissons_ratio)),
    )


def softened(patch):
    """Supports that the case calls hard leave normals free."""
    usual = equilibrium.held_fields
    patch.setattr(equilibrium, "held_fields", lambda case: [*usual(case)[:3], set(), set()])


def plate_of_elements(name):
    """Quantities of a plate outside the tolerance of `p-naghdi`."""
    return exceeded(name, PNaghdiSolver(), GridSettings(last_degree=9, smallest=0.25))


@pytest.mark.parametrize("fault", [without_shear_factor, shear_of_the_wrong_sign, softened])
def test_each_fault_of_elements_is_found(monkeypatch, fault):
    fault(monkeypatch)
    assert plate_of_elements(PLATE) == {"centre_deflection", "largest_displacement", "strain_energy"}


@pytest.mark.parametrize("name", [PLATE, f"{PLATE}@naghdi_soft"])
def test_elements_without_a_fault_pass(name):
    assert not plate_of_elements(name)


LONG = pytest.mark.long


@pytest.mark.parametrize("name", [PLATE, pytest.param(ROOF, marks=LONG)])
def test_the_theory_is_green(name):
    assert not reds(name)


@pytest.mark.parametrize(
    ("fault", "name"),
    [
        (without_shear_factor, PLATE),
        (shear_by_youngs_modulus, PLATE),
        pytest.param(bending_by_the_square, ROOF, marks=LONG),
        (shear_of_the_wrong_sign, PLATE),
        pytest.param(normals_that_slide, ROOF, marks=LONG),
        (soft_supports, PLATE),
    ],
)
def test_a_fault_is_found(monkeypatch, fault, name):
    fault(monkeypatch)
    assert fault.__doc__
    assert reds(name)
