"""The section on whole fields: how far the solvers' are from each other.

A headline figure can be right by chance; a field can't. All fields are compared on the grid that every record keeps,
with the field of a deterministic solver if there is exactly one, and with no other.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from shellbench.report.data.columns import code, column
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.fields import differences, read_fields
from shellbench.report.data.section import Section, given
from shellbench.report.data.table import Table


def section(found: Evidence) -> Section:
    """Return the section of differences between fields."""
    tables = given(field_table(found))
    return Section("fields", "Whole fields", tables=tables, place="its suites")


def field_table(evidence: Evidence) -> Table:
    """Return the table of differences between fields."""
    runs = evidence.made[evidence.made["default_settings"] & evidence.made["sound"]]  # the same load
    cases = [_held(of_case, evidence.folder) for _, of_case in runs.groupby(["case", "own_case"], sort=False)]
    held = pd.concat([runs.iloc[:0].assign(against="", mean_square=0.0, largest=0.0), *cases])
    lines = held.groupby(["case", "own_case", "solution"], sort=False).agg(
        block=("title", "first"),
        against=("against", "first"),
        seeds=("run_id", "size"),
        mean_square=("mean_square", "max"),
        largest=("largest", "max"),
        run_ids=("run_id", " ".join),
    )
    shown = ["block", "case", "solution", "against", "seeds", "mean_square", "largest", "run_ids"]
    return Table(
        name="fields",
        title="Differences between fields",
        caption="Root of the mean square over the shell's area, and largest, of the difference between displacement"
        " fields, relative to the same measure of the field that they are held against; the worst seed of each.",
        data=lines.reset_index()[shown].astype({"seeds": "Int64"}),
        columns=(column("solution", way=code), "against", "seeds", "mean_square", "largest"),
    )


def _held(runs: pd.DataFrame, folder: Path) -> pd.DataFrame:
    """Return the runs of a case that have a field beside that of the only deterministic one, and how far they are."""
    certain = runs[runs["seed"].isna()]
    theirs = read_fields(certain["record"].iloc[0], folder) if len(certain) == 1 else None
    if theirs is None or not np.any(theirs.displacement):
        return runs.iloc[:0]
    others = runs.drop(certain.index)
    fields = [read_fields(record, folder) for record in others["record"]]
    fit = [one is not None and one.position.shape == theirs.position.shape for one in fields]
    apart = [differences(one, theirs) for one, fits in zip(fields, fit, strict=True) if one is not None and fits]
    squares, largest = zip(*apart, strict=True) if apart else ((), ())
    return others[fit].assign(against=certain["solver"].iloc[0], mean_square=squares, largest=largest)
