"""Small cases of shells, stated in a line or two."""

from pathlib import Path

from shellbench.problems.shell.case import build_case, read_case

CASES = Path(__file__).parents[3] / "cases"
UNIT = {"kind": "plane", "xi1": [0, 1], "xi2": [0, 1]}
STEEL = {"youngs_modulus": 1e7, "poissons_ratio": 0.0, "thickness": 0.01}
RIM = {"name": "rim", "on": ["xi1_min", "xi1_max", "xi2_min", "xi2_max"]}
LARGEST = {"name": "largest", "kind": "largest_displacement", "primary": True}
ALL_MOTIONS = [f"{kind}_{axis}" for kind in ("translation", "rotation") for axis in "xyz"]


def known(name):
    """A case of the suite."""
    return read_case(CASES / f"{name}.toml")


def plate(**changes):
    """A simply supported square plate under a uniform load, in linear theory."""
    data = {
        "title": "plate",
        "theory": "kirchhoff-love-linear",
        "surface": UNIT,
        "material": STEEL,
        "points": {"centre": [0.5, 0.5], "beside": [0.5, 0.25]},
        "supports": [RIM],
        "loads": [{"kind": "area", "vector": [0, 0, -1e-3]}],
        "quantities": [LARGEST],
    }
    return build_case(data | changes, "plate", "plate")


def strip(force, length=2.0, width=0.5, **changes):
    """A cantilever strip along x, clamped at x = 0, with a force (3,) per width at its end, N/m."""
    data = {
        "surface": {"kind": "plane", "xi1": [0, length], "xi2": [0, width]},
        "points": {"tip": [length, width / 3]},
        "supports": [{"name": "wall", "on": ["xi1_min"], "clamped": True}],
        "loads": [{"kind": "edge", "on": ["xi1_max"], "vector": list(force)}],
    }
    return plate(**data | changes)


def ring(pressure=2.0, radius=3.0, **changes):
    """A closed cylinder about y that nothing holds, under pressure along its normal."""
    data = {
        "surface": {"kind": "cylinder", "radius": radius, "closed": True, "xi1": [0, 360], "xi2": [0, 4]},
        "points": {},
        "supports": [],
        "remove_rigid_motions": ALL_MOTIONS,
        "loads": [{"kind": "pressure", "value": pressure}],
    }
    return plate(**data | changes)
