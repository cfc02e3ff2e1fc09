"""Features that turn across narrow soft lines."""

import numpy as np
import pytest

from shellbench.solvers.ndf.field.jets import Placement
from shellbench.solvers.ndf.field.lines import ENDS, HINGE_POLYNOMIALS, MIDDLE, Hinges, hinges_of
from tests.solvers.ndf.shells import differences, shell

WIDTH = 0.02


def notched(factor):
    return shell("plane", material={"thickness_factor": factor.format(bump=f"exp(-((xi1 - 0.7)/{WIDTH})**2)")})


@pytest.mark.parametrize("factor", ["1", "1 + 0.5*xi1", "1 + 0.9*{bump}", "1 - 0.1*{bump}"])
def test_shells_that_are_nowhere_soft_have_none(factor):
    assert hinges_of(notched(factor)) == ()


def test_a_line_of_one_compliance_has_one_hinge_and_others_challenge_it_from_its_ends():
    alike, uneven = (hinges_of(notched(f)) for f in ("1 - 0.8*{bump}", "1 - (0.6 + 0.2*xi2)*{bump}"))
    assert [(h.axis, h.across) for h in alike] == [(0, MIDDLE)]
    assert alike[0].at == pytest.approx(0.7, abs=WIDTH / 4)
    assert [h.across for h in uneven] == [MIDDLE, *ENDS]


def test_profiles_bend_as_the_compliance_does():
    case = notched("1 - 0.8*{bump}")
    hinge = hinges_of(case)[0]
    x = np.linspace(0.6, 0.8, 401)
    height = 1 - 0.8 * np.exp(-(((x - 0.7) / WIDTH) ** 2))
    for profile, order, power in ((hinge.profiles[0], 2, 3), (hinge.profiles[2], 1, 1)):
        found, right = profile.derivative(order)(x), 1 / height**power - 1
        share = found.max() / right.max()
        np.testing.assert_allclose(found, share * right, atol=1e-5 * found.max())


def test_jets_are_derivatives():
    case = notched("1 - 0.8*{bump}")
    hinges = Hinges(case, hinges_of(case))
    points = np.array([[0.3, 0.2], [0.69, -0.4], [0.705, 0.1], [1.4, 0.7]])

    def values(at):
        return np.stack([c[0].numpy() for c in hinges.columns(at, Placement())], axis=-1)

    jets = np.stack([c.numpy() for c in hinges.columns(points, Placement())], axis=-1)
    assert jets.shape == (6, 4, hinges.count)
    assert hinges.count % HINGE_POLYNOMIALS[0] == 0
    for found, right in zip(jets, differences(values, points, 2e-4), strict=True):
        np.testing.assert_allclose(found, right, atol=1e-3 * np.abs(right).max())
