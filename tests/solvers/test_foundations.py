"""Shells at rest on springs, against closed forms, in both solvers' own mechanics."""

import math

import numpy as np
import pytest

from shellbench.errors import InputError
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.posed.rigid import free_motions
from shellbench.problems.shell.quantities.measure import measure
from shellbench.solvers.cst.solver import CstSolver
from shellbench.solvers.fem.solver import FemSolver
from shellbench.solvers.ndf.published_solver import PublishedSolver
from shellbench.solvers.ndf.ritz_solver import RitzSolver
from shellbench.solvers.ndf.trainer_solver import NdfSolver

LENGTH, WIDTH, YOUNG, HEIGHT, BED = 2.0, 1.0, 1e7, 0.05, 4000.0
SOLVERS = {
    "fem": (FemSolver(), 1e-5),
    "ndf-ritz": (RitzSolver(), 1e-3),
    "ndf": (NdfSolver(), 1e-3),
}  # chosen before any answer was seen
LEVEL = ["translation_x", "translation_y", "rotation_z"]  # what a bed along z leaves free


def plate(**fields):
    data = {
        "title": "Plate on a foundation",
        "theory": "kirchhoff-love-linear",
        "surface": {"kind": "plane", "xi1": [0, LENGTH], "xi2": [0, WIDTH]},
        "material": {"youngs_modulus": YOUNG, "poissons_ratio": 0.0, "thickness": HEIGHT},
        "points": {"near": [0, 0.5], "far": [LENGTH, 0.5], "aside": [0.7, 0.2]},
        "springs": [{"name": "bed", "stiffness": BED, "components": ["z"]}],
        "quantities": [down("near", primary=True), down("far"), down("aside")],
    }
    return build_case(data | fields, "bed", "bed")


def down(point, **more):
    return {"name": point, "kind": "displacement", "points": [point], "direction": [0, 0, -1], **more}


def answers(case, solver):
    solution = SOLVERS[solver][0].solve(case)
    return {q.name: measure(solution, q) for q in case.quantities}, SOLVERS[solver][1]


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_free_strip_sinks_into_its_bed_as_hetenyis_beam(solver):
    """M. Hetenyi, Beams on Elastic Foundation (1946): free ends, a force at one of them; l = (k / 4 B)^(1/4).

    y(x) = (2 P l / k) (sinh lL cos lx cosh lx' - sin lL cosh lx cos lx') / (sinh^2 lL - sin^2 lL), x' = L - x.
    """
    force = 3.0
    edge = {"kind": "edge", "on": ["xi1_min"], "vector": [0, 0, -force]}
    found, allowed = answers(plate(loads=[edge], remove_rigid_motions=LEVEL), solver)
    rate = (BED / (4 * YOUNG * HEIGHT**3 / 12)) ** 0.25
    sinh, sin = math.sinh(rate * LENGTH), math.sin(rate * LENGTH)
    scale = 2 * force * rate / BED
    for name, x in (("near", 0.0), ("far", LENGTH), ("aside", 0.7)):
        a, b = rate * x, rate * (LENGTH - x)
        shape = (sinh * math.cos(a) * math.cosh(b) - sin * math.cosh(a) * math.cos(b)) / (sinh**2 - sin**2)
        assert found[name] == pytest.approx(scale * shape, rel=0, abs=allowed * scale)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_wave_of_load_on_a_simply_supported_plate(solver):
    """Timoshenko & Woinowsky-Krieger, article 59: w = q sin sin / (pi^4 B (1/a^2 + 1/b^2)^2 + k)."""
    load = f"sin(pi*xi1/{LENGTH})*sin(pi*xi2/{WIDTH})"
    case = plate(
        material={"youngs_modulus": YOUNG, "poissons_ratio": 0.3, "thickness": HEIGHT},
        supports=[{"name": "rim", "on": ["xi1_min", "xi1_max", "xi2_min", "xi2_max"]}],
        loads=[{"kind": "area", "vector": [0, 0, f"-100*{load}"]}],
        quantities=[
            down("aside", primary=True),
            {"name": "strain", "kind": "strain_energy"},
            {"name": "rim", "kind": "reaction", "support": "rim", "direction": [0, 0, 1]},
        ],
    )
    found, allowed = answers(case, solver)
    bending = YOUNG * HEIGHT**3 / 12 / (1 - 0.3**2)
    plates = math.pi**4 * bending * (1 / LENGTH**2 + 1 / WIDTH**2) ** 2
    top = 100 / (plates + BED)
    assert 0.1 < BED / plates < 10  # both carry the load
    assert found["aside"] == pytest.approx(top * math.sin(0.35 * math.pi) * math.sin(0.2 * math.pi), rel=allowed)
    assert found["strain"] == pytest.approx(plates * top**2 * LENGTH * WIDTH / 8, rel=2 * allowed)
    carried = (100 - BED * top) * LENGTH * WIDTH * 4 / math.pi**2
    assert found["rim"] == pytest.approx(carried, rel=10 * allowed)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_uniform_load_sinks_a_free_plate_evenly(solver):
    case = plate(loads=[{"kind": "area", "vector": [0, 0, -8]}], remove_rigid_motions=LEVEL)
    found, allowed = answers(case, solver)
    np.testing.assert_allclose(list(found.values()), 8 / BED, rtol=allowed)


def test_a_bed_resists_what_it_draws_back():
    loads = [{"kind": "area", "vector": [0, 0, -1]}]
    assert free_motions(plate(loads=loads, remove_rigid_motions=LEVEL)).shape == (6, 3)
    with pytest.raises(InputError, match="nothing holds the shell against translation_x"):
        plate(loads=loads)
    with pytest.raises(InputError, match="names translation_z, which the supports already hold"):
        plate(remove_rigid_motions=[*LEVEL, "translation_z"])


def test_a_bed_at_large_displacement_is_refused():
    with pytest.raises(InputError, match="springs belong to the linear theory, or to a case with"):
        plate(theory="kirchhoff-love-nonlinear", supports=[{"name": "wall", "on": ["xi1_min"], "clamped": True}])


@pytest.mark.parametrize("solver", [CstSolver(), PublishedSolver()])
def test_other_solvers_decline(solver):
    case = plate(supports=[{"name": "wall", "on": ["xi1_min", "xi1_max"]}])
    assert solver.declines(case) == "it rests on springs, which this solver does not take"


@pytest.mark.parametrize("solver", [RitzSolver(), NdfSolver()])
def test_fields_decline_springs_beside_edge_moments(solver):
    """Such cases are solved along a path, whose energy has no springs."""
    moment = {"kind": "moment", "on": ["xi1_max"], "axis": [0, 1, 0], "value": 5}
    case = plate(supports=[{"name": "wall", "on": ["xi1_min"], "clamped": True}], loads=[moment])
    assert "no springs beside edge moments" in solver.declines(case)
