"""Second form of `folded_plates`: tensor products of polynomials by `folded_ritz`, no harmonics.

Half of the length is enough: at the plane x = L / 2, u, v_x and w_x vanish. The diaphragm holds v and w. Forces at a point converge slowest, for they are not smooth at the corners of the strips.
"""

from __future__ import annotations

import numpy as np

from .estimate import Estimate
from .folded_plates import BOX, ROOF, FoldedPlate, estimates
from .folded_ritz import Lengthwise, Prism, Section, flat_walls
from .surface_strains import Array

COARSE, FINE = (12, 11), (16, 15)
"""Degrees in s and in x."""
ROUNDING_OF_POLYNOMIALS = 1e-10


def between_diaphragms(plate: FoldedPlate, across: int, along: int) -> Prism:
    """Trial functions of degrees `across` and `along` on the half between a diaphragm and mid-length."""
    half = 0.0, 0.07 * plate.length, plate.length / 2
    held = Lengthwise(half, along, "zero", "even")
    section = Section(tuple(flat_walls(plate.nodes, plate.strips)), across, {})
    sets = {"u": Lengthwise(half, along, "free", "zero"), "v": held, "w": held}
    return Prism(section, sets, plate.thickness, plate.young, plate.poisson)


def weight(prism: Prism, plate: FoldedPlate) -> Array:
    """Work of the plate's load on each trial function."""
    total = np.zeros(prism.size)
    for i in range(len(plate.strips)):
        for component, axis in zip((1, 2), plate.frame(i), strict=True):
            total += prism.area_load(i, component, float(axis @ plate.load))
    return total


def _values(plate: FoldedPlate, degrees: tuple[int, int], fold: tuple[int, int]) -> dict[str, float]:
    prism, (before, after), middle = between_diaphragms(plate, *degrees), fold, plate.length / 2
    found, stretching, bending = prism.solve(weight(prism, plate))
    end, half = plate.width(before), plate.width(after) / 2

    def moved(strip: int, s: float) -> Array:
        local = [prism.place(strip, component, s, middle) @ found for component in (1, 2)]
        return np.array(plate.frame(strip)).T @ local

    def force(name: str, strip: int, s: float) -> float:
        return float(prism.resultant(name, strip, s, middle) @ found)

    start, at_fold = moved(before, 0.0), moved(before, end)
    return {
        "edge_displacement_y": start[0],
        "edge_deflection": -start[1],
        "fold_displacement_y": at_fold[0],
        "fold_deflection": -at_fold[1],
        "fold_turn": float(prism.place(before, 2, end, middle, 1) @ found),
        "crown_deflection": -moved(after, half)[1],
        "fold_moment": force("m_s", before, end),
        "fold_axial_moment_before": force("m_x", before, end),
        "fold_axial_moment_after": force("m_x", after, 0.0),
        "fold_axial_force_before": force("n_x", before, end),
        "fold_axial_force_after": force("n_x", after, 0.0),
        "fold_force_before": force("n_s", before, end),
        "fold_force_after": force("n_s", after, 0.0),
        "edge_axial_force": force("n_x", before, 0.0),
        "crown_moment": force("m_s", after, half),
        "membrane_energy": 2 * stretching,
        "bending_energy": 2 * bending,
        "strain_energy": 2 * (stretching + bending),
    }


def folded_roof_by_ritz() -> dict[str, Estimate]:
    """Known values of the roof by polynomials."""
    return estimates(*(_values(ROOF, degrees, (0, 1)) for degrees in (FINE, COARSE)), ROUNDING_OF_POLYNOMIALS)


def folded_box_by_ritz() -> dict[str, Estimate]:
    """Known values of the box by polynomials."""
    return estimates(*(_values(BOX, degrees, (1, 2)) for degrees in (FINE, COARSE)), ROUNDING_OF_POLYNOMIALS)
