"""Paths as data: what controls them, where they end, and which of their states are kept."""

import pytest
from pydantic import ValidationError

from shellbench.problems.shell.question.path import Path


def test_a_path_is_loaded_to_one_unless_told():
    path = Path()
    assert (path.control, path.quantity, path.until, path.states) == ("load", None, 1.0, ())
    assert path.after_buckling == "stop"


@pytest.mark.parametrize("control", ["displacement", "arc_length"])
def test_a_path_by_displacement_names_its_quantity(control):
    assert Path(control=control, quantity="w", until=30, states=(10, 20)).quantity == "w"


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"control": "displacement"}, ["names its displacement quantity", "'load'"]),
        ({"control": "arc_length"}, ["names its displacement quantity"]),
        ({"control": "load", "quantity": "w"}, ["only if", "'load'"]),
        ({"quantity": "w"}, ["only if"]),
        ({"control": "work", "quantity": "w"}, ["control", "arc_length"]),
        ({"until": 0}, ["until", "greater than 0"]),
        ({"until": -1}, ["until", "greater than 0"]),
        ({"until": float("inf")}, ["until"]),
        ({"until": float("nan")}, ["until"]),
        ({"states": [0.0]}, ["states", "greater than 0"]),
        ({"states": [0.5, 1.5]}, ["the path ends at 1", "beyond"]),
        ({"control": "displacement", "quantity": "w", "until": 2, "states": [2.1]}, ["the path ends at 2", "beyond"]),
        ({"quantity": "1w", "control": "displacement"}, ["quantity"]),
        ({"end": 2}, ["end"]),
        ({"after_buckling": "jump"}, ["after_buckling", "follow"]),
        ({"control": "arc_length", "quantity": "w", "after_buckling": "follow"}, ["'follow'", "control = 'load'"]),
    ],
)
def test_an_impossible_path_is_refused(data, words):
    with pytest.raises(ValidationError) as caught:
        Path.model_validate(data)
    for word in words:
        assert word in str(caught.value)


def test_the_end_itself_may_be_kept():
    assert Path(until=2.0, states=(2.0,)).states == (2.0,)
