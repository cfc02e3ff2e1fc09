"""Where known values come from: series, closed forms and Ritz's method, independent of every solver that they judge.

Only NumPy and SciPy are imported. README.md says which module belongs to which case, and `python -m derivations` prints
the values.
"""

from .annular_plate import annular_plate
from .elastica import cantilever_shear
from .estimate import Estimate
from .free_fall import free_fall
from .hemisphere import hemisphere_hole
from .hinged_roof import hinged_roof_thick, hinged_roof_thin
from .hypar import HYPARS
from .hyperboloid import HYPERBOLOIDS
from .large_displacements import (
    cylinder_pull_out,
    pinched_cylinder_nonlinear,
    scordelis_lo_nonlinear,
    semi_cylinder,
    slit_annular_plate,
    square_plate_nonlinear,
)
from .large_hemisphere import hemisphere_hole_nonlinear
from .levy_roof import scordelis_lo
from .manufactured import MANUFACTURED
from .motion import napkin_course, napkin_plane, napkin_soft_pin
from .navier_plate import square_plate
from .paper_napkins import napkin_corner, napkin_corner_early, napkin_fixed_edges, napkin_moving_corners
from .pinched_diaphragm import pinched_cylinder_diaphragm
from .pinched_free import pinched_cylinder_free
from .roll_up import cantilever_moment
from .rolled_plate import rigid_rotation, rolled_plate
from .sleeve_buckling import sleeve_compression, sleeve_compression_thin, sleeve_twist_thin
from .sleeve_path import sleeve_twist, sleeve_twist_thin_buckled
from .spiral import cantilever_pressure
from .swinging_strip import pendulum_strip
from .torsion import sleeve_torque

__all__ = [
    "HYPARS",
    "HYPERBOLOIDS",
    "MANUFACTURED",
    "Estimate",
    "annular_plate",
    "cantilever_moment",
    "cantilever_pressure",
    "cantilever_shear",
    "cylinder_pull_out",
    "free_fall",
    "hemisphere_hole",
    "hemisphere_hole_nonlinear",
    "hinged_roof_thick",
    "hinged_roof_thin",
    "napkin_corner",
    "napkin_corner_early",
    "napkin_course",
    "napkin_fixed_edges",
    "napkin_moving_corners",
    "napkin_plane",
    "napkin_soft_pin",
    "pendulum_strip",
    "pinched_cylinder_diaphragm",
    "pinched_cylinder_free",
    "pinched_cylinder_nonlinear",
    "rigid_rotation",
    "rolled_plate",
    "scordelis_lo",
    "scordelis_lo_nonlinear",
    "semi_cylinder",
    "sleeve_compression",
    "sleeve_compression_thin",
    "sleeve_torque",
    "sleeve_twist",
    "sleeve_twist_thin",
    "sleeve_twist_thin_buckled",
    "slit_annular_plate",
    "square_plate",
    "square_plate_nonlinear",
]
