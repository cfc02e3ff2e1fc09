"""The section on engines: solvers that share no line of mechanics, some on engines of others, on the same cases."""

from __future__ import annotations

from collections.abc import Sequence

from shellbench.report.digits import percent
from shellbench.report.engines_cases import STUDY, CheckedCase, checked_cases, is_cross_check
from shellbench.report.engines_figure import cross_check_figure, drawn_cases
from shellbench.report.engines_table import LEVELS, cross_check_table, factor
from shellbench.report.evidence import Evidence, Section
from shellbench.report.exhibit import Exhibit
from shellbench.report.notation import TEXT
from shellbench.report.palette import inks, style
from shellbench.report.studies import remarks_on


def section(evidence: Evidence) -> Section | None:
    """Return the section; None if no suite cross-checks engines on any case."""
    cases = checked_cases(evidence.records, evidence.rows)
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
    environments = [
        record.environment
        for row in evidence.rows
        if row.case in compared and (record := evidence.records.get(row.run_id or "")) is not None
    ]
    processors = " and ".join(dict.fromkeys(one.processor for one in environments))
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
        parts = [part for level in LEVELS if (part := _won(related, level))]
        if parts:
            sentences.append(
                f"Of the cases on which another solver reaches an error, {base} needs no more time than any:"
                f" {'; '.join(parts)}."
            )
    return sentences


def _won(cases: Sequence[CheckedCase], level: float) -> str:
    """Say on how many cases no other solver is faster; a case that only others reach is lost."""
    ratios, contested = [], 0
    for one in cases:
        others = [each for each in one.contenders if each.solver != one.base]
        if any(one.least(level, each) is not None for each in others):
            contested += 1
            ratios += (
                [min(found)] if (found := [r for each in others if (r := one.ratio(level, each)) is not None]) else []
            )
    if not contested:
        return ""
    won = sum(ratio >= 1 for ratio in ratios)
    longer = f" (the fastest other takes {_span(ratios)} times as long)" if ratios else ""
    return f"within {100 * level:g} % on {won} of {contested}{longer}"


def _span(ratios: Sequence[float]) -> str:
    low, high = factor(min(ratios)), factor(max(ratios))
    return low if low == high else f"{low} to {high}"


def _exhibits(evidence: Evidence, cases: Sequence[CheckedCase]) -> tuple[Exhibit, ...]:
    drawn = drawn_cases(cases)
    if not drawn:
        return ()
    colours = inks(row.solver for row in evidence.rows)
    with style():
        figure = cross_check_figure(drawn, colours)
    runs = [run for one in drawn for each in one.contenders for point in each.family.points for run in point.run_ids]
    return (
        Exhibit(
            name="cross_check",
            title="Error and time, by solver and settings",
            caption="Error of the headline quantity from the known value against wall time of the solve. A line is one"
            " choice of a solver's settings, a mark one size. Grey lines: the errors at which the table states seconds."
            " Shaded: below the uncertainty of the known value.",
            description=". ".join(_described(one) for one in drawn),
            figure=figure,
            run_ids=tuple(dict.fromkeys(runs)),
            drawing=True,
        ),
    )


def _described(one: CheckedCase) -> str:
    reached = []
    for each in one.contenders:
        sound = [point.error for point in each.family.points if point.sound]
        down = f"down to {TEXT.number(percent(min(sound), signed=False))} %" if sound else "failed"
        reached.append(f"{each.name} {down}")
    return f"{one.title}: {'; '.join(reached)}"
