"""Waiting for what must happen: no test asks how long it takes, and none hangs for ever."""

import time

GUARD = 600.0
"""Seconds after which nothing is waited for any more: a guard against hanging, far beyond what a busy machine takes."""


def until(condition):
    """Wait until something holds; return what it gave."""
    end = time.monotonic() + GUARD
    while not (found := condition()):
        assert time.monotonic() < end, "it did not come true"
        time.sleep(0.02)
    return found
