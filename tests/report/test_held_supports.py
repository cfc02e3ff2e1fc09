import pytest

from shellbench.report.studies.paper_studies import support_table, supports
from tests.report.studied import evidence, studied


def run(folder, settings, error, leak, penalty, status="ok"):
    diagnostics = {"support_error": leak, "penalty": penalty}
    return studied(folder, "sampling", "ritz", settings, error, seed=0, status=status, diagnostics=diagnostics)


@pytest.fixture
def runs(tmp_path):
    return [
        run(tmp_path, {"supports": "soft", "penalty": 100.0}, 1e-3, 1e-5, 100.0),
        run(tmp_path, {"supports": "soft", "penalty": 1.0}, 1e-1, 1e-3, 1.0),
        run(tmp_path, {"supports": "soft", "penalty": 1e10}, 0.5, 1e-13, 1e10, status="failed"),
    ]


def test_lines_are_ordered_by_weight_and_hold_what_the_records_say(tmp_path, runs):
    found = evidence(tmp_path, runs)
    data = support_table(found).data
    assert list(data["penalty"]) == [1.0, 100.0, 1e10]
    assert list(data["support_error"]) == [1e-3, 1e-5, 1e-13]
    assert data["relative_error"].tolist() == pytest.approx([1e-1, 1e-3, 0.5], rel=1e-6)


def test_a_failed_run_is_shown_with_its_reason(tmp_path, runs):
    found = evidence(tmp_path, runs)
    table = support_table(found)
    assert list(table.data["ended"]) == ["solved", "solved", "run failed"]
    assert [note.text for note in table.notes] == ["it was refused"]
    assert all("run failed" in table.write(format) for format in ("text", "markdown", "latex", "html"))


def test_the_share_is_of_the_largest_displacement(tmp_path, runs):
    found = evidence(tmp_path, runs)
    data = support_table(found).data
    largest = [max(s.largest_displacement for s in record.resolution) for record, _ in runs]
    assert sorted(data["largest_displacement"]) == sorted(largest)


def test_a_support_that_holds_exactly_stands_last(tmp_path, runs):
    """A leak of nought is a figure, not the lack of one."""
    hard = run(tmp_path, {}, 1e-6, 0.0, None)
    hard = (hard[0], hard[1].model_copy(update={"default_settings": True, "overrides": {}, "label": ""}))
    found = evidence(tmp_path, [hard, *runs])
    data = support_table(found).data
    assert data["penalty"].isna().tolist() == [False, False, False, True]
    assert data["support_error"].tolist()[-1] == 0.0


def test_without_a_penalty_there_is_no_section(tmp_path):
    assert supports(evidence(tmp_path, [run(tmp_path, {}, 1e-3, 0.0, None)])) is None
    assert supports(evidence(tmp_path, [])) is None
