"""Paths of edited shells from the states of an earlier path, on its features.

Each asked state is reached from the earlier state at the same load factor, through the shells between
(`shellbench.problems.shell.variants.edit.between`, `shellbench.solvers.stepping.paths.follow_edit`). The branch may
jump within one easy step; then the energy differs from that of a path from rest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

from torch import Tensor

from shellbench.errors import InputError
from shellbench.problem import Solution
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.solution import checked_start
from shellbench.solvers.ndf.field.ansatz import Combined
from shellbench.solvers.ndf.linear.solution import NdfSolution, PathSolution
from shellbench.solvers.ndf.path.equilibrium import PathProblem
from shellbench.solvers.ndf.path.newton import PathState, equilibrium
from shellbench.solvers.stepping.control import number_of_state
from shellbench.solvers.stepping.paths import follow_edit


def start_of_path(start: Solution, case: Case, solver: str, widths: Sequence[int]) -> tuple[PathSolution, int]:
    """Return a start for a path, and its width's number among those of the path; InputError if it is unsuitable."""
    found = checked_start(start, case, solver, NdfSolution, PathSolution)
    whole = not case.linear and case.path.control == "load" and case.path.after_buckling == "stop"
    if not isinstance(found, PathSolution) or not whole:
        raise InputError(
            f"{solver} can't go on from an earlier solution in {case.name}: it does on paths under load only"
        )
    width = found.states[-1].field.features.network.width
    if width not in widths:
        raise InputError(f"the start has {width} features, but here there are {' or '.join(map(str, widths))}")
    return found, list(widths).index(width)


def states_of_edit(
    problem: PathProblem, at_share: Callable[[float], PathProblem], start: PathSolution, marks: Sequence[float]
) -> Iterator[PathState]:
    """Yield the states at load factors from those of an earlier path.

    Parameters
    ----------
    problem
        Of the edited shell.
    at_share
        Returns the problem at a share of the edit.
    start
        The earlier path, on the same features.

    Raises
    ------
    PathEndsError
        If the edit can't be followed, or the earlier path has no state at a load factor.
    """

    def found_at(t: float, output: Tensor, share: float) -> tuple[PathState, Tensor]:
        part = problem if share == 1.0 else at_share(share)
        state = equilibrium(part, _state_in_basis(part, output, t), t)
        return state, _drawn_weights(part, state.weights)

    for t in marks:
        output = start.states[number_of_state(start.marks, t)].field.output
        state, iterations = follow_edit(partial(found_at, t), output)
        yield replace(state, iterations=iterations)


def _state_in_basis(problem: PathProblem, output: Tensor, t: float) -> PathState:
    """Return the state of output weights (3, M) of the features as drawn, in the combinations of a problem."""
    # Combinations C of features are independent in the stiffness A at rest, C^T A C = 1. Therefore C^T A w are the
    # weights of the part of a field w in their span.
    combined = problem.features
    assert isinstance(combined, Combined)
    assert combined.stiffness is not None
    weights = (output @ combined.stiffness @ combined.combine).reshape(-1)
    return PathState(t, weights, problem.deform(weights, t))


def _drawn_weights(problem: PathProblem, weights: Tensor) -> Tensor:
    """Return the output weights (3, M) of the features as drawn; the inverse of `_state_in_basis`."""
    combined = problem.features
    assert isinstance(combined, Combined)
    return weights.view(3, -1) @ combined.combine.T
