"""Small cases for the tests of `fem`, as data."""

import numpy as np
from numpy.polynomial import polynomial

from shellbench.problems.shell.case import build_case
from shellbench.solvers.fem.mesh.mesh import TensorMesh

PLANE = {"kind": "plane", "xi1": [0, 2], "xi2": [0, 1]}
CYLINDER = {"kind": "cylinder", "axis": "y", "radius": 2.0, "closed": True, "xi1": [0, 360], "xi2": [0, 3]}
HELICOID = {
    "kind": "expression", "x": "xi1*cos(xi2)", "y": "xi1*sin(xi2)", "z": "p*xi2 + 0.2*xi1",
    "xi1": [0.5, 2.0], "xi2": [0, 150], "angles": ["xi2"], "constants": {"p": 0.4},
}  # fmt: skip
HYPAR = {
    "kind": "expression", "x": "xi1 + 0.3*xi2", "y": "xi2", "z": "xi1*xi2/c",
    "xi1": [-1, 1], "xi2": [-1, 1], "constants": {"c": 1.5},
}  # fmt: skip
TORUS = {
    "kind": "expression", "x": "(R + r*cos(xi2))*cos(xi1)", "y": "(R + r*cos(xi2))*sin(xi1)", "z": "r*sin(xi2)",
    "xi1": [0, 360], "xi2": [0, 360], "angles": ["xi1", "xi2"], "periodic": ["xi1", "xi2"],
    "constants": {"R": 2.0, "r": 0.6},
}  # fmt: skip
SURFACES = {"plane": PLANE, "cylinder": CYLINDER, "helicoid": HELICOID, "hypar": HYPAR, "torus": TORUS}
MATERIAL = {"youngs_modulus": 1e4, "poissons_ratio": 0.3, "thickness": 0.05, "areal_density": 2.0}
LARGEST = {"name": "largest", "kind": "largest_displacement", "primary": True}
MEAN = {"name": "mean", "kind": "centre_of_mass", "primary": True, "direction": [1, 0, 0]}  # it has a limit always
EVERY_EDGE = ["xi1_min", "xi1_max", "xi2_min", "xi2_max"]
EVERY_MOTION = [
    "translation_x", "translation_y", "translation_z", "rotation_x", "rotation_y", "rotation_z",
]  # fmt: skip


def shell(surface="plane", **fields):
    """Return a case on one of `SURFACES`; it is held by nothing unless told."""
    data = {
        "title": "test",
        "theory": "kirchhoff-love-linear",
        "surface": SURFACES[surface] if isinstance(surface, str) else surface,
        "material": MATERIAL,
        "quantities": [LARGEST],
    }
    if "supports" not in fields:
        data["remove_rigid_motions"] = EVERY_MOTION
    return build_case({**data, **fields}, "test", "test")


def surface_points(surface, count, seed=0):
    """Return random points (count, 2) inside the domain."""
    domain = surface.domain
    unit = np.random.default_rng(seed).uniform(0.02, 0.98, (count, 2))
    return np.asarray(domain.lower) + unit * np.asarray(domain.size)


def uniform(case, cells=(8, 3)):
    """Return the mesh of equal cells on a case's domain."""
    domain = case.surface.domain
    lines = [np.linspace(low, high, n + 1) for low, high, n in zip(domain.lower, domain.upper, cells, strict=True)]
    return TensorMesh(domain, (lines[0], lines[1]))


class PolynomialField:
    """A displacement field with exact derivatives: three random polynomials in the coordinates."""

    def __init__(self, surface, seed=0, size=0.1, degree=3):
        domain = surface.domain
        self.middle = (np.asarray(domain.lower) + np.asarray(domain.upper)) / 2
        self.half = np.asarray(domain.size) / 2
        self.factors = np.random.default_rng(seed).uniform(-size, size, (degree + 1, degree + 1, 3))

    def derivatives(self, points, order=2):
        x, y = ((np.asarray(points) - self.middle) / self.half).T
        result = {}
        for i in range(order + 1):
            for j in range(order + 1 - i):
                factors = polynomial.polyder(polynomial.polyder(self.factors, i, axis=0), j, axis=1)
                result[i, j] = polynomial.polyval2d(x, y, factors).T / (self.half[0] ** i * self.half[1] ** j)
        return result
