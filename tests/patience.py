"""Waiting for what must happen: no test asks how long it takes, and none hangs for ever."""

import time

COMMAND_LINE = """
import signal
from shellbench.__main__ import main
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)
main()
"""
"""The command line for `python -c`: SIGINT and SIGHUP end it even if a shell or nohup runs the tests in the background.

What they start there ignores these signals, and programs hand that on to those that they start.
"""

GUARD = 600.0
"""Seconds after which nothing is waited for any more: a guard against hanging, far beyond what a busy machine takes."""


def until(condition):
    """Wait until something holds; return what it gave."""
    end = time.monotonic() + GUARD
    while not (found := condition()):
        assert time.monotonic() < end, "it did not come true"
        time.sleep(0.02)
    return found
