"""The cross-check of solvers: on each case, what every sweep of every solver comes to at its finest, and its table.

Seconds are set against each other where one command took them in one environment, on one core.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import pairwise
from typing import Any

import pandas as pd

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.reference import KnownValue
from shellbench.bench.catalogue.suite import Study, value_words
from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import Record
from shellbench.protocol.engine import ENGINE
from shellbench.report.data.accuracy import AnsweredCase, Family, Point, failed_runs, family, sizes
from shellbench.report.data.columns import Column, Line, Way, column, error, present
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.notation import TEXT, Notation, duration, rounded
from shellbench.report.data.rates import yardstick_of
from shellbench.report.data.runs import Known, grouped, headlines, study_of
from shellbench.report.data.solutions import heading, theory_words
from shellbench.report.data.table import Note, Table

STUDY: Study = "engines"
TOGETHER = 60.0  # seconds between runs that one command planned: a plan of hundreds of runs takes a few
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


@dataclass(frozen=True)
class CheckedCase(AnsweredCase):
    """One case with all who answered it, a family for each choice of a solver's settings.

    Attributes
    ----------
    base
        The solver to which the others are related: the first that the suite declares; empty if it did not answer. Its
        families come first, then the others by name.
    incomparable
        Why there are no ratios of seconds, as the end of a sentence; None if there are.
    """

    base: str
    incomparable: str | None

    @property
    def base_value(self) -> float | None:
        """Value of the finest run of the solver to which the others are related."""
        ours = [one for one in self.families if one.solver == self.base and one.finest is not None]
        finest = max(ours, key=lambda one: one.finest.unknowns if one.finest else 0, default=None)
        return finest.mean("value") if finest else None

    def least(self, level: float, one: Family) -> float | None:
        """Return the least seconds within a level by the strict rule of `Family.cheapest`."""
        found = one.cheapest(level, self.yardstick.floor, "seconds")
        return found[0] if found else None

    def ratio(self, level: float, one: Family) -> float | None:
        """Return these seconds over the least of the solver to which others are related; None if incomparable."""
        least = self.least(level, one)
        ours = [s for each in self.families if each.solver == self.base and (s := self.least(level, each)) is not None]
        return least / min(ours) if least is not None and ours and not self.incomparable else None


def checked_cases(evidence: Evidence) -> list[CheckedCase]:
    """Return the cross-check of each case that a suite of the study declares, in the suites' order."""
    runs = headlines(evidence.runs, STUDY)
    suites = dict.fromkeys(suite for row in runs["row"] for suite in row.suites if study_of(suite) == STUDY)
    order = {case: i for i, case in enumerate(case for suite in suites for case in catalog.find_suite(suite).order)}
    runs = runs.sort_values("case", key=lambda cases: cases.map(order).fillna(len(order)), kind="stable")
    cases = (_checked(of_case, evidence) for _, of_case in runs.groupby("case", sort=False))
    return [one for one in cases if one is not None]


def is_cross_check(cases: Sequence[CheckedCase]) -> bool:
    """Tell whether there is more than one solver: one alone checks nothing."""
    return len({one.solver for case in cases for one in case.families}) > 1


def _checked(runs: pd.DataFrame, evidence: Evidence) -> CheckedCase | None:
    rows = list(runs["row"])
    yardstick = yardstick_of(evidence.records, rows)
    families = _families(sizes(runs, yardstick))
    if yardstick is None or not families:
        return None
    suites = (suite for row in rows for suite in row.suites if study_of(suite) == STUDY)
    declared = next((run.solver for suite in suites for run in catalog.find_suite(suite).runs), "")
    base = declared if any(one.solver == declared for one in families) else ""
    return CheckedCase(
        first=rows[0],
        yardstick=yardstick,
        families=tuple(sorted(families, key=lambda one: (one.solver != base, one.solver, one.variant))),
        failed=failed_runs(rows),
        base=base,
        incomparable=why_incomparable(list(runs["record"].dropna())),
    )


def _families(points: Sequence[Point]) -> list[Family]:
    """Put runs of one solver that differ in one swept setting alone together, default settings among them."""
    found = grouped(points, lambda point: _sweep(point.rows[0]))
    for solver, variant, swept in list(found):
        siblings = [key for key in found if key[:2] == (solver, variant) and key[2]]
        if not swept and siblings:  # a run with defaults is one size of a sweep that changes nothing else
            found[max(siblings, key=lambda key: len(found[key]))] += found.pop((solver, variant, swept))
    return [family(solver, swept, of_family, variant) for (solver, variant, swept), of_family in found.items()]


def _sweep(row: Row) -> tuple[str, str, str]:
    """Return solver, the settings beside the swept one, and the setting over which a suite swept to make a run.

    That may have its default there, and is empty if there is none. A suite's own words will not do for the others, for
    suites may share a run.
    """
    named = row.label.rpartition(", ")[2].partition(" ")[0]
    swept = named if named in row.settings else ""
    fixed = (f"{key} {value_words(value)}" for key, value in sorted(row.overrides.items()) if key != swept)
    return row.solver, ", ".join(fixed), swept


def why_incomparable(records: Sequence[Record]) -> str | None:
    """Say why ratios of the runs' seconds would mislead, as the end of a sentence; None if they would not.

    A record carries the time at which its run was planned; all runs of one command are planned together. It does not
    say how many runs the command made at a time, nor what else the machine did.
    """
    found = [record.environment for record in records]
    machines = dict.fromkeys(f"{one.processor}, {one.cores} cores, {one.platform}" for one in found)
    threads, versions = sorted({one.threads for one in found}), sorted({one.python for one in found})
    if len(machines) > 1:
        return f"they were taken on different machines ({'; '.join(machines)})"
    if len({one.gpu for one in found}) > 1 or len({record.identity.device for record in records}) > 1:
        return "some were taken on a GPU and some were not"
    if threads not in ([], [1]):
        return f"they were taken with {' and '.join(map(str, threads))} threads, not with one"
    if len(versions) > 1:
        return f"they were taken by different versions of Python ({', '.join(versions)})"
    named: dict[str, str] = {}  # not all runs name an engine or a plug-in
    for package, version in (item for one in found for item in one.versions.items()):
        if named.setdefault(package, version) != version:
            return f"they were taken with different versions of {package}"
    commands = planned_apart(records)
    if len(commands) > 1:
        return f"they were taken by {len(commands)} commands, planned at {' and '.join(commands)}"
    return None


def planned_apart(records: Sequence[Record]) -> list[str]:
    """Return when each command planned its first of the runs, to the second."""
    times = sorted(datetime.fromisoformat(created) for created in {record.created for record in records})
    later = [after for before, after in pairwise(times) if (after - before).total_seconds() > TOGETHER]
    return [time.strftime("%Y-%m-%d %H:%M:%S") for time in (*times[:1], *later)]


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
    reasons = grouped((one for one in cases if one.incomparable), lambda one: one.incomparable)
    return [
        Note("; ".join(one.title for one in alike), f"no ratios of seconds, for {reason}.")
        for reason, alike in reasons.items()
    ]
