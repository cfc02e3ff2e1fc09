"""What a report is made from, and the sections that it is made of.

A section is made by one module, from records and rows alone, and says where it stands. The page, Markdown and LaTeX
show every section in the same way: words, figures, tables, and its parts under headings of their own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, TypeVar

import pandas as pd

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import Record
from shellbench.report.data.exhibit import Exhibit, Ink, inks
from shellbench.report.data.runs import compared, in_order_of_cases, table_of_runs
from shellbench.report.data.solutions import Known
from shellbench.report.data.table import Note, Table

T = TypeVar("T")

Place = Literal["own page", "one suite", "its suites"]
AND = "; "  # between headings that share a section


class Formula(str):
    """A formula, on a line of its own."""

    formula = True


@dataclass(frozen=True)
class Section:
    """One section of a report.

    Attributes
    ----------
    name
        Its anchor.
    words
        Paragraphs, plain words.
    details
        Long tables behind it, kept as CSV only.
    parts
        Under headings of their own, after all else.
    place
        The page that it stands on: its own, if there are several suites; that of the suite that most of it is about;
        or parted, each table and figure on the page of the suite that it is about.
    """

    name: str
    title: str
    words: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    exhibits: tuple[Exhibit, ...] = ()
    details: tuple[Table, ...] = ()
    parts: tuple[Section, ...] = ()
    place: Place = "own page"

    @property
    def all_tables(self) -> list[Table]:
        """Tables, those of its parts among them."""
        return [*self.tables, *(table for part in self.parts for table in part.all_tables)]

    @property
    def all_exhibits(self) -> list[Exhibit]:
        """Figures, those of its parts among them."""
        return [*self.exhibits, *(exhibit for part in self.parts for exhibit in part.all_exhibits)]

    @property
    def shows(self) -> bool:
        """Whether there is anything to see: words alone tell nothing."""
        return bool(self.all_tables or self.all_exhibits)

    def retitled(self) -> Section:
        """Return the section called as its tables say, if they do: a kind of problem after the other."""
        headings = dict.fromkeys(part for table in self.tables if table.heading for part in table.heading.split(AND))
        return replace(self, title=AND.join(headings)) if headings else self

    def with_each(self, table: Callable[[Table], Table | None], exhibit: Callable[[Exhibit], bool]) -> Section:
        """Return the section with each table changed or left out, and the figures that are wanted."""
        tables = tuple(one for each in self.tables if (one := table(each)) is not None)
        parts = tuple(part.with_each(table, exhibit) for part in self.parts)
        kept = tuple(part for part, before in zip(parts, self.parts, strict=True) if part.shows or not before.shows)
        exhibits = tuple(filter(exhibit, self.exhibits))
        return replace(self, tables=tables, exhibits=exhibits, parts=kept).retitled()


@dataclass(frozen=True)
class Evidence:
    """What sections are made from.

    Attributes
    ----------
    records
        By run id.
    rows
        That compare them, those of studies among them.
    folder
        Where the records' files are.
    known
        Known values by name of case.
    whole
        Whether each suite is shown whole, as it was asked for by name; else each run is shown once.
    drawn
        Figures that compare solvers, case by case.
    """

    records: Mapping[str, Record]
    rows: Sequence[Row]
    folder: Path
    known: Known = catalog.known_values
    _made: dict[Any, Any] = field(default_factory=dict, init=False, repr=False, compare=False)

    def once(self, make: Callable[[Evidence], T]) -> T:
        """Return what is made from it for several sections, made once."""
        if make not in self._made:
            self._made[make] = make(self)
        made: T = self._made[make]
        return made

    @cached_property
    def runs(self) -> pd.DataFrame:
        """The rows as one table, see `shellbench.report.data.runs`."""
        return table_of_runs(self.records, self.rows)

    @cached_property
    def inks(self) -> Mapping[str, Ink]:
        """Colour and marker of each solver."""
        return inks(row.solver for row in self.rows)

    whole: bool = False
    drawn: Sequence[Exhibit] = ()

    @cached_property
    def compared(self) -> list[Row]:
        """The rows that hold solvers against known values."""
        return compared(self.rows)

    @cached_property
    def headline(self) -> list[Row]:
        """Those of them that are about headline quantities."""
        return [row for row in self.compared if row.primary]

    @cached_property
    def made(self) -> pd.DataFrame:
        """The runs of these that left a record, each once, case by case."""
        found = self.runs[self.runs["primary"] & self.runs["compared"]].dropna(subset="record")
        return in_order_of_cases(found.drop_duplicates(["case", "own_case", "run_id"]), [])

    def figures(self, *prefixes: str) -> tuple[Exhibit, ...]:
        """Return the figures whose names begin so, in the order of the beginnings."""
        return tuple(one for prefix in prefixes for one in self.drawn if one.name.startswith(prefix))


Maker = Callable[[Evidence], Section | None]


def given(*tables: Table | None) -> tuple[Table, ...]:
    """Return the tables that there are and that have lines."""
    return tuple(table for table in tables if table is not None and len(table.data))


def failures(runs: pd.DataFrame) -> tuple[Note, ...]:
    """Say why runs failed that left a record; those of one solution that failed for the same reason together."""
    failed = runs[~runs["sound"]].dropna(subset="record").drop_duplicates(["title", "run_id"])
    failed = failed.assign(why=[record.reason or record.status for record in failed["record"]])
    found = []
    for (title, solution, status, why), alike in failed.groupby(["title", "solution", "status", "why"], sort=False):
        seeds = ", ".join(f"{seed:.0f}" for seed in alike["seed"].dropna())
        found.append(Note(f"{title}, {solution}{f', seed {seeds}' if seeds else ''} ({status})", why))
    return tuple(found)


def all_tables(sections: Iterable[Section]) -> list[Table]:
    """Return the tables of sections in their order."""
    return [table for section in sections for table in section.all_tables]
