"""Small cases that the tests of this solver share."""

from shellbench.problems.shell.case import build_case

UNIT = {"kind": "plane", "xi1": [0, 1], "xi2": [0, 1]}
CLOTH = {"youngs_modulus": 5000.0, "poissons_ratio": 0.25, "thickness": 0.01, "areal_density": 0.144}
GRAVITY = {"kind": "gravity", "acceleration": [0, 0, -9.8]}


def largest(at):
    return {"name": "largest", "kind": "largest_displacement", "at": at, "primary": True}


def cloth(until=0.1, **changes):
    """A square of cloth that nothing holds, under gravity."""
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


def plate(**changes):
    """A plate at rest."""
    data = {
        "title": "plate",
        "theory": "kirchhoff-love-nonlinear",
        "surface": UNIT,
        "material": CLOTH,
        "supports": [{"name": "rim", "on": ["xi1_min", "xi1_max", "xi2_min", "xi2_max"]}],
        "loads": [{"kind": "area", "vector": [0, 0, "t"]}],
        "quantities": [largest(1.0)],
    }
    return build_case(data | changes, "plate", "plate")
