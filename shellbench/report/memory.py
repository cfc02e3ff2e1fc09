"""Memory: bytes to keep an answer at stated error, what shorter numbers do to it, and what the solve itself took."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from shellbench.report.answers import LEVELS, answers, fewest, field_is_known
from shellbench.report.consistency import yardstick_words
from shellbench.report.evidence import Evidence, Section
from shellbench.report.exhibit import Exhibit
from shellbench.report.ladder import CaseRuns, case_runs
from shellbench.report.memory_figure import memory_figure
from shellbench.report.memory_tables import level_table, percents, rounding_table, solve_table
from shellbench.report.palette import inks, style
from shellbench.report.studies import remarks_on
from shellbench.report.table import Table

MEMORY = "memory_"  # how names of figures begin
WORDS = (
    "The bytes of a solution are those of the numbers that give its displacement: the weights of a field, the"
    " coefficients and mesh lines of finite elements, of a motion for all times that are kept, with rates where the"
    " solver keeps them. Where a hidden layer was drawn at random and never solved for, its weights count among the"
    " bytes, though its seed would do, and not among the unknowns. Connectivity of meshes is not counted. These bytes"
    " do not depend on the grid or frame rate at which the solution is asked; those of a mesh, or of a sequence of"
    " meshes, made from it do (after Kairanda et al., figure 8). Bytes mean little without an error, so they are"
    " stated together.",
    "The error of a field is the largest difference at the same material points, and at all kept instants or loads,"
    " from the best answer available, which each case names, relative to its largest displacement. What rounding to"
    " fewer digits or interpolation in a mesh add is measured by itself, and added; this bounds the difference"
    " at the probes from above. A run is credited with no smaller one than that answer itself is known to, and a level"
    " below this is called not known. The error of the headline quantity is against its known value; that of a"
    " position is relative to the largest displacement.",
    "The probes are few points: an error between them is not seen. A mesh is a regular grid with bilinear cells; one"
    " graded to the solution would need fewer vertices, and its vertices are in double precision, of which single"
    " precision is half. Compression is left out. The memory of a solve is that of its process, with the libraries"
    " that it loads; less what was held before it, it is nearer to the method's own need, but memory that is reused"
    " within the process is not told apart.",
)


def section(evidence: Evidence) -> Section | None:
    """Return the section; None if no run says how many bytes it takes."""
    cases = [case for case in case_runs(evidence) if _says_bytes(case)]
    tables = tuple(t for t in (level_table(cases), rounding_table(cases), solve_table(cases)) if t is not None)
    if not tables:
        return None
    return Section(
        name="memory",
        title="Memory",
        words=(*WORDS, *remarks_on(evidence.rows, "resolution")),
        tables=tables,
        exhibits=tuple(_exhibits(cases, [row.solver for row in evidence.rows])),
        details=details(cases),
    )


def details(cases: Sequence[CaseRuns]) -> tuple[Table, ...]:
    """Return the long table behind the section: the memory of all runs."""
    table = solve_table(cases, finest_only=False)
    return () if table is None else (table,)


def _says_bytes(case: CaseRuns) -> bool:
    return any(run.record.storage_bytes for ladder in case.ladders for run in ladder.runs)


def _exhibits(cases: Sequence[CaseRuns], solvers: Sequence[str]) -> Iterator[Exhibit]:
    colours = inks(solvers)
    studied = [case for case in cases if any(len(ladder.levels) > 1 for ladder in case.ladders)]
    for case in studied or cases:
        kept = {ladder.solver: answers(case, ladder) for ladder in case.ladders}
        if not any(answer.difference for found in kept.values() for answer in found):
            continue
        with style():
            figure = memory_figure(case, kept, colours)
        words = []
        for solver, found in kept.items():
            for level in LEVELS:
                best = fewest(found, level)
                if best is not None and field_is_known(case, level):
                    words.append(f"{solver}: within {percents(level)} in {best.storage_bytes} bytes, {best.format}")
        frames = (
            " Lower left: bytes against frames a second; lower right: memory of the solve."
            if case.moves
            else " Right: memory of the solve, less what its process held before."
        )
        yield Exhibit(
            name=f"{MEMORY}{case.case}",
            title=f"{case.title}: memory at stated error",
            caption=f"{'Upper left' if case.moves else 'Left'}: difference from the best answer against the bytes that"
            " keep a solution, as solved (full marks), rounded (open marks), and as a mesh made from it (dotted);"
            " levels of 1 %, 0.1 % and 0.01 % (dashed); grey: how well the best answer is known itself."
            f" {'Upper right' if case.moves else 'Middle'}: bytes against the resolution at which the answer is asked:"
            " a mesh of the best answer, with what interpolation adds, and for each solver the fewest bytes at the"
            f" level it reaches.{frames} {yardstick_words(case)}",
            description="; ".join(words) or "no level is reached",
            figure=figure,
            run_ids=tuple(run.record.run_id for ladder in case.ladders for run in ladder.runs),
            drawing=True,
        )
