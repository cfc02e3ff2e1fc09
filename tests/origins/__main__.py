"""Print the known values with their uncertainties: `python -m tests.origins`."""

from . import (
    pinched_cylinder_diaphragm,
    pinched_cylinder_free,
    scordelis_lo,
    sleeve_torque,
    square_plate,
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
    }
    row = "{:<31} {:<21} {:>19} {:>11} {}"
    print(row.format(*TITLE))
    for case, compute in cases.items():
        for quantity, estimate in compute().items():
            value, uncertainty = f"{estimate.value:.12g}", f"{estimate.uncertainty:.1e}"
            print(row.format(case, quantity, value, uncertainty, estimate.unit), flush=True)


if __name__ == "__main__":
    main()
