"""Rayleigh's damping: the decay of a mode, its order in time, one meaning in both mechanics, and who declines it."""

import itertools
import math

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.registry import load_solver, loads_here, solver_entries
from shellbench.errors import InputError
from shellbench.problems.shell.case import build_case
from shellbench.solvers.fem.solver import FemSettings, FemSolver
from shellbench.solvers.ndf.linear.ritz_settings import RitzSettings
from shellbench.solvers.ndf.ritz_solver import RitzSolver

TAKERS = {"fem", "ndf", "ndf-ritz"}
SQUARE = math.pi**4 * 0.1  # of the strip's lowest frequency
TIP = {"name": "tip", "kind": "displacement", "points": ["xi1_max,xi2_max"], "direction": [0, 0, -1], "primary": True}


def moving(alpha, beta, until=0.5, **fields):
    """A strip, B = 0.1 N m, and 1 kg/m^2."""
    data = {
        "title": "Strip",
        "theory": "kirchhoff-love-nonlinear",
        "surface": {"kind": "plane", "xi1": [0, 1], "xi2": [0, 0.1]},
        "material": {"youngs_modulus": 1.5e5, "poissons_ratio": 0.0, "thickness": 0.02, "areal_density": 1.0},
        "supports": [{"name": "ends", "on": ["xi1_min", "xi1_max"]}],
        "loads": [{"kind": "area", "vector": [0, 0, "-1e-6*sin(pi*xi1)"]}],
        "dynamics": {"until": until, "mass_damping": alpha, "stiffness_damping": beta},
        "quantities": [TIP | {"at": until}],
    }
    return build_case(data | fields, "moving", "moving")


@pytest.mark.parametrize(("alpha", "beta"), [(2.0, 0.0), (0.0, 0.1), (0.0, 1.5)], ids=["mass", "stiffness", "creeping"])
def test_a_mode_decays_by_alpha_and_beta_with_errors_of_second_order(alpha, beta):
    """u'' + (alpha + beta w^2) u' + w^2 u = f, beyond the critical damping too; the energy taken is in balance."""
    half, errors = (alpha + beta * SQUARE) / 2, []
    v = np.sqrt(SQUARE - half**2 + 0j)
    expected = 1e-6 / SQUARE * (1 - np.exp(-half / 2) * (np.cos(v / 2) + half / v * np.sin(v / 2))).real
    for steps in (20, 40):
        answer = FemSolver().solve(moving(alpha, beta), FemSettings(cells=(4, 1), time_step=0.5 / steps))
        found = -answer.displacement(np.array([[0.5, 0.05]]), 0.5)[0, 2]
        errors.append([abs(found / expected - 1), answer.diagnostics["energy_drift"] * SQUARE / 1e-12])
    np.testing.assert_array_less(errors[1], 1e-3)
    np.testing.assert_array_less(3, np.divide(*errors))


STRETCHED = {
    "surface": {"kind": "plane", "xi1": [0, 1], "xi2": [0, 0.5]},
    "material": {"youngs_modulus": 1e4, "poissons_ratio": 0.0, "thickness": 0.01, "areal_density": 1.0},
    "loads": [{"kind": "area", "vector": [0, 0, "-6*sin(pi*xi1)"]}],
}


def swung(solver, settings, beta):
    """Displacements of a soft strip that is blown up to a tenth of strain."""
    return solver.solve(moving(0.0, beta, 0.3, **STRETCHED), settings).displacement(
        np.array([[0.25, 0.5], [0.5, 0.1]]), 0.3
    )


def test_large_displacements_are_damped_with_errors_of_second_order():
    found = [swung(FemSolver(), FemSettings(cells=(4, 1), time_step=0.3 / steps), 0.02) for steps in (15, 30, 60)]
    coarse, fine = (np.abs(a - b).max() for a, b in itertools.pairwise(found))
    assert fine < 1e-3
    assert coarse / fine > 3


@pytest.mark.long
def test_both_mechanics_damp_large_displacements_alike():
    solvers = (
        (FemSolver(), FemSettings(cells=(6, 2), time_step=2e-3)),
        (RitzSolver(), RitzSettings(hidden="placed", degrees=(6,))),
    )
    changes = [swung(*solver, 0.005) - swung(*solver, 0.0) for solver in solvers]
    assert np.abs(changes[0]).max() > 1e-3
    np.testing.assert_allclose(changes[1], changes[0], rtol=0, atol=1e-5)


def test_solvers_that_know_no_damping_decline_it():
    """Each solver that takes a motion without damping takes it damped, or says that it does not."""
    free = catalog.named_case("free_fall")
    damped = free.model_copy(update={"dynamics": free.dynamics.model_copy(update={"mass_damping": 1.0})})
    solvers = [load_solver(entry) for entry in solver_entries().values() if loads_here(entry)]
    moved = [one for one in solvers if free.theory in one.capabilities.theories and one.declines(free) is None]
    assert {one.name for one in moved if one.declines(damped) is None} == TAKERS
    assert all("damped" in (one.declines(damped) or "damped") for one in moved)


def test_energy_that_damping_takes_is_no_error():
    total = {"name": "total", "kind": "total_energy", "at": 0.5}
    with pytest.raises(InputError, match="no damping"):
        moving(1.0, 0.0, quantities=[TIP | {"at": 0.5}, total])
