"""The table of runs: what rows say, in columns that can be grouped."""

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from shellbench.report.data.runs import groups_alike, headlines, in_order_of_cases, run_ids, table_of_runs
from tests.report.conftest import TRUTH, UNCERTAINTY
from tests.report.studied import BYTES_AN_UNKNOWN, evidence, studied


@pytest.fixture
def held(tmp_path):
    runs = [studied(tmp_path, "resolution", "field", {"neurons": 9}, 1e-3, seed=s, unknowns=40) for s in (0, 1)]
    runs.append(studied(tmp_path, "sampling", "mesh", {"cells": [4, 4]}, 0.5, case="scordelis_lo", status="failed"))
    return evidence(tmp_path, runs)


def test_a_line_says_what_its_row_and_record_say(held):
    first = held.runs.iloc[0]
    truth = TRUTH["square_plate"]
    assert (first["case"], first["solver"], first["solution"]) == ("square_plate", "field", "field, neurons 9")
    assert first["value"] == pytest.approx(truth * (1 + 1e-3))
    assert first["floor"] == pytest.approx(UNCERTAINTY)
    assert first["solve_memory_bytes"] == BYTES_AN_UNKNOWN * first["unknowns"] == 40 * BYTES_AN_UNKNOWN
    assert first["record"] is held.records[first["run_id"]]
    assert held.runs["sound"].tolist() == [True, True, False]
    assert math.isnan(held.runs["seed"].iloc[2])


def test_runs_that_differ_in_their_seed_alone_are_alike(held):
    one, other, third = held.runs["alike"]
    assert one == other != third


def test_a_missing_run_and_no_run_at_all_have_the_same_columns(held):
    bare = [row.model_copy(update={"run_id": None, "value": None, "parameters": None}) for row in held.rows]
    missing, nothing = table_of_runs({}, bare), table_of_runs({}, [])
    assert list(missing.columns) == list(nothing.columns)
    assert (missing.dtypes == nothing.dtypes).all()
    assert missing["run_id"].tolist() == ["", "", ""]
    assert missing["record"].isna().all()
    assert missing[["value", "unknowns"]].isna().all(axis=None)
    assert headlines(nothing, "resolution").empty


def test_headlines_are_of_one_study_and_of_the_suite_s_own_cases(held):
    assert headlines(held.runs)["case"].tolist() == ["square_plate", "square_plate", "scordelis_lo"]
    assert headlines(held.runs, "sampling")["case"].tolist() == ["scordelis_lo"]
    strange = [row.model_copy(update={"own_case": True}) for row in held.rows[:1]]
    beside = [row.model_copy(update={"primary": False}) for row in held.rows[1:]]
    assert headlines(table_of_runs({}, [*strange, *beside])).empty


def test_cases_keep_their_order(held):
    ordered = in_order_of_cases(held.runs.iloc[::-1], ["seed"])
    assert ordered["case"].tolist() == ["scordelis_lo", "square_plate", "square_plate"]
    assert ordered["seed"].tolist()[1:] == [0, 1]


def test_what_is_made_once_is_made_once(held):
    made = []
    assert [held.once(made.append) for _ in range(3)] == [None] * 3
    assert made == [held]


def test_runs_of_lines_that_name_several(held):
    assert run_ids(held.runs.assign(run_ids=["a b", "", "c"])) == ("a", "b", "c")


@given(st.lists(st.floats(1.0, 1e6)).map(sorted), st.floats(1.0, 3.0))
def test_groups_span_no_more_than_the_ratio_and_begin_beyond_it(sizes, ratio):
    groups = groups_alike(sizes, lambda size: size, ratio)
    assert [size for group in groups for size in group] == sizes
    assert all(group[-1] <= ratio * group[0] for group in groups)
    assert all(after[0] > ratio * before[0] for before, after in pairwise(groups))
