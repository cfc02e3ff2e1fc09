"""Forces and supports at single points: which quantities have a limit, and by how much the others drift."""

import math

import numpy as np
import pytest

from shellbench.errors import InputError
from shellbench.problems.shell.case import Case, build_case
from shellbench.problems.shell.posed.spots import spot_at
from shellbench.problems.shell.variants.variants import VARIANTS
from shellbench.solvers.fem.solver import FemSettings, FemSolver

STEEL = {"youngs_modulus": 2e11, "poissons_ratio": 0.3, "thickness": 0.01}
STRIP = {"kind": "plane", "xi1": [0, 2], "xi2": [0, 1]}
ROOF = {"kind": "cylinder", "axis": "y", "radius": 1.0, "xi1": [40, 140], "xi2": [0, 2]}
TUBE = {"kind": "cylinder", "axis": "y", "radius": 1.0, "closed": True, "xi1": [0, 360], "xi2": [0, 2]}
HYPAR = {"kind": "expression", "x": "xi1", "y": "xi2", "z": "0.3*xi1*xi2", "xi1": [-1, 1], "xi2": [-1, 1]}
SKEW = {"kind": "expression", "x": "xi1 + xi2/2", "y": "sqrt(3)/2*xi2", "z": "0", "xi1": [0, 2], "xi2": [0, 1]}
WALL = {"name": "wall", "on": ["xi1_min"], "clamped": True}
RIM = {"name": "rim", "on": ["xi1_min", "xi1_max", "xi2_min", "xi2_max"], "clamped": True}
ROLLER = {"name": "table", "on": ["xi1_min", "xi1_max"], "components": ["z"]}
PULL = {"kind": "edge", "on": ["xi1_max"], "vector": [1000, 0, 0]}
BALANCE = {"kind": "edge", "on": ["xi1_min"], "vector": [-1000, 0, 0]}
HIDDEN = "1e6*exp(-((xi1 - 1.2347)/0.0004)**2 - ((xi2 - 0.6181)/0.0004)**2)"
ALONG = "1e6*exp(-((xi2 - 0.6181)/0.0004)**2)"
WEIGHT = {"kind": "area", "vector": [0, 0, -100]}
MEAN = {"name": "mean", "kind": "centre_of_mass", "direction": [1, 0, 0]}
FINITE, NAGHDI = "kirchhoff-love-nonlinear", "naghdi-linear"


def push(*force, on="p"):
    return {"kind": "point", "on": [on], "force": list(force)}


def at(name, *direction):
    return {"name": f"u_{name}", "kind": "displacement", "points": [name], "direction": list(direction)}


def energy(part="strain"):
    return {"name": "energy", "kind": f"{part}_energy"}


def pins(*names, components=("x", "y")):
    return {"name": "pins", "on": list(names), "components": list(components)}


def shell(surface, asked=MEAN, theory="kirchhoff-love-linear", **data):
    whole = {"title": "test", "theory": theory, "surface": surface, "material": STEEL}
    whole |= {"quantities": [asked | {"primary": True}]}
    return build_case(whole | data, "shell", "shell.toml")


def pushed(surface, p, force, asked, *supports, **data):
    return shell(surface, asked, points={"p": p}, loads=[push(*force)], supports=supports or [RIM], **data)


NONE = {
    "inside, along the force": lambda: pushed(STRIP, [1, 0.5], [3, 1, 0], at("p", 1, 0, 0)),
    "inside, across the force": lambda: pushed(STRIP, [1, 0.5], [1, 0, 0], at("p", 0, 1, 0)),
    "on a free edge": lambda: pushed(STRIP, [2, 0.5], [1000, 0, 0], at("p", 1, 0, 0), WALL),
    "at a corner, down the slope": lambda: pushed(ROOF, [140, 2], [-0.766, 0, -0.643], at("p", 0, 0, 1), WALL),
    "around a tube": lambda: pushed(TUBE, [90, 1], [1, 0, 0.9], at("p", 1, 0, 1), {"name": "end", "on": ["xi2_min"]}),
    "largest displacement": lambda: pushed(ROOF, [90, 1], [0, 1, 0], {"name": "u", "kind": "largest_displacement"}),
    "strain energy": lambda: pushed(STRIP, [1, 0.5], [1, 0, 0], energy()),
    "membrane energy": lambda: pushed(ROOF, [80, 1], [0, 1, 0.2], energy("membrane")),
    "potential energy": lambda: pushed(HYPAR, [0.3, 0.1], [1, 0, 0], energy("potential")),
    "bending energy of a curved shell": lambda: pushed(ROOF, [80, 1], [0, 1, 0], energy("bending")),
    "where an edge holds another direction": lambda: pushed(
        STRIP, [2, 0.5], [1, 1, 0], at("p", 0, 1, 0), WALL, {"name": "end", "on": ["xi1_max"], "components": ["x"]}
    ),
    "two forces that add up to one": lambda: shell(
        STRIP, at("p", 1, 0, 0), points={"p": [1, 0.5]}, supports=[RIM], loads=[push(1, 0, 1), push(1, 0, -1)]
    ),
    "normal force, where shear deforms": lambda: pushed(STRIP, [1, 0.5], [0, 0, 1], at("p", 0, 0, 1), theory=NAGHDI),
    "finite strain": lambda: pushed(ROOF, [80, 2], ["t", 0, "-t"], at("p", 0, 0, 1), WALL, theory=FINITE),
    "finite strain, one plane of symmetry": lambda: pushed(
        ROOF, [90, 2], [0, 0, "-t"], MEAN, {"name": "end", "on": ["xi2_min"]}, theory=FINITE
    ),
    "points that hold against a pull": lambda: shell(
        STRIP, points={"p": [0, 0.25], "q": [0, 0.75]}, supports=[pins("p", "q"), ROLLER], loads=[PULL]
    ),
    "points that hold against a turn": lambda: shell(
        STRIP, loads=[PULL | {"vector": [0, 500, 0]}],
        supports=[pins("xi1_min,xi2_min"), pins("xi1_max,xi2_min", components="y") | {"name": "roll"}, ROLLER],
    ),
    "points that hold against a stretch": lambda: shell(
        STRIP, points={"p": [0.5, 0.5], "q": [1.5, 0.5]}, supports=[pins("p", "q"), ROLLER], loads=[PULL, BALANCE]
    ),
    "determinate points, and a pull that samples miss": lambda: shell(
        STRIP, loads=[WEIGHT, {"kind": "area", "vector": [HIDDEN, 0, 0]}],
        supports=[pins("xi1_min,xi2_min"), pins("xi1_max,xi2_min", components="y") | {"name": "roll"}, ROLLER],
    ),
    "determinate points, and a pull that samples of an edge miss": lambda: shell(
        STRIP, loads=[WEIGHT, PULL | {"vector": [ALONG, 0, 0]}],
        supports=[pins("xi1_min,xi2_min"), pins("xi1_max,xi2_min", components="y") | {"name": "roll"}, ROLLER],
    ),
    "idle plate on points, and a pull that samples miss": lambda: shell(
        STRIP, points={"p": [0.5, 0.5], "q": [1.5, 0.5]}, supports=[pins("p", "q"), ROLLER],
        loads=[WEIGHT, {"kind": "area", "vector": [HIDDEN, 0, 0]}],
    ),
    "four corners of a roof": lambda: shell(
        ROOF, supports=[pins(*(f"xi1_{a},xi2_{b}" for a in ("min", "max") for b in ("min", "max")), components="xyz")],
        loads=[WEIGHT],
    ),
    "vibration of a roof on points": lambda: shell(
        ROOF, {"name": "f", "kind": "frequency"}, points={"p": [90, 1]}, material=STEEL | {"areal_density": 1.0},
        supports=[{"name": "ends", "on": ["xi2_min", "xi2_max"], "components": ["x", "z"]}, pins("p", components="y")],
    ),
    "normal support, where shear deforms": lambda: shell(
        STRIP, theory=NAGHDI, points={"p": [2, 0.5]}, loads=[WEIGHT],
        supports=[{"name": "hinge", "on": ["xi1_min"]}, pins("p", components="z")],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", NONE)
def test_what_has_no_limit_is_refused_with_the_way_out(name):
    with pytest.raises(InputError, match=r"^shell\.toml: .*(spread it over|hold a part of an edge)"):
        NONE[name]()


KEPT = {
    "normal force": lambda: pushed(STRIP, [1, 0.5], [0, 0, 1], at("p", 0, 0, 1)),
    "normal force at a corner": lambda: pushed(STRIP, [2, 1], [0, 0, 1], energy(), WALL),
    "displacement along the normal": lambda: pushed(STRIP, [1, 0.5], [1, 0, 0], at("p", 0, 0, 1)),
    "displacement elsewhere": lambda: pushed(
        STRIP, [1, 0.5], [1, 0, 0], at("xi1_max,xi2_min", 1, 0, 0) | {"name": "u"}, WALL
    ),
    "mean": lambda: pushed(ROOF, [80, 1], [1, 1, 0], MEAN),
    "reaction": lambda: pushed(
        STRIP, [2, 0.5], [1, 0, 0], {"name": "r", "kind": "reaction", "support": "wall", "direction": [1, 0, 0]}, WALL
    ),
    "bending energy of a plate": lambda: pushed(STRIP, [1, 0.5], [1, 0, 1], energy("bending")),
    "force that a support takes": lambda: pushed(
        STRIP, [2, 0.5], [1, 0, 1], energy(), WALL, {"name": "end", "on": ["xi1_max"], "components": ["x"]}
    ),
    "forces that cancel": lambda: shell(
        STRIP, energy(), points={"p": [1, 0.5]}, supports=[RIM], loads=[push(1, 0, 1), push(-1, 0, 1)]
    ),
    "pinched tube": lambda: pushed(TUBE, [270, 1], [0, 0, 1], energy(), {"name": "end", "on": ["xi2_min"]}),
    "finite strain, in two planes of symmetry": lambda: pushed(
        ROOF, [90, 1], [0, 0, "-t"], at("p", 0, 0, 1), {"name": "ends", "on": ["xi2_min", "xi2_max"]}, theory=FINITE
    ),
    "pin that takes a rigid motion": lambda: shell(
        STRIP, energy(), points={"p": [1, 0.5]}, supports=[pins("p"), ROLLER], loads=[PULL, BALANCE],
        remove_rigid_motions=["rotation_z"],
    ),
    "pins of a plate that nothing pulls": lambda: shell(
        STRIP, energy(), points={"p": [0.5, 0.5], "q": [1.5, 0.5]}, supports=[pins("p", "q"), ROLLER], loads=[WEIGHT]
    ),
    "normal point support": lambda: pushed(STRIP, [1, 0.5], [0, 0, 1], energy(), WALL, pins("p", components="z")),
    "finite strain, hung at a point": lambda: shell(
        STRIP, energy(), theory=FINITE, loads=[WEIGHT | {"vector": [0, 0, "-t"]}],
        supports=[pins("xi1_min,xi2_min", "xi1_min,xi2_max", "xi1_max,xi2_min", components="xyz")],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", KEPT)
def test_what_has_a_limit_is_asked_and_does_not_drift(name):
    case = KEPT[name]()
    assert case.remark == ""
    assert case.drifts(None) == {}


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("name", ["inside, along the force", "at a corner, down the slope"])
def test_variants_are_refused_alike(variant, name, monkeypatch):
    with monkeypatch.context() as unchecked:
        unchecked.setattr("shellbench.problems.shell.case.check_point_actions", lambda case: None)
        case = NONE[name]()
        try:
            data = VARIANTS[variant].make(case)
        except InputError:
            pytest.skip("the case has no such variant")
    with pytest.raises(ValueError, match="has no limit"):
        Case.model_validate(data | {"name": "variant"})


@pytest.mark.parametrize(
    ("surface", "p", "force", "support", "cells"),
    [
        (STRIP | {"xi1": [0, 1]}, [0.5, 0.5], [0.6, 0.8, 0], RIM, 2),
        (STRIP, [2, 0.5], [1, 0, 0], WALL, 4),
        (STRIP, [1, 0], [1, 0, 0], WALL, 4),
        (STRIP, [2, 1], [1, -1, 0], WALL, 4),
        (SKEW, [2, 1], [1, -math.sqrt(3), 0], WALL, 8),
    ],
    ids=["inside", "edge, across", "edge, along", "corner", "corner of 60 degrees"],
)
def test_a_halving_of_the_cell_adds_what_theory_says(surface, p, force, support, cells):
    """Kelvin, Flamant and Michell, against the change between uniform meshes of `fem`."""
    case = pushed(surface, p, force, MEAN, support)
    spot, size = spot_at(case, case.places["p"]), np.linalg.norm(force)
    found = [
        FemSolver().solve(case, FemSettings(cells=(n, n), grading=1.0, degree=3)).displacement([spot.xi])[0]
        @ force
        / size
        for n in (cells, 2 * cells)
    ]
    assert (found[1] - found[0]) / size == pytest.approx(spot.softness, rel=0.01)


def test_a_force_that_leans_has_its_drift_in_what_is_stated():
    """A vertical force on a hypar: F sin^2 times Kelvin's softness, from a cell of the shell's size to its thickness."""
    case = pushed(HYPAR, [0.3, -0.2], [0, 0, -1e4], at("p", 0, 0, -1), material=STEEL | {"thickness": 0.02})
    slope = 0.09 * (0.3**2 + 0.2**2)
    softness = 1.3 * 2.7 * math.log(2) / (4 * math.pi * 2e11 * 0.02)
    halvings = math.log2(4 * math.sqrt(8 + 0.6**2) / 0.02)
    drift = 1e4 * slope / (1 + slope) * softness * halvings
    assert case.drifts(None) == {"u_p": pytest.approx(drift, rel=1e-9)}
    assert "leans from the normal, so that u_p" in case.remark
