"""Ways of writing for tables that name their columns themselves; `shellbench.report.columns` declares them."""

from __future__ import annotations

from shellbench.report import columns
from shellbench.report.columns import Show, column


def count(name: str) -> Show:
    """Return how to write a whole number."""
    return column(name, "", columns.count).show


def memory(name: str) -> Show:
    """Return how to write a number of bytes, in the unit that suits it."""
    return column(name, "", columns.size).show


def share(name: str) -> Show:
    """Return how to write a share in percent."""
    return column(name, "", columns.share).show


def error(name: str) -> Show:
    """Return how to write a relative error in percent, with its sign."""
    return column(name, "", columns.error).show


solution = column("solution").show
seconds = column("seconds").show
