"""The panel on logarithmic axes: marks, limits, shade, ticks and slopes."""

import pytest
from matplotlib.figure import Figure

from shellbench.report.data.exhibit import Ink, style
from shellbench.report.data.rates import Rate
from shellbench.report.figures.panel import (
    BELOW,
    FLOOR_SHOWN,
    FOR_SLOPES,
    START,
    add_legend,
    draw,
    draw_slopes,
    entry,
    failed_entry,
    finish,
    open_figure,
    shade_entry,
    shade_start,
    step_words,
)

INK = Ink("#0072B2", "o")


@pytest.fixture
def axes():
    return Figure().subplots()


def labels(axis):
    """The labels of an axis that are in view."""
    axis.axes.figure.draw_without_rendering()
    low, high = sorted(axis.get_view_interval())
    return [t.get_text() for t, at in zip(axis.get_ticklabels(), axis.get_ticklocs(), strict=True) if low <= at <= high]


def test_decades_are_labelled_plain_numbers_where_few_are_in_view(axes):
    draw(axes, [1e2, 1e6], [1e-4, 10.0], INK)
    finish([axes], "unknowns", "error (%)", "A title")
    assert labels(axes.yaxis) == ["10⁻⁴", "10⁻³", "10⁻²", "10⁻¹", "1", "10"]
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_title(loc="left")) == ("unknowns", "error (%)", "A title")


def test_fewer_decades_have_more_labels_each(axes):
    draw(axes, [10.0, 50.0], [2.0, 3.0], INK)
    finish([axes])
    assert labels(axes.xaxis) == ["10", "20", "50"]
    assert labels(axes.yaxis) == ["1", "3"]


def test_what_was_told_to_be_linear_and_what_is_empty_have_no_logarithm(axes):
    finish([axes])
    assert axes.get_yscale() == "linear"
    draw(axes, [1.0, 2.0], [1.0, 2.0], INK)
    finish([axes], log="y")
    assert (axes.get_xscale(), axes.get_yscale()) == ("linear", "log")


def test_the_shade_ends_at_the_floor_and_is_drawn_where_it_is_in_view():
    _, (panels,) = open_figure((4.0, 2.0), 1, 2, sharey=True)
    for axes in panels:
        draw(axes, [1.0, 10.0], [1.0, 1e-3], INK)
    finish(panels, floor=[1e-2, 1e-9])
    assert [len(axes.patches) for axes in panels] == [1, 0]
    assert panels[0].patches[0].get_y() + panels[0].patches[0].get_height() == pytest.approx(1e-2)
    low, _ = panels[0].get_ylim()
    assert 1e-2 / FLOOR_SHOWN <= low < 1e-3


def test_a_slope_is_drawn_below_its_curve_with_its_words_at_its_end(axes):
    rate = Rate(slope=-2.0, factor=1.0, first=10.0, last=100.0)
    draw(axes, [10.0, 100.0], [100 * rate(10.0), 100 * rate(100.0)], INK)
    finish([axes], below=FOR_SLOPES)
    draw_slopes(axes, [(rate, "-2.0", INK.colour)], unit=10.0)
    slope = axes.get_lines()[-1]
    assert list(slope.get_xdata()) == [1.0, 10.0]
    assert list(slope.get_ydata()) == pytest.approx([100 * rate(x) / BELOW for x in (10.0, 100.0)])
    (text,) = axes.texts
    assert (text.get_text(), text.get_color()) == ("−2.0", INK.colour)
    end = axes.transAxes.inverted().transform(axes.transData.transform((1.0, slope.get_ydata()[1])))[1]
    assert text.get_position()[1] == pytest.approx(end)
    assert slope.get_ydata()[1] > axes.get_ylim()[0]


def test_open_marks_have_a_white_face_in_the_solvers_colour(axes):
    draw(axes, [1.0], [1.0], INK, "none", hollow=True)
    draw(axes, [1.0], [1.0], INK)
    opened, full = axes.get_lines()
    assert (opened.get_markerfacecolor(), opened.get_markeredgecolor()) == ("white", INK.colour)
    assert full.get_markerfacecolor() == full.get_color() == INK.colour


@pytest.mark.parametrize("points", [1, 2])
@pytest.mark.parametrize("look", [{}, {"marker": None}, {"line": "--", "hollow": True}])
def test_one_or_two_points_are_marks_without_a_line(axes, points, look):
    draw(axes, [1.0, 2.0][:points], [1.0, 2.0][:points], INK, **look)
    (drawn,) = axes.get_lines()
    assert drawn.get_linestyle() == "None"
    assert drawn.get_marker() not in (None, "None", "")


def test_three_points_have_a_line(axes):
    draw(axes, [1.0, 2.0, 3.0], [1.0, 2.0, 3.0], INK)
    assert axes.get_lines()[0].get_linestyle() == "-"


@pytest.mark.parametrize("floor", [1e-3, 1.0, 1e6])
def test_what_lies_far_below_the_uncertainty_is_still_in_view(axes, floor):
    draw(axes, [1.0, 2.0, 3.0], [1e-5, 2e-5, 4e-5], INK)
    finish([axes], floor=floor)
    low, high = axes.get_ylim()
    assert low < 4e-5 < high


@pytest.mark.parametrize("words", [["fem"], ["a solver with a long name"] * 2, ["uncertainty of the known value"] * 6])
def test_a_legend_lies_within_its_figure(words):
    figure, ((one,),) = open_figure((7.0, 2.5))
    draw(one, [1.0, 2.0, 3.0], [1.0, 2.0, 3.0], INK)
    add_legend(figure, {f"{text} {i}": entry(INK) for i, text in enumerate(words)})
    figure.draw_without_rendering()
    box = figure.legends[0].get_window_extent()
    assert box.x0 >= 0
    assert box.x1 <= figure.bbox.width


@pytest.mark.parametrize(("value", "words"), [(3e-9, "3·10⁻⁹"), (0.3, "0.3"), (2e12, "2·10¹²"), (500.0, "500")])
def test_ticks_are_written_as_people_write_them(value, words):
    assert step_words(value) == words


def test_one_legend_names_what_is_there():
    figure, _ = open_figure((4.0, 2.0))
    add_legend(figure, {"costs $": entry(INK)} | failed_entry(True) | failed_entry(False) | shade_entry(False))
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [r"costs \$", "failed or not settled"]


def lie_apart(boxes):
    return not any(one.overlaps(other) for i, one in enumerate(boxes) for other in boxes[:i])


@pytest.mark.parametrize("letters", [3, 60])
def test_a_legend_lies_within_its_figure_and_over_no_panel(letters):
    with style():
        figure, (panels,) = open_figure((7.4, 3.05), 1, 3)
        for axes in panels:
            draw(axes, [1e2, 1e6], [1e-4, 10.0], INK)
        finish(panels, "unknowns")
        add_legend(figure, {f"{place}{'m' * letters}": entry(INK) for place in range(9)})
        figure.draw_without_rendering()
    box = figure.legends[0].get_window_extent()
    assert box.x0 >= 0
    assert box.x1 <= figure.bbox.x1
    assert lie_apart([box, *(axes.get_tightbbox() for axes in panels)])
    assert all(axes.get_window_extent().height > 100 for axes in panels)  # a legend of many rows leaves them room


def test_words_of_slopes_lie_over_no_panel_and_over_no_other_words():
    rates = [Rate(slope=-1.0, factor=factor, first=10.0, last=100.0) for factor in (1.0, 1.1, 1.2, 8.0)]
    with style():
        figure, (panels,) = open_figure((7.4, 3.05), 1, 2)
        for axes in panels:
            for rate in rates:
                draw(axes, [10.0, 100.0], [100 * rate(10.0), 100 * rate(100.0)], INK)
            finish([axes], "unknowns", "difference (%)", below=FOR_SLOPES)
            draw_slopes(axes, [(rate, f"$N^{{-{place}.0}}$", INK.colour) for place, rate in enumerate(rates)])
        figure.draw_without_rendering()
    words = [text.get_window_extent() for axes in panels for text in axes.texts]
    assert lie_apart(words)
    assert not any(one.overlaps(axes.get_window_extent()) for one in words for axes in panels)
    ticks = [text.get_window_extent() for text in (*panels[1].get_yticklabels(), panels[1].yaxis.label)]
    assert not any(one.overlaps(other) for one in words for other in ticks)


def test_times_in_which_a_process_starts_are_told_only_where_they_are_in_view(axes):
    draw(axes, [0.01, 10.0], [1.0, 1e-3], INK)
    finish([axes])
    limits = axes.get_xlim()
    assert shade_start(axes)
    assert axes.get_xlim() == limits
    assert axes.patches[0].get_x() + axes.patches[0].get_width() == pytest.approx(START)
    axes.set_xlim(1.0, 10.0)
    assert not shade_start(axes)
