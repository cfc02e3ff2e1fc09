"""Folded shells: what judges each, and its second form."""

from __future__ import annotations

from collections.abc import Callable

from .angle_frame import angle_frame, angle_frame_by_ritz, hinged_angle, hinged_angle_by_ritz
from .box_girder import box_girder, box_girder_by_ritz, held_girder, held_girder_by_splines
from .corrugated_sheet import (
    corrugation_across,
    corrugation_across_by_ritz,
    corrugation_along,
    corrugation_along_by_ritz,
)
from .estimate import Estimate
from .folded_plates import folded_box, folded_roof
from .folded_plates_by_ritz import folded_box_by_ritz, folded_roof_by_ritz
from .raasch_hook import raasch_hook, raasch_hook_by_polynomials
from .z_section import z_section, z_section_by_splines

JUDGES: dict[str, Callable[[], dict[str, Estimate]]] = {
    "angle_frame": angle_frame,
    "box_girder": box_girder,
    "corrugation_across": corrugation_across,
    "corrugation_along": corrugation_along,
    "folded_box": folded_box,
    "folded_roof": folded_roof,
    "held_girder": held_girder,
    "hinged_angle": hinged_angle,
    "raasch_hook": raasch_hook,
    "z_section": z_section,
}
SECOND_FORMS: dict[str, Callable[[], dict[str, Estimate]]] = {
    "angle_frame": angle_frame_by_ritz,
    "box_girder": box_girder_by_ritz,
    "corrugation_across": corrugation_across_by_ritz,
    "corrugation_along": corrugation_along_by_ritz,
    "folded_box": folded_box_by_ritz,
    "folded_roof": folded_roof_by_ritz,
    "held_girder": held_girder_by_splines,
    "hinged_angle": hinged_angle_by_ritz,
    "raasch_hook": raasch_hook_by_polynomials,
    "z_section": z_section_by_splines,
}
LONG = {"folded_box", "folded_roof", "held_girder", "raasch_hook", "z_section"}
"""Shells whose two forms take more than a few seconds together."""
