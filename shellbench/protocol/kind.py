"""Kinds of problem, for the entry points of the group ``shellbench.problems``."""

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
from shellbench.protocol.sheet import Request, Sheet

Account = Callable[[Any, Any, Mapping[str, float]], Sequence[Model]]
"""Makes one field of a record (see `shellbench.account`) of a solution, its problem and its named values."""


@dataclass(frozen=True)
class Variant:
    """An equivalent statement of the same question.

    Attributes
    ----------
    words
        Description in titles.
    make
        Takes a problem; returns the data of the variant. It may raise InputError with the reason, as a clause, why
        the problem has no such variant.
    """

    words: str
    make: Callable[[Any], dict[str, Any]]


@dataclass(frozen=True)
class NodalValues:
    """Values that were measured from nodal results of another program.

    Attributes
    ----------
    values
        By name of quantity, in its unit.
    nearest
        By name of quantity at points: distance of the nearest node from the farthest of its points, in the case's unit
        of length.
    cells
        Number of cells of the mesh.
    share
        Share of the shell that the mesh covers; the rest follows by symmetry.
    """

    values: Mapping[str, float]
    nearest: Mapping[str, float]
    cells: int
    share: float


@dataclass(frozen=True)
class Kind:
    """A kind of problem, the target of its entry point.

    Attributes
    ----------
    problem
        Class of its problems, read from files.
    keep
        Takes a solution and its problem; returns the arrays for comparison and pictures, by name. None if the solution
        has no finite answer.
    accounts
        Other required data of a record, by the record's field: without them a run is incomplete.
    studies
        Optional data of a record, by the record's field: a study that fails is left out.
    portrait
        Takes a problem; returns its description for reports.
    variants
        Equivalent statements of the same question, by name, with the same known values.
    twins
        The same shell in another theory, by name: other questions, with known values and tolerances of their own.
    sample
        Takes a solution, points a side, a mark (None: the last state) and a title; returns the sample for export. None
        if solutions of this kind are no surfaces.
    from_file
        Takes a file with data of a user's own, such as a mesh, and the path of a case file; returns the text of a case
        as a start. It may raise InputError with the reason, as a clause. None if there are no such files.
    sheet
        Takes a problem and a request; returns its sheet, for a person with another program. It may raise InputError.
        None if no program with meshes solves such problems.
    nodes
        Function, as ``module:name``, that measures nodal results: takes a problem, a file and the factor from lengths
        in the file to those of the problem; returns `NodalValues`. Empty if there are none. It is named, not imported,
        so that a change of it leaves all records of solvers valid.
    limits
        Names of the limits that other programs may tend to, by theory of a problem and by twin.
    headline, headlines
        Name of its headline quantities, for the heading of their table; other names by unit.
    exam, quick
        Suites that grade a solver, in minutes, and at a first look.
    """

    problem: type[Problem]
    keep: Callable[[Any, Any], Mapping[str, NDArray[Any]] | None]
    accounts: Mapping[str, Account] = field(default_factory=dict)
    studies: Mapping[str, Account] = field(default_factory=dict)
    portrait: Callable[[Any], Portrait] = Portrait
    variants: Mapping[str, Variant] = field(default_factory=dict)
    twins: Mapping[str, Variant] = field(default_factory=dict)
    sample: Callable[[Any, int, float | None, str], Sample] | None = None
    from_file: Callable[[Path, Path], str] | None = None
    sheet: Callable[[Any, Request], Sheet] | None = None
    nodes: str = ""
    limits: Mapping[str, str] = field(default_factory=dict)
    headline: str = "Headline figures"
    headlines: Mapping[str, str] = field(default_factory=dict)
    exam: tuple[str, ...] = ()
    quick: tuple[str, ...] = ()

    @property
    def statements(self) -> Mapping[str, Variant]:
        """Variants and twins by name."""
        return {**self.variants, **self.twins}

    @property
    def theories(self) -> tuple[str, ...]:
        """Theories of its problems; none if they are not stated."""
        return tuple(map(str, get_args(self.problem.model_fields["theory"].annotation)))
