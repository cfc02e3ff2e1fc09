"""Solvers that do not answer, but die, hang or raise where they are asked to solve."""

import os
import signal
import time

from tests.conformance.navier import NavierSolver


class Naughty(NavierSolver):
    def __init__(self, how):
        super().__init__()
        self.how = how

    def solve(self, case, settings, start=None, progress=None):
        print("words that are no answer", flush=True)
        match self.how:
            case "crash":
                os.kill(os.getpid(), signal.SIGSEGV)
            case "exit":
                os._exit(3)
            case "hang":
                time.sleep(3600)
            case "raise":
                raise ZeroDivisionError("a bug in\nthe solver")
        return super().solve(case, settings, start, progress)


CRASH, EXIT, HANG, RAISE, PRINT = (Naughty(how) for how in ("crash", "exit", "hang", "raise", "print"))
