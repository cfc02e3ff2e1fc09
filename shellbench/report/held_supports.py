"""The section on supports: built into the field, or asked for by a penalty (Kairanda et al., figure II, F.1)."""

from __future__ import annotations

import math

import numpy as np

from shellbench.bench.record import Record
from shellbench.report.columns import Line, column, words
from shellbench.report.evidence import Evidence, Section
from shellbench.report.notation import Notation, quoted
from shellbench.report.resolution import metres, of_largest
from shellbench.report.runs import in_order_of_cases
from shellbench.report.solutions import STATUS_WORDS
from shellbench.report.table import Note, Table

SUPPORT_ERROR = "support_error"  # diagnostics of a solver that can leak: the largest displacement at held places, m
PENALTY = "penalty"  # the weight of the penalty, None where supports are built into the field


def section(evidence: Evidence) -> Section | None:
    """Return the section; None if no run held its supports by a penalty."""
    table = support_table(evidence)
    if table is None:
        return None
    return Section(
        name="supports",
        title="Hard and soft supports",
        words=(
            "A support can be built into the form of a field, which then holds it for all weights, or it can be"
            " asked for by a penalty: a spring of a chosen weight along the held places. A soft support leaks by what"
            " the spring gives; too stiff a spring makes the equations ill-conditioned. The weight has to be found by"
            " trial, and no weight holds the support exactly.",
        ),
        tables=(table,),
        exhibits=(),
    )


def support_table(evidence: Evidence) -> Table | None:
    """Return a line for each run that says how well it holds its supports, of cases with a penalty in any run."""
    runs = evidence.runs[evidence.runs["primary"]].dropna(subset="record")
    found = runs.assign(
        penalty=[_number(record, PENALTY) for record in runs["record"]],
        support_error=[_number(record, SUPPORT_ERROR) for record in runs["record"]],
        largest_displacement=[
            max((step.largest_displacement for step in record.resolution), default=math.nan)
            for record in runs["record"]
        ],
    ).dropna(subset="support_error")
    soft = found["penalty"].fillna(0.0) != 0
    found = found[found["case"].isin(found.loc[soft, "case"]) & (soft | found["default_settings"])]
    first = found.groupby(["case", "solution"], sort=False)["seed"].transform(lambda seeds: seeds.iloc[0])
    found = found[(found["seed"] == first) | (found["seed"].isna() & first.isna())]
    if found.empty:
        return None
    found = in_order_of_cases(found.assign(weight=found["penalty"].replace(0.0, np.nan)), ["weight"])
    failed = found[~found["sound"] & (found["reason"] != "")].drop_duplicates(["solution", "reason"])
    ended = found["status"].map({"ok": "solved", **STATUS_WORDS})
    data = found.assign(block=found["title"], ended=ended.fillna(found["status"]))
    shown = ["block", "case", "solution", "run_id", "penalty", "support_error", "largest_displacement"]
    return Table(
        name="supports",
        title="Hard and soft supports",
        caption="Weight of the penalty (none: the support is built into the field), largest displacement at held"
        " places, that share of the largest displacement of the shell, and the error of the headline quantity."
        " One seed.",
        data=data[[*shown, "relative_error", "ended"]],
        columns=(
            "solution",
            column("penalty", "Weight", _weight, instead=lambda line, notation: "none"),
            column("support_error", "At held places (m)", metres),
            column("support_error", "Of the largest", of_largest),
            "relative_error",
            column("ended", way=words),
        ),
        notes=tuple(Note(one.solution, one.reason) for one in failed.itertuples()),
    )


def _number(record: Record, name: str) -> float:
    value = record.diagnostics.get(name)
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan


def _weight(value: float, line: Line, notation: Notation) -> str:
    return notation.number(quoted(value))
