"""Print the known values with their uncertainties: `python -m derivations`."""

from . import (
    cantilever_moment,
    cantilever_shear,
    cylinder_pull_out,
    free_fall,
    hinged_roof_thick,
    hinged_roof_thin,
    napkin_corner,
    napkin_fixed_edges,
    napkin_moving_corners,
    napkin_plane,
    napkin_soft_pin,
    pendulum_strip,
    pinched_cylinder_diaphragm,
    pinched_cylinder_free,
    rigid_rotation,
    rolled_plate,
    scordelis_lo,
    scordelis_lo_nonlinear,
    sleeve_compression,
    sleeve_compression_thin,
    sleeve_torque,
    sleeve_twist,
    sleeve_twist_thin,
    slit_annular_plate,
    square_plate,
    square_plate_nonlinear,
)

TITLE = "case", "quantity", "value", "uncertainty", "unit"


def main() -> None:
    """Compute every case and print one line a quantity."""
    cases = {
        "square_plate": square_plate,
        "scordelis_lo": scordelis_lo,
        **{f"scordelis_lo, h = {h} m": lambda h=h: scordelis_lo(thickness=h) for h in (0.025, 0.125, 0.5)},
        "pinched_cylinder_diaphragm": pinched_cylinder_diaphragm,
        "pinched_cylinder_free": pinched_cylinder_free,
        "sleeve_torque, lambda = 1 rad": sleeve_torque,
        "rolled_plate": rolled_plate,
        "rigid_rotation": rigid_rotation,
        "cantilever_shear": cantilever_shear,
        "cantilever_moment": cantilever_moment,
        "square_plate_nonlinear": square_plate_nonlinear,
        "scordelis_lo_nonlinear": scordelis_lo_nonlinear,
        "slit_annular_plate": slit_annular_plate,
        "cylinder_pull_out": cylinder_pull_out,
        "free_fall": free_fall,
        "napkin_plane": napkin_plane,
        "napkin_soft_pin": napkin_soft_pin,
        "napkin_corner": napkin_corner,
        "napkin_fixed_edges": napkin_fixed_edges,
        "napkin_moving_corners": napkin_moving_corners,
        "sleeve_compression": sleeve_compression,
        "sleeve_compression_thin": sleeve_compression_thin,
        "sleeve_twist_thin": sleeve_twist_thin,
        "sleeve_twist": sleeve_twist,
        "pendulum_strip": pendulum_strip,
        "hinged_roof_thick": hinged_roof_thick,
        "hinged_roof_thin": hinged_roof_thin,
    }
    row = "{:<31} {:<21} {:>19} {:>11} {}"
    print(row.format(*TITLE))
    for case, compute in cases.items():
        for quantity, estimate in compute().items():
            value, uncertainty = f"{estimate.value:.12g}", f"{estimate.uncertainty:.1e}"
            print(row.format(case, quantity, value, uncertainty, estimate.unit), flush=True)


if __name__ == "__main__":
    main()
