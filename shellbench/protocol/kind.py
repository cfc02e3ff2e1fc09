"""Kinds of problem: all that an entry point of the group ``shellbench.problems`` names."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args

from numpy.typing import NDArray

from shellbench.protocol.picture import Portrait
from shellbench.protocol.problem import Problem
from shellbench.protocol.sample import Sample
from shellbench.protocol.schema import Model

Account = Callable[[Any, Any, Mapping[str, float]], Sequence[Model]]
"""What makes one field of a record (see `shellbench.account`) of a solution, its problem and its values by name."""


@dataclass(frozen=True)
class Variant:
    """A way to ask the same question otherwise.

    Attributes
    ----------
    words
        What titles say of it.
    make
        Takes a problem; returns the data of the variant. It may raise InputError with the reason, as a clause, why
        the problem can't be asked so.
    """

    words: str
    make: Callable[[Any], dict[str, Any]]


@dataclass(frozen=True)
class Kind:
    """A kind of problem, as its entry point names it.

    Attributes
    ----------
    problem
        Its problems, read from files.
    keep
        Takes a solution and its problem; returns the arrays that are kept for comparison and pictures, by name. None if
        the solution has no finite answer.
    accounts
        What else a record keeps, by the record's field: without it a run is not whole.
    studies
        What stands beside the answer, by the record's field: a study that fails is left out.
    portrait
        Takes a problem; returns what a report can ask it.
    variants
        The same question asked otherwise, by name: known values carry over.
    sample
        Takes a solution, points a side, a mark (None: the last state) and a title; returns what is exported. None if
        solutions of this kind are no surfaces.
    from_file
        Takes a file with data of a user's own, such as a mesh, and the path of a case file; returns the text of a case
        to begin with. It may raise InputError with the reason, as a clause. None if there are no such files.
    headline, headlines
        What its headline quantities are, for the heading of their table; other words by unit.
    exam, quick
        Suites by which a solver is graded, in minutes, and at a first look.
    """

    problem: type[Problem]
    keep: Callable[[Any, Any], Mapping[str, NDArray[Any]] | None]
    accounts: Mapping[str, Account] = field(default_factory=dict)
    studies: Mapping[str, Account] = field(default_factory=dict)
    portrait: Callable[[Any], Portrait] = Portrait
    variants: Mapping[str, Variant] = field(default_factory=dict)
    sample: Callable[[Any, int, float | None, str], Sample] | None = None
    from_file: Callable[[Path, Path], str] | None = None
    headline: str = "Headline figures"
    headlines: Mapping[str, str] = field(default_factory=dict)
    exam: tuple[str, ...] = ()
    quick: tuple[str, ...] = ()

    @property
    def theories(self) -> tuple[str, ...]:
        """Theories that its problems can ask for; none if they do not say which."""
        return tuple(map(str, get_args(self.problem.model_fields["theory"].annotation)))
