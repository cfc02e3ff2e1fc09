"""Sheets of cases: a folder for a person with a program that shellbench does not know."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.kinds import find_kind
from shellbench.disk import said_plainly
from shellbench.errors import InputError
from shellbench.problem import Problem
from shellbench.protocol.sheet import ANSWERS, Request, Sheet

ANSWERS_FILE = "answers.csv"


def sheets_of(cases: Sequence[str], suites: Sequence[str], request: Request) -> tuple[list[Sheet], tuple[str, ...]]:
    """Return the sheets of cases and suites, and a note for each case of a suite that has none.

    Raises
    ------
    InputError
        If a case that is named has none, or no case of the suites has one.
    """
    found = {}
    for text in cases:
        made = _sheet(catalog.find_case(text), request)
        rows = ((text, *row[1:]) for row in made.answers)  # an own case is found by its file
        found[made.name] = replace(made, answers=tuple(rows))
    notes = []
    for case in (case for suite in suites for case in catalog.cases_of(suite) if case.name not in found):
        try:
            found[case.name] = _sheet(case, request)
        except InputError as error:
            notes.append(str(error))
    if not found:
        raise InputError(f"no case has a sheet: {notes[0]}" if notes else "name a case, or a --suite")
    return list(found.values()), tuple(notes)


def _sheet(case: Problem, request: Request) -> Sheet:
    make = find_kind(case.kind).sheet
    if make is None:
        raise InputError(f"{case.name} has no sheet: programs with meshes do not solve problems of kind '{case.kind}'")
    return make(case, request)


def write_sheets(sheets: Sequence[Sheet], out: Path, draw: Callable[[Sheet, Path], None]) -> Path:
    """Write a folder for each sheet and one table of answers for all; return that table.

    Parameters
    ----------
    draw
        Writes a sketch into a file.

    Raises
    ------
    InputError
        If the table is there and has been filled in, or is another one: nothing is written.
    """
    answers = out / ANSWERS_FILE
    text = [ANSWERS, *(row for sheet in sheets for row in sheet.answers)]
    with said_plainly(out, "folder"):
        if answers.exists():
            with answers.open(encoding="utf-8", errors="replace", newline="") as file:
                kept = [tuple(row) for row in csv.reader(file)]
            if any(any(cell.strip() for cell in row[3:4]) for row in kept[1:]) or kept[:1] != [ANSWERS]:
                raise InputError(f"{answers} has been filled in: it is not overwritten; choose another --out")
        for sheet in sheets:
            folder = out / sheet.name
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "problem.md").write_text(sheet.statement, encoding="utf-8")
            draw(sheet, folder / "sketch.svg")
            for name, write in sheet.files.items():
                write(folder / name)
        with answers.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows(text)
    return answers
