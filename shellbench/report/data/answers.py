"""Ways to keep an answer, each with its bytes and its error: the data of memory at stated error.

A solution is kept as its solver does, or with its numbers rounded to a shorter format, or as a mesh made from it (of a
motion, a sequence of meshes). The bytes of the first two do not depend on the resolution at which it is asked; what
rounding and interpolation add to the error does not hide, because it was measured and is added here.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from shellbench.protocol.history import PrecisionStep
from shellbench.report.data.ladder import ALIKE, CaseRuns, Ladder, Run
from shellbench.report.data.notation import BYTES_A_POINT

LEVELS = (1e-2, 1e-3, 1e-4)  # errors at which memory is stated, relative to the largest displacement
Kept = Literal["solved", "rounded", "mesh"]
Measure = Literal["difference", "error"]  # of the field from the best answer; of the headline from its known value


@dataclass(frozen=True)
class KeptForm:
    """One way to keep one run.

    Attributes
    ----------
    format
        In words: "as solved", a number format, or the size of a mesh.
    difference
        Bound of the difference from the run that all are compared with at the same material points, relative to the
        largest displacement: the run's own, and what rounding or interpolation add; None if it is not known.
    error
        Bound of the error of the headline quantity against its known value, relative (see `headline_size`): the run's
        own, the known value's uncertainty, and what rounding adds; of a mesh, for a length, what interpolation adds
        anywhere. None if it is not known.
    """

    run: Run
    kept: Kept
    format: str
    storage_bytes: int
    difference: float | None
    error: float | None


def answers(case: CaseRuns, ladder: Ladder) -> list[KeptForm]:
    """Return all ways in which a solver's answers to a case can be kept; meshes are made of its best answer."""
    found = [answer for run in ladder.runs for answer in _own_numbers(case, run)]
    known = [answer for answer in found if answer.kept == "solved" and answer.difference]
    if known:
        found += _meshes(case, min(known, key=lambda answer: answer.difference or 0.0))
    return found


def smallest_form(
    candidates: Sequence[KeptForm], level: float, among: Sequence[KeptForm] = (), measure: Measure = "difference"
) -> KeptForm | None:
    """Return the answer of fewest bytes whose displacement, or headline quantity, is within a level; None if none is.

    All runs of the solver that are as fine or finer must be so, as solved and in the same format, other seeds and
    marginally different meshes among them: a lucky run is no answer. `among` are all answers of the solver; the
    candidates themselves if empty.
    """
    lasting = [one for one in candidates if _stays_within(one, level, measure, among or candidates)]
    return min(lasting, key=lambda answer: answer.storage_bytes, default=None)


def _stays_within(answer: KeptForm, level: float, measure: Measure, among: Sequence[KeptForm]) -> bool:
    finer = [
        other
        for other in among
        if (other.kept == "solved" or (other.kept == answer.kept == "rounded" and other.format == answer.format))
        and other.run.unknowns >= answer.run.unknowns
        and ALIKE * other.run.time_steps >= answer.run.time_steps
    ]
    sizes = [getattr(one, measure) for one in (answer, *finer)]
    return all(size is not None and size <= level for size in sizes)


def field_is_known(case: CaseRuns, level: float) -> bool:
    """Return True if the run that all are compared with is itself known to a level."""
    return case.doubt is not None and bool(case.scale) and case.doubt <= level * (case.scale or 0.0)


def headline_is_known(case: CaseRuns, ladder: Ladder, level: float) -> bool:
    """Tell whether the headline quantity is known to a level."""
    row, size = ladder.finest.row, headline_size(case, ladder.finest)
    return size is not None and (row.reference_uncertainty or 0.0) <= level * size


def headline_size(case: CaseRuns, run: Run) -> float | None:
    """Return the magnitude that errors of the headline quantity are relative to; None if its value is not known.

    This is the known value. For a length that is judged by its absolute error, it is the largest displacement.
    """
    row = run.row
    if row.reference is None or row.value is None:
        return None
    if row.relative_error is not None:
        return abs(row.reference) or None
    return case.scale if row.unit == "m" else None


def own_difference(case: CaseRuns, run: Run) -> float | None:
    """Return the relative difference of a run from the yardstick, at least the yardstick's own relative uncertainty.

    None if the case has no yardstick or no scale, or if the two runs have no points in common.
    """
    if case.yardstick is None or not case.scale:
        return None
    doubt = case.doubt / case.scale if case.doubt is not None else None
    if run is case.yardstick:
        return doubt
    found = run.difference(case.yardstick)
    return max(found.largest / case.scale, doubt or 0.0) if found is not None else None


def _own_numbers(case: CaseRuns, run: Run) -> Iterator[KeptForm]:
    own = own_difference(case, run)
    if run.record.storage_bytes:
        yield KeptForm(run, "solved", "as solved", run.record.storage_bytes, own, _headline_error(case, run, 0.0))
    for step in run.record.precision:
        if step.largest_difference is None or step.storage_bytes >= (run.record.storage_bytes or 0):
            continue
        added = own + step.largest_difference / case.scale if own is not None and case.scale else None
        error = _headline_error(case, run, change_by_rounding(run, step))
        yield KeptForm(run, "rounded", step.format, step.storage_bytes, added, error)


def change_by_rounding(run: Run, step: PrecisionStep) -> float | None:
    """Return by how much rounding changes the headline quantity, relative; None if it is not known, or was zero."""
    name = run.row.quantity
    exact = next((other.quantities.get(name) for other in run.record.precision if other.format == "float64"), None)
    if exact is None and name in run.record.values:
        exact = run.record.values[name].value
    return step.quantities[name] / exact - 1 if exact and name in step.quantities else None


def _headline_error(case: CaseRuns, run: Run, change: float | None) -> float | None:
    size, value, reference = headline_size(case, run), run.row.value, run.row.reference
    if size is None or value is None or reference is None or change is None:
        return None
    return (abs(value - reference) + (run.row.reference_uncertainty or 0.0) + abs(value * change)) / size


def _meshes(case: CaseRuns, best: KeptForm) -> Iterator[KeptForm]:
    """Yield the meshes made of a run except the finest, at whose points the others were compared with it."""
    run = best.run
    grids = sorted(run.record.resolution, key=lambda step: step.points)[:-1]
    if not case.moves:
        states = len(run.probes.marks) if run.probes is not None else 1
        for grid in grids:
            words = f"mesh {grid.points}×{grid.points}" + (f", {states} states" if states > 1 else "")
            yield _mesh(case, best, words, grid.points**2 * states, grid.interpolation_difference)
        return
    for rate in sorted(run.record.frame_rates, key=lambda step: step.frames)[:-1]:
        for grid in grids:
            added = grid.interpolation_difference + rate.interpolation_difference
            words = f"{rate.frames} meshes {grid.points}×{grid.points}"
            yield _mesh(case, best, words, grid.points**2 * rate.frames, added)


def _mesh(case: CaseRuns, best: KeptForm, words: str, points: int, added: float) -> KeptForm:
    """Return a mesh of so many points, which differs from the answer by a length, m."""
    size = headline_size(case, best.run) if best.run.row.unit == "m" else None
    error = best.error + added / size if best.error is not None and size else None
    difference = (best.difference or 0.0) + added / (case.scale or 1.0)
    return KeptForm(best.run, "mesh", words, BYTES_A_POINT * points, difference, error)
