"""Answers of other programs: read from a filled-in answers.csv, or measured from nodal results."""

from __future__ import annotations

import csv
import hashlib
import io
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from importlib import import_module
from pathlib import Path
from typing import TypeAlias, cast

import pandas as pd

from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.kinds import find_kind
from shellbench.errors import InputError, without_middle
from shellbench.files import LARGEST_RESULT, read_file
from shellbench.problem import NodalValues, Problem
from shellbench.protocol.sheet import ANSWERS
from shellbench.protocol.spelling import did_you_mean
from shellbench.protocol.units import System, factor_between, length_of

COLUMNS, MORE = ANSWERS[:5], ANSWERS[5:]
NODAL = re.compile(rb"\bux\b|\bu1\b", re.IGNORECASE)  # in the first line of a table of displacements
SAME_MARK = 1e-6  # relative difference of two marks of one state
Source: TypeAlias = Path | pd.DataFrame


@dataclass(frozen=True)
class Answer:
    """One value of one quantity on one mesh.

    Attributes
    ----------
    value
        In the quantity's unit.
    cells, unknowns, seconds
        Of the mesh and of the solve; None if not stated.
    file, where
        Name of the file, and the place in it, for messages.
    nearest
        Distance of the nearest node, if it was measured on a mesh.
    rounding
        Half a unit of the last digit that was stated, in the quantity's unit.
    """

    case: Problem
    quantity: str
    value: float
    cells: int | None
    unknowns: int | None
    seconds: float | None
    file: str
    where: str
    nearest: float | None = None
    rounding: float = 0.0

    @property
    def size(self) -> float | None:
        """Size of a cell, up to a factor; None if the mesh is not stated."""
        count = self.cells or self.unknowns
        return None if count is None else float(count) ** -0.5


@dataclass(frozen=True)
class Read:
    """Answers of some files, with the SHA-256 of each file and remarks."""

    answers: tuple[Answer, ...]
    files: Mapping[str, str]
    remarks: tuple[str, ...] = ()


def read_sources(sources: Sequence[Source], case: str | None, units: str | None) -> Read:
    """Read answers and nodal results.

    Parameters
    ----------
    sources
        Files, or tables as pandas holds them.
    case
        Name or path of the case of nodal results; also of rows whose column `case` is empty.
    units
        System of units of nodal results, such as mm-N-MPa; the case's own if None.

    Raises
    ------
    InputError
        In one sentence with file, line and field.
    """
    given = None if case is None else catalog.find_case(case)
    answers: list[Answer] = []
    files: dict[str, str] = {}
    remarks: list[str] = []
    for number, source in enumerate(sources, 1):
        name = source.name if isinstance(source, Path) else f"table {number}"
        content = _content(source)
        digest = hashlib.sha256(content).hexdigest()
        nodal = name.endswith((".vtu", ".dat")) or NODAL.search(content.split(b"\n", 1)[0]) is not None
        if files.setdefault(name, digest) != digest:
            raise InputError(f"{source}: another file is called {name} too")
        if not nodal:
            answers += _rows(name, content, given)
            continue
        if given is None or not isinstance(source, Path):
            raise InputError(f"{name}: nodal results need a file, and --case with the case that they answer")
        found = _measured(given, source, 1.0 if units is None else _length_factor(units, given))
        remarks.append(f"{name}: {found.cells} cells cover {100 * found.share:.3g} % of the shell's coordinates")
        for quantity, value in found.values.items():
            near = found.nearest.get(quantity)
            answers.append(Answer(given, quantity, value, found.cells, None, None, name, "the nodal results", near))
    if not answers:
        raise InputError(f"{', '.join(files)}: no value is filled in")
    return Read(tuple(answers), files, tuple(remarks))


def _length_factor(units: str, case: Problem) -> float:
    """Return the factor from lengths in a system of units to those of a case."""
    system, own = System.read(units), length_of(case.units)
    if own is None:
        raise InputError(f"--units: case '{case.name}' does not name its unit of length: give the file in its units")
    return factor_between(system.length, own)


def _measured(case: Problem, path: Path, factor: float) -> NodalValues:
    module, _, function = find_kind(case.kind).nodes.partition(":")
    if not module:
        raise InputError(f"{path}: problems of kind '{case.kind}' take no nodal results: fill in answers.csv instead")
    return cast(NodalValues, getattr(import_module(module), function)(case, path, factor))


def _content(source: Source) -> bytes:
    if isinstance(source, pd.DataFrame):
        return bytes(source.to_csv(index=False), "utf-8")
    try:
        return read_file(source, LARGEST_RESULT)
    except InputError as error:
        raise InputError(f"{source}: {error}") from None


def _rows(name: str, content: bytes, given: Problem | None) -> Iterator[Answer]:
    """Yield the filled-in rows of a table."""
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{name}: it is no text in UTF-8: save it as CSV") from None
    head = text.partition("\n")[0]
    table = csv.reader(io.StringIO(text), delimiter=next((sign for sign in ";\t" if sign in head), ","))
    columns = [column.strip() for column in next(table, [])]
    lacking = [column for column in COLUMNS if column not in columns]
    unknown = [column for column in columns if column not in COLUMNS + MORE]
    if len(lacking) == len(COLUMNS):
        raise InputError(
            f"{name}: line 1 is no heading of answers ({','.join(COLUMNS)}), nor of displacements (x,y,z,ux,uy,uz);"
            " CalculiX writes its displacements to .dat"
        )
    if lacking or unknown or len(set(columns)) < len(columns):
        found = f"no column '{lacking[0]}'" if lacking else f"the columns {without_middle(head.strip())!r}"
        raise InputError(f"{name}: line 1: found {found}; allowed are {', '.join(COLUMNS)} and {', '.join(MORE)}")
    for cells in table:
        where = f"line {table.line_num}"
        if not any(cell.strip() for cell in cells):
            continue
        if len(cells) != len(columns):
            raise InputError(f"{name}: {where}: found {len(cells)} cells, and line 1 has {len(columns)}")
        row = dict(zip(columns, (cell.strip() for cell in cells), strict=True))
        if row["value"]:
            yield _Row(name, where, row).answer(given)


@dataclass(frozen=True)
class _Row:
    file: str
    where: str
    cells: Mapping[str, str]

    def wrong(self, field: str, error: object) -> InputError:
        return InputError(f"{self.file}: {self.where}, field '{field}': {error}")

    def number(self, field: str, least: float = -math.inf) -> float | None:
        text = self.cells.get(field, "")
        try:
            # a mesh may be given as 16 x 16
            found = math.prod(float(part) for part in text.lower().split("x")) if field == "cells" else float(text)
        except ValueError:
            found = math.nan
        if text and not (math.isfinite(found) and found >= least):
            raise self.wrong(field, f"found {without_middle(text)!r}, but it must be a finite number, such as 0.25")
        return found if text else None

    def answer(self, given: Problem | None) -> Answer:
        name = self.cells["case"]
        try:
            case = given if given is not None and name in ("", given.name) else catalog.find_case(name)
        except InputError as error:
            raise self.wrong("case", error) from None
        quantity = next((q for q in case.quantities if q.name == self.cells["quantity"]), None)
        if quantity is None:
            names, asked = [q.name for q in case.quantities], self.cells["quantity"]
            hint = did_you_mean(asked, names)
            found = f"found {without_middle(asked)!r}{hint}"
            raise self.wrong("quantity", f"{found}; case '{case.name}' has {', '.join(names)}")
        value = self.number("value")
        assert value is not None
        try:
            factor = factor_between(self.cells["unit"], quantity.unit)
        except InputError as error:
            raise self.wrong("unit", error) from None
        rounding = abs(factor) / 2 * 10.0 ** min(int(Decimal(self.cells["value"]).as_tuple().exponent), 300)
        try:
            mark: float | None = float(self.cells["at"])
        except ValueError:  # words about the place
            mark = None
        if mark is not None and quantity.mark is not None and not math.isclose(mark, quantity.mark, rel_tol=SAME_MARK):
            raise self.wrong("at", f"found {mark:g}, but the quantity is asked at {quantity.mark:g}")
        counts = [None if (n := self.number(field, 1)) is None else int(n) for field in MORE[:2]]
        seconds = self.number("seconds", 0)
        return Answer(
            case, quantity.name, value * factor, counts[0], counts[1], seconds, self.file, self.where, rounding=rounding
        )
