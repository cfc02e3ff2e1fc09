"""Small cases in motion, for the tests of the published training."""

from shellbench.problems.shell.case import build_case
from tests.solvers.ndf.shells import MATERIAL, SURFACES

NAPKIN = {"kind": "plane", "xi1": [0, 1], "xi2": [0, 1]}
SLEEVE = {"kind": "cylinder", "axis": "y", "radius": 0.25, "closed": True, "xi1": [0, 360], "xi2": [0, 1]}
G = 9.8


def moving(surface="plane", until=1.0, material=None, **data):
    """A case in motion on one of the surfaces, free and unloaded unless `data` says otherwise."""
    base = {
        "title": "test",
        "theory": "kirchhoff-love-nonlinear",
        "surface": SURFACES[surface] if isinstance(surface, str) else surface,
        "material": {**MATERIAL, **(material or {})},
        "dynamics": {"until": until},
        "quantities": [{"name": "centre", "kind": "centre_of_mass", "direction": [0, 0, 1], "at": until,
                        "primary": True}],
    }  # fmt: skip
    return build_case({**base, **data}, "test", "test")


def gravity(*acceleration):
    return {"kind": "gravity", "acceleration": list(acceleration)}
