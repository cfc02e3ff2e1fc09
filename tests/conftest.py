"""One thread a test process: the processes of pytest-xdist share the cores, and BLAS threads would fight over them."""

import gc
import os
import time
from collections import defaultdict

import pytest

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")
os.environ.setdefault("OMP_WAIT_POLICY", "passive")


START = time.monotonic()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave of a sweep that is `sampled` as many tests to the quick session as it says, spread from first to last."""
    sweeps = defaultdict(list)
    for item in items:
        if item.get_closest_marker("sampled") and not item.get_closest_marker("long"):
            sweeps[item.nodeid.partition("[")[0]].append(item)
    for sweep in sweeps.values():
        many, last = sweep[0].get_closest_marker("sampled").args[0], len(sweep) - 1
        quick = {round(last * k / max(many - 1, 1)) for k in range(many)}
        for item in (item for place, item in enumerate(sweep) if place not in quick):
            item.add_marker(pytest.mark.long)


def pytest_collection_finish() -> None:
    """Let Python look for cycles in what tests make, and not, again and again, in torch and in thousands of tests."""
    gc.collect()
    gc.freeze()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """End the long session by its verdict in a line."""
    passed, failed, error = (len(terminalreporter.stats.get(word, ())) for word in ("passed", "failed", "error"))
    if config.option.markexpr == "long":
        minutes = (time.monotonic() - START) / 60
        terminalreporter.write_line(f"long session: {passed} passed, {failed + error} failed, {minutes:.0f} min")
