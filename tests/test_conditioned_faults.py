"""Mistakes in a conditioned field, each made on purpose: the known values at held-out materials find every one."""

import numpy as np
import pytest

from shellbench.problems.series.conditioned import Material, Ranges
from shellbench.solvers.ndf.conditioned import conditioned, reduced
from shellbench.solvers.ndf.conditioned.reduced import Reduced, stiffness_rates, stiffnesses
from tests.solvers.ndf.conditioned import missed, small_field


@pytest.fixture
def broken(monkeypatch):
    def set_(where, name, value):
        for place in where if isinstance(where, tuple) else (where,):
            if hasattr(place, name):
                monkeypatch.setattr(place, name, value)

    return set_


def everywhere(broken, name, value):
    broken((reduced, conditioned), name, value)


def ignored_material(broken):
    """Every material is answered as the middle one."""
    usual = Reduced.coefficients
    broken(Reduced, "coefficients", lambda self, material: usual(self, Material(0.9, 1e7, 0.2)))


def swapped_range(broken):
    """The share of the thickness draws the modulus, and that of the modulus the thickness."""
    usual = Ranges.material
    broken(Ranges, "material", lambda self, shares: usual(self, (shares[1], shares[0], shares[2])))


def bending_by_the_square(broken):
    """B = E h^2 / 12 (1 - nu^2)."""

    def wrong(material):
        return stiffnesses(material) / np.array([1, 1, material.thickness, material.thickness])

    everywhere(broken, "stiffnesses", wrong)


def derivative_by_two(broken):
    """The derivative of h^3 has the factor 2."""

    def wrong(material, by):
        factors = np.array([1, 1, 2 / 3, 2 / 3]) if by == "thickness" else 1.0
        return stiffness_rates(material, by) * factors

    everywhere(broken, "stiffness_rates", wrong)


def plain_derivative(broken):
    """The derivative of the displacement, not of its logarithm."""
    usual = Reduced.sensitivity
    broken(Reduced, "sensitivity", lambda self, m, by: usual(self, m, by) * self.value(m))


def ratio_left_out(broken):
    """E h instead of E h / (1 - nu^2)."""
    everywhere(broken, "stiffnesses", lambda material: stiffnesses(material) * (1 - material.poissons_ratio**2))


@pytest.mark.parametrize(
    ("fault", "found"),
    [
        (ignored_material, "value_00"),
        (swapped_range, "value_00"),
        (bending_by_the_square, "value_00"),
        (derivative_by_two, "by_thickness_00"),
        (plain_derivative, "by_thickness_00"),
        (ratio_left_out, "value_02"),
    ],
)
def test_a_fault_is_found(broken, fault, found):
    field = small_field()
    fault(broken)
    assert found in missed(field)
    assert fault.__doc__


@pytest.mark.long
def test_a_roof_solved_for_at_the_wrong_materials_is_found(broken):
    """Fields of a tenth of the range's thicknesses do not span those of the rest."""
    usual = conditioned.candidates

    def narrow(case):
        _, places = usual(case)
        places = places * np.array([0.1, 1.0])
        return [case.ranges.material((float(h), 0.5, float(nu))) for h, nu in places], places

    assert not missed(small_field("conditioned_roof", neurons=240, snapshots=20))
    broken(conditioned, "candidates", narrow)
    assert missed(small_field("conditioned_roof", neurons=240, snapshots=21))
