"""The sections of evidence: consistency, memory, convergence and cost, and the studies, each from records alone.

A section is made by one module, which knows which runs it can use; the page shows those that have something to show.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from shellbench.bench import catalog
from shellbench.bench.record import Record
from shellbench.bench.row import Row
from shellbench.report.exhibit import Exhibit
from shellbench.report.solutions import Known
from shellbench.report.table import Table


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


Maker = Callable[[Evidence], Section | None]
