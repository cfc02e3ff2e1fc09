"""The evidence of a report: records, the rows that compare them, and results that several sections share."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import pandas as pd

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.classes import judged_by_class
from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import Record
from shellbench.report.data.exhibit import Exhibit, Ink, inks
from shellbench.report.data.runs import Known, compared, in_order_of_cases, is_graded, table_of_runs

T = TypeVar("T")


@dataclass(frozen=True)
class Evidence:
    """The evidence that all sections are made from.

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
        """Return the result of `make` on this evidence, computed once and shared by all sections."""
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
        """The rows that hold solvers against known values; those without frozen tolerances are judged by class."""
        return [judged_by_class(row) if is_graded(row) else row for row in compared(self.rows)]

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
