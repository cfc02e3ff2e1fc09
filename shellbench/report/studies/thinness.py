"""The thinness study: error, split of the energy and cost while a shell gets thinner and all else stays the same.

Bending stiffness over membrane stiffness is B / D = h^2 / 12: a thin shell prefers to bend, and what solves for it
must be able to bend it without stretching. The share of bending energy shows whether it can.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from shellbench.bench.catalogue.suite import Study
from shellbench.bench.store.record import portrait_of
from shellbench.protocol.picture import Portrait
from shellbench.report.data.columns import Column, Line, column, error, present, share
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import Dashes, Exhibit, Ink, dashes_of
from shellbench.report.data.notation import MARKDOWN, Notation, anchor, percent, rounded
from shellbench.report.data.runs import Known, in_study, remarks_on
from shellbench.report.data.section import Section, failures
from shellbench.report.data.table import Table
from shellbench.report.figures.panel import SHADE, add_legend, draw, entry, finish, open_figure, shade_entry

STUDY: Study = "thinness"
SHARE_DIGIT = 5e-3  # percentage points: shares are printed with three decimals
SIZE = (7.2, 5.0)  # inches
KNOWN = "#999999"
SPREAD = 0.012  # decades between the marks of two solutions, so that bars do not hide each other
PANELS = {
    "relative error (%)": ("mean_size", "least_size", "largest_size", 100.0),
    "bending energy in strain energy (%)": ("share", "least_share", "largest_share", 100.0),
    "unknowns": ("unknowns", "unknowns", "unknowns", 1.0),
    "wall time (s)": ("seconds", "seconds", "seconds", 1.0),
}  # by ordinate: what is drawn, the ends of its bars, and the factor of them


def section(evidence: Evidence) -> Section | None:
    """Return the section of the thinness study; None if no shell was solved at two thicknesses."""
    families = runs_by_shell(evidence)
    if not families:
        return None
    tables, exhibits, words = [], [], [_what_to_look_for(pd.concat(families)["ratio"])]
    for runs in families:
        title = family_title(list(runs["portrait"]))
        table = thinness_table(runs, title, evidence.known)
        tables.append(table)
        exhibits.append(
            Exhibit(
                name=table.name,
                title=table.title,
                caption="Thinner to the right. Error of the headline figure (shaded: uncertainty of the known value),"
                " share of the bending energy in the strain energy (grey: known), unknowns and wall time of the solve."
                " Bars span the seeds; an open mark: at least one run failed its solver's own check.",
                description=" ".join(findings(table.data)),
                figure=thinness_figure(table.data, evidence.inks),
                run_ids=tuple(runs["run_id"]),
            )
        )
        words += [f"{title}. {sentence}" if not i else sentence for i, sentence in enumerate(findings(table.data))]
    words += remarks_on(evidence.rows, STUDY)
    return Section(STUDY, "Thin and thinner shells", tuple(words), tuple(tables), tuple(exhibits))


def runs_by_shell(evidence: Evidence) -> list[pd.DataFrame]:
    """Return the runs of the study by shell, thickest first; shells of one thickness are left out.

    Each has the `portrait` of its case, its `ratio` of thickness over length, and its `share` of bending energy. A
    shell is the same if its case differs in nothing but the thickness, names, prose and loads.
    """
    runs = evidence.runs[evidence.runs["primary"] & in_study(evidence.runs, STUDY)].dropna(subset="record")
    runs = runs.assign(portrait=[portrait_of(record) for record in runs["record"]])
    thin = [portrait.thinness if portrait is not None else None for portrait in runs["portrait"]]
    runs = runs.assign(
        family=[one.family if one else None for one in thin],
        ratio=[one.ratio if one else math.nan for one in thin],
        share=[
            bending_share(one.portrait, {name: measured.value for name, measured in one.record.values.items()})
            if one.portrait is not None
            else math.nan
            for one in runs.itertuples()
        ],
    ).astype({"share": float})
    families = [family for _, family in runs.groupby("family", sort=False)]
    return [one.sort_values("ratio", ascending=False, kind="stable") for one in families if one["ratio"].nunique() > 1]


def family_title(cases: Sequence[Portrait]) -> str:
    """Return the parts that the titles of all cases have in common; the first title if there are none."""
    titles = [case.title.split(", ") for case in cases]
    return ", ".join(part for part in titles[0] if all(part in title for title in titles)) or cases[0].title


def bending_share(case: Portrait, values: Mapping[str, float]) -> float | None:
    """Return the share of bending in membrane and bending energy; None if one of them is not known."""
    thin = case.thinness
    membrane, bending = (values.get(thin.membrane), values.get(thin.bending)) if thin else (None, None)
    if membrane is None or bending is None or membrane + bending <= 0:
        return None
    return bending / (membrane + bending)


def known_share(case: Portrait, own: bool, known: Known) -> float | None:
    """Return the bending share of the values that judge a case."""
    judges = [value for value in known(case.name).values if value.role == "judge" and value.theory == case.theory]
    return None if own else bending_share(case, {judge.quantity: judge.value for judge in judges})


def thinness_table(runs: pd.DataFrame, title: str, known: Known) -> Table:
    """Return error, share of bending energy and cost of each solver at each thickness of one shell."""
    known_shares = {
        one.ratio: known_share(one.portrait, one.own_case, known) for one in runs.drop_duplicates("ratio").itertuples()
    }
    runs = runs.sort_values(["ratio", "solver", "default_settings"], ascending=[False, True, False], kind="stable")
    runs = runs.assign(known_share=runs["ratio"].map(known_shares).astype(float), size=runs["relative_error"].abs())
    runs = runs.assign(
        departure=runs["share"] - runs["known_share"],
        estimate=runs["uncertainty"] / runs["value"].abs().replace(0.0, math.nan),
        known_doubt=runs["reference_uncertainty"] / runs["reference"].abs().replace(0.0, math.nan),
    )
    groups = runs.groupby(["ratio", "solution"], sort=False)
    data = groups.agg(
        solver=("solver", "first"),
        case=("case", "first"),
        runs=("sound", "size"),
        good=("sound", "sum"),
        mean_error=("relative_error", "mean"),
        worst_error=("relative_error", _worst),
        least_size=("size", "min"),
        mean_size=("size", "mean"),
        largest_size=("size", "max"),
        known_doubt=("known_doubt", "first"),
        share=("share", "mean"),
        least_share=("share", "min"),
        largest_share=("share", "max"),
        known_share=("known_share", "first"),
        share_departure=("departure", _worst),
        own_estimate=("estimate", "max"),
        gap=("energy_gap", "max"),
        unknowns=("unknowns", "max"),
        seconds=("seconds", "mean"),
        run_ids=("run_id", " ".join),
    ).reset_index()
    data.insert(0, "block", data["ratio"].map(lambda ratio: f"{title}, h/L = {_plain(ratio)}"))
    return Table(
        name=f"{STUDY}_{anchor(title).replace('-', '_')}",
        title=f"{title}: from thick to thin",
        caption="Error of the headline figure (mean over seeds, and the worst), share of the bending energy in the"
        " strain energy and how far it is from the known share, in percentage points (the worst seed), the"
        " solver's own estimate of its error if it makes one, difference of the energy between the solve's own"
        " quadrature and a finer one, unknowns and wall time. Runs: those that"
        " ended well, of all. Errors of failed runs count as far as these left an answer."
        " *: less than the uncertainty of the known value.",
        data=data.astype({"unknowns": "Int64"}),
        columns=(
            "solution",
            Column("Runs", lambda line, notation: f"{int(line['good'])}/{int(line['runs'])}"),
            column("mean_error", "Error", _error),
            column("worst_error", way=_error),
            column("share", "Bending energy (%)", _share),
            column(
                "share_departure", "from known (points)", lambda value, _, notation: notation.number(percent(value))
            ),
            column("own_estimate", "Own estimate", share),
            column("gap", "Energy gap", share),
            "unknowns",
            "seconds",
        ),
        notes=failures(runs),
    )


def _worst(values: pd.Series) -> float:
    """Return the value of largest magnitude; NaN if there is none."""
    there = values.dropna()
    return float(there.loc[there.abs().idxmax()]) if len(there) else math.nan


def _what_to_look_for(ratios: pd.Series) -> str:
    stiffest, softest = (MARKDOWN.number(rounded(12 / r**2, 1 / r**2)) for r in (min(ratios), max(ratios)))
    return (
        f"The same shell with h/L from {_plain(max(ratios))} to {_plain(min(ratios))}, h its thickness and L its"
        f" largest extent. Its membrane stiffness over its bending stiffness, D L²/B = 12 (L/h)², grows from"
        f" {softest} to {stiffest}. A discretisation that can't bend without stretching locks: the thinner the"
        " shell, the more its displacements fall short, and stretching takes part of the energy that bending should"
        " have. An error that grows while the share of bending energy stays right is a matter of resolution: the"
        " layers along edges and around forces, about √(hR) wide, get thinner too. The energy gap of a solve tells"
        " whether it exploits its quadrature; it does not bound the error."
    )


def findings(data: pd.DataFrame) -> list[str]:
    """Return a sentence for each solution: error and bending share at both ends, and what failed."""
    sentences = []
    for name, lines in data.groupby("solution", sort=False):
        judged = lines[lines["mean_size"].notna()].to_dict("records")
        runs, good = int(lines["runs"].sum()), int(lines["good"].sum())
        parts = []
        if judged:
            ends = dict.fromkeys((judged[0]["ratio"], judged[-1]["ratio"]))
            worst = {line["ratio"]: line["worst_error"] for line in judged}
            parts.append(
                "largest error "
                + " and ".join(f"{MARKDOWN.error(worst[ratio])} at h/L = {_plain(ratio)}" for ratio in ends)
            )
            gap = judged[-1]["gap"]
            if present(gap):
                parts.append(f"energy gap {share(gap, {}, MARKDOWN)} at h/L = {_plain(judged[-1]['ratio'])}")
        departures = [line for line in lines.to_dict("records") if present(line["share_departure"])]
        if departures:
            most = max(departures, key=lambda line: abs(line["share_departure"]))
            points = MARKDOWN.number(percent(most["share_departure"]))
            parts.append(f"bending share off by at most {points} percentage points (at h/L = {_plain(most['ratio'])})")
        if good < runs:
            where = ", ".join(_plain(ratio) for ratio in lines.loc[lines["good"] < lines["runs"], "ratio"])
            parts.append(f"{runs - good} of {runs} runs failed (at h/L = {where})")
        sentences.append(f"{name}: {'; '.join(parts) or 'no answer that could be judged'}.")
    return sentences


def _plain(ratio: float) -> str:
    return f"{float(f'{ratio:.2g}'):.1e}".replace(".0e", "e").replace("e-0", "e-")


def _error(value: float, line: Line, notation: Notation) -> str:
    doubt = line["known_doubt"]
    return error(value, line, notation) + (notation.escape("*") if present(doubt) and abs(value) < doubt else "")


def _share(value: float, line: Line, notation: Notation) -> str:
    return notation.number(rounded(100 * value, SHARE_DIGIT))


def thinness_figure(data: pd.DataFrame, inks: Mapping[str, Ink]) -> Figure:
    """Draw the table of one shell, thinner to the right; variants of a solver differ in their dashes."""
    figure, panels = open_figure(SIZE, 2, 2, sharex=True)
    solutions = data.groupby("solution", sort=False)
    dashes = dashes_of(solutions.groups)
    for axes, (label, columns) in zip(panels.flat, PANELS.items(), strict=True):
        linear = columns[0] == "share"
        for place, (name, lines) in enumerate(solutions):
            shift = 10 ** (SPREAD * (place - (len(solutions) - 1) / 2))
            seen = lines[lines[columns[0]].notna() & (linear | (lines[columns[0]] > 0))]
            _curve(axes, seen, columns, shift, inks[lines["solver"].iloc[0]], dashes[name])
        finish([axes], y=label, log="x" if linear else "xy")
    _known(panels[0, 0], panels[0, 1], data.drop_duplicates("ratio"))
    for axes in panels[1]:
        axes.set_xlabel("thickness over length h/L")
    panels[0, 0].invert_xaxis()
    entries = {name: entry(inks[name.partition(", ")[0]], linestyle=dashes[name]) for name in solutions.groups}
    if data["known_share"].notna().any():
        entries["known share"] = entry(color=KNOWN, linewidth=3)
    add_legend(figure, entries | shade_entry(data["known_doubt"].notna().any()), 4)
    return figure


def _curve(
    axes: Axes, seen: pd.DataFrame, columns: tuple[str, str, str, float], shift: float, ink: Ink, dashes: Dashes
) -> None:
    """Draw a solution with bars over its seeds, its marks open where a run failed."""
    *names, factor = columns
    x = seen["ratio"].to_numpy(dtype=float) * shift
    middle, low, high = (factor * seen[name].to_numpy(dtype=float) for name in names)
    bars = np.vstack([middle - low, high - middle])
    if np.any(bars > 0):
        axes.errorbar(x, middle, bars, color=ink.colour, linestyle="none", linewidth=0.8, capsize=2)
    failed = (seen["good"] < seen["runs"]).to_numpy(dtype=bool)
    draw(axes, x, middle, ink, dashes)
    draw(axes, x[failed], middle[failed], ink, "none", hollow=True)


def _known(errors: Axes, shares: Axes, known: pd.DataFrame) -> None:
    """Draw what is known of the answer: the uncertainty of its value, and its share of bending energy."""
    doubt = known[known["known_doubt"].fillna(0) > 0]
    if len(doubt):
        bottom = min(errors.get_ylim()[0], 50 * doubt["known_doubt"].min())
        upper = 100 * doubt["known_doubt"].to_numpy(dtype=float)
        errors.fill_between(doubt["ratio"].to_numpy(dtype=float), bottom, upper, color=SHADE, alpha=0.35, linewidth=0)
        errors.set_ylim(bottom=bottom)
    share = known[known["known_share"].notna()]
    shares.plot(share["ratio"], 100 * share["known_share"], color=KNOWN, linewidth=3, zorder=0)
