"""A right solver of ropes, which is coarse and quick, and the same solver with one thing wrong."""

from dataclasses import replace
from itertools import count

import numpy as np

from shellbench.problem import Capabilities
from shellbench.problems.rope.solution import RopeMotion
from shellbench.problems.rope.solving import RopeSolver
from shellbench.solvers.rope.solver import ExactSolver, RopeSettings

FAULTS = {
    "pushes": "answers",
    "stretches": "answers",
    "roots": "answers",
    "forgets": "determinism",
    "metres": "units",
    "kilograms": "units",
    "compass": "placement",
    "stands": "convergence",
    "gains": "energy",
    "rewinds": "history",
    "loses": "saving",
    "uncounted": "parameters",
    "free": "storage",
}
CALLS = count()
RATE = 30.0  # steps a second of every solve of the solver whose answers stand


class Swung(RopeMotion):
    fault = ""

    @property
    def storage_bytes(self):
        return 1 if self.fault == "free" else super().storage_bytes

    @property
    def parameters(self):
        return 0 if self.fault == "uncounted" else super().parameters


def spoilt(fault, solution):
    """Return the solution with a fault in its states or history."""
    if fault == "rewinds":
        return replace(solution, history=solution.history[::-1])

    def state(one):
        rope = solution.case.rope
        match fault:
            case "pushes":
                return replace(one, tensions=-one.tensions)
            case "stretches":
                return replace(one, nodes=one.nodes[0] + 1.001 * (one.nodes - one.nodes[0]))
            case "roots":
                return replace(one, nodes=one.nodes + 1e-3)
            case "forgets":
                return replace(one, velocities=one.velocities * (1 + 1e-6 * next(CALLS)))
            case "metres":
                return replace(one, nodes=one.nodes + np.array([0.0, 0.0, 0.2]), stretch=1.0)
            case "kilograms":
                return replace(one, tensions=one.tensions + 5.0)
            case "compass":
                return replace(
                    one,
                    nodes=one.nodes + [0.2 * rope.link_lengths[0], 0.0, 0.0] * (one.nodes != one.nodes[0]),
                    stretch=1.0,
                )
            case "gains":
                return replace(one, velocities=one.velocities * 1.2)
        return one

    return replace(solution, kept=tuple(map(state, solution.kept)))


class SwingSolver(RopeSolver):
    name = "swinging"
    capabilities = Capabilities(("rigid-links",), "swings")
    settings_type = RopeSettings
    refinements = tuple({"steps_per_second": rate} for rate in (15.0, 30.0, 60.0))

    fault = ""

    def declines(self, case):
        return ExactSolver().declines(case)

    def answer(self, case, settings, progress):
        rate = RATE if self.fault == "stands" else min(settings.steps_per_second, 60.0)
        found = ExactSolver().answer(case, settings.model_copy(update={"steps_per_second": rate}), progress)
        return self._made(spoilt(self.fault, found))

    def load(self, path):
        found = RopeMotion.load(path)
        if self.fault == "loses":
            found = replace(found, kept=tuple(replace(s, nodes=np.float64(np.float32(s.nodes))) for s in found.kept))
        return self._made(found)

    def _made(self, motion):
        made = Swung(**{name: getattr(motion, name) for name in motion.__dataclass_fields__})
        object.__setattr__(made, "fault", self.fault)
        return made


SWINGING = SwingSolver
for _fault in FAULTS:
    globals()[f"WRONG_{_fault}"] = type("WrongSolver", (SwingSolver,), {"fault": _fault})
