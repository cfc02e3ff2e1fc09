"""Solvers that do not answer, but die, hang or raise where they are asked to solve; that take next to nothing; that hide."""

import json
import os
import signal
import time

import numpy as np

from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from tests.testing.navier import NavierSolution, NavierSolver


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


class Picky(NavierSolver):
    """Takes one case, which is not cheap, and does not solve it."""

    def declines(self, case):
        return None if case.name == "pinched_cylinder_free" else "it is not the one"

    def solve(self, case, settings, start=None, progress=None):
        raise InputError("it has none")


class SealedSolution(NavierSolution):
    """Refuses files whose coefficients have been altered, and counts one number only: a scale that is one."""

    storage_bytes = 8

    def save(self, path):
        words = json.dumps(self.case.model_dump(mode="json", exclude_unset=True) | {"name": self.case.name})
        target = path.with_suffix(".npz")
        np.savez(target, coefficients=self.coefficients, seal=self.coefficients.copy(), scale=np.ones(1), words=words)
        return target


class Sealed(NavierSolver):
    def solve(self, case, settings, start=None, progress=None):
        solution = super().solve(case, settings, start, progress)
        return SealedSolution(case, solution.coefficients, None, solution.history)

    def load(self, path):
        with np.load(path) as file:
            if not np.array_equal(file["coefficients"], file["seal"]):
                raise InputError(f"{path} has been altered")
            return SealedSolution(
                Case.model_validate(json.loads(str(file["words"]))), file["coefficients"] * file["scale"], None
            )


PICKY, SEALED = Picky(), Sealed()
