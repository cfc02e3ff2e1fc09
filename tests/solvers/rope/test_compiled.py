"""Compiled steps are the same steps: they agree to rounding, whatever a chain does."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError
from shellbench.solvers.rope import compiled
from shellbench.solvers.rope.compiled import HERE
from shellbench.solvers.rope.solver import ExactSolver
from shellbench.solvers.rope.stepping import Chains, Moving, Stepper
from tests.solvers.rope.making import scheme

STEPS = 5
ROUNDING = 1e-10  # of the lengths, and of the speeds: a few steps of a motion that may jerk


@pytest.mark.long
@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, 7),
    st.integers(1, 4),
    st.fixed_dictionaries(
        {"printed": st.booleans(), "placing": st.sampled_from(["rotation", "projection"]), "again": st.booleans()}
    ),
)
@settings(max_examples=40, deadline=None)
def test_they_agree_to_rounding(seed, links, chains, chosen):
    """Chains of unequal masses, some links slack, in wind, on roots that move each by itself."""
    random = np.random.default_rng(seed)
    steps = random.normal(size=(links, chains, 3))
    steps /= np.linalg.norm(steps, axis=-1, keepdims=True)
    lengths, masses = random.uniform(0.1, 0.3, (links, chains)), random.uniform(0.2, 3.0, (links, chains))
    slack = np.where(random.uniform(size=(links, chains)) < 0.3, random.uniform(0.5, 0.95, (links, chains)), 1.0)
    pace, pull = random.normal(size=(2, chains, 3))

    def root(t):
        return pace * t + pull * t**2 / 2, pace + pull * t, pull

    made = Chains(lengths, masses, 9.81, root, 0.5, np.array([4.0, 1.0, 0.0]))
    places = root(0.0)[0] + np.cumsum((slack * lengths)[..., None] * steps, axis=0)
    plain = fast = Moving(0.0, places, random.normal(size=places.shape))
    for _ in range(STEPS):
        plain = Stepper(made, scheme(**chosen), 1 / 240).next_state(plain)
        fast = Stepper(made, scheme(**chosen, compiled=True), 1 / 240).next_state(fast)
        assert fast.time == plain.time
        assert fast.places == pytest.approx(plain.places, abs=ROUNDING)
        assert fast.velocities == pytest.approx(plain.velocities, abs=ROUNDING * max(1, np.abs(plain.velocities).max()))


@pytest.mark.long
def test_threads_that_share_chains_take_the_same_steps(monkeypatch):
    random = np.random.default_rng(1)
    places = np.cumsum(random.normal(size=(3, 7, 3)), axis=0)
    lengths = np.linalg.norm(np.diff(places, axis=0, prepend=0), axis=-1)
    still = (np.zeros((7, 3)),) * 3
    made = Chains(lengths, random.uniform(0.5, 2.0, (3, 7)), 9.81, lambda _: still)
    moving = Moving(0.0, places, random.normal(size=places.shape))
    alone = Stepper(made, scheme(compiled=True), 1 / 60).next_state(moving)
    monkeypatch.setattr(compiled, "ENOUGH", 5)
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    shared = Stepper(made, scheme(compiled=True), 1 / 60).next_state(moving)
    assert np.abs(shared.places - places).max() > 0
    assert shared.places == pytest.approx(alone.places, abs=ROUNDING)
    assert shared.velocities == pytest.approx(alone.velocities, abs=ROUNDING)


def test_what_is_not_compiled_is_refused():
    with pytest.raises(ValueError, match="exclude each other"):
        ExactSolver().solve(catalog.named_case("rope_static"), {"compiled": True, "solve": "sweeps"})
    words = "know no obstacles" if HERE else "not installed"
    with pytest.raises(InputError, match=words):
        ExactSolver().solve(catalog.named_case("rope_ball"), {"compiled": True})


@pytest.mark.skipif(not HERE, reason="numba is not installed")
@pytest.mark.parametrize("compiles", [False, pytest.param(True, marks=pytest.mark.long)])  # which takes ten seconds
@pytest.mark.parametrize("name", ["rope_nine_links", "rope_catch", "rope_jerk"])
def test_a_case_has_the_same_figures(name, compiles, monkeypatch):
    if not compiles:
        for function in [name for name, found in vars(compiled).items() if hasattr(found, "py_func")]:
            monkeypatch.setattr(compiled, function, getattr(compiled, function).py_func)
    case = catalog.named_case(name)
    plain, fast = (ExactSolver().solve(case, {"steps_per_second": 120.0, "compiled": quick}) for quick in (False, True))
    for quantity in case.quantities:
        assert quantity.measure(fast) == pytest.approx(quantity.measure(plain), rel=1e-9, abs=1e-10)
