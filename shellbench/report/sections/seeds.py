"""The section on seeds: how far apart the answers of one solver are that differ in nothing but their random numbers."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pandas as pd

from shellbench.report.data.columns import Column, Line, column, count, share
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.notation import Notation, rounded
from shellbench.report.data.rates import known_yardstick
from shellbench.report.data.section import Section, given
from shellbench.report.data.table import Note, Table

WIDTH, LINE, GAP, MARGIN = 6.2, 0.155, 0.1, 1.0  # inches of the figure, a line, between cases, and of axis and legend
WORKING = ("title", "solver", "studied", "unit", "floor", "errors")  # and not in the table


def section(evidence: Evidence) -> Section | None:
    """Return the section; None if no solver answered a case with two seeds."""
    found = seed_spreads(evidence)
    if found.empty:
        return None
    compared = found[~found["studied"]]
    return Section(
        name="seeds",
        title="Spread over seeds",
        words=(
            "A neural field starts from random numbers. These runs differ in nothing else. Their spread shows how much"
            " an answer depends on the seed; a user may get the worst one.",
        ),
        tables=given(seed_table(compared)),
    )


def seed_spreads(evidence: Evidence) -> pd.DataFrame:
    """Return a line for each case and solver of which two seeds or more ended well: those of the table, and `WORKING`.

    Errors are relative to the known value, or from the mean where there is none.
    """
    seeded = evidence.runs[evidence.runs["primary"] & evidence.runs["seed"].notna()]
    groups = seeded.groupby(["case", "own_case", "alike"], sort=False)
    found = pd.DataFrame([line for _, alike in groups if (line := _spread(alike, evidence)) is not None])
    if found.empty:
        return found
    order = {case: place for place, case in enumerate(found["case"].unique())}
    keys = [  # numbers in words are what pandas does not sort by
        (order[line.case], line.studied, natural_key(line.solution)) for line in found.itertuples()
    ]
    return found.iloc[sorted(range(len(found)), key=keys.__getitem__)]


def _spread(alike: pd.DataFrame, evidence: Evidence) -> dict[str, Any] | None:
    runs = alike[~alike["run_id"].duplicated(keep="last") | (alike["run_id"] == "")]
    good = runs[runs["sound"] & np.isfinite(runs["value"])]
    if len(good) < 2 or not (mean := float(good["value"].mean())):
        return None
    values, seeds, first = good["value"].to_numpy(), good["seed"].astype(int).to_list(), good.iloc[0]
    known = known_yardstick(evidence.records, list(good["row"]))
    scale = known.scale if known else abs(mean)
    errors = (values - (known.value if known else mean)) / scale
    worst = int(np.argmax(np.abs(errors)))
    deviation = float(values.std(ddof=1))
    return {
        "block": f"{first['title']} ({first['unit']})" if first["unit"] else first["title"],
        **{name: first[name] for name in ("case", "title", "solver", "solution", "unit")},
        "studied": not first["default_settings"] and bool(first["studies"]),
        "seeds": " ".join(map(str, seeds)),
        "answered": len(good),
        "asked": len(runs),
        "mean": mean,
        "standard_deviation": deviation,
        "relative_standard_deviation": deviation / scale,
        "largest_from_mean": float(np.max(np.abs(values - mean))) / scale,
        "mean_error": float(np.mean(errors)) if known else None,
        "largest_error": float(errors[worst]) if known else None,
        "worst_seed": seeds[worst],
        "reference": known.value if known else None,
        "floor": known.floor if known else 0.0,
        "errors": tuple(map(float, errors)),
        "run_ids": " ".join(good["run_id"]),
    }


def natural_key(words: str) -> list[tuple[int, str]]:
    """Return a key that sorts words with numbers in them by the numbers."""
    parts = re.split(r"(\d+)", words)
    return [(int(part), "") if part.isdigit() else (0, part) for part in parts]


def seed_table(found: pd.DataFrame) -> Table:
    """Return the table of spreads."""
    return Table(
        name="seeds",
        title="Spread over seeds",
        caption="Mean and sample standard deviation of the headline quantity over seeds; the standard deviation and"
        " the largest distance from the mean relative to the known value, or to the mean where none is known; mean and"
        " largest error against the known value, and the seed that has the largest. Those of a position are relative to"
        " the extent of the shell. Runs that failed are left out.",
        data=found.drop(columns=list(WORKING)),
        columns=(
            "solution",
            Column("Seeds", _seeds),
            column("mean", "Mean", _mean),
            column("relative_standard_deviation", "Standard deviation", share),
            column("largest_from_mean", "Largest from mean", share),
            "mean_error",
            "largest_error",
            column("worst_seed", way=count),
        ),
        notes=tuple(
            Note(f"{spread.title}, {spread.solution}", f"{spread.asked - spread.answered} of {spread.asked} failed.")
            for spread in found[found["answered"] < found["asked"]].itertuples()
        ),
    )


def _seeds(line: Line, notation: Notation) -> str:
    answered, asked = int(line["answered"]), int(line["asked"])
    return str(asked) if answered == asked else notation.strong(f"{answered} of {asked}")


def _mean(mean: float, line: Line, notation: Notation) -> str:
    return notation.number(rounded(mean, line["standard_deviation"] or None))
