"""Cost of a step of many ropes, as ratios: a skirt of 26 chains, and 10,000 chains; direct, by one sweep, compiled."""

import numpy as np
import pytest

from shellbench.solvers.rope.compiled import HERE
from shellbench.solvers.rope.stepping import Moving
from tests.solvers.rope.making import scheme, stepper


@pytest.mark.long
@pytest.mark.parametrize(
    "solve",
    ["direct", "sweeps", pytest.param("compiled", marks=pytest.mark.skipif(not HERE, reason="numba is not installed"))],
)
@pytest.mark.parametrize(("chains", "links"), [(1, 9), (26, 9), (10_000, 13)])
def test_a_step(benchmark, chains, links, solve):
    angles = np.radians(np.random.default_rng(0).uniform(-60, 60, chains))
    lengths = np.full((links, chains), 0.1)
    along = np.stack([np.sin(angles), 0 * angles, -np.cos(angles)], axis=-1)
    places = np.cumsum(lengths, axis=0)[..., None] * along
    chosen = {"compiled": True} if solve == "compiled" else {"solve": solve, "sweeps": 1}
    made = stepper(scheme(**chosen), lengths, np.ones((links, chains)), 9.81, 1 / 60)
    moving = made.next_state(Moving(0.0, places, np.zeros_like(places)))
    later = benchmark(made.after, moving)
    assert np.isfinite(later.places).all()
