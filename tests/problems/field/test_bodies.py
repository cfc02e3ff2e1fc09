"""Bodies: distances have unit slopes and vanish on the surface; normals and curvatures are their slopes."""

import numpy as np
import pytest

from shellbench.problems.field.body import Ball, Prism, Torus

RANDOM = np.random.default_rng(11)
CENTRE = (0.5, 0.4, -0.1)
PRISMS = [
    Prism(kind="prism", centre=CENTRE, corners=n, turn=10.0, radius=0.25, height=0.2, rounding=0.03) for n in (3, 4, 6)
]
BODIES = [Ball(centre=CENTRE, radius=0.2), Torus(kind="torus", centre=CENTRE, ring=0.25, tube=0.1), *PRISMS]


@pytest.mark.parametrize("body", BODIES, ids=lambda body: f"{body.kind}{getattr(body, 'corners', '')}")
def test_normals_and_curvatures_are_slopes(body):
    places, step = CENTRE + RANDOM.uniform(-0.5, 0.5, (1000, 3)), 1e-6
    ends = [(places + step * way, places - step * way) for way in np.eye(3)]
    slopes = np.stack([(body.distance(up) - body.distance(down)) / (2 * step) for up, down in ends], axis=1)
    distance, normal = body.contact(places)
    assert normal == pytest.approx(slopes, abs=1e-7)
    assert np.linalg.norm(normal, axis=1) == pytest.approx(1, abs=1e-12)
    turns = np.stack([(body.contact(up)[1] - body.contact(down)[1]) / (2 * step) for up, down in ends], axis=1)
    assert body.curvature(places) == pytest.approx(turns, abs=1e-4)
    near = np.abs(distance) < 0.02  # from where the foot of the perpendicular is the nearest place of the surface
    assert body.distance(places - distance[:, None] * normal)[near] == pytest.approx(0, abs=1e-14)


@pytest.mark.parametrize(
    ("body", "place", "distance"),
    [
        (BODIES[1], (0.0, 0.0, 0.0), 0.15),  # in the middle of the hole
        (BODIES[1], (0.25, 0.0, 0.0), -0.1),
        (BODIES[1], (0.0, -0.25, 0.3), 0.2),
        (BODIES[1], (0.55, 0.0, 0.4), 0.4),  # 3, 4, 5
        (PRISMS[1], (0.0, 0.0, 0.2), 0.1),
        (PRISMS[1], (0.0, 0.0, 0.08), -0.02),
        (PRISMS[1], (0.3 * np.cos(np.pi / 18), 0.3 * np.sin(np.pi / 18), 0.0), 0.05 + 0.03 * (np.sqrt(2) - 1)),
        (PRISMS[0], (-0.3 * np.cos(np.pi / 18), -0.3 * np.sin(np.pi / 18), 0.0), 0.175),  # of a side
    ],
)
def test_distances_that_are_plain_to_see(body, place, distance):
    assert body.distance(np.array([CENTRE]) + place) == pytest.approx(distance, abs=1e-12)
