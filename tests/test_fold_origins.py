"""Folded shells: both forms of each known value agree within what they state."""

import pytest

from derivations.folds import JUDGES, SECOND_FORMS
from derivations.z_section import vlasov_stress, z_section

LONG = {"folded_box", "folded_roof", "raasch_hook", "z_section"}


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.long] if n in LONG else []) for n in JUDGES])
def test_two_forms_agree(name):
    judged, second = JUDGES[name](), SECOND_FORMS[name]()
    assert judged.keys() == second.keys()
    for quantity, value in judged.items():
        other = second[quantity]
        assert abs(value.value - other.value) <= value.uncertainty + other.uncertainty, quantity


@pytest.mark.long
def test_the_z_section_is_near_the_theory_of_beams():
    assert z_section()["edge_stress"].value == pytest.approx(vlasov_stress(), rel=0.02)
