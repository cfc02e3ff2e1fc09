"""The sections that a report is made of.

A section is made by one module, from records and rows alone, and says where it stands. The page, Markdown and LaTeX
show every section in the same way: words, figures, tables, and its parts under headings of their own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Literal

import pandas as pd

from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import Exhibit
from shellbench.report.data.table import Note, Table

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
        """True if the section has a table or a figure: words alone are not shown."""
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
