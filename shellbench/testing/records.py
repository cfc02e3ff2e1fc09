"""Checks of what an answer says of its making: its history, and what it told on the way."""

from __future__ import annotations

import math
from itertools import pairwise

from shellbench.problems.shell.case import Case
from shellbench.testing.examination import Examination
from shellbench.testing.verdict import Findings, Verdict

SLACK = 1.5  # times the measured wall time of a solve, which its history may claim at most


def history(exam: Examination, case: Case) -> Verdict:
    """Check that the history has steps, whose seconds do not fall, and that progress, if told, makes sense."""
    found, answer = Findings(), exam.solve(case)
    steps = answer.facts["history"]
    if not found.hold(bool(steps), "its history is empty"):
        return found.verdict()
    for phase in dict.fromkeys(step["phase"] for step in steps):
        own = [step for step in steps if step["phase"] == phase]
        seconds = [step["seconds"] for step in own]
        rising = all(a <= b for a, b in pairwise(seconds))
        found.hold(
            rising and min(seconds) >= 0 and all(map(math.isfinite, seconds)),
            f"seconds of its steps of phase '{phase}' fall, or are negative",
        )
        found.hold(all(math.isfinite(step["energy"]) for step in own), f"a step '{phase}' has no finite energy")
        found.hold(all(step["unknowns"] >= 0 for step in own), f"a step '{phase}' has negative unknowns")
    longest = max(step["seconds"] for step in steps)
    took = answer.facts["took"]
    found.hold(longest <= SLACK * took + 1, f"its history claims {longest:.3g} s, but the solve took {took:.3g} s")
    told = answer.facts["progress"]
    for step, total, message in told:
        whole = isinstance(step, int) and step >= 0 and (total is None or (isinstance(total, int) and total >= step))
        if not whole or not isinstance(message, str):
            found.faults.append(f"it tells of progress as step {step!r} of {total!r}: {message!r}")
            break
    found.figures.append(f"{len(steps)} steps in {longest:.3g} s; {len(told)} words on progress")
    return found.verdict()
