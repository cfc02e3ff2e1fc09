"""How a cell is written that many tables have: names of solutions, counts, seconds, bytes, shares and errors."""

from __future__ import annotations

from shellbench.report.digits import byte_size, duration, percent
from shellbench.report.notation import Notation
from shellbench.report.table import Line, Show, present


def solution(line: Line, notation: Notation) -> str:
    """Write the name of a solution: the solver's in typewriter, and how it departs from its defaults."""
    solver, comma, variant = str(line["solution"]).partition(", ")
    return notation.code(solver) + notation.escape(f"{comma}{variant}")


def count(name: str) -> Show:
    """Return how to write a whole number."""

    def show(line: Line, notation: Notation) -> str:
        return str(int(line[name])) if present(line[name]) else notation.missing

    return show


def seconds(line: Line, notation: Notation) -> str:
    """Write wall time with two significant digits."""
    return duration(line["seconds"]) if present(line["seconds"]) else notation.missing


def memory(name: str) -> Show:
    """Return how to write a number of bytes, in the unit that suits it."""

    def show(line: Line, notation: Notation) -> str:
        return notation.escape(byte_size(line[name])) if present(line[name]) else notation.missing

    return show


def share(name: str) -> Show:
    """Return how to write a share in percent."""

    def show(line: Line, notation: Notation) -> str:
        value = line[name]
        return notation.number(percent(value, signed=False)) + notation.per_cent if present(value) else notation.missing

    return show


def error(name: str) -> Show:
    """Return how to write a relative error in percent, with its sign."""

    def show(line: Line, notation: Notation) -> str:
        return notation.error(line[name]) if present(line[name]) else notation.missing

    return show
