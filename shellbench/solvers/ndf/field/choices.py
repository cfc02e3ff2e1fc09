"""Choices of a field, by their names in settings and files."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator
from pydantic import Field as PydanticField

from shellbench.protocol.schema import Model, Positive

PeriodicInput = Literal["both", "cosine", "none"]
"""Input of a periodic coordinate: as (cos, sin), as cos alone, or as it is (Kairanda et al. 2023, figure II)."""
Components = Literal["cartesian", "covariant"]
Supports = Literal["hard", "soft"]
"""Treatment of supports: exactly by boundary factors, or approximately by springs."""
Slopes = Literal["even", "rows"]
"""Treatment of a slope that is held where components are free that tilt the normal: by inputs that are even at the
edge, so that nothing has a slope there, or by rows of the output layer: u,n . a3 = 0, and nothing else."""
Pins = Literal["points", "cells", "none"]
"""Treatment of a shell that nothing holds, against drifting by the published boundary functions: by pins at points, as
printed; by pins as wide as a cell of the published grid, which samples see; or not, as its energy does not ask for
it."""
StrainName = Literal["exact", "published", "linear"]

LAYER = 1.2  # l in sqrt(h R) around a force; .12 R for R / h = 100, the best by certified energy on pinched cylinders
# Of {1, t1, t2, r^2, t1 t2, t1^2}. A tangential displacement follows the normal one as its integral, hence t1 and t2:
# without them the certified energy of a pinched cylinder is 5e-4 short, with them 4e-5; the others gain nothing.
MULTIPLIERS = 3
LARGEST_GAP = 5e-4  # of the energy on the two rules: converged fields show 3e-5 and less, exploited rules 1e-2 and more


Crease = tuple[int, float, int]
"""The axis of a coordinate, its value, and on which side of that the features are: 1 above, -1 below."""


def _from_bool(value: Any) -> Any:
    """Return the choice that a boolean stood for in files of earlier versions; any other value as it is."""
    return {True: "both", False: "none"}[value] if isinstance(value, bool) else value


SavedPeriodicInput = Annotated[PeriodicInput, BeforeValidator(_from_bool)]


class FieldSpec(Model):
    """The choices that turn a case into a field.

    Attributes
    ----------
    activation
        Of the network.
    periodic_input
        Input of a periodic coordinate: (cos, sin); its cosine, so that the field is even about the seam; or the plain
        coordinate, so that the field is that of a slit shell.
    components
        Components of the output layer: Cartesian or covariant.
    supports
        Whether boundary factors or springs hold the supports.
    pins
        Pins of the published boundary functions, if nothing holds the shell.
    slopes
        Method by which the slope of components that are free at its edge is held.
    stretched
        Whether stretched coordinates are added about points that carry a force.
    layer
        Their length l in units of sqrt(h R).
    edge_stretched
        Whether such coordinates are added toward the edges of a curved shell without forces at points.
    multipliers
        Functions that multiply r^2 log r^2 about each such point; 0 leaves the singular features out.
    detail
        Additional features: 0 none; from 1 on, coordinates stretched toward the edges of any shell, and few powers of
        the distance from held corners; 2 more powers.
    creases
        Coordinate lines along which the third derivative jumps: edges of contact.
    t
        Load factor.
    strain
        Strain measure.
    mirrors
        Whether planes of symmetry are built into the field; in linear theory, at rest.
    vanishing
        Whether features vanish at held edges by themselves, like products: the boundary matrix is then the identity.
    """

    activation: str = "sine"
    periodic_input: SavedPeriodicInput = "both"
    components: Components = "cartesian"
    supports: Supports = "hard"
    pins: Pins = "points"
    slopes: Slopes = "even"
    stretched: bool = True
    layer: Positive = LAYER
    edge_stretched: bool = False
    multipliers: int = PydanticField(MULTIPLIERS, ge=0, le=6)
    detail: int = PydanticField(0, ge=0, le=2)
    creases: tuple[Crease, ...] = ()
    t: float = 1.0
    strain: StrainName = "linear"
    mirrors: bool = False
    vanishing: bool = False
