"""Small cases that the tests of `kratos-thin` share."""

from shellbench.problems.shell.case import build_case
from tests.solvers.cst import shells
from tests.solvers.cst.shells import largest

STEEL = {"youngs_modulus": 1.2e6, "poissons_ratio": 0.0, "thickness": 0.1}


def plate(**changes):
    """A simply supported square plate under a uniform load, in linear theory; D = 1e4, B = 1000 / 12."""
    data = {
        "title": "plate",
        "theory": "kirchhoff-love-linear",
        "surface": {"kind": "plane", "xi1": [0, 10], "xi2": [0, 10]},
        "material": {"youngs_modulus": 1e5, "poissons_ratio": 0.0, "thickness": 0.1},
        "points": {"centre": [5, 5]},
        "supports": [{"name": "rim", "on": ["xi1_min", "xi1_max", "xi2_min", "xi2_max"]}],
        "loads": [{"kind": "area", "vector": [0, 0, -1e-4]}],
        "quantities": [largest()],
    }
    return build_case(data | changes, "plate", "plate")


def cantilever(**changes):
    """A strip that is clamped at one end, 10 m by 1 m; B = 100 N m."""
    data = {
        "title": "cantilever",
        "theory": "kirchhoff-love-linear",
        "surface": {"kind": "plane", "xi1": [0, 10], "xi2": [0, 1]},
        "material": STEEL,
        "points": {"tip": [10, 0.5]},
        "supports": [{"name": "wall", "on": ["xi1_min"], "clamped": True}],
        "loads": [{"kind": "edge", "on": ["xi1_max"], "vector": [0, 0, 1e-3]}],
        "quantities": [largest()],
    }
    return build_case(data | changes, "cantilever", "cantilever")


def cylinder(**changes):
    """A closed cylinder on diaphragms under a pressure that is not constant around it."""
    data = {
        "material": {"youngs_modulus": 1e7, "poissons_ratio": 0.3, "thickness": 0.05},
        "loads": [{"kind": "pressure", "value": "1 + 0.5*cos(2*xi1)"}],
    }
    return shells.cylinder(**data | changes)
