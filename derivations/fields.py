"""Functions that judge the cases of fields, and their second forms."""

from functools import partial

from . import drape, field_disc
from . import field_closed as closed
from .bridge_plate import sheet, sheet_by_ritz

SIDES = {"field_bridge_50": 0.05, "field_bridge_25": 0.025, "field_bridge_12": 0.0125}

JUDGES = {
    "field_count_plain": closed.field_count_plain,
    "field_count_positional": closed.field_count_positional,
    "field_count_grid": closed.field_count_grid,
    "field_count_vertices": closed.field_count_vertices,
    "field_sine": closed.field_sine,
    **closed.ORDER,
    "field_stretch": closed.field_stretch,
    "field_hang": closed.field_hang,
    "field_curvature": closed.field_curvature,
    "field_sampler": closed.field_sampler,
    "field_empty_row": closed.field_empty_row,
    "field_lloyd": closed.field_lloyd,
    "field_ball": closed.field_ball,
    **{name: partial(drape.by_triangles, name) for name in drape.BODIES},
    "field_folds": closed.field_folds,
    "field_disc": field_disc.polynomials,
    **{name: partial(sheet, side) for name, side in SIDES.items()},
}
SECOND_FORMS = {
    "field_count_plain": partial(closed.printed, 47_427),
    "field_count_positional": partial(closed.printed, 47_363),
    "field_count_grid": partial(closed.printed, 47_369),
    "field_count_vertices": partial(closed.printed, 49_152),
    "field_sine": closed.field_sine_by_cosines,
    **closed.ORDER,
    "field_stretch": closed.field_stretch_by_directions,
    "field_hang": closed.field_hang_by_energy,
    "field_curvature": closed.field_curvature_by_triangles,
    "field_sampler": closed.field_sampler_by_counting,
    "field_empty_row": closed.field_empty_row_by_counting,
    "field_lloyd": closed.field_lloyd_by_modes,
    "field_ball": closed.field_ball_by_regions,
    **{name: partial(drape.by_differences, name) for name in drape.BODIES},
    "field_folds": closed.field_folds_by_images,
    "field_disc": field_disc.paraboloid,
    **{name: partial(sheet_by_ritz, side) for name, side in SIDES.items()},
}
