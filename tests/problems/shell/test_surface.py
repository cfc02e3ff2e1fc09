"""Midsurfaces: derivatives, periodicity and the refusal of degenerate ones."""

import re

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from shellbench.problems.formula_text import substituted
from shellbench.problems.shell.posed.surfaces import SurfaceModel
from shellbench.problems.shell.question.surface import ExpressionSurface

ADAPTER = TypeAdapter(SurfaceModel)

SURFACES = {
    "plane": {"kind": "plane", "xi1": [0, 2], "xi2": [-1, 1]},
    "open cylinder": {"kind": "cylinder", "axis": "z", "radius": 25, "xi1": [50, 130], "xi2": [0, 50]},
    "closed cylinder": {"kind": "cylinder", "axis": "y", "radius": 3, "closed": True, "xi1": [0, 360], "xi2": [0, 5]},
    "x cylinder": {"kind": "cylinder", "axis": "x", "radius": 3, "xi1": [-10, 40], "xi2": [0, 5]},
    "hypar": {"kind": "expression", "x": "xi1", "y": "xi2", "z": "c*xi1*xi2", "constants": {"c": 0.3}, "xi1": [-1, 1], "xi2": [-1, 1]},
    "helicoid": {"kind": "expression", "x": "xi2*cos(xi1)", "y": "xi2*sin(xi1)", "z": "0.4*xi1", "xi1": [0, 90], "xi2": [1, 2], "angles": ["xi1"]},
    "torus": {"kind": "expression", "x": "(R + r*cos(xi2))*cos(xi1)", "y": "(R + r*cos(xi2))*sin(xi1)", "z": "r*sin(xi2)",
              "constants": {"R": 3, "r": 1}, "xi1": [0, 360], "xi2": [0, 360], "angles": ["xi1", "xi2"], "periodic": ["xi1", "xi2"]},
}  # fmt: skip


def build(**data):
    return ADAPTER.validate_python(data)


@pytest.mark.parametrize("name", SURFACES)
def test_derivatives_match_differences(name):
    surface = build(**SURFACES[name])
    domain = surface.domain
    inner = np.random.default_rng(0).uniform(0.1, 0.9, (20, 2))
    xi = np.asarray(domain.lower) + inner * np.asarray(domain.size)
    x = surface.derivatives(xi, order=3)
    steps = [np.array([s, 0.0]) for s in (1e-3,)] + [np.array([0.0, 1e-3])]
    for i, j in x:
        for axis, step in enumerate(steps):
            higher = (i + 1, j) if axis == 0 else (i, j + 1)
            if higher in x:
                values = [surface.derivatives(xi + k * step, order=3)[i, j] for k in (-2, -1, 1, 2)]
                difference = (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * 1e-3)
                assert np.allclose(x[higher], difference, rtol=1e-8, atol=1e-8 * np.abs(x[0, 0]).max())


@pytest.mark.parametrize("name", ["closed cylinder", "torus"])
def test_periodic_surfaces_close_and_wrap(name):
    surface = build(**SURFACES[name])
    domain = surface.domain
    xi = np.array([[0.3, 0.4], [5.0, 2.0]])
    turned = xi + np.array([domain.size[0], 0.0])
    assert np.allclose(surface.position(xi), surface.position(turned))
    assert np.allclose(domain.wrap(turned), xi)


def test_cylinders_lie_on_their_axis():
    for axis, kept in (("x", [1, 2]), ("y", [0, 2]), ("z", [0, 1])):
        surface = build(kind="cylinder", axis=axis, radius=2.0, xi1=[0, 90], xi2=[0, 1])
        x = surface.position(surface.domain.grid(7, 3))
        assert np.allclose(np.linalg.norm(x[..., kept], axis=-1), 2.0)


def test_degrees_become_radians():
    domain = build(**SURFACES["open cylinder"]).domain
    assert domain.lower == pytest.approx((np.radians(50), 0))
    assert domain.internal((90, 25)) == pytest.approx((np.pi / 2, 25))


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"z": "1/xi1"}, "finite"),
        ({"y": "2*xi1"}, "degenerate"),
        ({"x": "xi1**3"}, "degenerate"),
        ({"periodic": ["xi1"]}, "close"),
        ({"xi1": [1, -1]}, "smaller"),
        ({"xi1": [float("inf"), 2]}, "finite"),
        ({"x": "q*xi1"}, "unknown name"),
        ({"kind": "sphere"}, "sphere"),
    ],
)
def test_a_degenerate_surface_is_refused(change, word):
    with pytest.raises(ValidationError, match=word):
        build(**{**SURFACES["hypar"], **change})


def test_a_closed_cylinder_spans_a_turn():
    with pytest.raises(ValidationError, match="close"):
        build(kind="cylinder", axis="y", radius=1, closed=True, xi1=[0, 180], xi2=[0, 1])


POLES = {
    # at the end of a coordinate, where cos(90 degrees) is not quite zero, and where sin(0) is
    "north": ({"x": "cos(xi1)*cos(xi2)", "y": "sin(xi1)*cos(xi2)", "z": "sin(xi2)", "xi2": [0, 90]}, 90),
    "south": ({"x": "cos(xi1)*sin(xi2)", "y": "sin(xi1)*sin(xi2)", "z": "cos(xi2)", "xi2": [0, 60]}, 0),
    "disc": ({"x": "xi2*cos(xi1)", "y": "xi2*sin(xi1)", "z": "0", "xi2": [0, 90]}, 0),
    # within it, at no point of any grid
    "cone": ({"x": "(xi2 - 0.3)*cos(xi1)", "y": "(xi2 - 0.3)*sin(xi1)", "z": "xi2", "xi2": [-60, 60]}, 17.188734),
    "double": ({"x": "sin(2.1*xi2)*cos(xi1)", "y": "sin(2.1*xi2)*sin(xi1)", "z": "xi2", "xi2": [50, 130]}, 85.714286),
}  # fmt: skip


@pytest.mark.parametrize("name", POLES)
@pytest.mark.parametrize("exchanged", [False, True])
def test_poles_are_refused_wherever_they_are(name, exchanged):
    data, at = POLES[name]
    data = {"kind": "expression", "xi1": [10, 200], "angles": ["xi1", "xi2"], **data}
    if exchanged:
        names = {"xi1": "xi2", "xi2": "xi1"}
        data |= {c: substituted(data[c], names) for c in "xyz"} | {"xi1": data["xi2"], "xi2": data["xi1"]}
    with pytest.raises(ValidationError, match="degenerate") as caught:
        ExpressionSurface.model_validate(data)
    found = re.search(r"= \(([^,]+), ([^)]+)\)", str(caught.value))
    assert found is not None
    assert float(found[1 if exchanged else 2]) == pytest.approx(at, abs=1e-3)


@pytest.mark.parametrize("hole", [1.0, 0.01, 1e-5])
def test_a_hole_of_any_size_is_no_pole(hole):
    data = {"x": "xi2*cos(xi1)", "y": "xi2*sin(xi1)", "z": "0", "xi1": [0, 90], "xi2": [hole, 2], "angles": ["xi1"]}
    assert ExpressionSurface.model_validate({"kind": "expression", **data}).domain.lower[1] == hole
