"""The cases of the suites `shapes` and `bridge_shell`, of `buckling` a ring, and of `benchmarks` a plate, that closed forms and series answer: what judges each, and its second form."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from .bedded_plate import bedded_plate, bedded_plate_by_ritz
from .bent_in_plane import bent_in_plane, bent_in_plane_by_ritz
from .blown_tube import blown_tube, blown_tube_by_samples
from .bridge_plate import bridge_plate, bridge_plate_by_ritz
from .clamped_plate import by_ritz, clamped_plate_point, clamped_plate_uniform
from .constant_stress import bent_plate, sheared_sleeve, twisted_parallelogram
from .constant_stress_by_ritz import bent_plate_by_ritz, parallelogram_by_ritz, sleeve_by_ritz
from .elastica import swung_cantilever
from .estimate import Estimate
from .goursat_plate import by_goursat
from .graded_strip import graded_strip, graded_strip_by_equilibrium
from .guided_plate import guided_plate, guided_plate_by_ritz
from .guided_ring import guided_ring, guided_ring_by_ritz
from .held_corner import held_corner, held_corner_by_ritz
from .hooked_strip import hooked_cantilever, hooked_cantilever_by_polynomials
from .inclined_moments import inclined_moments, inclined_moments_by_potential
from .lifted_plate import lifted_plate, lifted_plate_by_navier
from .narrow_peak import NARROW, SHARP, peak, peak_by_galerkin
from .oval_tube import oval_tube, oval_tube_by_exponentials
from .plane_strip import swung_cantilever as swung_cantilever_by_polynomials
from .plate_series import by_levy, by_navier, plate_2_1_point, plate_2_1_uniform, strip_plate_1_50
from .pressed_motion import pressed_motion, pressed_motion_of_splines
from .pressed_oval import pressed_oval, pressed_oval_by_harmonics
from .pressed_ring import pressed_ring, pressed_ring_by_potential
from .pulled_motion import pulled_motion, pulled_motion_of_a_chain
from .pushed_plate import pushed_plate, pushed_plate_by_newton
from .raft import raft, raft_by_ritz
from .rhombic_elements import by_elements
from .rhombic_plate import by_corners
from .rigid_turn import (
    rigid_turn_about_point,
    rigid_turn_by_edge,
    rigid_turn_by_exponential,
    small_turn_by_generator,
)
from .ring_twist import ring_twist, ring_twist_by_ritz
from .rippled_plate import rippled_plate, rippled_plate_by_ritz
from .sine_plate import sine_plate, sine_plate_by_polynomials
from .sprung_motion import sprung_motion, sprung_motion_by_splines
from .turned_saddle import turned_saddle, turned_saddle_by_simpson
from .turned_strip import turned_cantilever, turned_cantilever_by_polynomials
from .uneven_pipe import uneven_pipe, uneven_pipe_by_statics

Values = Callable[[], dict[str, Estimate]]

JUDGES: dict[str, Values] = {
    "clamped_plate_uniform": partial(by_ritz, clamped_plate_uniform()),
    "clamped_plate_point": partial(by_ritz, clamped_plate_point()),
    "plate_2_1_uniform": partial(by_levy, plate_2_1_uniform()),
    "plate_2_1_point": partial(by_levy, plate_2_1_point()),
    "strip_plate_1_50": partial(by_levy, strip_plate_1_50()),
    "rhombic_plate_60": partial(by_corners, 60.0),
    "rhombic_plate_30": partial(by_corners, 30.0),
    "ring_twist": ring_twist,
    "graded_strip": graded_strip,
    "oval_tube": oval_tube,
    "rigid_turn_about_point": rigid_turn_about_point,
    "rigid_turn_by_edge": rigid_turn_by_edge,
    "pressed_motion": pressed_motion,
    "twisted_parallelogram": twisted_parallelogram,
    "bent_plate": bent_plate,
    "sheared_sleeve": sheared_sleeve,
    "turned_cantilever": turned_cantilever,
    "bedded_plate": bedded_plate,
    "guided_plate": guided_plate,
    "guided_ring": guided_ring,
    "hooked_cantilever": hooked_cantilever,
    "sprung_motion": sprung_motion,
    "pushed_plate": pushed_plate,
    "pulled_motion": pulled_motion,
    "raft": raft,
    "rippled_plate": rippled_plate,
    "blown_tube": blown_tube,
    "pressed_oval": pressed_oval,
    "pressed_ring": pressed_ring,
    "uneven_pipe": uneven_pipe,
    "held_corner": held_corner,
    "bent_in_plane": bent_in_plane,
    "turned_saddle": turned_saddle,
    "inclined_moments": inclined_moments,
    "narrow_peak": partial(peak, NARROW),
    "sharp_peak": partial(peak, SHARP),
    "lifted_plate": lifted_plate,
    "swung_cantilever": swung_cantilever,
    "bridge_plate": bridge_plate,
    "sine_plate": sine_plate,
}
SECOND_FORMS: dict[str, Values] = {
    "clamped_plate_uniform": partial(by_goursat, clamped_plate_uniform()),
    "clamped_plate_point": partial(by_goursat, clamped_plate_point()),
    "plate_2_1_uniform": partial(by_navier, plate_2_1_uniform()),
    "plate_2_1_point": partial(by_navier, plate_2_1_point()),
    "strip_plate_1_50": partial(by_navier, strip_plate_1_50(), 200),
    "rhombic_plate_60": partial(by_elements, 60.0),
    "rhombic_plate_30": partial(by_elements, 30.0),
    "ring_twist": ring_twist_by_ritz,
    "graded_strip": graded_strip_by_equilibrium,
    "oval_tube": oval_tube_by_exponentials,
    "rigid_turn_about_point": rigid_turn_by_exponential,
    "rigid_turn_by_edge": small_turn_by_generator,
    "pressed_motion": pressed_motion_of_splines,  # half a minute
    "twisted_parallelogram": parallelogram_by_ritz,
    "bent_plate": bent_plate_by_ritz,
    "sheared_sleeve": sleeve_by_ritz,
    "turned_cantilever": turned_cantilever_by_polynomials,
    "bedded_plate": bedded_plate_by_ritz,
    "guided_plate": guided_plate_by_ritz,
    "guided_ring": guided_ring_by_ritz,
    "hooked_cantilever": hooked_cantilever_by_polynomials,
    "sprung_motion": sprung_motion_by_splines,
    "pushed_plate": pushed_plate_by_newton,
    "pulled_motion": pulled_motion_of_a_chain,
    "raft": raft_by_ritz,
    "rippled_plate": rippled_plate_by_ritz,
    "blown_tube": blown_tube_by_samples,
    "pressed_oval": pressed_oval_by_harmonics,
    "pressed_ring": pressed_ring_by_potential,
    "uneven_pipe": uneven_pipe_by_statics,
    "held_corner": held_corner_by_ritz,
    "bent_in_plane": bent_in_plane_by_ritz,
    "turned_saddle": turned_saddle_by_simpson,
    "inclined_moments": inclined_moments_by_potential,
    "narrow_peak": partial(peak_by_galerkin, NARROW),
    "sharp_peak": partial(peak_by_galerkin, SHARP),
    "lifted_plate": lifted_plate_by_navier,
    "swung_cantilever": swung_cantilever_by_polynomials,
    "bridge_plate": bridge_plate_by_ritz,
    "sine_plate": sine_plate_by_polynomials,
}
