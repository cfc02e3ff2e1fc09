"""The share of a garment's vertices that lie in the body: none, whatever the motion.

A body is impenetrable: the signed distance phi of a cloth's vertex is never negative. A cloth that is pushed out along the
gradient of phi, to phi = margin, is outside too, which the second form computes for a capsule.
"""

from __future__ import annotations

import numpy as np

from derivations.estimate import Estimate

RADIUS, MARGIN = 0.14, 0.005  # m
AXIS = np.array([[0.0, 0.0, -0.1], [0.0, 0.0, -0.5]])  # of the trunk, m


def inside() -> dict[str, Estimate]:
    """Return the share of an impenetrable body's neighbours that are inside it."""
    return {"inside": Estimate(0.0, 0.0, "")}


def distance(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return distances (n,), m, of places (n, 3) from the capsule, and their gradients (n, 3)."""
    along = AXIS[1] - AXIS[0]
    share = np.clip((places - AXIS[0]) @ along / (along @ along), 0.0, 1.0)
    apart = places - AXIS[0] - share[:, None] * along
    lengths = np.linalg.norm(apart, axis=1)
    return lengths - RADIUS, apart / lengths[:, None]


def inside_after_pushes() -> dict[str, Estimate]:
    """Return the share of places that are inside after those below the margin were pushed to it."""
    places = np.random.default_rng(0).uniform([-0.3, -0.3, -0.8], [0.3, 0.3, 0.2], (10_000, 3))
    phi, out = distance(places)
    places = places + np.maximum(MARGIN - phi, 0.0)[:, None] * out
    return {"inside": Estimate(float((distance(places)[0] < 0).mean()), 0.0, "")}


JUDGES = {"cape_run": inside, "skirt_run": inside}
SECOND_FORMS = {"cape_run": inside_after_pushes, "skirt_run": inside_after_pushes}
