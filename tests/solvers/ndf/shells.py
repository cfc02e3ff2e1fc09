"""Small shells for the tests: surfaces of every kind, and cases made of them."""

import numpy as np

from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.question.loads import PointLoad

SURFACES = {
    "plane": {"kind": "plane", "xi1": [0, 2], "xi2": [-1, 1]},
    "roof": {"kind": "cylinder", "axis": "z", "radius": 3, "xi1": [50, 130], "xi2": [0, 5]},
    "tube": {"kind": "cylinder", "axis": "y", "radius": 3, "closed": True, "xi1": [0, 360], "xi2": [0, 5]},
    "hypar": {"kind": "expression", "x": "xi1", "y": "xi2 + 0.2*xi1", "z": "xi1*xi2", "xi1": [-1, 1], "xi2": [-1, 1]},
    "helicoid": {"kind": "expression", "x": "xi2*cos(xi1)", "y": "xi2*sin(xi1)", "z": "0.4*xi1",
                 "xi1": [0, 90], "xi2": [1, 2], "angles": ["xi1"]},
    "torus": {"kind": "expression", "x": "(3 + cos(xi2))*cos(xi1)", "y": "(3 + cos(xi2))*sin(xi1)", "z": "sin(xi2)",
              "xi1": [0, 360], "xi2": [0, 360], "angles": ["xi1", "xi2"], "periodic": ["xi1", "xi2"]},
}  # fmt: skip
MATERIAL = {"youngs_modulus": 1e7, "poissons_ratio": 0.3, "thickness": 0.05, "areal_density": 2.0}
FREE = ["translation_x", "translation_y", "translation_z", "rotation_x", "rotation_y", "rotation_z"]


def shell(surface="plane", material=None, **data):
    """A case on one of the surfaces, free and unloaded unless `data` says otherwise."""
    base = {
        "title": "test",
        "theory": "kirchhoff-love-linear",
        "surface": SURFACES[surface] if isinstance(surface, str) else surface,
        "material": {**MATERIAL, **(material or {})},
        "quantities": [{"name": "largest", "kind": "largest_displacement", "primary": True}],
    }
    if "supports" not in data:
        base["remove_rigid_motions"] = FREE
    return build_case({**base, **data}, "test", "test")


def with_force(case, place, force):
    """A case with a force at a point that it could not be asked for: for mechanics alone."""
    load = PointLoad(kind="point", on=(place,), force=force)
    return case.model_copy(update={"loads": (*case.loads, load)})


def support(name, *on, **data):
    return {"name": name, "on": list(on), **data}


def inner_points(case, count=20, seed=0):
    """Points of the inner part of a domain."""
    domain = case.surface.domain
    share = np.random.default_rng(seed).uniform(0.07, 0.93, (count, 2))
    return np.asarray(domain.lower) + share * np.asarray(domain.size)


def differences(function, points, step=1e-3):
    """Jet (6, N, ...) of a function of points by fourth-order central differences."""
    stencil = {-2: 1 / 12, -1: -8 / 12, 1: 8 / 12, 2: -1 / 12}
    second = {-2: -1 / 12, -1: 16 / 12, 0: -30 / 12, 1: 16 / 12, 2: -1 / 12}
    e1, e2 = np.array([step, 0.0]), np.array([0.0, step])

    def first(axis, at):
        return sum(w * function(at + k * axis) for k, w in stencil.items()) / step

    d11, d22 = (sum(w * function(points + k * e) for k, w in second.items()) / step**2 for e in (e1, e2))
    d12 = sum(w * first(e1, points + k * e2) for k, w in stencil.items()) / step
    return np.stack([function(points), first(e1, points), first(e2, points), d11, d12, d22])
