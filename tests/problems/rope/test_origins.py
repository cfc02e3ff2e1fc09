"""Known values of ropes: each figure has a judge and a second origin, both recomputed here."""

import pytest

from derivations import ropes
from shellbench.bench.catalogue import catalog

CASES = sorted(ropes.JUDGES)


def test_every_rope_has_both_forms():
    assert ropes.JUDGES.keys() == ropes.SECOND_FORMS.keys()
    assert {name for name in catalog.case_names() if name.startswith("rope_")} == ropes.JUDGES.keys()


@pytest.mark.parametrize("name", CASES)
def test_the_second_form_is_what_the_file_says(name):
    known, computed = catalog.known_values(name), ropes.SECOND_FORMS[name]()
    assert computed.keys() == {quantity.name for quantity in catalog.named_case(name).quantities}
    for quantity, estimate in computed.items():
        (origin,) = known.of(quantity, "origin")
        assert abs(origin.value - estimate.value) <= max(0.1 * origin.uncertainty, 1e-14 * abs(origin.value))
        assert estimate.uncertainty <= 1.1 * origin.uncertainty


@pytest.mark.parametrize("name", CASES)
def test_both_forms_agree(name):
    judges, seconds = ropes.JUDGES[name](), ropes.SECOND_FORMS[name]()
    for quantity, judge in judges.items():
        second = seconds[quantity]
        assert abs(judge.value - second.value) <= judge.uncertainty + second.uncertainty, quantity
