"""The properties of a solver's passport, each with the case and the quantities that measure it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

SUITE = "passport"
GRAVITY = 9.8  # m/s^2, of its free fall
Rule = Literal["inverse", "proportional", "quotient", "hanging", "peirce", "vibrating"]


@dataclass(frozen=True)
class Vibration:
    """A strip of length 1 m and areal density 1 kg/m^2 that a constant pressure moves from rest (N/m^2, N m, s)."""

    pressure: float
    bending: float
    time: float


VIBRATION = Vibration(pressure=1e-5, bending=0.1, time=1.0)


@dataclass(frozen=True)
class Property:
    """One line of a passport.

    Attributes
    ----------
    name, words, unit
        Name, description and unit of the property.
    case, quantities
        The case and the quantities that measure it.
    rule
        Rule that gives the property. It is proportional or inversely proportional to the quantity, or to the quotient
        of two. Or it is the stiffness of a strip that hangs under its own weight; the quantities are the drop and the
        shortening, as parts of its length. "peirce" is the same as a laboratory reads it, by Peirce's formula. Or it is
        that of a strip which vibrates as in `VIBRATION`; the quantity is the deflection.
    nominal
        The material's own, from the material of the case.
    """

    name: str
    words: str
    unit: str
    case: str
    quantities: tuple[str, ...]
    rule: Rule
    nominal: Callable[[Any], float]


def _stretching(material: Any) -> float:
    return float(material.youngs_modulus) * float(material.thickness)


PROPERTIES = (
    Property("stretch", "Stretch, E h", "N/m", "swatch", ("stretch",), "inverse", _stretching),
    Property("poisson", "Poisson's ratio", "", "swatch", ("contraction", "stretch"), "quotient",
             lambda m: m.poissons_ratio),
    Property("shear", "Shear, G h", "N/m", "swatch", ("shear",), "inverse",
             lambda m: _stretching(m) / 2 / (1 + m.poissons_ratio)),
    Property("twist", "Twist, B (1 - nu)", "N m", "swatch", ("twist",), "inverse",
             lambda m: m.bending_stiffness * (1 - m.poissons_ratio)),
    *(
        Property(f"bending_{gamma}", f"Bending, B, at Gamma {gamma}", "N m", "heavy_cantilever",
                 (f"drop_{gamma}", f"shortening_{gamma}"), "hanging", lambda m: m.bending_stiffness)
        for gamma in (1, 10, 100, 1000)
    ),
    Property("bending_by_peirce", "Bending, B, as Peirce's cantilever reads it", "N m", "heavy_cantilever",
             ("drop_10", "shortening_10"), "peirce", lambda m: m.bending_stiffness),
    Property("stretch_off_warp", "Stretch and shear off the warp, by their work", "N/m", "woven_swatch",
             ("strain_energy",), "inverse", lambda m: m.membrane_stiffness),
    *(
        Property(f"bending_{thread}", f"Bending, B, along the {thread}, at Gamma {gamma}", "N m",
                 f"woven_cantilever_{thread}", (f"drop_{gamma}", f"shortening_{gamma}"), "hanging",
                 lambda m: m.turned_stiffnesses[1][0, 0])
        for thread, gamma in (("warp", 40), ("weft", 100))
    ),
    Property("bending_off_warp", "Bending, B, off the warp", "N m", "woven_bias_strip", ("tip_deflection",), "inverse",
             lambda m: m.turned_stiffnesses[1][0, 0]),
    Property("bending_on_edge", "Bending and torsion, B, on edge", "N m", "strip_on_edge_1_20", ("load_factor_1",),
             "proportional", lambda m: m.bending_stiffness),
    Property("bending_in_motion", "Bending, B, in motion", "N m", "vibrating_strip", ("deflection_1000ms",),
             "vibrating", lambda m: m.bending_stiffness),
    Property("fall", "Free fall, g", "m/s^2", "free_fall", ("fall_1000ms",), "proportional",
             lambda m: GRAVITY),
)  # fmt: skip
