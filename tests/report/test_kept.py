"""The kept summary beside the runs of a store: a synthetic summary by formulas. No solver ran; no figure is a result."""

import json

import pytest

from shellbench.errors import InputError
from shellbench.report.data import kept_data
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import style
from shellbench.report.sections import kept
from tests.report.conftest import COURSE, TRUTH

SIZES = (4, 8, 16, 32, 64)
SCALE = 0.5
CASE = COURSE[0]


def kept_run(solver, n, error, *, seed=None, **changes):
    """A run whose headline is off by a relative error, and whose displacement is as far from the exact one."""
    run_id = f"{solver}-{n}-{seed}"
    at = [[SCALE * (1 + error), 0.0, 0.0], [0.0, 0.1 * (1 + error), 0.0]]
    made = {
        "case": CASE, "solver": solver, "label": f"cells {n}×{n}", "settings": {"cells": [n, n]}, "swept": "cells",
        "seed": seed, "status": "ok", "run_id": run_id, "unknowns": 12 * n * n, "seconds": 1e-3 * n * n,
        "memory": 1e6 * n, "storage": 96 * n * n, "value": TRUTH[CASE] * (1 + error), "error": error, "displacement": [at],
        "from_common": {"largest": SCALE * error, "rms": 0.5 * SCALE * error}, "from_coarser": None,
        "grids": [{"points": p, "difference": 0.0, "mesh_difference": SCALE / p**2} for p in (10, 50, 200)],
    }  # fmt: skip
    return made | changes


def summary():
    runs = [kept_run("fem", n, n**-4.0) for n in SIZES]
    runs += [kept_run("field", n, 3e-3 * (1 + seed), seed=seed) for n in SIZES for seed in (0, 1)]
    runs += [kept_run("field", 128, 0.0, status="failed", value=None, reason="it did not converge")]
    runs += [kept_run("field", 256, 0.0, status="missing", value=None, run_id=None)]
    made = {"commit": "c0ffee" + "0" * 34, "date": "2000-01-01", "processor": "a processor", "cores": 2, "threads": 1}
    case = {"title": "Square plate", "scale": SCALE, "common_run": "fem-64-None", "marks": [1.0]}
    return {"format": 1, "made": made, "cases": {CASE: case}, "runs": runs}


@pytest.fixture
def write(tmp_path, monkeypatch):
    path = tmp_path / "resolution.json"
    monkeypatch.setattr(kept_data, "shipped", lambda: path)

    def written(data):
        path.write_text(data if isinstance(data, str) else json.dumps(data), encoding="utf-8")

    return written


@pytest.fixture
def evidence(store):
    return Evidence({record.run_id: record for record in store.records}, store.rows, store.folder)


@pytest.fixture
def made(write, evidence):
    write(summary())
    with style():
        return kept.section(evidence)


def table(section, name):
    found = [one for one in (*section.tables, *section.details) if one.name == name]
    return found[0].data


def test_without_a_file_there_is_no_section(evidence, write):
    assert kept.section(evidence) is None


def test_the_page_says_who_made_the_kept_runs(made):
    assert "c0ffee000000 on 2000-01-01 (a processor, 2 cores)" in made.words[0]


def test_rows_of_the_run_and_kept_rows_are_told_apart(made, store):
    data = table(made, "kept_all_runs")
    ids = {record.run_id for record in store.records}
    own = data["rows"] == kept.OWN
    assert own.any()
    assert (~own).sum() == 2 * len(SIZES)
    for line in data.to_dict("records"):
        assert (set(line["run_ids"].split()) <= ids) == (line["rows"] == kept.OWN)
    assert set(data["case"]) == {CASE}  # no other case is in the summary


def test_errors_are_against_the_known_value_as_it_is_now(made, evidence):
    data = table(made, "kept_all_runs")
    kept_fem = data[(data["solver"] == "fem") & (data["rows"] == kept.KEPT)]
    reference = next(row.reference for row in evidence.rows if row.case == CASE and row.primary)
    assert kept_fem["worst"].tolist() == pytest.approx(
        [abs(TRUTH[CASE] * (1 + n**-4.0) / reference - 1) for n in SIZES], rel=1e-6
    )


def test_three_discretisations_are_compared_at_common_points(made):
    (fem,) = table(made, "kept_points").query("solver == 'fem'").to_dict("records")
    assert fem["discretisations"] == "cells 16×16, cells 32×32, cells 64×64"
    assert fem["first"] == pytest.approx(SCALE * (16**-4.0 - 32**-4.0))
    assert fem["last"] == pytest.approx(SCALE * (32**-4.0 - 64**-4.0))
    assert fem["is_common"]


def test_figures_have_four_points_a_line_and_mark_own_runs(made, store):
    convergence, consistency = made.exhibits
    lines = [line for line in convergence.figure.axes[0].get_lines() if len(line.get_xdata()) == len(SIZES)]
    assert len(lines) == 2
    rims = [line for line in convergence.figure.axes[0].get_lines() if line.get_markeredgecolor() == "black"]
    assert rims
    assert set(convergence.run_ids) <= {record.run_id for record in store.records}
    assert all(axes.get_xlabel() and axes.get_ylabel() for axes in consistency.figure.axes)


def test_failed_runs_are_noted(made):
    (note,) = next(one for one in made.tables if one.name == "kept_runs").notes
    assert "it did not converge" in note.text


@pytest.mark.parametrize("format", ["text", "markdown", "latex", "html", "csv"])
def test_all_tables_are_written_in_all_formats(made, format):
    for one in (*made.tables, *made.details):
        assert one.write(format)


def test_a_store_with_runs_of_the_study_shows_them_instead(write, store, evidence):
    write(summary())
    run = next(row for row in store.rows if row.case == CASE and row.primary and row.solver == "fem")
    studied = run.model_copy(update={"suites": ("resolution",), "suite": "resolution", "default_settings": False, "declared": True,
                                     "overrides": {"cells": [8, 8]}, "label": "cells 8×8"})  # fmt: skip
    assert kept.section(Evidence(evidence.records, [*store.rows, studied], store.folder)) is None


@pytest.mark.parametrize(
    ("broken", "words"),
    [
        ("{", "is no JSON"),
        ("[]", "resolution.json"),
        ({"format": 7, "made": {"commit": "", "date": ""}, "cases": {}, "runs": []}, "has format 7"),
        ({"format": 1, "made": {}, "cases": {}, "runs": []}, "commit"),
    ],
)
def test_a_broken_file_is_one_sentence(write, evidence, broken, words):
    write(broken)
    with pytest.raises(InputError, match=words) as error:
        kept.section(evidence)
    assert "\n" not in str(error.value)
