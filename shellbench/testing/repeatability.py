"""Check that the same question has the same answer: in another process, and about the same with another seed."""

from __future__ import annotations

from shellbench.problems.shell.case import Case
from shellbench.testing.examination import Examination, apart, grid, seed_difference
from shellbench.testing.subject import solve_in
from shellbench.testing.verdict import Findings, Verdict

SAME = 1e-10  # relative difference of two runs with one seed
NEAR = 0.1  # of two runs with different seeds: beyond, they answer different questions


def determinism(exam: Examination, case: Case) -> Verdict:
    """Two processes with one seed give the same numbers; another seed gives others, but near."""
    found, answer = Findings(), exam.solve(case)
    points = grid(case)
    first = answer.displacement(points)
    with exam.fresh() as other:
        again = apart(first, solve_in(other, "again", case, exam.settings).displacement(points))
    found.hold(again <= SAME, f"solved again in another process, it differs by {again:.1e}", f"again: {again:.1e}")
    if not exam.facts["seeded"]:
        found.figures.append("no seed")
        return found.verdict()
    seeded = seed_difference(exam, case)
    found.hold(seeded > 0, "another seed gives the same numbers, so the seed is not used")
    found.hold(seeded <= NEAR, f"with another seed it differs by {seeded:.1e}", f"another seed: {seeded:.1e}")
    return found.verdict()
