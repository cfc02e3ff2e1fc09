"""Folded shells: both forms of each known value agree within what they state."""

import pytest

from derivations.folds import JUDGES, LONG, SECOND_FORMS


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.long] if n in LONG else []) for n in JUDGES])
def test_two_forms_agree(name):
    second = SECOND_FORMS[name]()
    for quantity, value in JUDGES[name]().items():
        assert abs(value.value - second[quantity].value) <= value.uncertainty + second[quantity].uncertainty, quantity
