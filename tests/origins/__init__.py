"""Origins of the known values of linear Kirchhoff-Love shells, by series and closed forms.

These are independent of every solver that they judge: they import NumPy and SciPy only, expand in
harmonics instead of elements or neurons, and are written for one geometry each. The theory is
W = 1/2 (D H eps eps + B H kappa kappa) with D = E h / (1 - nu^2), B = E h^3 / (12 (1 - nu^2)) and the
exact linearisation of the metric and curvature changes as strains. `python -m tests.origins` prints
every value with its uncertainty.

| module | case | method | second form, in the tests |
|---|---|---|---|
| navier_plate | square plate | Navier's double series | Levy's single series |
| levy_roof | Scordelis-Lo roof | Fourier x Legendre-Ritz | exact exponentials |
| pinched_diaphragm | pinched cylinder, diaphragms | double Fourier, closed-form tail | `pinched_free` |
| pinched_free | pinched cylinder, free ends | Fourier x Legendre-Ritz, fitted tail | exact exponentials |
| torsion | twisted sleeve | closed form | stationarity of the Ritz energy |

`cylinder` has the strains, `strip` the Legendre-Ritz method for one harmonic, `exponentials` its exact
counterpart, `estimate` the number with its uncertainty.
"""

from .estimate import Estimate
from .levy_roof import scordelis_lo
from .navier_plate import square_plate
from .pinched_diaphragm import pinched_cylinder_diaphragm
from .pinched_free import pinched_cylinder_free
from .torsion import sleeve_torque

__all__ = [
    "Estimate",
    "pinched_cylinder_diaphragm",
    "pinched_cylinder_free",
    "scordelis_lo",
    "sleeve_torque",
    "square_plate",
]
