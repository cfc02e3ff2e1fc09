"""Marks: which state a figure belongs to, and in what words."""

from shellbench.bench import catalog
from shellbench.bench.marks import mark_of, mark_words, telling_mark
from tests.bench import spring


def test_a_turning_point_has_no_mark():
    case = spring.snapping_case()
    assert mark_of(case.quantity("limit")) is None
    assert telling_mark(case, case.quantity("limit")) == ""
    assert mark_of(case.quantity("load_15")) == 15.0


def test_a_mark_is_a_load_factor_or_the_displacement_of_the_path():
    assert mark_words(spring.loaded_case(), 0.25) == "t = 0.25"
    assert mark_words(spring.snapping_case(), 15.0) == "rise = 15 m"
    assert mark_words(catalog.named_case("hinged_roof_thin"), 12.0) == "deflection = 12 mm"


def test_a_mark_is_told_where_figures_belong_to_several_states():
    case = spring.loaded_case()
    assert [telling_mark(case, q) for q in case.quantities] == ["t = 0.5", "t = 1", "t = 0.5", "t = 1"]
    full = catalog.named_case("square_plate_nonlinear")  # its states beside the full load are for pictures
    assert {telling_mark(full, q) for q in full.quantities} == {""}
    linear = catalog.named_case("square_plate")
    assert {telling_mark(linear, q) for q in linear.quantities} == {""}
