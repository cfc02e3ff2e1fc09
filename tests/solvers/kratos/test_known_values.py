"""What references/ has from Kratos is what `kratos-iga` computes with the settings that stand there."""

import pytest

pytest.importorskip("KratosMultiphysics", reason="needs the extra kratos")

from shellbench.bench import catalog
from shellbench.problems.shell.measure import measure_all
from shellbench.solvers.kratos.iga_solver import KratosIgaSolver

GRADED = {"degree": 4, "grading": 2.0, "rounding": 1e-11}
SETTINGS = {
    "square_plate": {"degree": 5, "cells": (8, 8)},
    "scordelis_lo": {"degree": 5, "cells": (16, 16)},
    "square_plate_nonlinear": {"degree": 5, "cells": (8, 8), "load_steps": 4},
    "scordelis_lo_nonlinear": {"degree": 5, "cells": (12, 12), "load_steps": 4},
    "cantilever_shear": {"degree": 5, "cells": (32, 1), "load_steps": 4},
}
QUICK = {"square_plate"}
SPANS = (24, 32, 48)


def from_kratos(name):
    """The values of a case that this solver has made."""
    known = catalog.known_values(name).values
    return [value for value in known if value.source == "kratos" and "kratos-iga" in value.locator]


def solved(name, settings):
    return measure_all(KratosIgaSolver().solve(catalog.named_case(name), settings))


def test_each_case_has_some():
    assert all(map(from_kratos, (*SETTINGS, "pinched_cylinder_diaphragm", "pinched_cylinder_free")))


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in QUICK else [pytest.mark.long]) for name in SETTINGS]
)
def test_values_are_what_their_settings_give(name):
    found = solved(name, SETTINGS[name])
    for value in from_kratos(name):
        assert abs(found[value.quantity] - value.value) <= 0.2 * value.uncertainty  # they are rounded


@pytest.mark.long
@pytest.mark.parametrize("name", ["pinched_cylinder_diaphragm", "pinched_cylinder_free"])
def test_values_under_point_loads_are_extrapolated_with_the_order_that_shows(name):
    """The order p solves (w2 - w1) / (w3 - w2) = (n1^-p - n2^-p) / (n2^-p - n3^-p)."""
    found = [solved(name, GRADED | {"cells": (n, n)})["load_deflection"] for n in SPANS]
    shrinking = (found[1] - found[0]) / (found[2] - found[1])

    def excess(order):
        n = [spans**-order for spans in SPANS]
        return (n[0] - n[1]) / (n[1] - n[2]) - shrinking

    low, high = 1.0, 10.0
    assert excess(low) < 0 < excess(high)
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if excess(middle) < 0 else (low, middle)
    limit = found[2] + (found[2] - found[1]) / ((SPANS[2] / SPANS[1]) ** low - 1)
    (value,) = from_kratos(name)
    assert f"with the order {low:.1f}" in value.origin
    assert abs(limit - value.value) <= 0.2 * value.uncertainty
