"""The one vocabulary of columns: what a column of a table is called, and how its cells are written.

A column of a table is named by the column of its frame, ``columns=("solution", "unknowns", "seconds")``. Heading, unit,
side, sort key and way of being written are declared here, once. A table that departs says so where it does:
``column("mean_error", "Error")``, and declares what it alone has in the same words:
``column("drift", "Energy drift", significant(2), unit="J")``.

The frame holds a column only if its maker names it: for ``shellbench table`` that is `report.data.solutions.COLUMNS`.
`count` and `size` are ways for whole numbers; a ratio takes `significant` or `share`.

A way writes a value that is there. A value that is not there is a dash, or what the column has `instead`; in a line
about a known value, whose `kind` is not "solver", it is nothing: there is nothing to say.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import pandas as pd

from shellbench.report.data.notation import Notation, byte_size, duration, percent, quoted, rounded

Line = Mapping[str, Any]
Show = Callable[[Line, Notation], str]
Way = Callable[[Any, Line, Notation], str]


@dataclass(frozen=True)
class Column:
    """One column of a table.

    Attributes
    ----------
    heading
        Plain words.
    show
        Writes the cell of a row of the data in a notation.
    right
        Whether numbers are aligned to the right.
    wide
        Whether it holds sentences: neither the terminal nor a printed page has room for it.
    key
        Column of the data by which a reader sorts this one at full precision; what its cells show if empty.
    """

    heading: str
    show: Show
    right: bool = True
    wide: bool = False
    key: str = ""

    def sort_value(self, line: Line) -> float | None:
        """Return the number by which a row of the data is sorted; None if it has none."""
        value = line.get(self.key)
        return float(value) if isinstance(value, int | float) and present(value) and isfinite(value) else None


def present(value: Any) -> bool:
    """Tell whether a cell of the data has a value."""
    return value is not None and value is not pd.NA and value == value and value != ""


# Ways in which a value is written. They take the line too, for an uncertainty or a unit that stands in it.


def words(value: Any, line: Line, notation: Notation) -> str:
    """Write plain words."""
    return notation.escape(str(value))


def code(value: Any, line: Line, notation: Notation) -> str:
    """Write a name in typewriter."""
    return notation.code(str(value))


def solution(value: Any, line: Line, notation: Notation) -> str:
    """Write the name of a solution: the solver's in typewriter, and how it departs from its defaults."""
    solver, comma, variant = str(value).partition(", ")
    return notation.code(solver) + notation.escape(f"{comma}{variant}")


def count(value: Any, line: Line, notation: Notation) -> str:
    """Write a whole number."""
    return str(int(value))


def seconds(value: Any, line: Line, notation: Notation) -> str:
    """Write wall time with two significant digits."""
    return duration(value)


def size(value: Any, line: Line, notation: Notation) -> str:
    """Write a number of bytes, in the unit that suits it."""
    return notation.escape(byte_size(value))


def share(value: Any, line: Line, notation: Notation) -> str:
    """Write a share in percent."""
    return notation.number(percent(value, signed=False)) + notation.per_cent


def error(value: Any, line: Line, notation: Notation) -> str:
    """Write a relative error in percent, with its sign."""
    return notation.error(value)


def significant(figures: int) -> Way:
    """Return a format with a given number of significant digits, and one more if the first digit is a 1."""

    def written(value: Any, line: Line, notation: Notation) -> str:
        return notation.number(rounded(value, abs(value) / 10 ** (figures - 1) or None))

    return written


def at_most(figures: int) -> Way:
    """Return a format with at most a given number of significant digits, without trailing zeros."""

    def written(value: Any, line: Line, notation: Notation) -> str:
        return notation.number(quoted(float(f"{value:.{figures}g}")))

    return written


def rounded_value(value: Any, line: Line, notation: Notation) -> str:
    """Write a value of which nothing limits the digits."""
    return notation.number(rounded(value))


def known_value(value: Any, line: Line, notation: Notation) -> str:
    """Write a known value with its uncertainty in the last digits."""
    doubt = line["reference_uncertainty"]
    return notation.number(rounded(value, doubt if present(doubt) else None, show_uncertainty=True))


def strong(way: Way) -> Way:
    """Return a format that emphasises the value."""
    return lambda value, line, notation: notation.strong(way(value, line, notation))


def in_its_unit(name: str, way: Way) -> Show:
    """Return a format for another column of the data with the unit of its line; empty if the column has no value."""

    def written(line: Line, notation: Notation) -> str:
        value = line[name]
        return f"{way(value, line, notation)} {notation.escape(str(line['unit']))}" if present(value) else ""

    return written


LEFT = (words, code, solution)  # ways that are no numbers
WHOLE = (count, size)


def column(
    name: str,
    heading: str | None = None,
    way: Way | None = None,
    *,
    unit: str = "",
    right: bool | None = None,
    wide: bool = False,
    instead: Show | None = None,
) -> Column:
    """Return a column of a table.

    Parameters
    ----------
    name
        Column of the data.
    heading, way
        As the vocabulary has them unless they depart from it.
    unit
        Stands in the heading.
    right
        Whether it is aligned to the right; follows from the way unless given.
    wide
        Whether it holds sentences.
    instead
        Writes what stands where there is no value; a dash if that is empty.
    """
    if heading is None or way is None:
        declared_heading, declared_way = VOCABULARY[name]
        heading = declared_heading if heading is None else heading
        way = way or declared_way
    write = way

    def written(line: Line, notation: Notation) -> str:
        if present(value := line.get(name)):
            return write(value, line, notation)
        nothing = notation.missing if line.get("kind", "solver") == "solver" else ""
        return (instead(line, notation) if instead else "") or nothing

    aligned = way not in LEFT if right is None else right
    heading = f"{heading} ({unit})" if unit else heading
    return Column(heading, written, aligned, wide, name if aligned else "")


def frame(lines: Sequence[Line], columns: Sequence[str] | None = None) -> pd.DataFrame:
    """Return lines as the data of a table, whole numbers as such though some be missing.

    With `columns`, names that it lacks are dropped.
    """
    data = pd.DataFrame(list(lines), columns=columns)
    counts = [name for name in data if name in VOCABULARY and VOCABULARY[name][1] in WHOLE]
    return data.astype({name: "Int64" for name in counts if not data[name].map(type).eq(str).any()})


def _declared(way: Way, **headings: str) -> dict[str, tuple[str, Way]]:
    return {name: (heading, way) for name, heading in headings.items()}


COST = ("unknowns", "seconds", "peak_memory_bytes")  # of a run, in every table that tells it
VOCABULARY: dict[str, tuple[str, Way]] = {
    **_declared(solution, solution="Solution"),
    **_declared(code, solver="Solver", against="Held against"),
    **_declared(words, run="Run", engine="Engine", environment="Environment", ended="Ended", when="Time"),
    **_declared(count, seeds="Seeds", answered="Answered", runs="Runs", worst_seed="Worst seed", states="States"),
    **_declared(count, steps="Steps", iterations="Iterations", most_in_a_step="Most in a step"),
    **_declared(count, unknowns="Unknowns", parameters="Unknowns"),
    **_declared(seconds, seconds="Time (s)"),
    **_declared(size, storage_bytes="Kept in", peak_memory_bytes="Memory", solve_memory_bytes="Peak less idle"),
    **_declared(known_value, reference="Known value"),
    **_declared(error, error="Error", relative_error="Error", mean_error="Mean error", worst_error="Worst"),
    **_declared(error, largest_error="Largest error"),
    **_declared(share, mean_square="Mean square", largest="Largest", largest_difference="Largest"),
    **_declared(share, rms_difference="rms"),
}
