"""Print known values with their uncertainties: `python -m derivations [CASE ...]`, without a name all of them."""

import argparse
import math
from functools import partial

from . import (
    HYPARS,
    HYPERBOLOIDS,
    MANUFACTURED,
    annular_plate,
    cantilever_moment,
    cantilever_pressure,
    cantilever_shear,
    cylinder_pull_out,
    free_fall,
    hemisphere_hole,
    hemisphere_hole_nonlinear,
    hinged_roof_thick,
    hinged_roof_thin,
    napkin_corner,
    napkin_corner_early,
    napkin_course,
    napkin_fixed_edges,
    napkin_moving_corners,
    napkin_plane,
    napkin_soft_pin,
    pendulum_strip,
    pinched_cylinder_diaphragm,
    pinched_cylinder_free,
    pinched_cylinder_nonlinear,
    rigid_rotation,
    rolled_plate,
    scordelis_lo,
    scordelis_lo_nonlinear,
    semi_cylinder,
    sleeve_compression,
    sleeve_compression_thin,
    sleeve_torque,
    sleeve_twist,
    sleeve_twist_thin,
    sleeve_twist_thin_buckled,
    slit_annular_plate,
    square_plate,
    square_plate_nonlinear,
)
from .ball_drape import JUDGES as DRAPE
from .benchmark_shells import JUDGES as BENCHMARKS
from .bent_strip import JUDGES as BENT_STRIP
from .contact import JUDGES as CONTACT
from .cylinder_modes import JUDGES as CYLINDERS
from .damped import JUDGES as DAMPED
from .discrete_catenary import hanging_chain
from .fields import JUDGES as FIELDS
from .garments import JUDGES as GARMENTS
from .gradients import JUDGES as GRADIENTS
from .identification import JUDGES as IDENTIFIED
from .naghdi import JUDGES as NAGHDI
from .passport import JUDGES as PASSPORT
from .plate_modes import JUDGES as PLATES
from .pressed_column import pressed_column
from .resultants import JUDGES as RESULTANTS
from .ropes import JUDGES as ROPES
from .shapes_by_series import JUDGES
from .strip_on_edge import JUDGES as STRIPS
from .woven import JUDGES as WOVEN

ROOFS = {"1e_2": 0.5, "3e_3": 0.15, "1e_3": 0.05, "3e_4": 0.015, "1e_4": 0.005}  # thickness, m: name times 50 m
TWIST = math.radians(0.2)  # that of cases/sleeve_torque.toml
CASES = {
    "square_plate": square_plate,
    "scordelis_lo": scordelis_lo,
    **{f"roof_thinness_{name}": partial(scordelis_lo, thickness=h) for name, h in ROOFS.items()},
    "pinched_cylinder_diaphragm": pinched_cylinder_diaphragm,
    "pinched_cylinder_free": pinched_cylinder_free,
    "annular_plate": annular_plate,
    "sleeve_torque": partial(sleeve_torque, twist=TWIST),
    "rolled_plate": rolled_plate,
    "rigid_rotation": rigid_rotation,
    "cantilever_shear": cantilever_shear,
    "cantilever_moment": cantilever_moment,
    "cantilever_pressure": cantilever_pressure,
    "square_plate_nonlinear": square_plate_nonlinear,
    "scordelis_lo_nonlinear": scordelis_lo_nonlinear,
    "slit_annular_plate": slit_annular_plate,
    "cylinder_pull_out": cylinder_pull_out,
    "semi_cylinder": semi_cylinder,
    "pinched_cylinder_nonlinear": pinched_cylinder_nonlinear,
    "free_fall": free_fall,
    "hanging_chain": hanging_chain,
    **ROPES,
    **FIELDS,
    "napkin_plane": napkin_plane,
    "napkin_course": napkin_course,
    "napkin_soft_pin": napkin_soft_pin,
    "napkin_corner": napkin_corner,
    "napkin_corner_early": napkin_corner_early,
    "napkin_fixed_edges": napkin_fixed_edges,
    "napkin_moving_corners": napkin_moving_corners,
    "sleeve_compression": sleeve_compression,
    "sleeve_compression_thin": sleeve_compression_thin,
    "sleeve_twist_thin": sleeve_twist_thin,
    "sleeve_twist_thin_buckled": sleeve_twist_thin_buckled,
    "sleeve_twist": sleeve_twist,
    "sleeve_course": sleeve_twist,
    "pendulum_strip": pendulum_strip,
    **HYPERBOLOIDS,
    **HYPARS,
    **MANUFACTURED,
    "hemisphere_hole": hemisphere_hole,
    "hemisphere_hole_nonlinear": hemisphere_hole_nonlinear,
    "hinged_roof_thick": hinged_roof_thick,
    "hinged_roof_thin": hinged_roof_thin,
    **JUDGES,
    **CONTACT,
    **DRAPE,
    **GARMENTS,
    **PASSPORT,
    **PLATES,
    **BENT_STRIP,
    **CYLINDERS,
    "pressed_column": pressed_column,
    **STRIPS,
    **NAGHDI,
    **RESULTANTS,
    **BENCHMARKS,
    **GRADIENTS,
    **IDENTIFIED,
    **WOVEN,
    **DAMPED,
}
TITLE = "case", "quantity", "value", "uncertainty", "unit"
ROW = "{:<31} {:<21} {:>19} {:>11} {}"


def main(arguments: list[str] | None = None) -> None:
    """Compute the named cases, or all, and print one line a quantity."""
    parser = argparse.ArgumentParser(prog="python -m derivations", description=__doc__)
    parser.add_argument("case", nargs="*", help=f"one of {', '.join(CASES)}")
    chosen = parser.parse_args(arguments).case
    for name in chosen:
        if name not in CASES:
            parser.error(f"nothing is derived for '{name}'; cases are {', '.join(CASES)}")
    print(ROW.format(*TITLE))
    for case in chosen or CASES:
        for quantity, estimate in CASES[case]().items():
            value, uncertainty = f"{estimate.value:.12g}", f"{estimate.uncertainty:.1e}"
            print(ROW.format(case, quantity, value, uncertainty, estimate.unit), flush=True)


if __name__ == "__main__":
    main()
