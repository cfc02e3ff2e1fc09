"""Deformed shapes along a path: one frame, one scale, one range of colours."""

import numpy as np
import pytest

from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import style
from shellbench.report.data.fields import read_fields
from shellbench.report.figures.pictures import MOST_SHOWN, spread, states
from shellbench.report.figures.shells import shapes_figure
from shellbench.report.sections.whole_fields import field_table
from shellbench.report.studies.trace_exhibits import path_exhibits
from tests.report.test_paths import BEAM, run_of


@pytest.fixture(scope="module")
def kept(nonlinear):
    return states(run_of(nonlinear, BEAM, "fem"), nonlinear.folder)


def test_each_kept_state_is_named_by_its_mark(kept, nonlinear):
    fields = read_fields(run_of(nonlinear, BEAM, "fem"), nonlinear.folder)
    assert [words for words, _ in kept] == ["t = 0.25", "t = 0.5", "t = 0.75", "t = 1"]
    for (_, drawn), displacement in zip(kept, fields.displacements, strict=True):
        assert np.array_equal(drawn.displacement, displacement)
        assert drawn.scale == 1.0  # true to scale
        assert np.array_equal(drawn.deformed, drawn.position + drawn.displacement)


def test_states_share_frame_scale_and_colours(kept):
    with style():
        figure = shapes_figure([[shell for _, shell in kept]], [words for words, _ in kept])
        figure.draw_without_rendering()
    panels = [axes for axes in figure.axes if axes.get_title(loc="left")]
    assert [axes.get_title(loc="left") for axes in panels] == [words for words, _ in kept]
    first = panels[0]
    for axes in panels[1:]:
        assert (*axes.get_xlim(), *axes.get_ylim()) == pytest.approx((*first.get_xlim(), *first.get_ylim()))
    (width, height), *others = {tuple(axes.get_window_extent().size.round(6)) for axes in panels}
    assert not others
    for axes in panels:  # a metre is as long across as upward
        assert np.ptp(axes.get_xlim()) / width == pytest.approx(np.ptp(axes.get_ylim()) / height)
    (bar,) = [axes for axes in figure.axes if axes.get_xlabel()]
    assert bar.get_xlabel() == "$u_{z}$ (m)"
    largest = max(drawn.coloured.max() for _, drawn in kept)
    assert bar.get_xlim()[1] == pytest.approx(largest)


@pytest.mark.parametrize("count", [1, 4, MOST_SHOWN, MOST_SHOWN + 1, 13, 40])
def test_spread_keeps_order_and_the_last_state(count):
    shown = spread(range(count))
    assert len(shown) == min(count, MOST_SHOWN)
    assert shown[-1] == count - 1
    assert sorted(set(shown)) == shown


def test_the_best_run_is_shown_a_failed_one_only_where_no_other_kept_states(nonlinear):
    def shown(records):
        by_id = {record.run_id: record for record in records}
        found = path_exhibits(Evidence(by_id, nonlinear.rows, nonlinear.folder, nonlinear.known_values))
        return next(one for one in found if one.name == f"states_{BEAM}")

    best = shown(nonlinear.records)
    assert best.run_ids == (f"{BEAM}-fem--None",)
    assert "true scale" in best.caption
    failed = shown([r for r in nonlinear.records if r.identity.solver == "ndf"])
    assert failed.run_ids == (f"{BEAM}-ndf--1",)
    assert "failed" in failed.caption
    assert "t = 0.5" in failed.description


def test_the_field_of_a_failed_run_is_held_against_no_other(nonlinear):
    """It belongs to another load."""
    by_id = {record.run_id: record for record in nonlinear.records}
    assert field_table(Evidence(by_id, nonlinear.rows, nonlinear.folder)).data.empty


@pytest.mark.parametrize(
    "change",
    [
        lambda fields: fields | {"marks": fields["marks"][:-1]},
        lambda fields: fields | {"displacements": fields["displacements"] * np.nan},
        lambda fields: {k: v for k, v in fields.items() if k != "displacements"},
    ],
)
def test_states_that_do_not_fit_or_are_not_finite_draw_nothing(nonlinear, tmp_path, change):
    record = run_of(nonlinear, BEAM, "fem")
    with np.load(nonlinear.folder / record.fields_file) as stored:
        np.savez(tmp_path / record.fields_file, **change(dict(stored)))
    assert states(record, tmp_path) == []


def test_older_fields_without_states_are_read(nonlinear, tmp_path):
    record = run_of(nonlinear, BEAM, "fem")
    with np.load(nonlinear.folder / record.fields_file) as stored:
        np.savez(tmp_path / record.fields_file, **{k: stored[k] for k in ("xi", "position", "displacement")})
    assert states(record, tmp_path) == []
    assert read_fields(record, tmp_path) is not None
