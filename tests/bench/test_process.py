"""Who has had its time: a process that computes is measured by its processor, one that hangs by the clock."""

import os
import subprocess
import sys
import time

import pytest

from shellbench.bench.plugins.process import cpu_time, is_overdue
from tests.patience import until

COMPUTE = "import time\nwhile time.process_time() < 0.3: pass\nprint(time.process_time(), flush=True)\ninput()"
IN_A_CHILD = f"import subprocess, sys\nsubprocess.run([sys.executable, '-c', {COMPUTE!r}])\n"


@pytest.mark.parametrize(
    ("waited", "had", "overdue"),
    [
        (9.0, 9.0, False),
        (10.0, 10.0, True),
        (50.0, 9.0, False),  # four others compute beside it
        (50.0, 10.0, True),
        (10.0, 0.1, True),  # it hangs
        (200.0, 9.9, True),
    ],
)
def test_a_limit_is_of_the_processor_where_something_is_computed(waited: float, had: float, overdue: bool) -> None:
    assert is_overdue(10.0, waited, had) is overdue


@pytest.mark.parametrize("program", [COMPUTE, IN_A_CHILD])
def test_what_a_process_and_its_children_compute_is_counted_and_sleep_is_not(program: str) -> None:
    began = time.monotonic()
    with subprocess.Popen([sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        said = float(process.stdout.readline())
        while time.monotonic() < began + 2 * said:  # it sleeps
            time.sleep(0.05)
        tick = 1 / os.sysconf("SC_CLK_TCK")
        assert said - 2 * tick <= cpu_time(process.pid)
        before = cpu_time(process.pid)
        time.sleep(0.2)
        assert cpu_time(process.pid) - before <= 2 * tick
        process.communicate(b"\n")
    until(lambda: cpu_time(process.pid) == 0)


def test_of_no_process_nothing_is_counted() -> None:
    assert cpu_time(None) == 0
