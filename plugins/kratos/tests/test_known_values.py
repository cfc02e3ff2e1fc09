"""The values of Kratos in references/ are those that `kratos-iga` computes with the settings given there.

The solver does not use symmetry here, because these values are compared with those of solvers that do. A shell is
solved whole. Otherwise the part between planes of symmetry is a case of its own, written here by hand.
"""

import numpy as np
import pytest

pytest.importorskip("KratosMultiphysics", reason="needs Kratos: python -m pip install ./plugins/kratos")

from shellbench_kratos.iga_solver import KratosIgaSolver

from shellbench.bench.catalogue import catalog
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.quantities.measure import measure_all

GRADED = {"degree": 4, "grading": 2.0, "rounding": 1e-11}
FINEST = {"degree": 5}
PATH = {"degree": 5, "load_steps": 4}
CYLINDERS = ("pinched_cylinder_diaphragm", "pinched_cylinder_free")


def stated(name, measured=(), **changes):
    """A case of the suite with changes by hand, asked for displacements; `measured` are those of its primary one."""
    data = catalog.named_case(name).model_dump(mode="json", exclude_unset=True, exclude={"name"})
    kept = [quantity for quantity in data["quantities"] if quantity["kind"].endswith("displacement")]
    asked = [quantity | dict(measured) if quantity.get("primary") else quantity for quantity in kept]
    return build_case(data | {"quantities": asked} | changes, name, name)


def held(name, *edges, **fields):
    return {"name": name, "on": list(edges)} | fields


def planes(**normals):
    return [held(f"plane_{edge}", edge, symmetry=normal) for edge, normal in normals.items()]


def whole_roof(name):
    """The whole roof; nothing loads it along its axis, and a corner holds it there: for what no such shift changes."""
    ends = held("diaphragms", "xi2_min", "xi2_max", components=["x", "y"])
    return stated(name, supports=[ends, held("pin", "xi1_min,xi2_min", components=["z"])], remove_rigid_motions=[])


def quarter_roof(name):
    return stated(
        name,
        surface={"kind": "cylinder", "axis": "z", "radius": 25, "xi1": [50, 90], "xi2": [0, 25]},
        supports=[held("diaphragm", "xi2_min", components=["x", "y"]), *planes(xi1_max="x", xi2_max="z")],
        remove_rigid_motions=[],
        points={"right_edge": [50, 25]},
        measured={"points": ["right_edge"]},
    )


def quarter_plate(name):
    surface = {"kind": "plane", "xi1": [0, 50], "xi2": [0, 50]}
    return stated(
        name, surface=surface, supports=[held("rim", "xi1_min", "xi2_min"), *planes(xi1_max="x", xi2_max="y")]
    )


def eighth_cylinder(name):
    """An eighth with a quarter of one of the two loads; a closed patch is beyond the solver."""
    diaphragm = [held("diaphragm", "xi2_min", components=["x", "z"])] if name == CYLINDERS[0] else []
    return stated(
        name,
        surface={"kind": "cylinder", "axis": "y", "radius": 300, "xi1": [0, 90], "xi2": [0, 300]},
        supports=[*diaphragm, *planes(xi1_min="z", xi1_max="x", xi2_max="y")],
        remove_rigid_motions=[],
        points={"top": [90, 300]},
        loads=[{"kind": "point", "on": ["top"], "force": [0, 0, -0.25]}],
        measured={"points": ["top"], "direction": [0, 0, -1]},
    )


SETTINGS = {
    "square_plate": (stated, FINEST | {"cells": (32, 32)}),
    "scordelis_lo": (whole_roof, FINEST | {"cells": (32, 32)}),
    "scordelis_lo_nonlinear": (quarter_roof, PATH | {"cells": (12, 12)}),
    "cantilever_shear": (stated, PATH | {"cells": (32, 1)}),
}
EXTRAPOLATED = {  # how the shell is stated, and spans a side
    "square_plate_nonlinear": (stated, PATH, (8, 12, 16)),
} | dict.fromkeys(CYLINDERS, (eighth_cylinder, GRADED, (24, 32, 48)))
PARTS = {
    "square_plate": (quarter_plate, FINEST | {"cells": (3, 4)}),
    "scordelis_lo": (quarter_roof, FINEST | {"cells": (4, 3)}),
    "square_plate_nonlinear": (quarter_plate, PATH | {"cells": (2, 3)}),
    "scordelis_lo_nonlinear": (quarter_roof, PATH | {"cells": (3, 2)}),
} | {name: (eighth_cylinder, GRADED | {"cells": (6, 8)}) for name in CYLINDERS}


def from_kratos(name):
    """The values of a case that this solver has made."""
    known = catalog.known_values(name).values
    return [value for value in known if value.source == "kratos" and "kratos-iga" in value.locator]


def solved(case, settings, symmetry=False):
    return measure_all(KratosIgaSolver().solve(case, settings | {"symmetry": symmetry}))


def test_each_case_has_some():
    assert all(map(from_kratos, (*SETTINGS, *EXTRAPOLATED)))


@pytest.mark.long
@pytest.mark.parametrize("name", SETTINGS)
def test_values_are_what_their_settings_give(name):
    shell, settings = SETTINGS[name]
    found = solved(shell(name), settings)
    for value in from_kratos(name):
        assert abs(found[value.quantity] - value.value) <= 0.2 * value.uncertainty  # they are rounded


@pytest.mark.long
def test_the_whole_plate_tends_to_its_value():
    """The error at its middle falls with the sixth power of the spans, one more than the splines' degree."""
    (value,) = from_kratos("square_plate")
    case = stated("square_plate")
    errors = [solved(case, FINEST | {"cells": (n, n)})[value.quantity] - value.value for n in (8, 12)]
    assert np.log(errors[0] / errors[1]) / np.log(12 / 8) == pytest.approx(6, abs=0.3)


@pytest.mark.long
@pytest.mark.parametrize("name", PARTS)
def test_parts_that_are_stated_by_hand_are_those_that_symmetry_leaves(name):
    """Both ways, on coarse patches: nothing is solved but the part, and the same is found."""
    part, settings = PARTS[name]
    by_hand, found = solved(part(name), settings), solved(catalog.named_case(name), settings, symmetry=True)
    for quantity, value in by_hand.items():
        assert value == pytest.approx(found[quantity], rel=1e-9)


def extrapolated(spans, found):
    """Order and limit: the order p solves (w2 - w1) / (w3 - w2) = (n1^-p - n2^-p) / (n2^-p - n3^-p)."""
    shrinking = (found[1] - found[0]) / (found[2] - found[1])

    def excess(order):
        n = [float(count) ** -order for count in spans]
        return (n[0] - n[1]) / (n[1] - n[2]) - shrinking

    low, high = 1.0, 10.0
    assert excess(low) < 0 < excess(high)
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if excess(middle) < 0 else (low, middle)
    return low, found[2] + (found[2] - found[1]) / ((spans[2] / spans[1]) ** low - 1)


@pytest.mark.long
@pytest.mark.parametrize("name", EXTRAPOLATED)
def test_values_are_extrapolated_with_the_order_that_shows(name):
    shell, settings, spans = EXTRAPOLATED[name]
    found = [solved(shell(name), settings | {"cells": (n, n)}) for n in spans]
    for value in from_kratos(name):
        order, limit = extrapolated(spans, [values[value.quantity] for values in found])
        assert f"with the order {order:.1f}" in value.origin
        assert abs(limit - value.value) <= 0.2 * value.uncertainty
