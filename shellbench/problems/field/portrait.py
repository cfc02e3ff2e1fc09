"""What a field tells of itself, so that a report can draw how it was learned."""

from __future__ import annotations

from typing import Any

from shellbench.portrait import Portrait


class FieldPortrait(Portrait):
    """A field over the unit square, or points of a density."""

    problem: Any

    @property
    def learns(self) -> bool:
        """Whether it asks for a field."""
        return bool(self.problem.has_field)

    @property
    def sampled(self) -> tuple[str, str] | None:
        """Names of the density and of the samples of answers that had some."""
        return ("density", "points") if self.problem.has_field else None
