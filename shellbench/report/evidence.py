"""The sections of evidence: consistency, memory, convergence and cost, and the studies, each from records alone.

A section is made by one module, which knows which runs it can use; the page shows those that have something to show.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import pandas as pd

from shellbench.bench import catalog
from shellbench.bench.record import Record
from shellbench.bench.row import Row
from shellbench.report.exhibit import Exhibit
from shellbench.report.palette import Ink, inks
from shellbench.report.runs import table_of_runs
from shellbench.report.solutions import Known
from shellbench.report.table import Table

T = TypeVar("T")


@dataclass(frozen=True)
class Section:
    """One section of the page.

    Attributes
    ----------
    name
        Its anchor.
    words
        Paragraphs, plain words.
    details
        Long tables behind it, kept as CSV only.
    """

    name: str
    title: str
    words: tuple[str, ...]
    tables: tuple[Table, ...]
    exhibits: tuple[Exhibit, ...]
    details: tuple[Table, ...] = ()


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
        """The rows as one table, see `shellbench.report.runs`."""
        return table_of_runs(self.records, self.rows)

    @cached_property
    def inks(self) -> Mapping[str, Ink]:
        """Colour and marker of each solver."""
        return inks(row.solver for row in self.rows)


Maker = Callable[[Evidence], Section | None]
