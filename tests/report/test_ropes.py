"""Section "Ropes": curves of what a suite sweeps, laws of what falls, ribbons of frames, and its page."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.row import Row
from shellbench.bench.plugins.kinds import headline_of, portrait_of_named
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.fields import BREADTH, read_ribbon
from shellbench.report.data.section import Section
from shellbench.report.studies.ropes import curves, law, reached_at, reached_table, side_by_side
from shellbench.report.studies.speed import Pace, paces, speed_figure, speed_table

KNOWN = -0.5


def row(solver, value, label="", **settings):
    return Row(
        case="rope_nine_links", suite=None, solver=solver, settings={"rate": 60, "again": False} | settings, seed=None,
        quantity="tip_x", primary=True, at=1.0, value=value, status="ok", reference=KNOWN, seconds=1.0, label=label,
        overrides=settings, default_settings=not settings, unit="m", run_id=f"{solver} {settings}",
    )  # fmt: skip


def swept(errors, solver="one", **others):
    return [
        row(solver, KNOWN + error, f"word, rate {60 * 2**i}", rate=60 * 2**i, **others)
        for i, error in enumerate(errors)
    ]


def test_runs_that_differ_in_one_number_are_a_curve():
    rows = swept([0.04, 0.01, 0.0025]) + swept([0.1, 0.1, 0.1], again=True) + swept([0.1, 0.2], "two")
    one, other = curves(rows)
    assert (one.solver, one.setting, one.values, one.others) == ("one", "rate", (60, 120, 240), "word")
    assert one.errors == pytest.approx([0.08, 0.02, 0.005])
    assert other.errors == pytest.approx([0.2] * 3)


def test_only_what_falls_has_a_law():
    falls, levels, crosses = (
        curves(swept(errors))[0] for errors in ([0.04, 0.01, 0.0025], [0.1] * 3, [0.1, 0.01, 0.05])
    )
    assert law(falls).slope == pytest.approx(-2)
    assert law(levels) is law(crosses) is None


def curve(*errors, floor=0.0):
    """Return a curve of runs that each take twice the steps, and four times the seconds, of the one before."""
    one = curves(swept([0.04, 0.01, 0.0025]))[0]
    count = range(len(errors))
    changed = {"values": [60.0 * 2**i for i in count], "seconds": [4.0**i for i in count]}
    return replace(one, errors=errors, floor=floor, **changed)


def test_what_an_error_takes_is_read_between_runs():
    """Errors fall as the square of the steps, and seconds grow as their square: seconds times the error are constant."""
    squares = curve(0.16, 0.04, 0.01, 0.0025)
    for level in (0.1, 0.02, 0.004):
        assert reached_at(squares, level) == pytest.approx((0.16 / level, 60 * (0.16 / level) ** 0.5, False))
    assert reached_at(squares, 0.2) == (1.0, 60.0, True)
    assert reached_at(squares, 0.002) is None


def test_an_error_is_reached_where_no_later_run_is_farther_off():
    through_zero = curve(0.1, 1e-5, 0.01, 1e-3)
    assert reached_at(through_zero, 2e-3)[1] > 240
    assert reached_at(curve(0.1, 0.01, 1e-4, 0.01), 1e-3) is None
    assert reached_at(curve(0.1, 0.01, 1e-5, floor=2e-4), 1e-4) is None
    assert reached_at(curve(0.1, 0.0), 1e-3)[1] == pytest.approx(60, rel=0.01)


def test_the_table_of_what_errors_take():
    rows = [
        row("one", KNOWN * (1 + error), steps_per_second=60 * 2**i).model_copy(update={"seconds": 4.0**i})
        for i, error in enumerate([0.16, 0.04, 0.01, 0.0025])
    ]
    text = reached_table(rows).write("markdown")
    assert "1.6 (76)" in text
    assert "16 (240)" in text
    assert not len(reached_table(swept([0.1, 0.1, 0.1])).data)


def test_solvers_stand_beside_what_is_known():
    table = side_by_side([row("one", -0.51), row("two", -0.49), *swept([0.1, 0.2, 0.3])])
    (line,) = table.data.to_dict("records")
    assert (line["known"], line["one"], line["two"]) == (KNOWN, -0.51, -0.49)
    assert "-0.51" in table.write("csv")


def test_a_ribbon_is_the_chain_frame_by_frame(tmp_path):
    case = portrait_of_named(catalog.named_case("rope_nine_links"))
    frames = np.random.default_rng(0).normal(size=(4, 10, 3))
    np.savez(tmp_path / "kept.npz", frame_times=np.arange(4.0), frames=frames)

    class Kept:
        fields_file = "kept.npz"

    ribbon = read_ribbon(Kept(), tmp_path, case)
    assert ribbon.marks == pytest.approx(np.arange(4.0))
    middle = (ribbon.position + ribbon.displacements).mean(axis=2)
    assert middle == pytest.approx(frames)
    length = np.linalg.norm(np.diff(frames[0], axis=0), axis=1).sum()
    assert np.ptp(ribbon.position, axis=1) == pytest.approx(np.tile([0, 2 * BREADTH * length, 0], (10, 1)))


class Ran:
    """A record with the data of a pace only: the last of three levels takes 0.63 s for 100 steps."""

    def __init__(self, case, run_id, threads=1):
        self.case, self.run_id = {"name": case, **catalog.named_case(case).data()}, run_id
        self.environment = SimpleNamespace(threads=threads)
        levels = [(25, 9.0), (50, 9.2), (100, 9.83)]
        self.history = [SimpleNamespace(iterations=steps, seconds=seconds) for steps, seconds in levels]


def fast(case, solver, label, suite="rope_speed"):
    made = row(solver, KNOWN + 0.01, label, rate=1)
    told = {"case": case, "suites": (suite,), "declared": True, "absolute_error": 0.01, "run_id": f"{case} {label}"}
    return made.model_copy(update=told)


def test_a_pace_is_of_the_last_level_and_of_all_links():
    rows = [fast("rope_skirt", "one", "plain"), fast("rope_crowd_400", "one", "plain")]
    rows += [fast("rope_nine_links", "two", "strict", "rope_convergence"), fast("rope_ball", "two", "loose")]
    records = {r.run_id: Ran(r.case, r.run_id, 2) for r in rows}
    counted = paces(Evidence(records, rows, None))
    assert [(pace.all_links, pace.name) for pace in counted] == [
        (234, "one, plain, 2 threads"),
        (5200, "one, plain, 2 threads"),
    ]
    assert [pace.steps for pace in counted] == pytest.approx([100 / 0.63] * 2)
    text = speed_table(counted).write("markdown")
    assert "26 x 9" in text
    assert "1.0e-02 m" in text
    axes = speed_figure(Evidence(records, rows, None), counted).axes[0]
    assert axes.get_xscale() == axes.get_yscale() == "log"
    assert axes.lines[0].get_xdata() == pytest.approx([234, 5200])


def test_the_legend_of_paces_is_whole():
    """Of all labels that the suite of speeds declares, on one thread and on two."""
    declared = {(runs.solver, runs.label) for runs in catalog.find_suite("rope_speed").runs}
    counted = [
        Pace("rope_skirt", "Skirt", 26, 9, solver, label, threads, 100.0, "", "")
        for solver, label in sorted(declared)
        for threads in (1, 2)
    ]
    rows = [row(solver, KNOWN) for solver, _ in declared]
    figure = speed_figure(Evidence({}, rows, None), counted)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    (legend,) = figure.legends
    assert len(legend.get_texts()) == len(counted)
    inside = legend.get_window_extent(canvas.get_renderer())
    assert 0 <= inside.x0 < inside.x1 <= figure.bbox.width
    assert figure.axes[0].get_position().height > 0.4


def test_a_section_is_called_as_what_it_is_about():
    def headed(*headings):
        tables = [replace(side_by_side([row("one", -0.5), row("two", -0.5)]), heading=heading) for heading in headings]
        return Section("displacements", "Figures", tables=tuple(tables)).retitled()

    both = headed("Displacements", "Places and tensions; Displacements")
    assert both.title == "Displacements; Places and tensions"
    one = both.with_each(lambda table: table if table.heading == "Displacements" else None, lambda _: True)
    assert one.title == "Displacements"
    assert headed("").title == "Figures"
    assert headline_of("rope", "m") == "Places and tensions"
    assert headline_of("shell", "m") == headline_of("", "m") == "Displacements"
    assert headline_of("unheard", "m") == "Headline figures"


def test_loose_masses_and_chains_at_rest_have_no_frames():
    for name in ("rope_ball", "hanging_chain"):
        assert portrait_of_named(catalog.named_case(name)).frames is None
    assert not portrait_of_named(catalog.named_case("hanging_chain")).steps_in_time
