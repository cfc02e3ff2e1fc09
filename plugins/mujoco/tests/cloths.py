"""A plate at rest; cloth that nothing holds is that of the tests of `cst-hinge`."""

from shellbench.problems.shell.case import build_case
from tests.solvers.cst.shells import CLOTH, RIM, UNIT, largest


def plate(**changes):
    """A plate at rest."""
    data = {
        "title": "plate",
        "theory": "kirchhoff-love-nonlinear",
        "surface": UNIT,
        "material": CLOTH,
        "supports": [RIM],
        "loads": [{"kind": "area", "vector": [0, 0, "t"]}],
        "quantities": [largest()],
    }
    return build_case(data | changes, "plate", "plate")
