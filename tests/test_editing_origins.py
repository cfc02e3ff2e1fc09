"""Known values of edited shells are what two independent forms compute."""

import pytest

from derivations.edits import EDITS
from shellbench.bench.catalogue import catalog

LONG = ("edit_roof_thickness", "edit_cantilever_force", "edit_cantilever_pose")


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.long) if n in LONG else n for n in EDITS])
def test_known_values_are_what_their_origins_compute(name):
    for form, role in enumerate(("judge", "origin")):
        for quantity, estimate in EDITS[name](form).items():
            (kept,) = catalog.known_values(name).of(quantity, role)
            assert abs(kept.value - estimate.value) <= kept.uncertainty, quantity
            assert kept.uncertainty >= 0.5 * estimate.uncertainty
