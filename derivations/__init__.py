"""Origins of the known values of Kirchhoff-Love shells, by series, closed forms and Ritz's method.

These are independent of every solver that they judge: they import NumPy and SciPy only. The linear ones expand in
harmonics instead of elements or neurons and are written for one geometry each; the theory is
W = 1/2 (D H eps eps + B H kappa kappa) with D = E h / (1 - nu^2), B = E h^3 / (12 (1 - nu^2)) and the
exact linearisation of the metric and curvature changes as strains. Those of large displacements take these changes
themselves, from positions. `python -m derivations` prints every value with its uncertainty, which takes some ten
minutes for the large displacements.

| module | case | method | second form, in the tests |
|---|---|---|---|
| navier_plate | square plate | Navier's double series | Levy's single series |
| levy_roof | Scordelis-Lo roof | Fourier x Legendre-Ritz | exact exponentials |
| pinched_diaphragm | pinched cylinder, diaphragms | double Fourier, closed-form tail | `pinched_free` |
| pinched_free | pinched cylinder, free ends | Fourier x Legendre-Ritz, fitted tail | exact exponentials |
| torsion | twisted sleeve | closed form | stationarity of the Ritz energy |
| elastica | cantilever, end shear | equations of equilibrium | `plane_strip`, elliptic integrals |
| roll_up | cantilever, end moment | closed form | `plane_strip` |
| rolled_plate | prescribed bending, rigid rotation | closed form | sampled positions |
| large_displacements | plate, roof, pull-out, slit annulus | Ritz on splines | limits: linear values, `elastica` |
| hinged_roof | hinged roofs | Ritz on splines, arc length | work of the load |
| sleeve_path, sleeve_buckling | sleeve twisted, compressed | Fourier x Legendre-Ritz, second variation | classical limits |
| free_fall | free fall | closed form | splines in time |
| motion | napkins on a soft pin | splines, explicit in time | Legendre polynomials |
| swinging_strip | pendulum strip | splines, explicit in time | Legendre polynomials |
| paper_napkins | the paper's napkins | splines, explicit in time | - |

`cylinder` has the linear strains, `strip` the Legendre-Ritz method for one harmonic, `exponentials` its exact
counterpart. `surface_strains` has those of large displacements, `spline_shell` their Ritz method, `spline_path` its
equilibria along a path, `patch` knots and surfaces. `sleeve` and `sleeve_functions` have the Ritz method of the sleeve
that turns with its rims, `spline_motion` and `polynomial_napkin` cloth in motion, `explicit_motion` its steps in time. `estimate` is the number with its uncertainty.
"""

from .elastica import cantilever_shear
from .estimate import Estimate
from .free_fall import free_fall
from .hinged_roof import hinged_roof_thick, hinged_roof_thin
from .large_displacements import cylinder_pull_out, scordelis_lo_nonlinear, slit_annular_plate, square_plate_nonlinear
from .levy_roof import scordelis_lo
from .motion import napkin_plane, napkin_soft_pin
from .navier_plate import square_plate
from .paper_napkins import napkin_corner, napkin_fixed_edges, napkin_moving_corners
from .pinched_diaphragm import pinched_cylinder_diaphragm
from .pinched_free import pinched_cylinder_free
from .roll_up import cantilever_moment
from .rolled_plate import rigid_rotation, rolled_plate
from .sleeve_buckling import sleeve_compression, sleeve_compression_thin, sleeve_twist_thin
from .sleeve_path import sleeve_twist
from .swinging_strip import pendulum_strip
from .torsion import sleeve_torque

__all__ = [
    "Estimate",
    "cantilever_moment",
    "cantilever_shear",
    "cylinder_pull_out",
    "free_fall",
    "hinged_roof_thick",
    "hinged_roof_thin",
    "napkin_corner",
    "napkin_fixed_edges",
    "napkin_moving_corners",
    "napkin_plane",
    "napkin_soft_pin",
    "pendulum_strip",
    "pinched_cylinder_diaphragm",
    "pinched_cylinder_free",
    "rigid_rotation",
    "rolled_plate",
    "scordelis_lo",
    "scordelis_lo_nonlinear",
    "sleeve_compression",
    "sleeve_compression_thin",
    "sleeve_torque",
    "sleeve_twist",
    "sleeve_twist_thin",
    "slit_annular_plate",
    "square_plate",
    "square_plate_nonlinear",
]
