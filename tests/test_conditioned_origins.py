"""Known values at the held-out materials: drawn here and there alike, and what two independent series compute."""

import pytest

from derivations import conditioned
from derivations.conditioned import COUNT, QUESTIONS
from shellbench.bench.catalogue import catalog

FORMS = {"judge": 0, "origin": 1}
FIRST = range(1)  # materials of the quick test
EVERY_OTHER = {  # materials of the long test
    "conditioned_plate": 1,
    "conditioned_roof": 4,
    "conditioned_cylinder": 7,
    "conditioned_napkin": 7,
}


@pytest.mark.parametrize("name", QUESTIONS)
def test_the_held_out_materials_are_those_of_the_case(name):
    case, question = catalog.named_case(name), QUESTIONS[name]
    assert len(case.materials) == COUNT
    for drawn, material in zip(question.materials, case.materials, strict=True):
        assert drawn == pytest.approx(tuple(material), rel=1e-12)
        assert case.ranges.outside(material) is None


@pytest.mark.parametrize(
    ("name", "numbers"),
    [
        ("conditioned_plate", FIRST),
        *(pytest.param(name, range(0, COUNT, step), marks=pytest.mark.long) for name, step in EVERY_OTHER.items()),
    ],
)
@pytest.mark.parametrize("role", FORMS)
def test_known_values_are_what_their_origins_compute(name, numbers, role):
    known = catalog.known_values(name)
    for quantity, estimate in conditioned.conditioned(name, FORMS[role], numbers).items():
        (kept,) = known.of(quantity, role)
        assert abs(kept.value - estimate.value) <= kept.uncertainty + 1e-14 * abs(kept.value), quantity
        assert kept.uncertainty >= 0.5 * estimate.uncertainty, quantity
