"""Small cases that the tests of this solver share."""

from shellbench.problems.shell.case import build_case
from tests.problems.shell.stated_shells import STEEL, UNIT

CLOTH = {"youngs_modulus": 5000.0, "poissons_ratio": 0.25, "thickness": 0.01, "areal_density": 0.144}
GRAVITY = {"kind": "gravity", "acceleration": [0, 0, -9.8]}


def largest(at=1.0):
    return {"name": "largest", "kind": "largest_displacement", "at": at, "primary": True}


def cylinder(**changes):
    """A closed cylinder on diaphragms under pressure."""
    data = {
        "title": "cylinder",
        "theory": "kirchhoff-love-linear",
        "surface": {"kind": "cylinder", "radius": 2, "closed": True, "xi1": [0, 360], "xi2": [0, 3]},
        "material": STEEL,
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
