"""A plate at rest; cloth that nothing holds is that of the tests of `cst-hinge`."""

from shellbench.problems.shell.case import build_case
from tests.solvers.cst.shells import CLOTH, UNIT, largest


def plate(**changes):
    """A plate at rest."""
    data = {
        "title": "plate",
        "theory": "kirchhoff-love-nonlinear",
        "surface": UNIT,
        "material": CLOTH,
        "supports": [{"name": "rim", "on": ["xi1_min", "xi1_max", "xi2_min", "xi2_max"]}],
        "loads": [{"kind": "area", "vector": [0, 0, "t"]}],
        "quantities": [largest()],
    }
    return build_case(data | changes, "plate", "plate")
