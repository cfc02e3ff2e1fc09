"""The cases of the suite `passport`: what judges each, and its second form."""

from __future__ import annotations

from collections.abc import Callable

from .constant_stress import swatch
from .constant_stress_by_ritz import swatch_by_ritz
from .estimate import Estimate
from .heavy_strip import heavy_cantilever, heavy_cantilever_by_polynomials
from .vibrating_strip import vibrating_strip, vibrating_strip_by_polynomials

JUDGES: dict[str, Callable[[], dict[str, Estimate]]] = {
    "swatch": swatch,
    "heavy_cantilever": heavy_cantilever,
    "vibrating_strip": vibrating_strip,
}
SECOND_FORMS: dict[str, Callable[[], dict[str, Estimate]]] = {
    "swatch": swatch_by_ritz,
    "heavy_cantilever": heavy_cantilever_by_polynomials,
    "vibrating_strip": vibrating_strip_by_polynomials,
}
