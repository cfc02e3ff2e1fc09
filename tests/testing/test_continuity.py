"""Continuity of an answer along lines through it."""

from types import SimpleNamespace

import numpy as np

from shellbench.bench.catalogue.catalog import named_case
from shellbench.testing.answers import continuity

PLATE = named_case("square_plate")


def verdict_on(field):
    """Judge a field of the plate, which gives (n, 3) at points (n, 2)."""
    return continuity(SimpleNamespace(solve=lambda case: SimpleNamespace(displacement=field)), PLATE)


def test_a_hole_that_a_line_meets_is_no_continuous_answer():
    def field(points):
        u = np.repeat(np.sin(points[:, :1] / 30), 3, axis=-1)
        u[np.abs(points[:, 0] - 43.0) < 0.5] = np.nan
        return u

    verdict = verdict_on(field)
    assert (verdict.status, verdict.words) == ("failed", "it is not finite along 12 lines")


def test_a_kink_is_continuous_and_a_step_is_not():
    assert verdict_on(lambda points: np.abs(points[:, [0, 0, 0]] - 43.0)).status == "passed"
    assert verdict_on(lambda points: np.where(points[:, [0, 0, 0]] > 43.0, 1.0, 0.0)).status == "failed"
