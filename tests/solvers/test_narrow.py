"""Formulas that vary within less than samples resolve are answered right, said not to have settled, or declined."""

import numpy as np
import pytest

from shellbench.bench.plugins.registry import find_solver, load_solver
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.solvers.fem.solver import FemSettings, FemSolver
from shellbench.solvers.ndf.ritz_solver import RitzSettings, RitzSolver
from tests.solvers.fem.shells import EVERY_EDGE, shell

AT, WIDTH, FORCE = (0.373, 0.619), 2e-4, -100.0
SUPPORTED = [{"name": "rim", "on": EVERY_EDGE}]
CLAMPED = [{"name": "root", "on": ["xi1_min"], "clamped": True}]
U = [{"name": "u", "kind": "displacement", "primary": True, "points": ["p"], "direction": [0, 0, 1]}]
PEAK = "({f}/(2*pi*{w}**2)*exp(-((xi1 - {a})**2 + (xi2 - {b})**2)/(2*{w}**2)))"


def plate(load, **more):
    data = {"kind": "plane", "xi1": [0, 1], "xi2": [0, 1]}
    return shell(data, supports=SUPPORTED, points={"p": [0.6, 0.3]}, quantities=U,
                 loads=[{"kind": "area", "vector": [0, 0, load]}], **more)  # fmt: skip


def strip(factor, **more):
    """Return a cantilever 5 m long and 1 m wide, pulled up at its end by 3 N/m."""
    material = {"youngs_modulus": 1e9, "poissons_ratio": 0.0, "thickness": 0.1, **factor}
    return shell({"kind": "plane", "xi1": [0, 5], "xi2": [0, 1]}, material=material, supports=CLAMPED, quantities=U,
                 points={"p": [5, 0.5]}, loads=[{"kind": "edge", "on": ["xi1_max"], "vector": [0, 0, 3]}], **more)  # fmt: skip


def navier(case, force, uniform):
    """Return the deflection of a supported unit square under a force that is spread by a Gaussian, and a pressure."""
    m, n = np.meshgrid(np.arange(1, 800), np.arange(1, 800), indexing="ij")
    modes = lambda x, y: np.sin(m * np.pi * x) * np.sin(n * np.pi * y)  # noqa: E731
    spread = np.exp(-((m**2 + n**2) * np.pi**2 * WIDTH**2) / 2)
    odd = (m % 2) * (n % 2) * 16 / (np.pi**2 * m * n)
    load = 4 * force * spread * modes(*AT) + uniform * odd
    return float(np.sum(load * modes(0.6, 0.3) / (np.pi**4 * (m**2 + n**2) ** 2)) / case.material.bending_stiffness)


def bent(thickness, modulus):
    """Return the end's deflection of the strip: the integral of F (L - x)^2 / (E I)."""
    x, w = np.polynomial.legendre.leggauss(12)
    ends = np.unique(np.concatenate([[0, 5], *(2.317 + s * np.geomspace(1e-9, 2.6, 900) for s in (-1, 1))]).clip(0, 5))
    half = np.diff(ends)[:, None] / 2
    at = ends[:-1, None] + half * (x + 1)
    return float(np.sum(half * w * 3 * (5 - at) ** 2 / (1e9 * modulus(at) * (0.1 * thickness(at)) ** 3 / 12)))


def notch(depth, width):
    return lambda x: 1 - depth * np.exp(-(((x - 2.317) / width) ** 2))


def one(x):
    return np.ones_like(x)


def test_a_load_between_all_samples_is_found_by_fem():
    case = plate("-0.01 + " + PEAK.format(f=FORCE, w=WIDTH, a=AT[0], b=AT[1]))
    solution = FemSolver().solve(case, FemSettings())
    error = abs(measure_all(solution)["u"] - navier(case, FORCE, -0.01))
    assert error < solution.uncertainty["u"] < 1e-4 * abs(navier(case, FORCE, -0.01))
    assert solution.unsettled is None


@pytest.mark.long
def test_a_load_between_all_samples_is_found_by_ndf_ritz():
    case = plate("-0.01 + " + PEAK.format(f=FORCE, w=WIDTH, a=AT[0], b=AT[1]))
    solution = RitzSolver().solve(case, RitzSettings())
    assert abs(measure_all(solution)["u"] - navier(case, FORCE, -0.01)) < solution.uncertainty["u"]


@pytest.mark.long
@pytest.mark.parametrize("width", [1e-2, 5e-3, 1e-3])
@pytest.mark.parametrize("name", ["thickness_factor", "modulus_factor"])
def test_a_notch_between_all_samples_is_found_by_fem(name, width):
    depth = 0.9 if name == "thickness_factor" else 0.9999
    case = strip({name: f"1 - {depth}*exp(-((xi1 - 2.317)/{width!r})**2)"})
    parts = (notch(depth, width), one) if name == "thickness_factor" else (one, notch(depth, width))
    solution = FemSolver().solve(case, FemSettings())
    right = bent(*parts)
    assert abs(measure_all(solution)["u"] - right) < max(solution.uncertainty["u"], 1e-9 * right)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("width", [5e-3, 1e-3])
def test_a_notch_between_all_samples_is_found_by_ndf_ritz(width):
    """Few waves are enough: the field turns across the notch by features of its own."""
    case = strip({"thickness_factor": f"1 - 0.9*exp(-((xi1 - 2.317)/{width!r})**2)"})
    solution = RitzSolver().solve(case, RitzSettings(neurons=60))
    right = bent(notch(0.9, width), one)
    assert abs(measure_all(solution)["u"] - right) < solution.uncertainty["u"] < 5e-3 * right


OBLIQUE = "1 + exp(-((xi1 - 0.7*xi2 - 0.1)/1e-6)**2)/1e-6"


def test_what_no_cells_tell_is_named_with_its_place():
    assert "a load of kind 'area' varies more quickly than" in plate(OBLIQUE).undecided
    assert plate("1 + xi1").undecided is None


@pytest.mark.long
def test_a_mesh_that_does_not_resolve_a_stiffness_says_so():
    material = {"youngs_modulus": 1e7, "poissons_ratio": 0.3, "thickness": 0.01, "thickness_factor": OBLIQUE}
    solution = FemSolver().solve(plate("1", material=material), FemSettings(cells=(4, 4)))
    assert "varies within" in solution.unsettled
    assert "the mesh does not resolve it" in solution.unsettled


@pytest.mark.parametrize(
    ("part", "what"),
    [
        ({"load": PEAK.format(f=1, w=1e-5, a=0.3, b=0.6)}, "a load of kind 'area' varies within"),
        ({"springs": [{"name": "pin", "stiffness": PEAK.format(f=1, w=1e-5, a=0.3, b=0.6)}]}, "varies within"),
    ],
)
def test_solvers_that_look_at_points_alone_decline(part, what):
    case = plate(part.get("load", "1"), **{key: value for key, value in part.items() if key != "load"})
    for name in ("ndf", "ndf-published"):
        assert load_solver(find_solver(name)).declines(case) is not None
    assert what in load_solver(find_solver("ndf")).declines(case) or "springs" in part
    assert FemSolver().declines(case) is None
    assert RitzSolver().declines(case) is None


@pytest.mark.parametrize("turned", [False, True])
def test_contact_with_what_points_miss_has_not_settled(turned):
    data = {"kind": "plane", "xi1": [0, 4], "xi2": [0, 1]}
    if turned:
        data |= {"kind": "expression", "x": "xi1", "y": "xi2", "z": "0.01*xi1"}
    for width, said in ((0.002, True), (0.5, False)):
        needle = {"kind": "formula", "centre": [0.3, 0, 0], "phi": f"z + 5 - 4.99*exp(-((x - 1)/{width})**2)"}
        case = shell(data, supports=SUPPORTED, quantities=U, points={"p": [2, 0.5]}, obstacles=[needle])
        found = case.undecided
        assert (found is not None) is said
        assert not said or "an obstacle of kind 'formula' varies within" in found
