"""Cloth in motion: traces, differences over time, strips of frames, tables by time; torque along a buckling path."""

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.problems.shell.records.portrait import ShellPortrait
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import inks, style
from shellbench.report.data.fields import read_fields
from shellbench.report.data.runs import leading_rows
from shellbench.report.data.traces import (
    BALANCE,
    CLOTH,
    Trace,
    TracedRun,
    apart,
    frame_at,
    known_points,
    rms_difference,
    shown_marks,
    traced,
    yardstick,
)
from shellbench.report.figures.shells import shapes_figure
from shellbench.report.figures.trace_figure import TracePanel, trace_figure
from shellbench.report.studies.trace_exhibits import MOST_FRAMES, is_cloth, motion_exhibits, path_exhibits
from shellbench.report.studies.trace_tables import by_time_tables, motion_table
from tests.report.motion import BROKEN, CRITICAL, OFFSET, REASON, G, torque

G_HALF = G / 8  # m fallen in half of a second


@pytest.fixture(scope="module")
def by_id(motion):
    return {record.run_id: record for record in motion.records}


@pytest.fixture(scope="module")
def exhibits(motion, by_id):
    with style():
        return {
            one.name: one for one in motion_exhibits(Evidence(by_id, motion.rows, motion.folder, motion.known_values))
        }


def record_of(motion, case, solver):
    return next(r for r in motion.records if (r.case_name, r.identity.solver) == (case, solver))


def runs_of(motion, by_id, case):
    return Evidence(by_id, [row for row in motion.rows if row.case == case], motion.folder).made


def test_a_run_is_traced_as_it_was_recorded(motion):
    record = record_of(motion, "free_fall", "fem")
    run = traced(record, ShellPortrait(catalog.named_case("free_fall")), "fem")
    fall = run.traces["fall"]
    assert fall.values == pytest.approx(G * fall.marks**2 / 2, abs=1e-12)
    assert run.traces[BALANCE].marks[0] == 0.0
    assert len(run.traces[BALANCE].marks) == 1 + sum(step.phase == "time" for step in record.history)
    assert run.reason is None
    assert run.special == {}


def test_a_failed_run_is_traced_as_far_as_it_came(motion):
    run = traced(record_of(motion, "pendulum_strip", "ndf"), ShellPortrait(catalog.named_case("pendulum_strip")), "ndf")
    assert run.reason == REASON
    assert {trace.marks[-1] for trace in run.traces.values()} == {BROKEN}
    assert run.traces["tip_x"].at(BROKEN) is not None
    assert run.traces["tip_x"].at(0.75) is None


def test_a_trace_is_read_between_its_marks_and_not_beyond():
    trace = Trace(np.array([0.0, 1.0, 3.0]), np.array([0.0, 2.0, 6.0]))
    assert trace.at(0.25) == pytest.approx(0.5)
    assert trace.at(3.0 + 1e-12) == 6.0
    assert trace.at(3.01) is None
    assert trace.at(-0.01) is None
    assert Trace(np.empty(0), np.empty(0)).at(0.0) is None


def test_known_values_stand_at_their_times_with_their_uncertainty(motion):
    case = ShellPortrait(catalog.named_case("napkin_plane"))
    corner = next(one for one in case.along if one.name == "corner_x")
    judge, origin = known_points(case, motion.known_values(case.name), corner)
    assert (judge.label, judge.judges) == ("known value", True)
    assert (judge.marks.tolist(), judge.values.tolist(), judge.uncertainties.tolist()) == ([0.2], [0.96], [2e-3])
    assert (origin.label, origin.judges, origin.values.tolist()) == ("second origin", False, [0.97])


def test_each_series_is_in_one_figure(motion):
    case = ShellPortrait(catalog.named_case("pendulum_strip"))
    where, energy = ({one.name for one in f} for f in (case.along, case.energies))
    assert where == {"tip_x", "tip_z", "centre_x", "centre_z", "hinge_x", "hinge_z"}
    assert energy == {"kinetic_energy", "membrane_energy", "bending_energy", "total_energy"}


def test_the_yardstick_is_the_only_good_run_without_a_seed(motion):
    rows = [row for row in motion.rows if row.case == "napkin_plane" and row.primary]
    assert yardstick(rows).solver == "fem"
    other = rows[0].model_copy(update={"run_id": "other"})
    assert yardstick([*rows, other]) is None
    assert yardstick([row.model_copy(update={"status": "failed"}) for row in rows]) is None


def test_a_rigid_offset_is_its_own_root_of_the_mean_square(motion, by_id):
    (found,) = apart(runs_of(motion, by_id, "napkin_plane"), motion.folder).values()
    assert found.against == "fem"
    assert found.rms.marks[0] == found.rms.values[0] == 0.0
    assert found.rms.values == pytest.approx(OFFSET * found.rms.marks / 0.5, rel=1e-4, abs=1e-9)
    assert {0.1, 0.2, 0.25, 0.4, 0.5} <= set(found.rms.marks.round(9))
    assert found.largest == pytest.approx((0.5, OFFSET), rel=1e-4)


def test_differences_are_weighed_by_area():
    """A quarter of the surface moves by 2: the root of the mean square is 1, though it holds half of the points."""
    case = catalog.named_case("napkin_plane")
    x = np.concatenate([np.linspace(0, 0.25, 41), np.linspace(0.25, 1, 41)[1:]])
    xi = np.stack(np.meshgrid(x, np.linspace(0, 1, 5), indexing="ij"), axis=-1)
    position = case.surface.position(xi)
    from shellbench.report.data.fields import Fields

    still = np.zeros((1, *position.shape))
    moved = still.copy()
    moved[0, xi[..., 0] <= 0.25, 1] = 2.0
    marks = np.array([0.5])
    ours, theirs = (Fields(xi, position, u[0], marks, u) for u in (moved, still))
    assert rms_difference(ours, theirs).values == pytest.approx([0, 1], abs=0.02)


def test_a_run_that_failed_is_compared_as_far_as_it_came(motion, by_id):
    (found,) = apart(runs_of(motion, by_id, "pendulum_strip"), motion.folder).values()
    assert found.rms.marks[-1] == pytest.approx(0.6)
    assert found.rms.values == pytest.approx(0 * found.rms.marks, abs=1e-7)


def test_frames_are_found_by_their_mark(motion):
    fields = read_fields(record_of(motion, "pendulum_strip", "ndf"), motion.folder)
    assert fields.marks[frame_at(fields, 0.25)] == 0.25
    assert fields.marks[frame_at(fields, BROKEN)] == BROKEN
    assert frame_at(fields, 0.75) is None
    assert frame_at(fields, 0.62) is None


def test_shown_marks_are_common_and_evenly_spread(motion, by_id):
    case = ShellPortrait(catalog.named_case("pendulum_strip"))
    runs = runs_of(motion, by_id, case.name)["record"]
    kept = {record.identity.solver: read_fields(record, motion.folder) for record in runs}
    assert shown_marks(case, kept, 5) == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0])
    sleeve = ShellPortrait(catalog.named_case("sleeve_twist"))
    kept = {"fem": read_fields(record_of(motion, "sleeve_twist", "fem"), motion.folder)}
    marks = shown_marks(sleeve, kept, 4)
    assert len(marks) == 4
    assert (marks[0], marks[-1]) == (0.05, 0.5)
    assert shown_marks(sleeve, {}, 4) == []


def test_every_case_has_its_figures(exhibits):
    assert set(exhibits) == {
        *(f"{kind}_{case}" for case in ("free_fall", "pendulum_strip", "napkin_plane")
          for kind in ("motion", "energy", "apart", "frames", "film")),
        "buckling_sleeve_twist", "frames_sleeve_twist",
    }  # fmt: skip
    for exhibit in exhibits.values():
        assert exhibit.name.startswith(CLOTH)
        assert len(exhibit.caption) > 40
        assert len(exhibit.description) > 20
    assert REASON in exhibits["motion_pendulum_strip"].caption
    assert "at most 0.002 m, at 0.5 s" in exhibits["apart_napkin_plane"].caption


def test_trajectories_are_drawn_as_recorded_in_the_solvers_colours(motion, exhibits):
    axes = {a.get_ylabel(): a for a in exhibits["motion_napkin_plane"].figure.axes}
    assert set(axes) == {"corner x (m)", "corner y (m)", "centre x (m)", "centre y (m)"}
    assert axes["centre x (m)"].get_xlabel() == "time t (s)"
    colours = inks(row.solver for row in motion.rows)
    for solver in ("fem", "ndf"):
        record = record_of(motion, "napkin_plane", solver)
        (series,) = [one for one in record.series if one.name == "corner_x"]
        lines = [line for line in axes["corner x (m)"].lines if line.get_color() == colours[solver].colour]
        assert any(
            line.get_xdata().tolist() == list(series.marks) and line.get_ydata().tolist() == list(series.values)
            for line in lines
        )
    (legend,) = exhibits["motion_napkin_plane"].figure.legends
    assert {"fem", "ndf", "known value", "second origin"} == {text.get_text() for text in legend.get_texts()}


def test_energies_of_a_motion_are_four(exhibits):
    labels = [a.get_ylabel() for a in exhibits["energy_napkin_plane"].figure.axes]
    assert labels == ["kinetic energy (J)", "membrane energy (J)", "bending energy (J)", "total energy (J)"]


def test_rounding_of_an_energy_is_drawn_as_none(exhibits):
    total = exhibits["energy_free_fall"].figure.axes[3]
    low, high = total.get_ylim()
    assert high - low > 1e-3


def test_where_no_total_energy_is_kept_the_solvers_balance_is_drawn():
    case = ShellPortrait(catalog.named_case("napkin_moving_corners"))
    assert "total_energy" not in {one.name for one in case.energies}
    run = TracedRun("fem", None, "id", None, {BALANCE: Trace(np.array([0.0, 1.0]), np.array([0.0, 1e-5]))})
    with style():
        figure = trace_figure([TracePanel(("total_energy", BALANCE), "J")], [run], inks(["fem"]))
    (line,) = figure.axes[0].lines
    assert line.get_ydata().tolist() == [0.0, 1e-5]


def test_the_torque_is_drawn_with_its_critical_state(motion, exhibits):
    exhibit = exhibits["buckling_sleeve_twist"]
    (axes,) = exhibit.figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("twist (rad)", "torque (N m)")
    curve = max(axes.lines, key=lambda line: len(line.get_xdata()))
    assert curve.get_ydata() == pytest.approx([torque(t) for t in curve.get_xdata()])
    assert curve.get_xdata()[0] == 0.0
    diamond = next(line for line in axes.lines if line.get_marker() == "D")
    assert (*diamond.get_xdata(), *diamond.get_ydata()) == pytest.approx((CRITICAL, torque(CRITICAL)))
    assert f"{torque(CRITICAL):.4g} N m at 0.08" in exhibit.caption
    labels = {text.get_text() for text in exhibit.figure.legends[0].get_texts()}
    assert {"known value", "known critical state", "fem: critical state"} <= labels


@pytest.mark.parametrize(
    ("name", "words"),
    [("sleeve_twist", "twist (rad)"), ("sleeve_compression", "shortening (m)"), ("cantilever_shear", "load factor t")],
)
def test_a_load_factor_is_called_what_the_critical_point_calls_it(name, words):
    assert ShellPortrait(catalog.named_case(name)).load_words == words


def test_frames_have_one_view_one_scale_and_one_column_a_time(exhibits, motion):
    figure = exhibits["frames_pendulum_strip"].figure
    with style():
        figure.draw_without_rendering()
    panels = [axes for axes in figure.axes if axes.get_aspect() == 1.0]
    assert len(panels) >= 8
    for axes in panels[1:]:
        seen = (*panels[0].get_xlim(), *panels[0].get_ylim())
        assert (*axes.get_xlim(), *axes.get_ylim()) == pytest.approx(seen)
    titles = [axes.get_title() for axes in figure.axes if axes.get_title()]
    assert titles == ["t = 0.2 s", "t = 0.4 s", "t = 0.6 s", "t = 0.8 s", "t = 1 s"]
    words = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert words.count("not reached") == 2  # at 0.8 s and 1 s, of the run that failed at 0.604 s
    assert {"fem", "ndf"} <= set(words)


def test_a_strip_without_a_state_is_empty(motion):
    case = ShellPortrait(catalog.named_case("free_fall"))
    from shellbench.report.figures.pictures import shell

    one = shell(record_of(motion, case.name, "fem"), motion.folder)
    with style():
        figure = shapes_figure([[one, None]], ["t = 1 s", "t = 2 s"], ["a"])
    assert sum(bool(axes.collections) for axes in figure.axes[:2]) == 1


def test_a_run_that_a_suite_declares_stands_for_its_solver_where_it_has_no_other(motion):
    row = next(row for row in motion.rows if row.solver == "ndf-published" and row.case == "free_fall")
    short = row.model_copy(update={"overrides": {"iterations": 9}, "default_settings": False, "declared": True})
    tried = short.model_copy(update={"declared": False})
    assert leading_rows([short]) == [short]
    assert leading_rows([short, row]) == [row]
    assert leading_rows([tried]) == []
    elsewhere = row.model_copy(update={"case": "napkin_plane"})
    assert leading_rows([short, elsewhere]) == [short, elsewhere]


def test_cloth_is_not_drawn_as_a_path_too(motion, by_id):
    with style():
        found = [one.name for one in path_exhibits(Evidence(by_id, motion.rows, motion.folder, motion.known_values))]
    assert found == []
    assert is_cloth(ShellPortrait(catalog.named_case("sleeve_compression")))
    assert not is_cloth(ShellPortrait(catalog.named_case("cantilever_shear")))


def test_the_table_of_motions_says_how_each_run_went(motion, by_id):
    table = motion_table(Evidence(by_id, motion.rows, motion.folder))
    lines = {(line["case"], line["solution"]): line for line in table.data.to_dict("records")}
    assert set(lines) == {(r.case_name, r.identity.solver) for r in motion.records if r.case_name != "sleeve_twist"}
    failed = lines["pendulum_strip", "ndf"]
    assert failed["reached"] == BROKEN
    assert failed["steps"] == 25
    assert failed["iterations"] == 75
    assert lines["napkin_plane", "fem"]["drift"] == pytest.approx(3e-5 * 0.5)
    assert lines["napkin_plane", "ndf"]["drift"] == pytest.approx(2e-4 * 0.5)
    assert lines["napkin_plane", "ndf"]["largest"] == pytest.approx(OFFSET, rel=1e-4)
    assert lines["free_fall", "ndf-published"]["largest"] == pytest.approx(2 * G_HALF, rel=1e-4)  # at T/2
    assert lines["free_fall", "ndf-published"]["largest_at"] == 0.5
    assert np.isnan(lines["napkin_plane", "fem"]["largest"])
    asked = lines["napkin_plane", "ndf"]
    times, values = ([float(x) for x in asked[name].split()] for name in ("asked_times", "asked_differences"))
    assert times == list(catalog.named_case("napkin_plane").states)
    assert values == pytest.approx([OFFSET * t / 0.5 for t in times], rel=1e-4)
    assert [float(t) for t in failed["asked_times"].split()] == [0.25, 0.5]  # of 0.25, 0.5, 0.75 and 1 s
    assert "at 0.2 s" in table.write("markdown")
    assert "at 0.2 s" not in table.write("text")  # no room for it
    assert any(REASON in note.text for note in table.notes)
    assert "from that of fem" in table.caption


def test_quantities_are_grouped_by_time_with_solvers_side_by_side(motion, by_id):
    tables = {table.name: table for table in by_time_tables(Evidence(by_id, motion.rows, None))}
    assert set(tables) == {"times_free_fall", "times_pendulum_strip", "times_napkin_plane"}
    fall = tables["times_free_fall"]
    assert list(dict.fromkeys(fall.data["block"])) == ["t = 0.5 s", "t = 1 s"]
    text = fall.write("markdown")
    assert "| fall (m) | 1.22500 | 1.22500 |" in text
    lines = {line["quantity"]: line for line in fall.data.to_dict("records")}
    assert lines["fall_500ms"]["ndf-published relative error"] == pytest.approx(2.0)
    assert lines["fall_1000ms"]["ndf-published relative error"] == pytest.approx(0.0, abs=1e-9)
    pendulum = tables["times_pendulum_strip"]
    later = pendulum.data[pendulum.data["at"] == 0.75]
    assert later["ndf value"].isna().all()
    assert "run failed" in pendulum.write("text")
    for table in tables.values():
        for format in ("text", "markdown", "html", "latex", "csv"):
            assert table.write(format)


def test_frames_of_a_row_fit_a_page():
    assert MOST_FRAMES <= 6


def test_what_moves_as_a_block_is_coloured_evenly(motion):
    from shellbench.report.figures.pictures import shell
    from shellbench.report.figures.shells import shell_figure

    one = shell(record_of(motion, "free_fall", "fem"), motion.folder)
    one.displacement[...] += 1e-11 * np.random.default_rng(0).standard_normal(one.displacement.shape)
    with style():
        figure = shell_figure(one)
    (bar,) = [axes for axes in figure.axes if axes.get_xlabel()]
    assert bar.get_xlim() == pytest.approx((-G / 2, 0.0))
