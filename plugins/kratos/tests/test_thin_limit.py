"""The theory that flat thin elements converge to on a curved shell, found from a series of another origin.

The curvature kappa_11 = bbar_11 - b_11 around a cylinder has a part eps_11 / R: a ring that only grows changes its
curvature. Flat elements see the turning of the normal alone, and miss it; the twist has no such part missing. The
Levy series of the Scordelis-Lo roof, solved once more without it, gives the value that the elements must approach.
"""

import pytest

pytest.importorskip("KratosMultiphysics", reason="needs Kratos: python -m pip install ./plugins/kratos")

from pathlib import Path

from shellbench_kratos.thin_solver import KratosThinSolver

from derivations import cylinder, levy_roof
from shellbench.problems.shell.case import read_case

ROOF = read_case(Path(__file__).parents[3] / "cases" / "scordelis_lo.toml")
EPS_T, KAPPA_T = 1, 4  # rows of the strains of a harmonic


def series_value():
    solution = levy_roof.solve_roof(levy_roof.roof(), 59, 24)
    return solution.deflection(25.0, levy_roof.HALF_ANGLE)


def without_stretch_in_the_curvature(radius, alpha):
    strains = cylinder.strains_of_axial_harmonic(radius, alpha)
    strains[:, KAPPA_T] -= strains[:, EPS_T] / radius
    return strains


@pytest.mark.long
def test_the_roof_converges_to_the_theory_of_flat_elements_and_so_does_its_rate(monkeypatch):
    kirchhoff_love = series_value()
    monkeypatch.setattr(levy_roof, "strains_of_axial_harmonic", without_stretch_in_the_curvature)
    limit = series_value()
    found = [
        KratosThinSolver().solve(ROOF, {"cells": (n, n)}).history[0].quantities["edge_deflection"] for n in (10, 20, 40)
    ]
    errors = [value / limit - 1 for value in found]
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.05)
    extrapolated = found[2] + (found[2] - found[1]) / 3
    assert extrapolated == pytest.approx(limit, rel=1e-5)
    assert kirchhoff_love / limit - 1 == pytest.approx(1.9e-4, rel=0.05)  # 0.02 h / R
