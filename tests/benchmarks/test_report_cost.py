"""Cost of the report of the obstacle course, in units of the picture of one shell.

Both are made in one run and in turns, so that the ratio does not depend on the machine or its load. It grows if the
report repeats work or draws more. The records are synthetic, as finely sampled as real ones; no solver runs. The whole
report should take less than 20 s on two cores.
"""

import time

import pytest

from shellbench.bench.store import store as bench
from shellbench.problems.shell.records.sampling import PICTURE
from shellbench.report.data.evidence import Evidence
from shellbench.report.figures.pictures import PICTURE as SHELL
from shellbench.report.page.page import write_report
from shellbench.report.page.sections import exhibits
from tests.report import conftest

ROUNDS = 3


def seconds(function):
    begin = time.perf_counter()
    function()
    return time.perf_counter() - begin


@pytest.mark.long
def test_a_report_of_the_course(benchmark, tmp_path, monkeypatch):
    monkeypatch.setattr(conftest, "GRID", PICTURE)
    made = conftest.make_store(tmp_path / "runs")
    rows = [row for row in made.rows if row.suite == "obstacle_course"]
    records = {record.run_id: record for record in made.records}
    plate = [row for row in rows if row.case == "square_plate" and row.solver == "fem"]
    figures = tmp_path / "figures"
    figures.mkdir()

    def report():
        return write_report(bench.Store(made.folder), rows, tmp_path / "out", made.known_values, for_print=False)

    def figure():
        drawn = exhibits(Evidence(records, plate, made.folder, made.known_values))
        return next(one for one in drawn if one.name == f"{SHELL}square_plate").save(figures, for_print=False)

    assert report().is_file()
    assert figure().startswith("data:image/png")
    if benchmark.enabled:
        whole, one = [], []
        for _ in range(ROUNDS):
            one.append(seconds(figure))
            whole.append(seconds(report))
        benchmark.extra_info["report_seconds"] = min(whole)
        benchmark.extra_info["figure_seconds"] = min(one)
        benchmark.extra_info["ratio"] = min(whole) / min(one)
        benchmark.extra_info["page_bytes"] = sum(one.stat().st_size for one in (tmp_path / "out").glob("*.html"))
    benchmark.pedantic(report, rounds=ROUNDS, warmup_rounds=1)
