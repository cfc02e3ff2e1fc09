"""Shells that no suite has are answered as they were: nothing is tuned on them, and no gate looks at them."""

import json

import pytest

from tests.solvers.unseen import KEPT, SHELLS, answers

REPEATS = 1e-6
"""Relative. An emulated old processor changes the strip of `fem` by 8e-10, and fields by 2e-11."""


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", SHELLS)
def test_an_unseen_shell_is_answered_as_it_was(name: str) -> None:
    kept = json.loads(KEPT.read_text(encoding="utf-8"))[name]
    for solver, values in answers(name).items():
        assert values == pytest.approx(kept[solver], rel=REPEATS), solver


def test_the_shells_are_a_dozen_and_all_are_kept() -> None:
    assert len(SHELLS) == 12
    assert json.loads(KEPT.read_text(encoding="utf-8")).keys() == SHELLS.keys()
