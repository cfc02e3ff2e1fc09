"""Surfaces whose position, tangent or curvature jumps are refused with the place, however that is written."""

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from shellbench.problems.shell.question.surface import ExpressionSurface


def surface(z: str) -> ExpressionSurface:
    data = {"kind": "expression", "x": "xi1", "y": "xi2", "z": z, "xi1": (0, 1), "xi2": (0, 1)}
    return ExpressionSurface.model_validate(data)


def refused(z: str) -> tuple[float, float, str]:
    """Return the place that a refusal names, and what jumps."""
    with pytest.raises(ValidationError) as error:
        surface(z)
    (only,) = error.value.errors()
    found = re.search(
        r"kink at \(xi1, xi2\) = \((.*), (.*)\), where its (.*): (?:a midsurface|if the shell) has", only["msg"]
    )
    assert found, only["msg"]
    return float(found[1]), float(found[2]), found[3]


@settings(deadline=None, max_examples=15)
@given(place=st.floats(0.04, 0.96), slope=st.floats(1e-4, 3.0), along=st.sampled_from([0, 1]))
def test_a_fold_is_found_where_it_is(place, slope, along):
    *at, what = refused(f"{slope!r}*sqrt((xi{along + 1} - {place!r})**2)")
    assert at[along] == pytest.approx(place, abs=1e-6)
    assert what.startswith("tangent turns by")


@pytest.mark.parametrize(
    "z", ["abs({x})", "sqrt({x}**2)", "max({x}, -({x}))", "({x}**2)**0.5", "where({x} < 0, -({x}), {x})"]
)
@pytest.mark.parametrize("x", ["xi1 - 0.5", "xi2 - 0.3", "xi1 + 0.7*xi2 - 0.61"])
def test_one_jump_has_one_sentence_however_it_is_written(z, x):
    *at, what = refused(z.format(x=f"({x})"))
    assert abs(eval(x, {"xi1": at[0], "xi2": at[1]})) < 1e-6
    assert what == "tangent turns by 90 degrees" if "+" not in x else what.startswith("tangent turns by")


@pytest.mark.parametrize(
    ("z", "what"),
    [
        ("(xi1 - 0.3)*abs(xi1 - 0.3)", "curvature jumps"),
        ("sqrt((xi1 - 0.3)**2)*(xi1 - 0.3)", "curvature jumps"),
        ("max(xi1 - 0.3, 0)**2", "curvature jumps"),
        ("where(xi1 < 0.3, 0, (xi1 - 0.3)**2)", "curvature jumps"),
        ("where(xi1 < 0.3, 0, 1)", "position jumps"),
    ],
)
def test_curvature_and_position_do_not_jump_either(z, what):
    assert refused(z)[2] == what


@pytest.mark.parametrize(
    "z",
    [
        "xi1**2*xi2",
        "sin(40*xi1)",
        "tanh(200*(xi1 - 0.3))",
        "sqrt((xi1 - 0.3)**2 + 1e-10)",  # turns within 1e-5
        "max(xi1, -5)",  # never changes over
        "abs(xi1 - 0.3)**3",  # its third derivative jumps
    ],
)
def test_what_is_sharp_and_has_a_curvature_everywhere_is_taken(z):
    assert surface(z)
