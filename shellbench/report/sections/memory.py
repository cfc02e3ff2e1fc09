"""Memory: bytes to keep an answer at stated error, what shorter numbers do to it, and what the solve itself took."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter

from shellbench.report.data.answers import (
    LEVELS,
    KeptForm,
    Measure,
    answers,
    change_by_rounding,
    field_is_known,
    headline_is_known,
    headline_size,
    smallest_form,
)
from shellbench.report.data.columns import Column, Line, Show, column, error, frame, present, words
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import DASHES, Exhibit, Ink
from shellbench.report.data.ladder import CaseRuns, Ladder, Run, case_runs
from shellbench.report.data.notation import Notation, byte_size, quoted
from shellbench.report.data.runs import remarks_on
from shellbench.report.data.section import Section, given
from shellbench.report.data.table import Table
from shellbench.report.figures.panel import add_legend, draw, entry, finish, open_figure, shade_entry
from shellbench.report.sections.resolution import of_largest, yardstick_words

NOT_KNOWN, NOT_REACHED, REACHED = "not known", "not reached", "reached"
OWN, MESH = "its own numbers", "a mesh"
FIELD, HEADLINE = "field", "headline"
WIDTH, HEIGHT, MARGIN = 3.5, 2.3, 0.45  # inches: a panel, its height, and the legend
MEGABYTE = 1e6
SMALLEST = 1e-10  # relative difference below which rounding is all there is
OTHER_WAYS: Mapping[str, dict[str, Any]] = {
    "rounded": {"line": DASHES[1], "hollow": True, "linewidth": 0.9},
    "mesh": {"line": DASHES[2], "marker": ".", "markersize": 4, "linewidth": 1.2},
}
ORDINATES: Mapping[Measure, str] = {"error": "error of the headline (%)", "difference": "difference (% of the largest)"}
DOUBTS: Mapping[Measure, str] = {
    "error": "uncertainty of the known value",
    "difference": "uncertainty of the best answer",
}
WAY_WORDS = {"rounded": "numbers rounded", "mesh": "mesh made from it"}
WORDS = (
    "The bytes of a solution are those of the numbers that give its displacement: the weights of a field, the"
    " coefficients and mesh lines of finite elements, of a motion for all times that are kept, with rates where the"
    " solver keeps them. Where a hidden layer was drawn at random and never solved for, its weights count among the"
    " bytes, though its seed would do, and not among the unknowns. Connectivity of meshes is not counted. These bytes"
    " do not depend on the grid or frame rate at which the solution is asked; those of a mesh, or of a sequence of"
    " meshes, made from it do (after Kairanda et al. 2023, figure 8). Bytes mean little without an error, so they are"
    " stated together.",
    "The error of a field is the largest difference at the same material points, and at all kept instants or loads,"
    " from the best answer available, which each case names, relative to its largest displacement. What rounding to"
    " fewer digits or interpolation in a mesh add is measured by itself, and added; this bounds the difference"
    " at the probes from above. A run is credited with no smaller one than that answer itself is known to, and a level"
    " below this is called not known. The best answer is some solver's finest run: that solver's own line tells how"
    " fast it converges, not how right it is. The error of the headline quantity is against its known value; that of a"
    " position is relative to the largest displacement. The figures judge by it wherever there is one.",
    "The probes are few points: an error between them is not seen. A mesh is a regular grid with bilinear cells; one"
    " graded to the solution would need fewer vertices, and its vertices are in double precision, of which single"
    " precision is half. Compression is left out. The memory of a solve is that of its process, with the libraries"
    " that it loads; less what was held before it, it is nearer to the method's own need, but memory that is reused"
    " within the process is not told apart.",
)


def section(evidence: Evidence) -> Section | None:
    """Return the section; None if no run says how many bytes it takes."""
    found = evidence.once(case_runs)
    cases = [one for one in found if any(run.record.storage_bytes for ladder in one.ladders for run in ladder.runs)]
    tables = given(level_table(cases), rounding_table(cases))
    if not tables:
        return None
    studied = [case for case in cases if any(len(ladder.levels) > 1 for ladder in case.ladders)]
    return Section(
        name="memory",
        title="Memory",
        words=(*WORDS, *remarks_on(evidence.rows, "resolution")),
        tables=tables,
        exhibits=tuple(one for case in studied or cases if (one := _exhibit(case, evidence.inks)) is not None),
    )


def _exhibit(case: CaseRuns, inks: Mapping[str, Ink]) -> Exhibit | None:
    measure = measure_of(case)
    kept = {ladder.solver: answers(case, ladder) for ladder in case.ladders}
    own = None if measure == "error" or case.yardstick is None else case.yardstick.row.solver
    shown = {solver: found for solver, found in kept.items() if solver != own}
    if not any(getattr(answer, measure) for found in shown.values() for answer in found):
        return None
    said = [
        f"{solver}: within {percents(level)} in {best.storage_bytes} bytes, {best.format}"
        for solver, found in shown.items()
        for level in LEVELS
        if (best := smallest_form(found, level, measure=measure)) is not None and _is_known(case, measure, level)
    ]
    against = (
        "error of the headline quantity against its known value"
        if measure == "error"
        else "difference from the best answer, for no value is known"
        f" (it is of {own}, which has no curve: its own finest run would judge it),"
    )
    return Exhibit(
        name=f"memory_{case.case}",
        title=f"{case.title}: memory at stated error",
        caption=f"Left: {against} against the bytes that keep an answer: as solved (full marks); its numbers rounded to"
        " fewer digits (open marks, dashed) and a mesh made from it (dotted), the least of each error. Grey lines:"
        f" levels of 1 %, 0.1 % and 0.01 %; shaded: {DOUBTS[measure]}. Right: memory of the solve, less what its"
        f" process held before.{'' if measure == 'error' else f' {yardstick_words(case)}'}",
        description="; ".join(said) or "no level is reached",
        figure=memory_figure(case, shown, measure, inks),
        run_ids=tuple(run.record.run_id for ladder in case.ladders for run in ladder.runs),
    )


def measure_of(case: CaseRuns) -> Measure:
    """Return the measure of the figure: the error if a value is known, else the difference from the best answer."""
    known = any(headline_size(case, run) for ladder in case.ladders for run in ladder.runs)
    return "error" if known else "difference"


def _doubt(case: CaseRuns, measure: Measure) -> float:
    """Return the relative uncertainty of the values that a measure compares with."""
    if measure == "difference":
        return case.doubt / case.scale if case.doubt and case.scale else 0.0
    runs = [run for ladder in case.ladders for run in ladder.runs]
    return max((run.row.reference_uncertainty or 0.0) / size for run in runs if (size := headline_size(case, run)))


def _is_known(case: CaseRuns, measure: Measure, level: float) -> bool:
    return field_is_known(case, level) if measure == "difference" else _doubt(case, measure) <= level


def percents(level: float) -> str:
    """Say a level in percent, as the heading of a column."""
    return f"{quoted(float(f'{100 * level:.6g}')).mantissa} %"


def level_table(cases: Sequence[CaseRuns]) -> Table:
    """Return the fewest bytes for each case, solver, way of keeping and level."""
    lines = [line for case in cases for ladder in case.ladders for line in _level_lines(case, ladder)]
    data = frame(lines)
    kinds = [(kind, level) for kind in (FIELD, HEADLINE) for level in LEVELS]
    return Table(
        name="memory",
        title="Bytes at stated error",
        caption="The fewest bytes in which a solver's answer, of any resolution it was computed at, can be kept so that"
        " the displacement at all probes is within 1 %, 0.1 % or 0.01 % of the largest displacement of the best answer"
        " available, and so that the headline quantity is as near to its known value (a position: relative to the"
        " largest displacement); all finer runs of the solver, other seeds among them, must be so too. Its own numbers:"
        " coefficients or weights, as solved or rounded, where rounding's largest difference is added; a mesh: vertices"
        " of a regular grid (of a motion, times frames), where the interpolation's is added. Not known: the best"
        " answer, or the known value, is less certain than the level.",
        data=data.astype({name: "Int64" for name in data if str(name).startswith("bytes_")}),
        columns=(
            "solver",
            column("kept_as", "Kept as", words),
            *(Column(f"{kind.capitalize()}, {percents(level)}", _size(kind, level)) for kind, level in kinds),
            Column("Runs", _runs, right=False, wide=True),
        ),
    )


def _level_lines(case: CaseRuns, ladder: Ladder) -> Iterator[dict[str, Any]]:
    found = answers(case, ladder)
    for kept_as in (OWN, MESH):
        candidates = [answer for answer in found if (answer.kept == "mesh") == (kept_as == MESH)]
        if not candidates:
            continue
        line = case.line(ladder) | {"kept_as": kept_as}
        for level in LEVELS:
            known = field_is_known(case, level)
            line |= _entry(FIELD, level, known, smallest_form(candidates, level, found) if known else None)
            known = headline_is_known(case, ladder, level) and kept_as == OWN
            line |= _entry(HEADLINE, level, known, smallest_form(candidates, level, found, "error") if known else None)
        yield line


def _entry(kind: str, level: float, known: bool, answer: KeptForm | None) -> dict[str, Any]:
    key = f"{kind}_{level:g}"
    return {
        f"status_{key}": REACHED if answer else NOT_REACHED if known else NOT_KNOWN,
        f"bytes_{key}": answer.storage_bytes if answer else None,
        f"format_{key}": answer.format if answer else "",
        f"run_{key}": answer.run.name if answer else "",
        f"run_id_{key}": answer.run.record.run_id if answer else "",
    }


def _size(kind: str, level: float) -> Show:
    key = f"{kind}_{level:g}"

    def show(line: Line, notation: Notation) -> str:
        count = line[f"bytes_{key}"]
        if present(count):
            short = line[f"format_{key}"].removeprefix("mesh ").replace("as solved", "")
            return notation.escape(f"{byte_size(count)}{f' ({short})' if short else ''}")
        mesh = line["kept_as"] == MESH and kind == HEADLINE
        return notation.missing if mesh else notation.escape(line[f"status_{key}"])

    return show


def _runs(line: Line, notation: Notation) -> str:
    names = dict.fromkeys(line[f"run_{kind}_{level:g}"] for kind in (FIELD, HEADLINE) for level in LEVELS)
    return notation.escape("; ".join(name for name in names if name)) or notation.missing


def rounding_table(cases: Sequence[CaseRuns]) -> Table:
    """Return the table of changes that each solver's finest run suffers from storage in shorter number formats."""
    lines = [
        {
            **case.line(ladder, ladder.finest),
            "format": step.format,
            "storage_bytes": step.storage_bytes,
            "largest_difference": step.largest_difference,
            "rms_difference": step.rms_difference,
            "largest_displacement": ladder.finest.largest or None,
            "quantity": ladder.finest.row.quantity,
            "change": change_by_rounding(ladder.finest, step),
        }
        for case in cases
        for ladder in case.ladders
        for step in ladder.finest.record.precision
    ]
    return Table(
        name="memory_rounding",
        title="Shorter numbers",
        caption="The numbers that each solver's finest run is kept in, rounded to a shorter format: bytes, difference"
        " from the solution as solved at the probes, relative to its largest displacement, and change of the headline"
        " quantity. What is asked of the rounded solution is computed in double precision.",
        data=frame(lines),
        columns=(
            "solver",
            column("format", "Format", words),
            "storage_bytes",
            column("largest_difference", way=of_largest, instead=_not_finite),
            column("rms_difference", way=of_largest, instead=_not_finite),
            column("change", "Headline quantity", error),
        ),
    )


def _not_finite(line: Line, notation: Notation) -> str:
    return notation.escape("not finite")


def memory_figure(
    case: CaseRuns, kept: Mapping[str, Sequence[KeptForm]], measure: Measure, inks: Mapping[str, Ink]
) -> Figure:
    """Draw one case: error against the bytes that keep an answer, for solvers in `kept`, and memory of all solves."""
    figure, ((left, right),) = open_figure((2 * WIDTH, HEIGHT + MARGIN), 1, 2)
    least = SMALLEST if measure == "difference" else 0.0  # an error has the known value's uncertainty in it
    for ladder in case.ladders:
        ink = inks[ladder.solver]
        known = [one for one in kept.get(ladder.solver, ()) if (getattr(one, measure) or 0.0) > least]
        by_kept = {way: [one for one in known if one.kept == way] for way in ("solved", "rounded", "mesh")}
        draw(left, *_points((one for one in by_kept["solved"] if one.run in ladder.line), measure), ink)
        for way, look in OTHER_WAYS.items():
            draw(left, *_points(_front(by_kept[way], measure), measure), ink, **look)
        draw(right, *_peaks(ladder.line), ink)
    for level in LEVELS:
        left.axhline(100 * level, color="#444444", linewidth=0.5, linestyle=(0, (1, 3)), zorder=1)
    doubt = 100 * _doubt(case, measure)
    finish([left], "bytes that keep an answer", ORDINATES[measure], "Error against bytes", floor=doubt)
    left.xaxis.set_major_formatter(EngFormatter("B"))
    finish([right], "unknowns", "peak less idle (MB)", "Memory of the solve")
    shown = {one.kept for found in kept.values() for one in found if getattr(one, measure)}
    entries = {ladder.solver: entry(inks[ladder.solver]) for ladder in case.ladders}
    entries |= {WAY_WORDS[way]: _way_entry(way) for way in OTHER_WAYS if way in shown}
    in_view = doubt > max(left.get_ylim()[0], 0.0)
    add_legend(figure, entries | shade_entry(in_view, DOUBTS[measure]))
    return figure


def _way_entry(way: str) -> Any:
    """Return the legend entry of a way to store an answer."""
    look = dict(OTHER_WAYS[way])
    hollow: dict[str, Any] = {"marker": "o", "markerfacecolor": "white"} if look.pop("hollow", False) else {}
    return entry(linestyle=look.pop("line"), **look, **hollow)


def _front(candidates: Sequence[KeptForm], measure: Measure) -> list[KeptForm]:
    """Return the answers that no smaller one outdoes, from small to large."""
    front: list[KeptForm] = []
    for answer in sorted(candidates, key=lambda one: (one.storage_bytes, getattr(one, measure))):
        if not front or getattr(answer, measure) < getattr(front[-1], measure):
            front.append(answer)
    return front


def _points(found: Iterable[KeptForm], measure: Measure) -> tuple[list[int], list[float]]:
    ordered = sorted(found, key=lambda answer: answer.storage_bytes)
    return [answer.storage_bytes for answer in ordered], [100 * getattr(answer, measure) for answer in ordered]


def _peaks(runs: Sequence[Run]) -> tuple[list[int], list[float]]:
    found = [(run.unknowns, run.record.peak_memory_bytes, run.record.idle_memory_bytes) for run in runs]
    shown = [(unknowns, peak - idle) for unknowns, peak, idle in found if peak and idle is not None and peak > idle]
    return [unknowns for unknowns, _ in shown], [size / MEGABYTE for _, size in shown]
