"""Small cases that the tests of `kratos-thin` share."""

from shellbench.problems.shell.case import build_case

STEEL = {"youngs_modulus": 1.2e6, "poissons_ratio": 0.0, "thickness": 0.1}
RIM = {"name": "rim", "on": ["xi1_min", "xi1_max", "xi2_min", "xi2_max"]}


def largest(at=1.0):
    return {"name": "largest", "kind": "largest_displacement", "at": at, "primary": True}


def plate(**changes):
    """A simply supported square plate under a uniform load, in linear theory; D = 1e4, B = 1000 / 12."""
    data = {
        "title": "plate",
        "theory": "kirchhoff-love-linear",
        "surface": {"kind": "plane", "xi1": [0, 10], "xi2": [0, 10]},
        "material": {"youngs_modulus": 1e5, "poissons_ratio": 0.0, "thickness": 0.1},
        "points": {"centre": [5, 5]},
        "supports": [RIM],
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
        "title": "cylinder",
        "theory": "kirchhoff-love-linear",
        "surface": {"kind": "cylinder", "radius": 2, "closed": True, "xi1": [0, 360], "xi2": [0, 3]},
        "material": {"youngs_modulus": 1e7, "poissons_ratio": 0.3, "thickness": 0.05},
        "supports": [{"name": "ends", "on": ["xi2_min", "xi2_max"], "components": ["x", "z"]}],
        "remove_rigid_motions": ["translation_y"],
        "loads": [{"kind": "pressure", "value": "1 + 0.5*cos(2*xi1)"}],
        "quantities": [largest()],
    }
    return build_case(data | changes, "cylinder", "cylinder")
