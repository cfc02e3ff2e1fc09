"""The table that pytest prints at the end: what was judged, and by what."""

from __future__ import annotations

from collections.abc import Sequence

from shellbench.testing.pytest_judging import Judgement

HEAD = ("case", "solver", "quantity", "value", "known", "error", "tolerance", "seconds", "verdict")
LEFT = {"case", "solver", "quantity", "verdict"}  # columns of words
NOTHING = "-"
VERDICTS = {"green": "pass", "red": "FAIL", "expected failure": "expected failure", "not judged": "skipped"}


def table(found: Sequence[Judgement]) -> list[str]:
    """Return the lines of the table, and below it why something was not judged; of a declined case once."""
    rows: list[tuple[str, ...]] = [HEAD]
    unjudged: dict[tuple[str, ...], str] = {}
    for judgement in found:
        where: tuple[str, ...] = (judgement.case, judgement.solver)
        if judgement.value is not None:
            where = (*where, judgement.quantity)
        if judgement.colour != "not judged" or judgement.value is not None:
            rows.append(_cells(judgement))
        if judgement.colour == "not judged":
            unjudged[where] = judgement.sentence
    lines = _aligned(rows) if len(rows) > 1 else []
    lines += [f"{' '.join(where)}: {sentence}" for where, sentence in unjudged.items()]
    if any(j.kept for j in found):
        lines.append("(k) kept from an earlier session: solver, settings and case are the same")
    return lines


def _cells(judgement: Judgement) -> tuple[str, ...]:
    unit = f" {judgement.unit}" if judgement.absolute else ""
    return (
        judgement.case,
        judgement.solver,
        judgement.quantity,
        _figure(judgement.value, ".7g"),
        _figure(judgement.known, ".7g"),
        _figure(judgement.error, "+.1e", unit),
        _figure(judgement.tolerance, ".1e", unit),
        _figure(judgement.seconds, ".2f", " (k)" if judgement.kept else ""),
        VERDICTS[judgement.colour],
    )


def _figure(value: float | None, form: str, unit: str = "") -> str:
    return NOTHING if value is None else f"{value:{form}}{unit}"


def _aligned(rows: Sequence[tuple[str, ...]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if name in LEFT else cell.rjust(width)
            for cell, width, name in zip(row, widths, HEAD, strict=True)
        ).rstrip()
        for row in rows
    ]
