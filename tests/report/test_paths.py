"""Load-displacement curves: from records to what is drawn."""

import numpy as np
import pytest
from matplotlib.colors import to_hex

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.reference import KnownCurve, KnownValue, KnownValues
from shellbench.bench.store.task import case_data
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.records.portrait import ShellPortrait
from shellbench.protocol.picture import LoadAxis
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import inks, style
from shellbench.report.data.traces import Trace, known_paths, limit_loads, path_run, readable
from shellbench.report.figures.trace_figure import TracePanel, trace_figure
from shellbench.report.studies.trace_exhibits import path_exhibits
from tests.report.conftest import Store
from tests.report.nonlinear import FIRST, LOADS, REACHED, REASON, SECOND, deflection, roof_load, shortening

BEAM, ROOF = "cantilever_shear", "hinged_roof_thick"
FINE = 1e-3  # relative: a spline through states 1 mm apart


def run_of(store: Store, case: str, solver: str, seed: int | None = None):
    return next(
        r
        for r in store.records
        if (r.case_name, r.identity.solver, r.identity.seed) == (case, solver, seed)
        and r.identity.settings == r.defaults
    )


def portrait(case: str):
    return ShellPortrait(catalog.named_case(case))


def series(case: str):
    return {one.name: one for one in portrait(case).paths}


def figure_of(store: Store, name: str):
    by_id = {record.run_id: record for record in store.records}
    with style():
        shown = {one.name: one for one in path_exhibits(Evidence(by_id, store.rows, store.folder, store.known_values))}
    return shown[name]


def lines(axes, marker: str | None = None, dashes: str | None = None):
    return [
        line
        for line in axes.get_lines()
        if (marker is None or line.get_marker() == marker) and (dashes is None or line.get_linestyle() == dashes)
    ]


def test_quantities_of_one_displacement_at_several_loads_are_one_series():
    beam = series(BEAM)
    assert list(beam) == ["shortening", "deflection"]
    assert [q.at for q in beam["deflection"].quantities] == [0.25, 0.5, 1.0]
    assert beam["deflection"].description == "displacement of the tip along the force"
    assert list(series("cylinder_pull_out")) == ["W_A", "U_B", "U_C"]
    assert series(ROOF)["free_edge_deflection"].unit == "mm"


def test_loads_are_in_the_unit_in_which_the_case_asks_for_them():
    assert portrait(ROOF).load_axis == LoadAxis(1000.0, "load (N)")
    assert portrait(BEAM).load_axis == LoadAxis(1.0, "load factor t")


def test_names_with_an_index_are_symbols():
    assert readable("U_B") == "$U_{B}$"
    assert readable("free_edge_deflection") == "free edge deflection"


def test_a_path_starts_at_rest_and_has_the_records_states(nonlinear):
    run = path_run(run_of(nonlinear, BEAM, "fem"), portrait(BEAM), "fem")
    for name, exact in (("deflection", deflection), ("shortening", shortening)):
        assert list(run.traces[name].marks) == [0.0, *LOADS]  # the refinements before it are no part
        assert list(run.traces[name].values) == [0.0, *map(exact, LOADS)]
    assert run.reason is None


def test_a_failed_run_keeps_its_path_and_its_reason(nonlinear):
    run = path_run(run_of(nonlinear, BEAM, "ndf", 1), portrait(BEAM), "ndf")
    assert run.traces["deflection"].marks[-1] == REACHED
    assert run.reason == REASON


def test_a_record_without_a_path_has_no_curve(nonlinear):
    record = run_of(nonlinear, BEAM, "fem")
    old = record.model_copy(update={"history": tuple(s for s in record.history if s.phase == "solve")})
    assert path_run(old, portrait(BEAM), "fem") is None
    bare = tuple(s.model_copy(update={"quantities": {}}) for s in record.history)
    assert path_run(record.model_copy(update={"history": bare}), portrait(BEAM), "fem") is None


@pytest.mark.parametrize("name", ["deflection", "free_edge_deflection"])
def test_limit_points_are_where_the_load_turns(nonlinear, name):
    run = path_run(run_of(nonlinear, ROOF, "fem"), portrait(ROOF), "fem")
    factor = 0.8 if name == "free_edge_deflection" else 1.0
    (top, first), (valley, second) = run.traces[name].limit_points()
    assert (top, valley) == pytest.approx((roof_load(FIRST), roof_load(SECOND)), rel=FINE)
    assert (first, second) == pytest.approx((factor * FIRST, factor * SECOND), rel=FINE)


def test_a_state_told_twice_hides_no_limit_point():
    w = np.arange(0.0, 31.0)
    twice = np.insert(w, 5, w[5])
    assert len(Trace(np.array([roof_load(x) for x in twice]), twice).limit_points()) == 2
    assert Trace(np.array([0.0, 1.0]), np.array([0.0, 2.0])).limit_points() == []


def test_known_values_stand_at_their_loads(nonlinear):
    case, known = portrait(BEAM), nonlinear.known[BEAM]
    judges, curve = known_paths(case, known, series(BEAM)["deflection"])
    assert judges.judges
    assert dict(zip(judges.marks, judges.values, strict=True)) == {t: deflection(t) for t in (0.25, 0.5, 1)}
    assert not curve.judges
    assert curve.label == "book, Reissner–Mindlin"
    assert list(curve.marks) == [0.3, 0.6, 1.0]
    assert list(curve.values) == [2.4, 4.8, 6.69]


def test_a_value_of_the_literature_stands_apart_unless_its_source_has_it_in_a_curve(nonlinear):
    case, known = portrait(BEAM), nonlinear.known[BEAM]
    other = KnownValue(
        quantity="deflection_4", role="literature", value=6.5, theory="mixed", origin="another", source="paper2024"
    )
    found = known_paths(
        case, KnownValues(values=(*known.values, other), curves=known.curves), series(BEAM)["deflection"]
    )
    assert [one.label for one in found] == ["known value", "paper2024, mixed theories", "book, Reissner–Mindlin"]
    assert (found[1].marks[0], found[1].values[0]) == (1.0, 6.5)


def test_known_loads_of_a_controlled_path_stand_at_their_displacements(nonlinear):
    case, known = portrait(ROOF), nonlinear.known[ROOF]
    (judges,) = known_paths(case, known, series(ROOF)["deflection"])
    assert (judges.values[0], judges.marks[0]) == (20.0, 1.770)
    assert known_paths(case, known, series(ROOF)["free_edge_deflection"]) == []
    assert limit_loads(case, known) == [2.2]  # its displacement is not known


def test_a_limit_point_known_whole_is_a_point(nonlinear):
    case = portrait(ROOF)
    whole = KnownValue(
        quantity="limit_deflection", role="judge", value=10.0, theory=case.theory, origin="series", source="series1900"
    )
    known = KnownValues(values=(*nonlinear.known[ROOF].values, whole))
    assert limit_loads(case, known) == []
    (judges,) = known_paths(case, known, series(ROOF)["deflection"])
    assert (10.0, 2.2) in list(zip(judges.values, judges.marks, strict=True))


def test_a_figure_draws_the_records_states_in_the_load_of_the_case(nonlinear):
    shown = figure_of(nonlinear, "curve_hinged_roof_thick")
    left, right = shown.figure.axes
    assert left.get_ylabel() == "load (N)"
    assert (left.get_xlabel(), right.get_xlabel()) == ("deflection (mm)", "free edge deflection (mm)")
    ink = inks(row.solver for row in nonlinear.rows)["fem"]
    solid = [line for line in lines(left, dashes=ink.dashes) if to_hex(line.get_color()).upper() == ink.colour]
    drawn = next(line for line in solid if len(line.get_xdata()) > 2)
    widths = [line.get_linewidth() for line in left.get_lines() if len(line.get_xdata()) == len(drawn.get_xdata())]
    assert len(set(widths)) == len(widths)  # of curves that cover each other a rim is seen
    w = np.arange(0.0, 31.0)
    assert drawn.get_xdata() == pytest.approx(w)
    assert drawn.get_ydata() == pytest.approx([1000 * roof_load(x) for x in w])
    (diamonds,) = lines(left, "D", "None")
    assert diamonds.get_ydata() == pytest.approx([1000 * roof_load(FIRST), 1000 * roof_load(SECOND)], rel=FINE)
    limit = [line for line in left.get_lines() if list(line.get_ydata()) == [2200.0, 2200.0]]
    assert len(limit) == 1


def test_a_figure_shows_each_run_the_failed_ones_end_and_the_tabulated_points(nonlinear):
    shown = figure_of(nonlinear, "curve_cantilever_shear")
    left, right = shown.figure.axes
    assert left.get_ylabel() == "load factor t"
    assert (left.get_xlabel(), right.get_xlabel()) == ("shortening (m)", "deflection (m)")
    (end,) = lines(right, "X", "None")
    assert (end.get_xdata()[0], end.get_ydata()[0]) == (deflection(REACHED), REACHED)
    (circles,) = lines(right, "o", "None")
    assert list(circles.get_ydata()) == [0.25, 0.5, 1.0]
    assert any(list(line.get_xdata()) == [2.4, 4.8, 6.69] for line in lines(right, "x", "None"))
    legend = [text.get_text() for text in shown.figure.legends[0].get_texts()]
    assert {"fem", "ndf", "ndf-ritz", "known value", "book, Reissner–Mindlin"} <= set(legend)
    assert legend.count("ndf") == 1  # two seeds
    assert REASON in shown.caption
    assert "seed 1" in shown.caption
    assert {"cantilever_shear-fem--None", "cantilever_shear-ndf--0", "cantilever_shear-ndf--1"} <= set(shown.run_ids)


def test_variants_are_no_part_of_the_solvers_curves(nonlinear):
    assert not any("published" in run for run in figure_of(nonlinear, "curve_cantilever_shear").run_ids)


def test_prescribed_motion_has_no_curve(nonlinear):
    by_id = {record.run_id: record for record in nonlinear.records}
    names = {
        one.name for one in path_exhibits(Evidence(by_id, nonlinear.rows, nonlinear.folder, nonlinear.known_values))
    }
    assert not {"curve_rolled_plate", "curve_rigid_rotation"} & names


@pytest.mark.parametrize("letters", [8, 40, 90])
def test_a_legend_is_never_cut(nonlinear, letters):
    case = portrait(ROOF)
    run = path_run(run_of(nonlinear, ROOF, "fem"), case, "fem")
    (one, _) = case.paths
    curve = KnownCurve(
        quantity="deflection", theory="mixed", origin="", source="s", label="l" * letters, loads=(1.0,), values=(3.0,)
    )
    known = tuple(known_paths(case, KnownValues(curves=(curve,)), one))
    panels = [TracePanel((one.name,), "w (mm)", "t", known=known, load_scale=1.0, limit_loads=(2.2,))] * 2
    with style():
        figure = trace_figure(panels, [run], inks(["fem"]), special="limit points")
        figure.draw_without_rendering()
    box = figure.legends[0].get_window_extent()
    if letters <= 40:
        assert box.x0 >= 0
        assert box.x1 <= figure.bbox.x1
    else:  # one column is all that can be done
        assert len(figure.legends[0].get_texts()) == 4


def test_a_case_that_can_not_be_read_any_more_draws_nothing(nonlinear):
    broken = [
        record.model_copy(update={"case": {"name": record.case_name}}) if record.case_name == ROOF else record
        for record in nonlinear.records
    ]
    by_id = {record.run_id: record for record in broken}
    names = {
        one.name for one in path_exhibits(Evidence(by_id, nonlinear.rows, nonlinear.folder, nonlinear.known_values))
    }
    assert "curve_hinged_roof_thick" not in names
    assert "curve_cantilever_shear" in names


def test_stored_cases_can_be_read_again(nonlinear):
    for record in nonlinear.records:
        case = Case.model_validate(record.case)
        assert case_data(case) == record.case
