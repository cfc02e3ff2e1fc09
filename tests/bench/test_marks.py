"""Marks: which state a figure belongs to, and in what words."""

from shellbench.bench.catalogue import catalog
from tests.bench import spring


def test_a_turning_point_has_no_mark():
    case = spring.snapping_case()
    assert case.quantity("limit").mark is None
    assert case.telling_mark(case.quantity("limit")) == ""
    assert case.quantity("load_15").mark == 15.0


def test_a_mark_is_a_load_factor_or_the_displacement_of_the_path():
    assert spring.loaded_case().mark_words(0.25) == "t = 0.25"
    assert spring.snapping_case().mark_words(15.0) == "rise = 15 m"
    assert catalog.named_case("hinged_roof_thin").mark_words(12.0) == "deflection = 12 mm"


def test_a_mark_is_told_where_figures_belong_to_several_states():
    case = spring.loaded_case()
    assert [case.telling_mark(q) for q in case.quantities] == ["t = 0.5", "t = 1", "t = 0.5", "t = 1"]
    full = catalog.named_case("square_plate_nonlinear")  # its states beside the full load are for pictures
    assert {full.telling_mark(q) for q in full.quantities} == {""}
    linear = catalog.named_case("square_plate")
    assert {linear.telling_mark(q) for q in linear.quantities} == {""}
