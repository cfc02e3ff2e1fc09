"""What a field tells of itself, so that a report can draw how it was learned."""

from __future__ import annotations

from typing import Any

from shellbench.portrait import Portrait


class FieldPortrait(Portrait):
    """A field over the unit square, or points of a density."""

    problem: Any
