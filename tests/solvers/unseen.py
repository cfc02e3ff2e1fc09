"""A dozen shells that no suite has: oblique, doubly curved, under pressure, in odd coordinates.

Solvers are tuned on the cases of the suites. What a change does to shells that nobody looks at shows here: values on
small meshes and narrow fields, which need not be accurate, are kept in unseen.json and must stay.
`python -m tests.solvers.unseen` writes them anew.
"""

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path

from shellbench.problems.shell.case import Case, build_case
from shellbench.solvers.fem.solver import FemSettings, FemSolver
from shellbench.solvers.ndf.ritz_solver import RitzSettings, RitzSolver

KEPT = Path(__file__).with_name("unseen.json")
QUANTITIES = ("strain_energy", "membrane_energy", "bending_energy", "largest_displacement")
END = "".join(
    f'[[quantities]]\nname = "{name}"\nkind = "{name}"\nprimary = {str(not i).lower()}\n'
    for i, name in enumerate(QUANTITIES)
)
STEEL = "youngs_modulus = 2e11\npoissons_ratio = 0.3\nthickness = 0.01"


def shell(surface: str, supports: str, loads: str, material: str = STEEL, points: str = "", rigid: str = "") -> str:
    """Return the text of a linear case."""
    return (
        f'title = "Unseen"\ntheory = "kirchhoff-love-linear"\n{rigid}\n[surface]\nkind = "expression"\n{surface}\n'
        f"[material]\n{material}\n[points]\n{points}\n{supports}\n{loads}\n{END}"
    )


def held(on: str, more: str = "clamped = true", name: str = "held") -> str:
    """Return a support of edges, points or corners."""
    return f'[[supports]]\nname = "{name}"\non = {on}\n{more}\n'


ALL = '["translation_x", "translation_y", "translation_z", "rotation_x", "rotation_y", "rotation_z"]'
FREE = f"remove_rigid_motions = {ALL}"
RHOMBUS = 'x = "xi1 + xi2*cos(a)"\ny = "xi2*sin(a)"\nz = "0"\nxi1 = [0, 100]\nxi2 = [0, 100]\nconstants = {{ a = {0} }}'
PLATE = "youngs_modulus = 1e7\npoissons_ratio = 0.3\nthickness = 1"
HYPERBOLOID = (
    'x = "sqrt(1 + xi2**2)*cos(xi1)"\ny = "sqrt(1 + xi2**2)*sin(xi1)"\nz = "xi2"\nxi1 = [0, 360]\nxi2 = [-1, 1]\n'
    'angles = ["xi1"]\nperiodic = ["xi1"]'
)
HYPAR = 'x = "xi1"\ny = "xi2"\nz = "xi1**2 - xi2**2"\nxi1 = [-0.5, 0.5]\nxi2 = [-0.5, 0.5]'
ROUND = '[[loads]]\nkind = "pressure"\nvalue = "{0}*cos(2*xi1)"'
DOWN = '[[loads]]\nkind = "area"\nvector = [0, 0, {0}]'
SIDES = '["xi1_min", "xi1_max", "xi2_min", "xi2_max"]'
SUPPORTED = held(SIDES, 'components = ["x", "y", "z"]')
ROOF = "youngs_modulus = 4.32e8\npoissons_ratio = 0.0\nthickness = 0.25"
DIAPHRAGMS = held('["xi2_min", "xi2_max"]', 'components = ["x", "z"]')

SHELLS: Mapping[str, str] = {
    "hemisphere_with_hole": shell(
        'x = "10*cos(xi2)*cos(xi1)"\ny = "10*cos(xi2)*sin(xi1)"\nz = "10*sin(xi2)"\nxi1 = [0, 360]\nxi2 = [0, 72]\n'
        'angles = ["xi1", "xi2"]\nperiodic = ["xi1"]',
        "",
        "".join(
            f'[[loads]]\nkind = "point"\non = ["p{i}"]\nforce = [{x}, {y}, 0]\n'
            for i, (x, y) in enumerate([(2, 0), (0, -2), (-2, 0), (0, 2)])
        ),
        "youngs_modulus = 6.825e7\npoissons_ratio = 0.3\nthickness = 0.04",
        "p0 = [0, 0]\np1 = [90, 0]\np2 = [180, 0]\np3 = [270, 0]",
        FREE,
    ),
    "hypar": shell(HYPAR, held('["xi1_min"]'), DOWN.format(-80.0)),
    "hyperboloid_clamped": shell(HYPERBOLOID, held('["xi2_min", "xi2_max"]'), ROUND.format(1e4)),
    "hyperboloid_free": shell(HYPERBOLOID, "", ROUND.format(1.0), rigid=FREE),
    "rhombic_plate_30": shell(RHOMBUS.format(0.5235987755982988), SUPPORTED, DOWN.format(-1.0), PLATE),
    "rhombic_plate_60": shell(RHOMBUS.format(1.0471975511965976), SUPPORTED, DOWN.format(-1.0), PLATE),
    "long_plate": shell(
        'x = "xi1"\ny = "xi2"\nz = "0"\nxi1 = [0, 50]\nxi2 = [0, 1]',
        SUPPORTED,
        DOWN.format(-1.0),
        "youngs_modulus = 1e7\npoissons_ratio = 0.49\nthickness = 0.05",
    ),
    "roof_in_warped_coordinates": shell(
        'x = "25*sin(a*(xi1 + 0.1*sin(3*xi1)*xi2*(1 - xi2)))"\ny = "50*(xi2 + 0.05*sin(pi*xi2)*xi1)"\n'
        'z = "25*cos(a*(xi1 + 0.1*sin(3*xi1)*xi2*(1 - xi2)))"\nxi1 = [-1, 1]\nxi2 = [0, 1]\nconstants = { a = 0.6981317007977318 }',
        DIAPHRAGMS,
        DOWN.format(-90.0),
        ROOF,
        rigid='remove_rigid_motions = ["translation_y"]',
    ),
    "cylinder_in_helical_coordinates": shell(
        'x = "300*cos(xi1 + 0.3*xi2)"\ny = "600*xi2"\nz = "300*sin(xi1 + 0.3*xi2)"\nxi1 = [0, 360]\nxi2 = [0, 1]\n'
        'angles = ["xi1"]\nperiodic = ["xi1"]',
        held('["xi2_min", "xi2_max"]'),
        ROUND.format(1e-3),
        "youngs_modulus = 3e6\npoissons_ratio = 0.3\nthickness = 3",
    ),
    "spherical_zone": shell(
        'x = "cos(xi2)*cos(xi1)"\ny = "cos(xi2)*sin(xi1)"\nz = "sin(xi2)"\nxi1 = [0, 360]\nxi2 = [0, 60]\n'
        'angles = ["xi1", "xi2"]\nperiodic = ["xi1"]',
        held('["xi2_min"]'),
        ROUND.format(1e3),
    ),
    "skew_cantilever": shell(
        'x = "xi1 + 0.5*xi2"\ny = "xi2"\nz = "0.1*xi1**2"\nxi1 = [0, 2]\nxi2 = [0, 1]',
        held('["xi1_min"]'),
        DOWN.format(-80.0),
    ),
    "twisted_strip_with_a_point_load": shell(
        'x = "xi1"\ny = "xi2*cos(0.5*xi1)"\nz = "xi2*sin(0.5*xi1)"\nxi1 = [0, 3]\nxi2 = [-0.5, 0.5]',
        held('["xi1_min"]') + held('["xi1_max,xi2_min"]', 'components = ["y"]', "pin"),
        '[[loads]]\nkind = "point"\non = ["inside"]\nforce = [0, 1, -2]',
        points="inside = [2, 0.2]",
    ),
}


def case_of(name: str) -> Case:
    """Return one of the shells."""
    return build_case(tomllib.loads(SHELLS[name]), name, name)


def answers(name: str) -> dict[str, dict[str, float]]:
    """Return the answers on a small mesh, and by a narrow field, by solver and quantity."""
    case = case_of(name)
    solutions = {
        "fem": FemSolver().solve(case, FemSettings(cells=(5, 6))),
        "ndf-ritz": RitzSolver().solve(case, RitzSettings(neurons=40, seed=0, largest_gap=1.0)),
    }
    return {
        solver: {quantity.name: float(quantity.measure(solution)) for quantity in case.quantities}
        for solver, solution in solutions.items()
    }


if __name__ == "__main__":
    KEPT.write_text(json.dumps({name: answers(name) for name in SHELLS}, indent=1) + "\n", encoding="utf-8")
