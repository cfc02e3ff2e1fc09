import math
import re

import pytest

pytest.importorskip("shellbench_kratos", reason="needs the package: python -m pip install ./plugins/kratos")

from shellbench_kratos.engines_section import cross_check_figure, lines_of, section
from shellbench_kratos.engines_table import (
    LEVELS,
    TOGETHER,
    checked_cases,
    cross_check_table,
    why_incomparable,
)

from shellbench.bench.catalogue.suite import SuiteRun
from shellbench.bench.store.record import Environment
from shellbench.report.data.exhibit import inks
from shellbench.report.data.runs import compared
from shellbench.report.page.brought import sections_brought
from tests.report.conftest import ENVIRONMENT, TRUTH, UNCERTAINTY, synthetic_known
from tests.report.resolutions import only_suites
from tests.report.studied import SECONDS_AN_UNKNOWN, UNKNOWNS_A_CELL, Run, evidence, studied
from tests.report.test_sections_agree import assert_they_agree

OURS, PEER = "ours", "peer"
STRICT = 1 - UNCERTAINTY  # an error by formula, moved by what the known value is not sure of


@pytest.fixture(autouse=True)
def suite(monkeypatch):
    """A catalog whose only suite cross-checks engines; its first line is that of `OURS`."""
    runs = (SuiteRun(solver=OURS), SuiteRun(solver=PEER))
    facts = {"order": ("scordelis_lo", "square_plate"), "runs": runs, "remarks": ("Mind.",)}
    only_suites(monkeypatch, ("engines",), **facts)


def sweep(folder, solver, errors, *, slower=1.0, changed=None, fixed=None, **more) -> list[Run]:
    """Runs over meshes of n x n cells with the given errors, each `slower` than the synthetic time of its unknowns."""
    made = []
    for n, error in errors.items():
        settings = {**(fixed or {}), "cells": [n, n]}
        record, row = studied(folder, "engines", solver, settings, error, unknowns=UNKNOWNS_A_CELL * n * n, **more)
        seconds = slower * record.seconds
        record = record.model_copy(update={"seconds": seconds, **(changed or {})})
        made.append((record, row.model_copy(update={"seconds": seconds})))
    return made


def alone(folder, solver, error, unknowns=700, **more) -> Run:
    record, row = studied(folder, "engines", solver, {"tolerance": 1}, error, unknowns=unknowns, **more)
    return record, row.model_copy(update={"overrides": {}, "default_settings": True, "label": ""})


def seconds_of(n):
    return SECONDS_AN_UNKNOWN * UNKNOWNS_A_CELL * n * n


def table_of(folder, runs):
    return cross_check_table(checked_cases(evidence(folder, runs)), synthetic_known)


def line(folder, runs, name):
    (found,) = [line for line in table_of(folder, runs).data.to_dict("records") if line["name"] == name]
    return found


def absent(value):
    return value is None or math.isnan(value)


FAST = {4: 8e-3, 8: 5e-4, 16: 4e-5, 32: 2e-6}
SLOW = {8: 9e-3, 16: 6e-4, 32: 5e-5}


def both(folder):
    return [*sweep(folder, OURS, FAST), *sweep(folder, PEER, SLOW, slower=3.0)]


def test_the_known_value_heads_the_block_and_the_one_to_whom_others_are_related_comes_first(tmp_path):
    data = table_of(tmp_path, both(tmp_path)).data
    assert data["name"].tolist() == ["Known value", OURS, PEER]
    known = data.iloc[0]
    assert known["value"] == TRUTH["square_plate"]
    assert known["uncertainty"] == pytest.approx(UNCERTAINTY * TRUTH["square_plate"])


def test_the_finest_value_its_error_and_its_difference(tmp_path):
    found = line(tmp_path, both(tmp_path), PEER)
    assert found["value"] == pytest.approx(TRUTH["square_plate"] * (1 + 5e-5), rel=1e-14)
    assert found["error"] == pytest.approx(5e-5, rel=1e-9)
    assert found["from_base"] == pytest.approx(5e-5 - 2e-6, rel=1e-9)
    assert found["unknowns"] == UNKNOWNS_A_CELL * 32 * 32
    assert absent(line(tmp_path, both(tmp_path), OURS)["from_base"])


def test_seconds_and_their_ratio_at_each_error(tmp_path):
    ours, peer = (line(tmp_path, both(tmp_path), name) for name in (OURS, PEER))
    assert [ours[f"seconds_{level:g}"] for level in LEVELS] == pytest.approx(list(map(seconds_of, (8, 16, 32))))
    assert [peer[f"seconds_{level:g}"] for level in LEVELS[:2]] == pytest.approx(
        [3 * seconds_of(16), 3 * seconds_of(32)]
    )
    assert [peer[f"ratio_{level:g}"] for level in LEVELS[:2]] == pytest.approx([3 * 4.0, 3 * 4.0])
    assert [ours[f"ratio_{level:g}"] for level in LEVELS] == [1, 1, 1]
    assert absent(peer["seconds_1e-05"])
    assert absent(peer["ratio_1e-05"])


def test_a_sweep_that_is_lucky_once_does_not_count(tmp_path):
    lucky = {4: 8e-3, 8: 1e-7, 16: 6e-4, 32: 9e-5}
    found = line(tmp_path, [*sweep(tmp_path, OURS, FAST), *sweep(tmp_path, PEER, lucky)], PEER)
    assert found["seconds_0.001"] == pytest.approx(seconds_of(8))  # there and in all finer ones
    assert found["seconds_0.0001"] == pytest.approx(seconds_of(32))
    assert absent(found["seconds_1e-05"])


def test_the_uncertainty_of_the_known_value_counts_against_a_run(tmp_path):
    just = {4: 1e-3, 8: 1e-5 - 0.5 * UNCERTAINTY}
    assert absent(line(tmp_path, sweep(tmp_path, OURS, just), OURS)["seconds_1e-05"])
    sure = {4: 1e-3, 8: 1e-5 - 1.5 * UNCERTAINTY}
    assert line(tmp_path, sweep(tmp_path, OURS, sure), OURS)["seconds_1e-05"] == pytest.approx(seconds_of(8))


def test_settings_apart_from_the_swept_one_are_lines_of_their_own(tmp_path):
    """A bad choice of settings takes nothing from a good one."""
    good = sweep(tmp_path, PEER, SLOW, fixed={"degree": 4})
    bad = sweep(tmp_path, PEER, {16: 0.3, 64: 0.2}, fixed={"degree": 2})
    runs = [*sweep(tmp_path, OURS, FAST), *good, *bad]
    assert table_of(tmp_path, runs).data["name"].tolist()[1:] == [OURS, "peer, degree 2", "peer, degree 4"]
    assert line(tmp_path, runs, "peer, degree 4")["seconds_0.001"] == pytest.approx(seconds_of(16))
    assert absent(line(tmp_path, runs, "peer, degree 2")["seconds_0.001"])


def test_default_settings_are_one_size_of_a_sweep_that_changes_nothing_else(tmp_path):
    finer = alone(tmp_path, PEER, 2e-3, unknowns=UNKNOWNS_A_CELL * 64 * 64)
    joined = [*sweep(tmp_path, OURS, FAST), *sweep(tmp_path, PEER, SLOW), finer]
    found = line(tmp_path, joined, PEER)
    assert found["unknowns"] == UNKNOWNS_A_CELL * 64 * 64
    assert absent(found["seconds_0.001"])  # the finer run with defaults falls back
    apart = [*sweep(tmp_path, OURS, FAST), *sweep(tmp_path, PEER, SLOW, fixed={"degree": 4}), finer]
    assert table_of(tmp_path, apart).data["name"].tolist()[2:] == [PEER, "peer, degree 4"]


def test_runs_that_another_suite_declares_too_stay_in_their_sweep(tmp_path):
    """A row has the label of one suite alone; what makes a sweep is the settings."""
    runs = sweep(tmp_path, OURS, FAST, fixed={"refine": False})
    labels = ("refine False, cells 4×4", "cells 8×8", "one mesh, cells 16×16", "cells 32×32")
    runs = [(made, of.model_copy(update={"label": label})) for (made, of), label in zip(runs, labels, strict=True)]
    assert table_of(tmp_path, runs).data["name"].tolist()[1:] == ["ours, refine False"]
    assert line(tmp_path, runs, "ours, refine False")["seconds_1e-05"] == pytest.approx(seconds_of(32))


def test_a_size_of_a_sweep_may_be_the_default(tmp_path):
    """Such a run does not depart from the defaults in the swept setting, and still belongs to the sweep."""
    runs = sweep(tmp_path, OURS, FAST, fixed={"degree": 4})
    made, of = runs[2]
    label = of.label.rpartition(", ")[2]
    runs[2] = (made, of.model_copy(update={"overrides": {"degree": 4}, "label": label}))
    assert table_of(tmp_path, runs).data["name"].tolist()[1:] == ["ours, degree 4"]
    assert line(tmp_path, runs, "ours, degree 4")["seconds_0.0001"] == pytest.approx(seconds_of(16))


def test_one_size_alone_is_marked(tmp_path):
    text = table_of(tmp_path, [*sweep(tmp_path, OURS, FAST), alone(tmp_path, PEER, 5e-4)]).write("text")
    (of_peer,) = [words for words in text.splitlines() if words.startswith("  peer")]
    (of_ours,) = [words for words in text.splitlines() if words.startswith("  ours")]
    assert "0.07†" in of_peer.replace("0.070", "0.07")
    assert "†" not in of_ours


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"processor": "another processor"}, "different machines (synthetic processor"),
        ({"platform": "Another"}, "different machines"),
        ({"threads": 2}, "1 and 2 threads, not with one"),
        ({"python": "3.13.0"}, "different versions of Python"),
        ({"versions": {"numpy": "1.0.0"}}, "different versions of numpy"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_ratios_are_withheld_when_environments_differ(tmp_path, changed, words):
    other: Environment = ENVIRONMENT.model_copy(update=changed)
    runs = [*sweep(tmp_path, OURS, FAST), *sweep(tmp_path, PEER, SLOW, changed={"environment": other})]
    assert line(tmp_path, runs, PEER)["seconds_0.001"] == pytest.approx(seconds_of(16))
    assert absent(line(tmp_path, runs, PEER)["ratio_0.001"])
    text = table_of(tmp_path, runs).write("text")
    assert words in text
    assert "(×" not in text
    assert (
        section(evidence(tmp_path, runs)).words[1].startswith("Seconds are wall time of the solve alone. There are no")
    )


def test_a_package_that_only_one_run_has_is_no_difference(tmp_path):
    engine = ENVIRONMENT.model_copy(update={"versions": {"numpy": "2.0.0", "engine": "1.0"}})
    runs = [*sweep(tmp_path, OURS, FAST), *sweep(tmp_path, PEER, SLOW, changed={"environment": engine})]
    assert not absent(line(tmp_path, runs, PEER)["ratio_0.001"])


def test_ratios_are_withheld_of_one_case_alone(tmp_path):
    many = ENVIRONMENT.model_copy(update={"threads": 4})
    roof = sweep(tmp_path, OURS, FAST, case="scordelis_lo", changed={"environment": many})
    runs = [*both(tmp_path), *roof, *sweep(tmp_path, PEER, SLOW, case="scordelis_lo", changed={"environment": many})]
    ratios = {
        found["case"]: found["ratio_0.001"]
        for found in table_of(tmp_path, runs).data.to_dict("records")
        if found["name"] == PEER
    }
    assert ratios["square_plate"] == pytest.approx(12)
    assert absent(ratios["scordelis_lo"])


def test_runs_of_one_command_are_planned_together(tmp_path):
    def planned(minute, second=0.0):
        (made, _), *_ = sweep(tmp_path, OURS, {4: 1e-3})
        return made.model_copy(update={"created": f"2026-01-01T10:{minute:02d}:{second:06.3f}+00:00"})

    chain = [planned(0, 0), planned(0, 0.9 * TOGETHER), planned(1, 0.8 * TOGETHER)]
    assert why_incomparable(chain) is None
    reason = why_incomparable([*chain, planned(30)])
    assert "2 commands, planned at 2026-01-01 10:00:00 and 2026-01-01 10:30:00" in reason


def test_the_cases_stand_in_the_order_of_the_suite(tmp_path):
    runs = [*both(tmp_path), *sweep(tmp_path, OURS, FAST, case="scordelis_lo")]
    assert list(dict.fromkeys(table_of(tmp_path, runs).data["case"])) == ["scordelis_lo", "square_plate"]


def test_theory_origin_and_engine_are_named(tmp_path):
    runs = both(tmp_path)
    runs[-3:] = [
        (made, of.model_copy(update={"settings": {**of.settings, "engine": "Engine 1.2.3"}})) for made, of in runs[-3:]
    ]
    text = table_of(tmp_path, runs).write("text")
    assert re.search(r"known value \[series1900\]: linear Kirchhoff–Love; synthetic series\.", text)
    assert "Engine 1.2.3" in next(words for words in text.splitlines() if words.startswith("  peer"))


def test_runs_that_failed_are_told(tmp_path):
    runs = [*both(tmp_path), *sweep(tmp_path, PEER, {64: 0.2}, status="failed")]
    assert "one run failed, cells 64×64: it was refused" in table_of(tmp_path, runs).write("text")
    found = line(tmp_path, runs, PEER)
    assert found["unknowns"] == UNKNOWNS_A_CELL * 32 * 32  # the finest that ended well
    assert absent(found["seconds_0.001"])  # and a finer one failed


def test_without_the_first_solver_nothing_is_related(tmp_path):
    table = table_of(tmp_path, sweep(tmp_path, PEER, SLOW))
    assert "From" not in " ".join(column.heading for column in table.declared)
    assert "(×" not in table.write("text")


def test_all_formats_say_the_same(tmp_path):
    runs = [*both(tmp_path), *sweep(tmp_path, OURS, FAST, case="scordelis_lo"), alone(tmp_path, "third", 5e-4)]
    table = table_of(tmp_path, runs)
    assert_they_agree([table])
    assert [table.write(format).count("×12") for format in ("text", "markdown", "html")] == [2, 2, 2]
    assert table.write("latex").count(r"($\times$12)") == 2


def test_the_words_count_the_cases_on_which_the_first_is_not_slower(tmp_path):
    roof = [
        *sweep(tmp_path, OURS, FAST, case="scordelis_lo", slower=10.0),
        *sweep(tmp_path, PEER, FAST, case="scordelis_lo"),
    ]
    words = " ".join(section(evidence(tmp_path, [*both(tmp_path), *roof])).words)
    assert "within 0.1 % on 1 of 2 (the fastest other takes 0.10 to 12 times as long)" in words
    assert "within 0.001 % on 0 of 1 (the fastest other takes 0.10 times as long)" in words
    assert "Mind." in words


def test_a_case_that_only_others_reach_is_lost(tmp_path):
    runs = [*sweep(tmp_path, OURS, SLOW), *sweep(tmp_path, PEER, FAST)]
    words = " ".join(section(evidence(tmp_path, runs)).words)
    assert "within 0.001 % on 0 of 1." in words


def test_a_panel_for_each_case_and_a_line_for_each_settings(tmp_path):
    runs = [
        *sweep(tmp_path, OURS, FAST),
        *sweep(tmp_path, PEER, SLOW, fixed={"degree": 3}),
        *sweep(tmp_path, PEER, SLOW, fixed={"degree": 4}),
        alone(tmp_path, OURS, 1e-6, case="scordelis_lo"),
    ]
    held = evidence(tmp_path, runs)
    cases = checked_cases(held)
    colours = inks([OURS, PEER])
    (axes,) = cross_check_figure(cases, colours).axes  # the roof has no curve
    curves = {}
    for drawn in axes.get_lines():
        if len(drawn.get_xdata()) > 2:
            curves[drawn.get_color(), drawn.get_linestyle(), len(drawn.get_xdata())] = list(drawn.get_ydata())
    assert {colour for colour, *_ in curves} == {colours[OURS].colour, colours[PEER].colour}
    ours = next(values for (colour, *_), values in curves.items() if colour == colours[OURS].colour)
    assert ours == pytest.approx([100 * error for error in FAST.values()], rel=1e-6)
    assert len(set(lines_of(cases).values())) == 2  # peer's two are told apart


def test_a_default_run_is_named_in_the_figure(tmp_path):
    runs = [
        *sweep(tmp_path, OURS, FAST),
        *sweep(tmp_path, PEER, SLOW, fixed={"degree": 3}),
        alone(tmp_path, PEER, 1e-6),
    ]
    cases = checked_cases(evidence(tmp_path, runs))
    (legend,) = cross_check_figure(cases, inks([OURS, PEER])).legends
    assert f"{PEER}, default settings" in [text.get_text() for text in legend.get_texts()]


def test_the_section_is_made_only_of_a_cross_check(tmp_path):
    made = section(evidence(tmp_path, both(tmp_path)))
    assert [table.name for table in made.tables] == ["cross_check"]
    assert [exhibit.name for exhibit in made.exhibits] == ["cross_check"]
    assert section(evidence(tmp_path, sweep(tmp_path, OURS, FAST))) is None  # one alone checks nothing
    none = [(made, of.model_copy(update={"declared": False})) for made, of in both(tmp_path)]
    assert section(evidence(tmp_path, none)) is None


def test_the_report_shows_the_section(tmp_path):
    assert "engines" in [one.name for one in sections_brought(evidence(tmp_path, both(tmp_path)), (), print)]


def test_its_rows_are_kept_out_of_the_tables_of_displacements(tmp_path):
    held = evidence(tmp_path, both(tmp_path))
    assert compared(held.rows) == []
