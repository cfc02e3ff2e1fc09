"""Folds: closed forms of frames and tubes, folds without angle, and faults in the conditions at a fold."""

from dataclasses import replace

import numpy as np
import pytest

from shellbench.errors import InputError, SolveFailure
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.problems.shell.variants.variants import VARIANTS
from shellbench.solvers.fem.mechanics import constraints, fold_conditions
from shellbench.solvers.fem.mechanics.rigid_motions import nodal_rigid_motions
from shellbench.solvers.fem.mesh.grading import graded_mesh
from shellbench.solvers.fem.solver import FemSettings, FemSolver

E, NU, H = 1e7, 0.3, 0.01
STRETCHING, BENDING = E * H / (1 - NU**2), E * H**3 / 12 / (1 - NU**2)
ANGLE = {"x": "min(xi1, 1)", "y": "xi2", "z": "max(xi1 - 1, 0)", "xi1": [0, 2.5], "xi2": [0, 1]}
TUBE = {
    "x": "where(xi1 < 2, xi1 - 1, where(xi1 < 3, 1, where(xi1 < 5, 4 - xi1, -1)))",
    "y": "xi2",
    "z": "where(xi1 < 2, -0.5, where(xi1 < 3, xi1 - 2.5, where(xi1 < 5, 0.5, 5.5 - xi1)))",
    "xi1": [0, 6],
    "xi2": [0, 5],
    "periodic": ["xi1"],
    "folds": {"xi1": [0, 2, 3, 5]},
}
PLANES = {"name": "planes", "on": ["xi2_min", "xi2_max"], "symmetry": "y"}
ROOT = {"name": "root", "on": ["xi1_min"], "clamped": True}


def shell(surface, supports, loads=(), quantities=(), **more):
    return build_case(
        {
            "title": "Folded",
            "description": "A folded shell.",
            "suites": [],
            "theory": "kirchhoff-love-linear",
            "surface": {"kind": "expression", **surface},
            "material": {"youngs_modulus": E, "poissons_ratio": NU, "thickness": H, "areal_density": 1.0},
            "supports": list(supports),
            "loads": list(loads),
            "quantities": [{"name": "strain_energy", "kind": "strain_energy", "primary": True}, *quantities],
            **more,
        },
        "folded",
        "folded.toml",
    )


def changed(case, **changes):
    data = case.data() | changes
    return build_case({key: value for key, value in data.items() if key != "name"}, "folded", "folded.toml")


def at(name, kind, point, **more):
    key = "on" if kind in ("moment", "membrane_force", "shear_force") else "points"
    return {"name": name, "kind": kind, key: [point], **more}


def angle(fold="folds", **more):
    return shell(
        ANGLE | {fold: {"xi1": [1]}},
        [ROOT, PLANES],
        [{"kind": "edge", "on": ["xi1_max"], "vector": [1, 0, 0.3]}],
        [
            at("tip", "displacement", "tip", direction=[1, 0, 0]),
            at("fold", "displacement", "fold", direction=[0, 0, 1]),
            at("before", "moment", "fold", component="11", fold_side="before"),
            at("after", "moment", "fold", component="11", fold_side="after"),
            at("force", "membrane_force", "fold", component="11", fold_side="before"),
        ],
        points={"tip": [2.5, 0.5], "fold": [1, 0.5]},
        **more,
    )


def solved(case, **settings):
    found = measure_all(FemSolver().solve(case, FemSettings(**settings)))
    return {quantity.name: quantity.factor * found[quantity.name] for quantity in case.quantities}


def frame():
    """Two bars at a right angle, in cylindrical bending: the rotation and the deflection of the first one's end."""
    qx, qz, a, b = 1.0, 0.3, 1.0, 1.5
    turned = (qx * b * a - qz * a**2 / 2) / BENDING
    lifted = (qz * a**3 / 3 - qx * b * a**2 / 2) / BENDING
    tip = qx * a / STRETCHING + turned * b + qx * b**3 / 3 / BENDING
    energy = (qx * tip + qz * (lifted + qz * b / STRETCHING)) / 2
    return {"tip": tip, "fold": lifted, "strain_energy": energy, "before": qx * b, "after": qx * b, "force": qx}


def misfit(found, exact):
    return max(abs(found[name] / value - 1) for name, value in exact.items())


def test_an_angle_bends_as_the_frame_does():
    assert misfit(solved(angle()), frame()) < 1e-6


def hinged():
    return shell(
        ANGLE | {"hinges": {"xi1": [1]}},
        [ROOT, PLANES, {"name": "top", "on": ["xi1_max"], "components": ["x"]}],
        [{"kind": "area", "vector": ["where(xi1 < 1, 0, 2)", 0, 0]}],
        [
            at("middle", "displacement", "middle", direction=[1, 0, 0]),
            at("moment", "moment", "fold", component="11", fold_side="after"),
        ],
        points={"middle": [1.75, 0.5], "fold": [1, 0.5]},
    )


AROUND, ENCLOSED = 6.0, 2.0  # of the box
TORQUE = E / 2 / (1 + NU) * (4 * ENCLOSED**2 * H / AROUND + AROUND * H**3 / 3) * 0.001 / 5
BEAM = 5 * 2 * 1.5**4 / 384 / BENDING + 1.5 / STRETCHING / 2


def test_a_hinge_passes_forces_and_no_moment():
    found = solved(hinged())
    assert found["middle"] == pytest.approx(BEAM, rel=1e-6)
    assert abs(found["moment"]) < 1e-6


def box(**more):
    turn = {"kind": "rotation", "axis": [0, 1, 0], "angle": "0.001*180/pi"}
    return shell(
        TUBE,
        [
            {"name": "near", "on": ["xi2_min"], "components": ["x", "z"]},
            {"name": "far", "on": ["xi2_max"], "components": ["x", "z"], "motion": turn},
            {"name": "middle", "on": ["middle"], "components": ["y"]},
        ],
        (),
        [{"name": "torque", "kind": "torque", "support": "far", "axis": [0, 1, 0]}],
        points={"middle": [1, 2.5]},
        **more,
    )


@pytest.mark.long
def test_a_box_girder_twists_by_bredt_and_saint_venant():
    """T = G (4 A^2 / (U/h) + U h^3/3) theta', exact for walls whose ends turn rigidly and may warp; a fold is a seam."""
    assert solved(box())["torque"] == pytest.approx(TORQUE, rel=1e-9)


def test_a_fold_without_angle_changes_nothing():
    flat = {"x": "xi1", "y": "xi2", "z": "0", "xi1": [0, 2], "xi2": [0, 1]}
    supports = [{"name": "rim", "on": ["xi1_min", "xi2_min", "xi2_max"], "components": ["x", "y", "z"]}]
    loads = [{"kind": "area", "vector": ["xi2", 0.5, 1]}]
    plain, folded = (shell(flat | more, supports, loads) for more in ({}, {"folds": {"xi1": [0.7]}}))
    assert solved(folded)["strain_energy"] == pytest.approx(solved(plain)["strain_energy"], rel=2e-6)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ["axes", "turned", "units", "flipped", "swapped", "stretched", "warped"])
def test_an_angle_asked_otherwise_answers_the_same(name):
    case = angle()
    without_moments = [q for q in case.data()["quantities"] if q["kind"] != "moment"]
    plain = changed(case, quantities=without_moments)
    found = solved(changed(plain, **VARIANTS[name].make(plain)))
    assert misfit(found, {key: frame()[key] for key in ("tip", "fold", "strain_energy")}) < 1e-6
    assert found["force"] == pytest.approx(1, rel=1e-5)


def test_a_smooth_change_over_between_folds_stays():
    bent = "max(xi1 - 1, 0) + where(xi1 < 0.6, 0, (xi1 - 0.6)**4)"
    x = shell(ANGLE | {"z": bent, "folds": {"xi1": [1]}}, [ROOT]).surface.position([[0.2, 0.5], [0.8, 0.5], [2, 0.5]])
    assert x[:, 2] == pytest.approx([0, 0.2**4, 1 + 1.4**4], abs=1e-12)


def test_rigid_motions_obey_the_conditions_at_curved_folds():
    """A cone on a cylinder: the fold is a circle along which both normals turn."""
    radius = "where(xi2 < 1, 1, 1 + 0.5*(xi2 - 1))"
    cone = {
        "x": f"({radius})*cos(xi1)",
        "y": f"({radius})*sin(xi1)",
        "z": "where(xi2 < 1, xi2, 1 + 0.8*(xi2 - 1))",
        "xi1": [0, 80],
        "xi2": [0, 2],
        "angles": ["xi1"],
        "folds": {"xi2": [1]},
    }
    case = shell(cone, [{"name": "foot", "on": ["xi2_min"]}])
    mesh = graded_mesh(case, (4, 4), 1.0, degree=5)
    (stated,) = fold_conditions.fold_conditions(case, mesh, 1)
    motions = nodal_rigid_motions(case, mesh)[stated.nodes]
    vertex, bubbles = np.abs(stated.rows @ motions)[:, :2], np.abs(stated.rows @ motions)[:, 2:]
    assert vertex.max() < 1e-9
    assert bubbles.max() < 1e-4  # the weights of a cell are those of its middle


def wrong_sense(fold, x, right=fold_conditions._weights):
    w, rate = right(fold, x)
    return (w, rate) if abs(x[0, 0][0, 0] - 1) > 1e-12 or x[1, 0][0, 2] < 0.5 else (-w, -rate)


def welded(case, mesh, states, right=fold_conditions.fold_conditions):
    return right(case, replace(mesh, folds=tuple(replace(fold, hinged=False) for fold in mesh.folds)), states)


def error_or_refusal(case, exact):
    try:
        return misfit(solved(case, cells=(6, 4)), exact)
    except (SolveFailure, InputError):  # a mechanism, or supports that contradict the fault
        return np.inf


FAULTS = {
    "the rotation is not coupled": (constraints, "fold_conditions", lambda *_: iter(())),
    "the conormal turns round": (fold_conditions, "_weights", wrong_sense),
    "a weld is where a hinge is": (constraints, "fold_conditions", welded),
    "supports hold one side only": (constraints, "with_jumps", lambda mesh, nodes, rows, side: rows),
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", FAULTS)
def test_faults_at_folds_are_seen(name, monkeypatch):
    place, attribute, fault = FAULTS[name]
    monkeypatch.setattr(place, attribute, fault)
    asked = ((angle(), frame()), (box(), {"torque": TORQUE}), (hinged(), {"middle": BEAM}))
    assert max(error_or_refusal(case, exact) for case, exact in asked) > 1e-3


FINITE = {
    "theory": "kirchhoff-love-nonlinear",
    "loads": [{"kind": "edge", "on": ["xi1_max"], "vector": ["t", 0, 0]}],
    "quantities": [{"name": "strain_energy", "kind": "strain_energy", "primary": True}],
}
REFUSED = [
    ({"folds": {"xi1": [3]}}, "the fold at xi1 = 3 is not inside the surface"),
    ({"folds": {"xi1": [1], "xi2": [0.5]}}, "both coordinates have folds"),
    ({"folds": {"xi1": [1]}, "hinges": {"xi1": [1]}}, "the fold at xi1 = 1 is given twice"),
    ({"folds": {"xi1": [1]}, "z": "where(xi1 < 1, 0, xi1)"}, "its position jumps there"),
    ({}, r"declare it in \[surface\]: folds = \{ xi1 = \[1\] \}"),
    ({"x": "xi1 + xi2/10", "z": "abs(xi1 - xi2)"}, "without jumps"),
]


@pytest.mark.parametrize(("change", "words"), REFUSED)
def test_surfaces_with_undeclared_or_impossible_folds_are_refused(change, words):
    with pytest.raises(InputError, match=words):
        shell(ANGLE | change, [ROOT])


def test_other_theories_and_degree_3_decline_folds():
    nonlinear = changed(angle(), **FINITE)
    assert "linear theory" in FemSolver().declines(nonlinear)
    assert "without folds" in FemSolver().declines_with(angle(), FemSettings(degree=3))
    oblique = shell(ANGLE | {"folds": {"xi1": [1]}, "y": "xi2 + xi1/5"}, [ROOT])
    assert "obliquely" in FemSolver().declines(oblique)


@pytest.mark.long
def test_an_angle_between_clamps_vibrates_as_the_frame_does():
    """Its fold turns, and stays but for 1e-4 of stretching: bars that are clamped and pinned, then clamped at both ends."""
    modes = [{"name": f"mode_{k}", "kind": "frequency", "number": k, "primary": k == 1} for k in (1, 2)]
    equal = ANGLE | {"xi1": [0, 2], "folds": {"xi1": [1]}}
    clamps = {"name": "clamps", "on": ["xi1_min", "xi1_max"], "clamped": True}
    found = solved(changed(shell(equal, [clamps, PLANES]), quantities=modes))
    exact = {f"mode_{k}": beta**2 * BENDING**0.5 / (2 * np.pi) for k, beta in ((1, 3.926602), (2, 4.730041))}
    assert misfit(found, exact) < 1e-3
