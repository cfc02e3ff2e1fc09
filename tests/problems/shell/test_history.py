"""Uncertainties of a solution, together with those of its single values."""

import pytest

from shellbench.bench.catalogue.catalog import named_case
from shellbench.problems.shell.records.history import COMPONENT, moving_uncertainty


def test_a_component_that_changes_little_by_chance_is_no_surer_than_its_place():
    case = named_case("pendulum_strip")
    values = {q.name: 1.0 for q in case.quantities}
    apart = {q.name: 1e-9 for q in case.quantities} | {"centre_z_750ms": 1e-5, "tip_x_500ms": 1e-4}
    sure = moving_uncertainty(case, values, apart)
    assert sure["centre_x_750ms"] == COMPONENT * 1e-5
    assert sure["tip_z_500ms"] == COMPONENT * 1e-4
    # another place, another time, another kind
    assert sure["tip_x_750ms"] == sure["centre_x_1000ms"] == sure["kinetic_energy_750ms"] == 1e-9
    assert all(sure[name] >= apart[name] for name in apart)


def test_energy_that_a_motion_from_rest_has_gained_is_an_error():
    case = named_case("pendulum_strip")
    values = {q.name: 0.1 for q in case.quantities} | {"total_energy_500ms": -3e-6}
    sure = moving_uncertainty(case, values, {q.name: 1e-9 for q in case.quantities})
    assert sure["total_energy_500ms"] == 3e-6
    assert sure["kinetic_energy_500ms"] == 1e-9


@pytest.mark.parametrize("name", ["pendulum_strip", "napkin_soft_pin"])
def test_figures_that_say_nothing_stay_silent(name):
    case = named_case(name)
    assert moving_uncertainty(case, {}, {}) == {}
