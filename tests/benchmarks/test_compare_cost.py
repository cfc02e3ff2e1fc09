"""Cost of a comparison of many rows, relative to one of few rows.

Both are compared in one run and in turns, so that the ratio does not depend on the machine or its load. Ten times the
rows should take about ten times as long, and not a hundred times. All rows answer one question, which is the worst
case.
"""

import time

import pytest

from shellbench.bench.judge.compare import with_mutual_differences
from shellbench.bench.judge.row import Row

FEW, MANY = 500, 5000
ROUNDS = 5
ROW = Row(
    case="own",
    suite=None,
    solver="",
    settings={},
    seed=None,
    quantity="centre",
    primary=True,
    at=None,
    value=1.0,
    status="ok",
)


def answers(count):
    return [ROW.model_copy(update={"solver": f"solver {i % 3}", "seed": i, "value": 1.0 + i}) for i in range(count)]


def seconds(rows):
    begin = time.perf_counter()
    with_mutual_differences(rows)
    return time.perf_counter() - begin


@pytest.mark.long
def test_comparing(benchmark):
    few, many = answers(FEW), answers(MANY)
    if benchmark.enabled:
        short, long = [], []
        for _ in range(ROUNDS):
            short.append(seconds(few))
            long.append(seconds(many))
        benchmark.extra_info["ratio"] = min(long) / min(short)
    found = benchmark.pedantic(with_mutual_differences, args=(many,), rounds=ROUNDS, warmup_rounds=1)
    assert all(row.disagreement_with == "median" for row in found)
