"""The report of the whole obstacle course stays small enough to be sent by mail."""

from pathlib import Path

import pytest

from shellbench.bench.store import store as bench
from shellbench.problems.shell.records.sampling import PICTURE
from shellbench.report.page.page import write_report
from tests.report import conftest

LARGEST_PAGE = 8_000_000  # bytes; the promise of the report


@pytest.mark.long
def test_the_report_of_the_course_is_below_8_megabytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(conftest, "GRID", PICTURE)  # as finely sampled as real records
    made = conftest.make_store(tmp_path / "runs")
    rows = [row for row in made.rows if row.suite == "obstacle_course"]
    page = write_report(bench.Store(made.folder), rows, tmp_path / "report", made.known_values, for_print=False)
    assert max(one.stat().st_size for one in page.parent.glob("*.html")) < LARGEST_PAGE
    assert sum(path.stat().st_size for path in page.parent.rglob("*") if path.is_file()) < 2 * LARGEST_PAGE
