"""Functions that judge the cases of ropes, and their second forms."""

from functools import partial

from . import rope_closed as closed
from . import rope_motion as motion
from . import rope_springs as springs

JUDGES = {
    "rope_static": closed.rope_static,
    "rope_falling_root": closed.rope_falling_root,
    "rope_circle": closed.rope_circle,
    "rope_pendulum": motion.rope_pendulum,
    "rope_nine_links": motion.rope_nine_links,
    "rope_unequal_links": motion.rope_unequal_links,
    "rope_jerk": closed.rope_jerk,
    "rope_drop": closed.rope_drop,
    "rope_catch": motion.rope_catch,
    "rope_wind": closed.rope_wind,
    "rope_long": partial(closed.rope_wind, 100),
    "rope_skirt": motion.rope_skirt,
    "rope_crowd_400": partial(motion.rope_crowd, 400),
    "rope_crowd_10000": partial(motion.rope_crowd, 10_000),
    "rope_ball": closed.rope_ball,
    "rope_plate": closed.rope_plate,
    "rope_incline_slides": closed.rope_incline_slides,
    "rope_incline_sticks": closed.rope_incline_sticks,
    "rope_lateral_rest": springs.rope_lateral_rest,
    "rope_lateral": springs.rope_lateral,
    "rope_decay": springs.rope_decay,
    "rope_damped": springs.rope_damped,
    "rope_of_springs": springs.rope_of_springs,
}
SECOND_FORMS = {
    "rope_static": closed.rope_static_by_multipliers,
    "rope_falling_root": closed.rope_falling_root_by_multipliers,
    "rope_circle": closed.rope_circle_by_newton,
    "rope_pendulum": motion.rope_pendulum_by_elliptic_functions,
    "rope_nine_links": motion.rope_nine_links_by_hamilton,
    "rope_unequal_links": motion.rope_unequal_links_by_hamilton,
    "rope_jerk": closed.rope_jerk_by_least_squares,
    "rope_drop": closed.rope_drop_by_time,
    "rope_catch": motion.rope_catch_by_elliptic_functions,
    "rope_wind": closed.rope_wind_by_moments,
    "rope_long": partial(closed.rope_wind_by_moments, 100),
    "rope_skirt": motion.rope_skirt_by_hamilton,
    "rope_crowd_400": partial(motion.rope_crowd_by_hamilton, 400),
    "rope_crowd_10000": partial(motion.rope_crowd_by_hamilton, 10_000),
    "rope_ball": closed.rope_ball_from_the_ball,
    "rope_plate": closed.rope_plate_by_time,
    "rope_incline_slides": closed.rope_incline_slides_by_energy,
    "rope_incline_sticks": closed.rope_incline_sticks_by_cone,
    "rope_lateral_rest": springs.rope_lateral_rest_by_a_polynomial,
    "rope_lateral": springs.rope_lateral_by_hamilton,
    "rope_decay": springs.rope_decay_by_newton,
    "rope_damped": springs.rope_damped_by_hamilton,
    "rope_of_springs": springs.rope_of_springs_by_forces,
}
