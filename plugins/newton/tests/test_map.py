"""The map from E, nu and h to each solver's numbers, compared with closed forms; free fall."""

import numpy as np
import pytest

pytest.importorskip("newton", reason="needs newton: python -m pip install ./plugins/newton")

from shellbench_newton.cloth import Cloth
from shellbench_newton.solver import ClothSettings, SemiImplicitSolver, Style3DSolver, VbdSolver
from shellbench_newton.solving import ClothSolution, Run

from shellbench.errors import InputError
from shellbench.problems.shell.case import build_case

STRETCH, NU, THICKNESS = 1.0, 0.3, 0.5  # E h, N/m
BENDING = STRETCH * THICKNESS**2 / 12 / (1 - NU**2)
SHEAR = STRETCH / 2 / (1 + NU)
STEP, STRAIN, ANGLE = 1e-2, 0.05, 0.1
KINDS = ("semi-implicit", "vbd", "xpbd", "style3d")


def square(**changes):
    data = {
        "title": "square",
        "theory": "kirchhoff-love-nonlinear",
        "surface": {"kind": "plane", "xi1": [0, 1], "xi2": [0, 1]},
        "material": {
            "youngs_modulus": STRETCH / THICKNESS,
            "poissons_ratio": NU,
            "thickness": THICKNESS,
            "areal_density": 1.0,
        },
        "loads": [{"kind": "gravity", "acceleration": [0, 0, -9.8]}],
        "dynamics": {"until": 0.5},
        "quantities": [{"name": "size", "kind": "largest_displacement", "at": 0.5, "primary": True}],
    }
    return build_case(data | changes, "square", "square")


def forces(kind, places, cut="right"):
    """Forces (v, 3) on vertices at places, from the velocities after one short step."""
    cloth = Cloth(square(), (2, 2), cut)
    run = Run(cloth, kind, 1)
    run.load(np.zeros_like(cloth.mesh.nodes))
    run.put(places(cloth.mesh.nodes.copy()), np.zeros_like(cloth.mesh.nodes))
    run.step(STEP)
    return cloth.mesh.nodes, cloth.masses[:, None] * run.velocities / STEP


@pytest.mark.parametrize("kind", KINDS)
def test_constant_stretch_and_shear_have_the_stress_of_the_plate(kind):
    """N11, N22 for a strain along xi1, and N12 for a shear; the odd part in the strain, without its square."""
    stress = []
    for gradient in ([[1, 0], [0, 0]], [[0, 0.5], [0.5, 0]]):
        odd = 0.0
        for sign in (1, -1):

            def places(x, sign=sign, gradient=gradient):
                x[:, :2] += sign * STRAIN * x[:, :2] @ np.array(gradient)
                return x

            nodes, force = forces(kind, places)
            right, top = nodes[:, 0] > 0.9, nodes[:, 1] > 0.9
            odd -= sign * np.array([force[right, 0].sum(), force[top, 1].sum(), force[right, 1].sum()]) / 2 / STRAIN
        stress.append(odd)
    plate = {"C11": STRETCH / (1 - NU**2), "C12": STRETCH * NU / (1 - NU**2)}
    if kind == "style3d":  # no Poisson's effect: a strip of stiffness E h
        plate = {"C11": STRETCH, "C12": 0.0}
    if kind == "xpbd":  # springs: C12 = G h, and E h along the sides
        plate = {"C11": (STRETCH + np.hypot(STRETCH, 2 * SHEAR)) / 2, "C12": SHEAR}
    assert stress[0][:2] == pytest.approx([plate["C11"], plate["C12"]], rel=0.02, abs=0.01)
    assert stress[1][2] == pytest.approx(SHEAR, rel=0.02)


@pytest.mark.parametrize("kind", KINDS)
def test_one_fold_has_the_moment_of_the_plate(kind):
    """The right half is turned about the middle: the moment is B times the angle over a cell, along the whole side."""

    def places(x):
        turned = x[:, 0] > 0.5
        arm = x[turned, 0] - 0.5
        x[turned, 0], x[turned, 2] = 0.5 + arm * np.cos(ANGLE), arm * np.sin(ANGLE)
        return x

    nodes, force = forces(kind, places)
    right = nodes[:, 0] > 0.9
    across = force[right] @ [-np.sin(ANGLE), 0, np.cos(ANGLE)]
    assert -across.sum() * 0.5 == pytest.approx(BENDING * ANGLE / 0.5, rel=0.02)
    assert np.abs(force.sum(axis=0)).max() < 0.02 * abs(across.sum())


def test_free_fall_is_that_of_the_rule_in_time(tmp_path):
    """Semi-implicit Euler falls g t (t + dt)/2. `style3d` keeps 0.998 of its velocity in every step."""
    step, time = 0.005, 0.5
    settings = ClothSettings(cells=(2, 2), time_step=step, frame_rate=20)
    expected = 9.8 * time * (time + step) / 2
    solution = SemiImplicitSolver().solve(square(), settings)
    assert -solution.displacement([0.5, 0.5])[2] == pytest.approx(expected, rel=1e-4)
    assert -VbdSolver().solve(square(), settings).displacement([0.3, 0.6])[2] == pytest.approx(expected, rel=2e-3)
    velocity = fallen = 0.0
    for _ in range(round(time / step)):
        moved = velocity + 9.8 * step
        fallen, velocity = fallen + moved * step, 0.998 * moved
    assert -Style3DSolver().solve(square(), settings).displacement([0.5, 0.5])[2] == pytest.approx(fallen, rel=1e-3)
    again = ClothSolution.load(solution.save(tmp_path / "fall"))
    assert np.array_equal(again.displacement([0.2, 0.7], at=0.33), solution.displacement([0.2, 0.7], at=0.33))


def test_a_clamped_strip_comes_to_rest_where_a_beam_does():
    """The tip sinks by q L^4/(8 B'): B' is B without twist, and 0.8 B if hinges twist it freely (findings/hinges.md)."""
    clamped = [{"name": "wall", "on": ["xi1_min"], "clamped": True}]
    load = [{"kind": "area", "vector": [0, 0, "-t"]}]
    material = {"youngs_modulus": 12.0, "poissons_ratio": 0.0, "thickness": 1.0}
    tip = {
        "name": "tip",
        "kind": "displacement",
        "points": ["tip"],
        "direction": [0, 0, -1],
        "at": 0.01,
        "primary": True,
    }
    case = square(
        surface={"kind": "plane", "xi1": [0, 1], "xi2": [0, 0.1]}, material=material, supports=clamped, loads=load,
        points={"tip": [1, 0.05]}, quantities=[tip], dynamics=None,
    )  # fmt: skip
    solution = SemiImplicitSolver().solve(case, ClothSettings(cells=(8, 1)))
    assert solution.unsettled is None
    found = np.mean([-solution.displacement([1, y], at=0.01)[2] for y in (0.0, 0.1)])
    assert 0.01 / 8 < found < 0.01 / 8 / 0.8


@pytest.mark.parametrize("cut", ["right", "left", "alternating"])
def test_cuts_cover_the_square(cut):
    cloth = Cloth(square(), (3, 2), cut)
    assert cloth.areas.min() > 0
    assert cloth.areas.sum() == pytest.approx(1)
    assert len(cloth.hinges[0]) == 6 + 2 * 2 + 3 * 1


def test_small_triangles_are_refused():
    tiny = square(surface={"kind": "plane", "xi1": [0, 1e-3], "xi2": [0, 1e-3]})
    with pytest.raises(InputError, match="newton has no bending in triangles below 5e-07"):
        Cloth(tiny, (2, 2)).model("vbd")
