"""The section on engines: solvers that share no line of mechanics, some on engines of others, on the same cases."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from shellbench.report.data.accuracy import Family, down_to
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import Dashes, Exhibit, Ink, dashes_of
from shellbench.report.data.notation import duration
from shellbench.report.data.runs import remarks_on
from shellbench.report.data.section import Section
from shellbench.report.figures import panel
from shellbench_kratos.engines_table import (
    LEVELS,
    STUDY,
    CheckedCase,
    checked_cases,
    cross_check_table,
    is_cross_check,
)

WIDTH, HEIGHT, MARGIN = 7.4, 2.45, 0.6  # inches of the figure, a row of panels, and the legend
IN_A_ROW, ENTRIES = 2, 3  # panels and entries of the legend beside each other
BIG, SMALL = 6.0, 3.6  # marks
LEVEL_COLOUR = "#999999"


def section(evidence: Evidence) -> Section | None:
    """Return the section; None if no suite cross-checks engines on any case."""
    cases = evidence.once(checked_cases)
    if not is_cross_check(cases):
        return None
    return Section(
        name="engines",
        title="Engines",
        words=(
            "The same cases by solvers that share the question and no line of mechanics, some of them on engines that"
            " others wrote. An engine's name and version are part of a run's identity.",
            _timing_words(evidence, cases),
            *_fastest(cases),
            *remarks_on(evidence.rows, STUDY),
        ),
        tables=(cross_check_table(cases, evidence.known),),
        exhibits=_exhibits(evidence, cases),
    )


def _timing_words(evidence: Evidence, cases: Sequence[CheckedCase]) -> str:
    limits = (
        "A record says neither how many runs its command made at a time nor what else the machine did: read seconds as"
        " factors rather than digits."
    )
    compared = {one.case for one in cases if not one.incomparable}
    if not compared:
        return (
            "Seconds are wall time of the solve alone. There are no ratios of them; why is said below the table."
            f" {limits}"
        )
    records = evidence.runs.loc[evidence.runs["case"].isin(compared), "record"].dropna()
    processors = " and ".join(dict.fromkeys(record.environment.processor for record in records))
    which = "" if len(compared) == len(cases) else " Where ratios are withheld, the table says why."
    return (
        f"Seconds are wall time of the solve alone. All runs of a case were planned by one command and solved with one"
        f" thread each on one machine ({processors}).{which} {limits}"
    )


def _fastest(cases: Sequence[CheckedCase]) -> list[str]:
    """Say for each error on how many cases the solver to which others are related needs no more time than any."""
    sentences = []
    for base in dict.fromkeys(one.base for one in cases if one.base and not one.incomparable):
        related = [one for one in cases if one.base == base and not one.incomparable]
        parts = [part for level in LEVELS if (part := _wins(related, level))]
        if parts:
            sentences.append(
                f"Of the cases on which another solver reaches an error, {base} needs no more time than any:"
                f" {'; '.join(parts)}."
            )
    return sentences


def _wins(cases: Sequence[CheckedCase], level: float) -> str:
    """Say on how many cases no other solver is faster; a case that only others reach is lost."""
    ratios, contested = [], 0
    for one in cases:
        others = [each for each in one.families if each.solver != one.base]
        if any(one.least(level, each) is not None for each in others):
            contested += 1
            ratios += sorted(ratio for each in others if (ratio := one.ratio(level, each)) is not None)[:1]
    if not contested:
        return ""
    won = sum(ratio >= 1 for ratio in ratios)
    longer = f" (the fastest other takes {_span(ratios)} times as long)" if ratios else ""
    return f"within {100 * level:g} % on {won} of {contested}{longer}"


def _span(ratios: Sequence[float]) -> str:
    low, high = duration(min(ratios)), duration(max(ratios))
    return low if low == high else f"{low} to {high}"


def _exhibits(evidence: Evidence, cases: Sequence[CheckedCase]) -> tuple[Exhibit, ...]:
    drawn = drawn_cases(cases)
    if not drawn:
        return ()
    return (
        Exhibit(
            name="cross_check",
            title="Error and time, by solver and settings",
            caption="Error of the headline quantity from the known value against wall time of the solve. A line is one"
            " choice of a solver's settings, a mark one size. Grey lines: the errors at which the table states seconds."
            " Shaded: below the uncertainty of the known value. Hatched: times in which a process starts, which tell"
            " little of the solve.",
            description=". ".join(
                f"{one.title}: " + "; ".join(f"{each.name} {down_to(each.points)}" for each in one.families)
                for one in drawn
            ),
            figure=cross_check_figure(drawn, evidence.inks),
            run_ids=tuple(dict.fromkeys(run_id for one in drawn for run_id in one.run_ids)),
        ),
    )


def drawn_cases(cases: Sequence[CheckedCase]) -> list[CheckedCase]:
    """Return the cases that have a panel: those with a curve."""
    return [one for one in cases if any(not each.alone for each in one.families)]


def cross_check_figure(cases: Sequence[CheckedCase], inks: Mapping[str, Ink]) -> Figure:
    """Draw the panels; horizontal lines are the errors for which the table has the seconds."""
    drawn = drawn_cases(cases)
    dashes, starting, shaded = lines_of(drawn), False, False
    rows = math.ceil(len(drawn) / IN_A_ROW)
    figure, panels = panel.open_figure((WIDTH, rows * HEIGHT + MARGIN), rows, min(IN_A_ROW, len(drawn)))
    for axes in panels.flat[len(drawn) :]:
        axes.set_axis_off()
    for i, (axes, one) in enumerate(zip(panels.flat, drawn, strict=False)):
        for each in one.families:
            _draw(axes, each, inks[each.solver], dashes.get(each.name, "none"))
        for level in LEVELS:
            axes.axhline(100 * level, color=LEVEL_COLOUR, linewidth=0.7, zorder=0.5)
        ordinate = "" if i % IN_A_ROW else panel.ERROR_LABEL
        panel.finish([axes], "wall time of the solve (s)", ordinate, one.title, floor=100 * one.yardstick.floor)
        starting |= panel.shade_start(axes)
        shaded |= 100 * one.yardstick.floor > axes.get_ylim()[0]
    further = panel.shade_entry(shaded) | panel.start_entry(starting)
    panel.add_legend(figure, _legend(drawn, inks, dashes) | further, ENTRIES)
    return figure


def lines_of(cases: Sequence[CheckedCase]) -> dict[str, Dashes]:
    """Return the dashes of each line by its name: the same in all panels, different for one solver's settings."""
    names = sorted({(each.solver, each.name) for one in cases for each in one.families if not each.alone})
    return dashes_of(name for _, name in names)


def _draw(axes: Axes, each: Family, ink: Ink, line: Dashes) -> None:
    look = {"markersize": BIG, "markeredgecolor": "black", "zorder": 3} if each.alone else {"markersize": SMALL}
    drawn = [(point.seconds, 100 * point.error, point.sound) for point in each.points]
    panel.draw_runs(axes, drawn, ink, line, linewidth=1.0, **look)


def _legend(cases: Sequence[CheckedCase], inks: Mapping[str, Ink], dashes: Mapping[str, Dashes]) -> dict[str, Any]:
    families = [each for one in cases for each in one.families]
    solver_of = {each.name: each.solver for each in families}
    entries = {
        name: panel.entry(replace(inks[solver_of[name]], dashes=line), linewidth=1.0) for name, line in dashes.items()
    }
    for each in families:  # a run alone is named in full, that with default settings too
        if each.alone:
            name = each.name if each.variant else f"{each.name}, default settings"
            look = {"color": inks[each.solver].colour, "marker": inks[each.solver].marker}
            entries[name] = panel.mark_entry(**look, markersize=BIG, markeredgecolor="black")
    entries["errors of the table"] = panel.entry(color=LEVEL_COLOUR, linewidth=0.7)
    entries |= panel.failed_entry(any(not point.sound for each in families for point in each.points))
    return entries
