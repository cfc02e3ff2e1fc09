import numpy as np
import pytest

from shellbench.report.data.evidence import Evidence
from shellbench.report.sections.seeds import natural_key, section, seed_spreads, seed_table
from tests.report.conftest import TRUTH
from tests.report.studied import studied

ERRORS = {0: -3e-3, 1: 1e-3, 2: 5e-3}


@pytest.fixture
def runs(tmp_path):
    return [studied(tmp_path, "resolution", "field", {"neurons": 60}, e, seed=seed) for seed, e in ERRORS.items()]


def spreads_of(rows):
    return seed_spreads(Evidence({}, rows, None))


def line(rows):
    (found,) = seed_table(spreads_of(rows)).data.to_dict("records")
    return found


def test_mean_spread_and_largest_error_are_those_of_numpy(runs):
    found = line([of for _, of in runs])
    truth = TRUTH["square_plate"]
    values = truth * (1 + np.array(list(ERRORS.values())))
    assert found["mean"] == pytest.approx(np.mean(values), rel=1e-14)
    assert found["standard_deviation"] == pytest.approx(np.std(values, ddof=1), rel=1e-12)
    assert found["relative_standard_deviation"] == pytest.approx(np.std(values, ddof=1) / truth, rel=1e-12)
    assert found["largest_from_mean"] == pytest.approx(np.max(np.abs(values - np.mean(values))) / truth, rel=1e-12)
    assert found["mean_error"] == pytest.approx(1e-3)
    assert (found["largest_error"], found["worst_seed"]) == (pytest.approx(5e-3), 2)


def test_the_largest_error_keeps_its_sign(tmp_path):
    rows = [
        studied(tmp_path, "resolution", "field", {"neurons": 9}, e, seed=s)[1] for s, e in {4: 1e-3, 7: -2e-3}.items()
    ]
    found = line(rows)
    assert (found["largest_error"], found["worst_seed"]) == (pytest.approx(-2e-3), 7)
    assert "-0.20 %" in seed_table(spreads_of(rows)).write("text")


def test_without_a_known_value_spreads_are_relative_to_the_mean(runs):
    rows = [of.model_copy(update={"reference": None, "relative_error": None}) for _, of in runs]
    (errors,) = spreads_of(rows)["errors"]
    values = 1 + np.array(list(ERRORS.values()))
    assert errors == pytest.approx(values / values.mean() - 1)
    found = line(rows)
    assert found["relative_standard_deviation"] == pytest.approx(np.std(values, ddof=1) / values.mean())
    assert np.isnan(found["largest_error"]) if found["largest_error"] is not None else True


def test_a_failed_seed_is_counted_and_left_out(tmp_path, runs):
    failed = studied(tmp_path, "resolution", "field", {"neurons": 60}, 0.9, seed=3, status="failed")
    rows = [of for _, of in [*runs, failed]]
    assert line(rows)["mean"] == line(rows[:3])["mean"]
    text = seed_table(spreads_of(rows)).write("text")
    assert "3 of 4" in text
    assert "1 of 4 failed" in text


def test_one_seed_has_no_spread(runs):
    assert spreads_of([runs[0][1]]).empty
    assert section(Evidence({}, [runs[0][1]], None)) is None


def test_runs_with_other_settings_are_not_mixed(tmp_path, runs):
    other = [studied(tmp_path, "resolution", "field", {"neurons": 7}, 10 * e, seed=s) for s, e in ERRORS.items()]
    spreads = spreads_of([of for pair in zip(runs, other, strict=True) for _, of in pair])
    assert spreads["solution"].to_list() == ["field, neurons 7", "field, neurons 60"]  # by number
    wide, narrow = spreads["standard_deviation"]
    assert wide == pytest.approx(10 * narrow)


def test_numbers_in_words_sort_as_numbers():
    assert sorted(["w 10", "w 9", "w 9, a", "v 11"], key=natural_key) == ["v 11", "w 9", "w 9, a", "w 10"]


def test_default_runs_that_a_study_declares_too_stand_with_the_comparison_of_solvers(tmp_path, runs):
    as_defaults = [of.model_copy(update={"overrides": {}, "default_settings": True}) for _, of in runs]
    assert spreads_of(as_defaults)["studied"].to_list() == [False]
    assert spreads_of([of for _, of in runs])["studied"].to_list() == [True]
