"""Small cases that the tests of this solver share."""

from shellbench.problems.shell.case import build_case

UNIT = {"kind": "plane", "xi1": [0, 1], "xi2": [0, 1]}
CLOTH = {"youngs_modulus": 5000.0, "poissons_ratio": 0.25, "thickness": 0.01, "areal_density": 0.144}
PLATE = {"youngs_modulus": 1e7, "poissons_ratio": 0.0, "thickness": 0.01}
RIM = {"name": "rim", "on": ["xi1_min", "xi1_max", "xi2_min", "xi2_max"]}
GRAVITY = {"kind": "gravity", "acceleration": [0, 0, -9.8]}


def largest(at=1.0):
    return {"name": "largest", "kind": "largest_displacement", "at": at, "primary": True}


def plate(**changes):
    """A simply supported square plate under a uniform load, in linear theory."""
    data = {
        "title": "plate",
        "theory": "kirchhoff-love-linear",
        "surface": UNIT,
        "material": PLATE,
        "points": {"centre": [0.5, 0.5]},
        "supports": [RIM],
        "loads": [{"kind": "area", "vector": [0, 0, -1e-3]}],
        "quantities": [largest()],
    }
    return build_case(data | changes, "plate", "plate")


def cylinder(**changes):
    """A closed cylinder on diaphragms under pressure."""
    data = {
        "title": "cylinder",
        "theory": "kirchhoff-love-linear",
        "surface": {"kind": "cylinder", "radius": 2, "closed": True, "xi1": [0, 360], "xi2": [0, 3]},
        "material": PLATE,
        "supports": [{"name": "ends", "on": ["xi2_min", "xi2_max"], "components": ["x", "z"]}],
        "remove_rigid_motions": ["translation_y"],
        "loads": [{"kind": "pressure", "value": 1.0}],
        "quantities": [largest()],
    }
    return build_case(data | changes, "cylinder", "cylinder")


def cloth(until=0.1, **changes):
    """A square of cloth that nothing holds."""
    data = {
        "title": "cloth",
        "theory": "kirchhoff-love-nonlinear",
        "surface": UNIT,
        "material": CLOTH,
        "loads": [GRAVITY],
        "dynamics": {"until": until},
        "quantities": [largest(until)],
    }
    return build_case(data | changes, "cloth", "cloth")
