"""Replication: what a training had come to on its way, by certified energies and not by displacements alone.

Of runs whose energies were certified on points of which the training knew nothing: on the way, or at the end alone.
Published figures of the same quantity stand before them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from shellbench.bench.catalogue.reference import KnownValue
from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import Record
from shellbench.protocol.history import HistoryStep
from shellbench.report.data.columns import column, count, frame, share
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.runs import grouped, solution_name
from shellbench.report.data.section import Section, given
from shellbench.report.data.table import Table

CERTIFIED = "certified_energy"  # in steps of a history, J
TRAINED = 10  # iterations from which a solve is a training: those of a direct or Newton solve in the course are 3
SHARES = (0.25, 0.5, 1.0)  # of a training, at which it is looked at


def section(found: Evidence) -> Section | None:
    """Return the section; None if no training certified its energy on the way."""
    lines = list(_lines(found))
    return Section("replication", "Replication", tables=given(table(lines)), place="its suites") if lines else None


def _lines(found: Evidence) -> Iterator[dict[str, Any]]:
    for case, of_case in grouped(found.rows, lambda row: row.case).items():
        trained = [
            (row, certified)
            for row in of_case
            if row.primary
            and row.run_id in found.records
            and (certified := course(found.records[str(row.run_id)], is_linear(row)))
        ]
        known = found.known(case)
        yield from (published(row, value) for row, _ in trained[:1] for value in known.of(row.quantity, "published"))
        for row, certified in trained:
            judge = known.judge("strain_energy", row.reference_theory or "") if is_linear(row) else None
            looked_at = [at_share(certified, share) for share in SHARES]
            for step, energy in {step.iteration: (step, energy) for step, energy in looked_at}.values():
                yield line(row, step, energy, judge.value if judge else None)


def is_linear(row: Row) -> bool:
    """Return True if the least potential energy is known: in a linear theory it is minus the strain energy."""
    return (row.reference_theory or "").endswith("-linear")


def course(record: Record, end_counts: bool) -> list[tuple[HistoryStep, float]]:
    """Return the steps of a training whose energies were certified, with these, J; none of other solves.

    A training that certified the energy of its end alone has one, where that counts; a solve of fewer than `TRAINED`
    iterations is none.
    """
    found = [(step, step.quantities[CERTIFIED]) for step in record.history if CERTIFIED in step.quantities]
    last, end = record.history[-1:], record.diagnostics.get(CERTIFIED)
    return found or [
        (step, float(end)) for step in last if end_counts and isinstance(end, float) and step.iteration >= TRAINED
    ]


def published(row: Row, value: KnownValue) -> dict[str, Any]:
    """Return the line of a published figure, of which the error is all that can be told."""
    error = value.value / row.reference - 1 if row.reference else None
    return {
        "block": row.case_title or row.case,
        "case": row.case,
        "solution": f"{value.label or value.source}, published",
        **dict.fromkeys(("seed", "iteration", "energy", "above", "gap", "seconds")),
        "error": error,
    }


def at_share(certified: Sequence[tuple[HistoryStep, float]], share: float) -> tuple[HistoryStep, float]:
    """Return the last step within a share of a training; its first one if there is none."""
    last = certified[-1][0].iteration
    return next((pair for pair in reversed(certified) if pair[0].iteration <= share * last), certified[0])


def line(row: Row, step: HistoryStep, energy: float, known: float | None) -> dict[str, Any]:
    """Return one line of the table."""
    value, reference = step.quantities.get(row.quantity), row.reference
    return {
        "block": row.case_title or row.case,
        "case": row.case,
        "solution": solution_name(row),
        "seed": row.seed,
        "iteration": step.iteration,
        "energy": energy,
        "above": (energy + known) / known if known else None,
        "gap": step.gap,
        "error": value / reference - 1 if value is not None and reference else None,
        "seconds": step.seconds,
    }


def table(lines: list[dict[str, Any]]) -> Table:
    """Return the table of trainings."""
    return Table(
        name="replication",
        title="Trainings on their way",
        caption="At a quarter, half and the whole of each training: how far its certified potential energy is above the"
        " least one, relative to the known strain energy; how far the energy that it was trained on is from the"
        " certified one; and the error of the headline quantity, which may be small by chance where energies are not."
        " The answer is what the solver kept, which need not be the last state. Of a training that certified its energy"
        " at the end alone there is one line.",
        data=frame(lines),
        columns=(
            "solution",
            column("seed", "Seed", count),
            column("iteration", "Iteration", count),
            column("above", "Energy above the least", share),
            column("gap", "Gap", share),
            "error",
            "seconds",
        ),
    )
