"""The cross-check table: on each case the known value, then every solver's own, how they differ, and the seconds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pandas as pd

from shellbench.bench.reference import KnownValue
from shellbench.engine import ENGINE
from shellbench.report.accuracy import Family
from shellbench.report.columns import Column, Line, Way, column, error, present
from shellbench.report.engines_cases import CheckedCase
from shellbench.report.notation import TEXT, Notation, duration, rounded
from shellbench.report.solutions import Known, heading, theory_words
from shellbench.report.table import Note, Table

LEVELS = (1e-3, 1e-4, 1e-5)
COLUMNS = (
    *("block", "case", "kind", "name", "solver", "settings", "value", "uncertainty", "source", "deviation", "error"),
    *("reference_uncertainty", "doubtful", "extrapolated_error", "from_base", "unknowns"),
    *(f"{what}_{level:g}" for level in LEVELS for what in ("seconds", "ratio")),
    *("alone", "engine", "run_ids"),
)
ALONE = "†"
TIMES = "×"
CAPTION = (
    "A line is one choice of a solver's settings, over all sizes that it ran with. Value, error and unknowns are those"
    " of its finest run that ended well. Seconds: least wall time of a solve within the given error of the known value,"
    " there and in all finer runs of the line, the uncertainty of the known value counted against it."
    f" {ALONE}: one size alone, which no finer one confirms. Digits in brackets are the uncertainty of the last digits;"
    " an error marked * is smaller than the uncertainty of the known value."
)


def cross_check_table(cases: Sequence[CheckedCase], known: Known) -> Table:
    """Return the table of all cases."""
    lines = [line for one in cases for line in (_known(one), *(_solver(one, each) for each in one.families))]
    bases = list(dict.fromkeys(one.base for one in cases if one.base))
    return Table(
        name="cross_check",
        title="Solvers and engines, cross-checked",
        caption=" ".join(filter(None, (CAPTION, _extrapolation(lines), _relation(bases)))),
        data=pd.DataFrame(lines, columns=COLUMNS),
        columns=(
            column("name", "Solver", _name, right=False),
            column("value", "Value", _value),
            column("error", way=_marked),
            *_if_any(lines, "extrapolated_error", column("extrapolated_error", "Extrapolated", error)),
            *_if_any(lines, "from_base", column("from_base", f"From {' or '.join(bases)}", error)),
            "unknowns",
            *(column(f"seconds_{level:g}", f"{100 * level:g} % (s)", _seconds(level)) for level in LEVELS),
            *_if_any(lines, "engine", "engine"),
        ),
        notes=(*_origins(cases, known), *_withheld(cases), *(note for one in cases for note in one.failures())),
        sources=tuple(dict.fromkeys(str(line["source"]) for line in lines if present(line.get("source")))),
    )


def _if_any(lines: Sequence[Line], name: str, one: str | Column) -> tuple[str | Column, ...]:
    return (one,) if any(present(line.get(name)) for line in lines) else ()


def _relation(bases: Sequence[str]) -> str:
    if not bases:
        return ""
    named = " or ".join(bases)
    return (
        f"From {named}: relative difference to the finest value of {named}. In brackets: the seconds over the least of"
        f" {named} at that error, with any of its settings; above 1, {named} is the faster."
    )


def _extrapolation(lines: Sequence[Line]) -> str:
    stated = any(present(line.get("extrapolated_error")) for line in lines)
    return "Extrapolated: error of the value that a solver itself extrapolates." if stated else ""


def _known(one: CheckedCase) -> dict[str, Any]:
    row = one.first
    return {
        "block": heading(row),
        "case": one.case,
        "kind": "known",
        "name": "Known value" if row.reference is not None else "Best answer",
        "value": one.yardstick.value,
        "uncertainty": one.yardstick.floor * one.yardstick.scale,
        "source": row.reference_source,
        "doubtful": False,
        "alone": False,
    }


def _solver(one: CheckedCase, each: Family) -> dict[str, Any]:
    engines = dict.fromkeys(row.settings.get(ENGINE) for point in each.points for row in point.rows)
    line = {
        "block": heading(one.first),
        "case": one.case,
        "kind": "solver",
        "name": each.name,
        "solver": each.solver,
        "settings": each.variant,
        "value": each.mean("value"),
        "uncertainty": each.mean("uncertainty"),
        "reference_uncertainty": one.yardstick.floor * one.yardstick.scale,
        "doubtful": False,
        "alone": each.alone,
        "engine": ", ".join(str(engine) for engine in engines if engine is not None),
    }
    value, extrapolated, base = each.mean("value"), each.mean("extrapolated"), one.base_value
    if value is None or each.finest is None:
        return line
    line |= {
        "error": one.yardstick.error(value),
        "doubtful": abs(one.yardstick.error(value)) < one.yardstick.floor,
        "deviation": value - one.yardstick.value,
        "unknowns": each.finest.unknowns,
        "run_ids": " ".join(each.finest.run_ids),
    }
    if extrapolated is not None:
        line["extrapolated_error"] = one.yardstick.error(extrapolated)
    if base is not None and each.solver != one.base:
        line["from_base"] = (value - base) / one.yardstick.scale
    for level in LEVELS:
        line |= {f"seconds_{level:g}": one.least(level, each), f"ratio_{level:g}": one.ratio(level, each)}
    return line


def _name(value: Any, line: Line, notation: Notation) -> str:
    if line["kind"] == "known":
        cited = f" {notation.cite(line['source'])}" if present(line["source"]) else ""
        return notation.strong(notation.escape(value)) + cited
    settings = f", {line['settings']}" if line["settings"] else ""
    return notation.code(line["solver"]) + notation.escape(settings)


def _value(value: Any, line: Line, notation: Notation) -> str:
    if line["kind"] == "known":
        return notation.strong_number(rounded(value, line["uncertainty"], show_uncertainty=True))
    doubts = (line["uncertainty"], line["reference_uncertainty"], abs(line["deviation"]) / 10)
    return notation.number(rounded(value, max(filter(present, doubts))))


def _marked(value: Any, line: Line, notation: Notation) -> str:
    return error(value, line, notation) + (notation.escape("*") if line["doubtful"] else "")


def _seconds(level: float) -> Way:
    def written(value: Any, line: Line, notation: Notation) -> str:
        ratio, mark = line[f"ratio_{level:g}"], ALONE if line["alone"] else ""
        return notation.escape(f"{duration(value)}{mark}" + (f" ({TIMES}{duration(ratio)})" if present(ratio) else ""))

    return written


def _origins(cases: Sequence[CheckedCase], known: Known) -> list[Note]:
    """Say of what theory and origin each known value is, and what second derivations confirm it."""
    notes = []
    for one in cases:
        row, theory = one.first, one.first.reference_theory or ""
        judge = known(one.case).judge(row.quantity, theory) if row.reference is not None else None
        if judge is None:
            if row.reference is None:
                notes.append(Note(f"{one.title}, no known value", f"errors are relative to {one.yardstick.words}."))
            continue
        others = "; ".join(map(_origin, known(one.case).of(row.quantity, "origin")))
        confirmed = f" Other origins: {others}." if others else ""
        words = f"{theory_words(theory)}; {judge.origin}.{confirmed}"
        notes.append(Note(f"{one.title}, known value", words, row.reference_source or ""))
    return notes


def _origin(value: KnownValue) -> str:
    digits = rounded(value.value, value.uncertainty, show_uncertainty=True)
    return f"{value.origin}, {TEXT.number(digits)} [{value.source}]"


def _withheld(cases: Sequence[CheckedCase]) -> list[Note]:
    """Say why ratios are withheld."""
    reasons: dict[str, list[str]] = {}
    for one in cases:
        if one.incomparable:
            reasons.setdefault(one.incomparable, []).append(one.title)
    return [Note("; ".join(titles), f"no ratios of seconds, for {reason}.") for reason, titles in reasons.items()]
