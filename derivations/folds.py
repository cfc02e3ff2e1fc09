"""Folded shells: what judges each, and its second form."""

from __future__ import annotations

from collections.abc import Callable

from .estimate import Estimate
from .folded_plates import folded_box, folded_roof
from .folded_plates_by_ritz import folded_box_by_ritz, folded_roof_by_ritz

JUDGES: dict[str, Callable[[], dict[str, Estimate]]] = {
    "folded_roof": folded_roof,
    "folded_box": folded_box,
}
SECOND_FORMS: dict[str, Callable[[], dict[str, Estimate]]] = {
    "folded_roof": folded_roof_by_ritz,
    "folded_box": folded_box_by_ritz,
}
