"""Surfaces with kinks are found and refused with the place."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shellbench.errors import InputError
from shellbench.problems.shell.surface import ExpressionSurface
from shellbench.solvers.fem.kinks import find_kink
from shellbench.solvers.fem.solver import FemSolver
from tests.solvers.fem.shells import shell


def surface(z: str, **more: object) -> ExpressionSurface:
    data = {"kind": "expression", "x": "xi1", "y": "xi2", "z": z, "xi1": (0, 1), "xi2": (0, 1)}
    return ExpressionSurface.model_validate({**data, **more})


@settings(deadline=None, max_examples=15)
@given(place=st.floats(0.04, 0.96), slope=st.floats(1e-4, 3.0), along=st.sampled_from(["xi1", "xi2"]))
def test_a_fold_is_found_where_it_is(place, slope, along):
    place = place + 1e-5 * 2**0.5  # on no point at which surfaces are checked
    kink = find_kink(surface(f"{slope!r}*sqrt(({along} - {place!r})**2)"))
    assert kink is not None
    assert kink.xi[("xi1", "xi2").index(along)] == pytest.approx(place, abs=1e-8)
    assert kink.degrees > 0


def test_its_angle_is_that_between_the_tangents():
    kink = find_kink(surface("sqrt((xi1 - 0.3)**2)"))
    assert kink is not None
    assert kink.degrees == pytest.approx(90.0, abs=1e-4)


def test_an_oblique_fold_is_found_on_it():
    kink = find_kink(surface("sqrt((xi1 + 0.7*xi2 - 0.61)**2)"))
    assert kink is not None
    assert kink.xi[0] + 0.7 * kink.xi[1] == pytest.approx(0.61, abs=1e-8)


@pytest.mark.parametrize(
    "z",
    [
        "xi1**2*xi2",
        "sin(40*xi1)",
        "tanh(200*(xi1 - 0.3))",
        "sqrt((xi1 - 0.3)**2 + 1e-10)",  # turns within 1e-5
        "sqrt((xi1 - 0.3)**2)*(xi1 - 0.3)",  # C1: the curvature jumps, the tangent does not
    ],
)
def test_what_is_sharp_and_has_a_tangent_everywhere_is_none(z):
    assert find_kink(surface(z)) is None


def test_fem_refuses_it_with_the_place():
    data = {"kind": "expression", "x": "xi1", "y": "xi2", "z": "sqrt((xi1 - 0.3)**2)", "xi1": [0, 1], "xi2": [0, 1]}
    case = shell(data, supports=[{"name": "wall", "on": ["xi1_min"], "clamped": True}],
                 loads=[{"kind": "area", "vector": [0, 0, 1]}])  # fmt: skip
    with pytest.raises(InputError, match=r"kink at \(xi1, xi2\) = \(0\.3, .*turns by 90 degrees") as refusal:
        FemSolver().solve(case)
    assert "\n" not in str(refusal.value)
