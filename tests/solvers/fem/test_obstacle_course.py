"""The suite's own cases at default settings: errors, uncertainties and rates.

The known values are read here, and only here: the solver never sees them.
"""

from functools import cache

import numpy as np
import pytest

from derivations.levy_roof import scordelis_lo
from shellbench.bench.catalogue import catalog
from shellbench.problems.shell.case import build_case
from shellbench.solvers.fem.solver import FemSettings, FemSolver

CASES = ["square_plate", "scordelis_lo", "sleeve_torque", "pinched_cylinder_diaphragm", "pinched_cylinder_free"]
LONG = [pytest.param(n, marks=pytest.mark.long) if n.startswith("pinched") else n for n in CASES]


@cache
def solved(name):
    return FemSolver().solve(catalog.named_case(name), FemSettings())


def known(name, quantity):
    return catalog.known_values(name).judge(quantity, catalog.named_case(name).theory)


def slope(errors, resolutions):
    return -np.polyfit(np.log(resolutions), np.log(np.abs(errors)), 1)[0]


@pytest.mark.parametrize("name", LONG)
def test_default_settings_reach_the_gates_and_know_it(name):
    solution = solved(name)
    assert solution.diagnostics["converged"]
    assert solution.diagnostics["residual"] < 1e-5
    for quantity in solution.case.quantities:
        allowed = catalog.tolerance(name, quantity.name, "fem")
        if allowed is None or allowed.open_finding:
            continue
        found, true = solution.history[-1].quantities[quantity.name], known(name, quantity.name)
        assert abs(found / true.value - 1) <= allowed.relative
        # Its own estimate covers the error; of an energy it may be half of it (the roof's bending energy: 1.09).
        sure = solution.uncertainty[quantity.name] * (2 if quantity.unit == "J" else 1)
        assert abs(found - true.value) <= sure + true.uncertainty


@pytest.mark.long
@pytest.mark.parametrize("name", ["pinched_cylinder_diaphragm", "pinched_cylinder_free"])
def test_graded_cylinders_converge_with_order_three_and_a_half_at_least(name):
    history = solved(name).history
    true = known(name, "load_deflection").value
    errors = [step.quantities["load_deflection"] - true for step in history]
    assert np.all(np.array(errors) < 0)  # the deflection under a load is its work: from below (Ritz)
    assert slope(errors, [np.sqrt(step.unknowns) for step in history]) >= 3.5


@pytest.mark.parametrize(("degree", "cells"), [(3, (4, 8, 16)), (4, (3, 6, 12)), (5, (2, 4, 8))])
@pytest.mark.parametrize("name", ["square_plate", "scordelis_lo"])
def test_rates_of_the_smooth_cases(name, degree, cells):
    case = catalog.named_case(name)
    true = known(name, case.primary.name).value
    settings = [FemSettings(cells=(n, n), degree=degree) for n in cells]
    values = [FemSolver().solve(case, chosen).history[0].quantities for chosen in settings]
    if degree == 3:
        assert slope([v[case.primary.name] - true for v in values], cells) >= 3.9
    # the energy, which bounds all else, converges with twice the degree less two, or with what corners leave of it:
    # on a hinged plate w has a part r^4 log r, of rate six
    energies = [v["strain_energy"] for v in values]
    rate = np.log2((energies[1] - energies[0]) / (energies[2] - energies[1]))
    assert rate >= min(2 * degree - 2, 6) - (0.1 if degree == 3 else 0.5)


@pytest.mark.parametrize("thickness", [0.025, pytest.param(0.125, marks=pytest.mark.long), 0.5])
def test_the_roof_at_other_thicknesses(thickness):
    data = catalog.named_case("scordelis_lo").model_dump(mode="json", exclude_unset=True, exclude={"name"})
    case = build_case(data | {"material": data["material"] | {"thickness": thickness}}, "roof", "test")
    true = scordelis_lo(thickness)["edge_deflection"]
    found = FemSolver().solve(case, FemSettings()).history[-1].quantities["edge_deflection"]
    assert found == pytest.approx(true.value, rel=1e-6, abs=true.uncertainty)
