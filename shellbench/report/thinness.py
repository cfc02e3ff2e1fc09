"""The thinness study: error, split of the energy and cost while a shell gets thinner and all else stays the same.

Bending stiffness over membrane stiffness is B / D = h^2 / 12: a thin shell prefers to bend, and what solves for it
must be able to bend it without stretching. The share of bending energy shows whether it can.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any

import pandas as pd

from shellbench.bench.kinds import portrait_of
from shellbench.bench.record import Record
from shellbench.bench.row import Row
from shellbench.bench.suite import Study
from shellbench.portrait import Portrait
from shellbench.report import cells
from shellbench.report.digits import percent, rounded
from shellbench.report.evidence import Evidence, Section
from shellbench.report.exhibit import Exhibit
from shellbench.report.notation import MARKDOWN, Notation, anchor
from shellbench.report.palette import inks
from shellbench.report.solutions import Known, grouped, solution_name
from shellbench.report.studies import remarks_on, studies_of
from shellbench.report.table import Column, Line, Note, Show, Table, present
from shellbench.report.thinness_figure import thinness_figure

STUDY: Study = "thinness"
SHARE_DIGIT = 5e-3  # percentage points: shares are printed with three decimals
INTEGERS = ("runs", "good", "unknowns")


@dataclass(frozen=True)
class Member:
    """A run of the study: its headline row, its record, its case and the known values of that."""

    row: Row
    record: Record
    case: Portrait
    ratio: float


def section(evidence: Evidence) -> Section | None:
    """Return the section of the thinness study; None if no shell was solved at two thicknesses."""
    families = thinning(evidence.records, evidence.rows)
    if not families:
        return None
    colours = inks(row.solver for row in evidence.rows)
    tables, exhibits, words = [], [], [_what_to_look_for(families)]
    for members in families:
        title = family_title(members)
        table = thinness_table(members, title, evidence.known)
        tables.append(table)
        exhibits.append(
            Exhibit(
                name=table.name,
                title=table.title,
                caption="Thinner to the right. Error of the headline figure (shaded: uncertainty of the known value),"
                " share of the bending energy in the strain energy (grey: known), unknowns and wall time of the solve."
                " Bars span the seeds; an open mark: at least one run failed its solver's own check.",
                description=" ".join(findings(table.data)),
                figure=thinness_figure(table.data, colours),
                run_ids=tuple(member.record.run_id for member in members),
                drawing=True,
            )
        )
        words += [f"{title}. {sentence}" if not i else sentence for i, sentence in enumerate(findings(table.data))]
    words += remarks_on(evidence.rows, STUDY)
    return Section(STUDY, "Thin and thinner shells", tuple(words), tuple(tables), tuple(exhibits))


def thinning(records: Mapping[str, Record], rows: Iterable[Row]) -> list[list[Member]]:
    """Return the runs of the study by shell, thickest first; shells of one thickness are left out.

    A shell is the same if its case differs in nothing but the thickness, names, prose and loads.
    """
    found: dict[str, list[Member]] = {}
    for row in rows:
        record = records.get(row.run_id or "")
        if record is None or not row.primary or STUDY not in studies_of(row):
            continue
        case = portrait_of(record)
        if case is not None and (thin := case.thinness) is not None:
            found.setdefault(thin.family, []).append(Member(row, record, case, thin.ratio))
    families = [sorted(members, key=lambda member: -member.ratio) for members in found.values()]
    return [members for members in families if members[0].ratio > members[-1].ratio]


def family_title(members: Sequence[Member]) -> str:
    """Return what the titles of all cases have in common, part by part; the first title if that is nothing."""
    titles = [member.case.title.split(", ") for member in members]
    return ", ".join(part for part in titles[0] if all(part in title for title in titles)) or members[0].case.title


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


def thinness_table(members: Sequence[Member], title: str, known: Known) -> Table:
    """Return error, share of bending energy and cost of each solver at each thickness of one shell."""
    lines: list[dict[str, Any]] = []
    notes: list[Note] = []
    by_run = {member.record.run_id: member for member in members}
    for ratio in dict.fromkeys(member.ratio for member in members):
        of_ratio = [member for member in members if member.ratio == ratio]
        share = known_share(of_ratio[0].case, of_ratio[0].record.own_case, known)
        ordered = sorted((member.row for member in of_ratio), key=lambda row: (row.solver, not row.default_settings))
        for name, rows in grouped(ordered, solution_name).items():
            group = [by_run[row.run_id or ""] for row in rows]
            common = {"block": f"{title}, h/L = {_plain(ratio)}", "ratio": ratio, "solution": name}
            lines.append(common | _line(group, share))
            notes += _notes(name, ratio, group)
    return Table(
        name=f"{STUDY}_{anchor(title).replace('-', '_')}",
        title=f"{title}: from thick to thin",
        caption="Error of the headline figure (mean over seeds, and the worst), share of the bending energy in the"
        " strain energy and how far it is from the known share, in percentage points (the worst seed), the"
        " solver's own estimate of its error if it makes one, difference of the energy between the solve's own"
        " quadrature and a finer one, unknowns and wall time. Runs: those that"
        " ended well, of all. Errors of failed runs count as far as these left an answer."
        " *: less than the uncertainty of the known value.",
        data=pd.DataFrame(lines).astype(dict.fromkeys(INTEGERS, "Int64")),
        columns=(
            Column("Solution", cells.solution, right=False),
            Column("Runs", _runs),
            Column("Error", _error("mean_error")),
            Column("Worst", _error("worst_error")),
            Column("Bending energy (%)", _share),
            Column("from known (points)", _departure),
            Column("Own estimate", cells.share("own_estimate")),
            Column("Energy gap", cells.share("gap")),
            Column("Unknowns", cells.count("unknowns")),
            Column("Time (s)", cells.seconds),
        ),
        notes=tuple(notes),
    )


def _line(group: Sequence[Member], known: float | None) -> dict[str, Any]:
    rows = [member.row for member in group]
    errors = [row.relative_error for row in rows if row.relative_error is not None]
    measured = [
        bending_share(member.case, {name: one.value for name, one in member.record.values.items()}) for member in group
    ]
    shares = [share for share in measured if share is not None]
    estimates = [row.uncertainty / abs(row.value) for row in rows if row.uncertainty is not None and row.value]
    gaps = [row.energy_gap for row in rows if row.energy_gap is not None]
    first = rows[0]
    return {
        "solver": first.solver,
        "case": first.case,
        "runs": len(rows),
        "good": sum(row.status == "ok" for row in rows),
        "mean_error": fmean(errors) if errors else None,
        "worst_error": max(errors, key=abs, default=None),
        "least_size": min(map(abs, errors), default=None),
        "mean_size": fmean(map(abs, errors)) if errors else None,
        "largest_size": max(map(abs, errors), default=None),
        "known_doubt": first.reference_uncertainty / abs(first.reference)
        if first.reference and first.reference_uncertainty is not None
        else None,
        "share": fmean(shares) if shares else None,
        "least_share": min(shares, default=None),
        "largest_share": max(shares, default=None),
        "known_share": known,
        "share_departure": max((share - known for share in shares), key=abs, default=None)
        if known is not None
        else None,
        "own_estimate": max(estimates, default=None),
        "gap": max(gaps, default=None),
        "unknowns": max((row.parameters for row in rows if row.parameters is not None), default=None),
        "seconds": fmean(seconds) if (seconds := [row.seconds for row in rows if row.seconds is not None]) else None,
        "run_ids": " ".join(member.record.run_id for member in group),
    }


def _notes(name: str, ratio: float, group: Sequence[Member]) -> list[Note]:
    reasons = dict.fromkeys(m.record.reason or m.record.status for m in group if m.record.status != "ok")
    return [Note(f"{name}, h/L = {_plain(ratio)}", reason) for reason in reasons]


def _what_to_look_for(families: Sequence[Sequence[Member]]) -> str:
    ratios = [member.ratio for members in families for member in members]
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
                parts.append(f"energy gap {_unsigned(gap, MARKDOWN)} at h/L = {_plain(judged[-1]['ratio'])}")
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


def _runs(line: Line, notation: Notation) -> str:
    return f"{int(line['good'])}/{int(line['runs'])}"


def _error(which: str) -> Show:
    def show(line: Line, notation: Notation) -> str:
        error, doubt = line[which], line["known_doubt"]
        if not present(error):
            return notation.missing
        return notation.error(error) + (notation.escape("*") if present(doubt) and abs(error) < doubt else "")

    return show


def _share(line: Line, notation: Notation) -> str:
    share = line["share"]
    return notation.number(rounded(100 * share, SHARE_DIGIT)) if present(share) else notation.missing


def _departure(line: Line, notation: Notation) -> str:
    points = line["share_departure"]
    return notation.number(percent(points)) if present(points) else notation.missing


def _unsigned(error: float, notation: Notation) -> str:
    return notation.number(percent(error, signed=False)) + notation.per_cent
