"""Known values of fields: each figure has a judge and a second origin, both recomputed here."""

import pytest

from derivations import field_closed, fields
from shellbench.bench.catalogue import catalog

CASES = sorted(fields.JUDGES)


def test_every_field_has_both_forms():
    assert fields.JUDGES.keys() == fields.SECOND_FORMS.keys()
    assert {name for name in catalog.case_names() if name.startswith("field_")} == fields.JUDGES.keys()


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(
            n, marks=[pytest.mark.long] if n in ("field_ball", "field_drape", "field_torus", "field_prism") else []
        )
        for n in CASES
    ],
)
def test_both_forms_agree_and_are_what_the_file_says(name):
    known, judges, seconds = catalog.known_values(name), fields.JUDGES[name](), fields.SECOND_FORMS[name]()
    assert judges.keys() == seconds.keys() == {quantity.name for quantity in catalog.named_case(name).quantities}
    for quantity, second in seconds.items():
        judge = judges[quantity]
        assert abs(judge.value - second.value) <= judge.uncertainty + second.uncertainty, quantity
        (origin,) = known.of(quantity, "origin")
        assert abs(origin.value - second.value) <= max(0.1 * origin.uncertainty, 1e-14 * abs(origin.value))
        assert second.uncertainty <= 1.1 * origin.uncertainty


def test_the_bias_of_adaptive_samples_has_two_forms():
    assert field_closed.biased_elongation() == pytest.approx(field_closed.biased_by_quadrature(), rel=1e-12)
    linear = field_closed.WEIGHT / (9 / 4 * field_closed.STRAIN_WEIGHT) / 2
    assert linear == pytest.approx(8.8889e-3, rel=1e-5)
    assert field_closed.biased_elongation() / linear - 1 == pytest.approx(-0.2747, abs=1e-4)


def test_the_smallest_strains_and_curvatures_measure_what_section_3_says():
    """3 (2 tr E^2 + tr^2 E)/8, whatever the directions of E."""
    import numpy as np

    strain = 1e-6 * np.array([[2.0, 0.5], [0.5, -1.0]])
    exact = 3 * (2 * np.trace(strain @ strain) + np.trace(strain) ** 2) / 8
    assert field_closed.strain_loss_by_directions(np.eye(2) + strain) == pytest.approx(exact, rel=1e-5)
