"""What a check ends in: one of four words, and the figures that it rests on."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

Status = Literal["passed", "failed", "not applicable", "not shown"]
"""A check is not applicable where the solver or case lacks what is asked about, and not shown where the answer can't be
told either way; neither is a failure, and neither is a pass."""


@dataclass(frozen=True)
class Verdict:
    """How a check ended.

    Attributes
    ----------
    words
        One line: the figures, or what is wrong.
    """

    status: Status
    words: str


@dataclass
class Findings:
    """What a check has found so far.

    Attributes
    ----------
    faults
        What is wrong: any fault fails the check.
    figures
        What was measured and is well.
    unseen
        What could not be told, and why.
    """

    faults: list[str] = field(default_factory=list)
    figures: list[str] = field(default_factory=list)
    unseen: list[str] = field(default_factory=list)

    def hold(self, holds: bool, fault: str, figure: str = "") -> bool:
        """Note a fault, or a figure where there is none; return whether it holds."""
        if not holds:
            self.faults.append(fault)
        elif figure:
            self.figures.append(figure)
        return holds

    def verdict(self) -> Verdict:
        """Return how the check ended."""
        if self.faults:
            return Verdict("failed", "; ".join(self.faults))
        if self.unseen and not self.figures:
            return Verdict("not shown", "; ".join(self.unseen))
        return Verdict("passed", "; ".join([*self.figures, *(f"not shown: {words}" for words in self.unseen)]))


def not_applicable(reason: str) -> Verdict:
    """Return the verdict of a check that asks about what is not there."""
    return Verdict("not applicable", reason)


def not_shown(reason: str) -> Verdict:
    """Return the verdict of a check that could not tell."""
    return Verdict("not shown", reason)


def failed(reason: str) -> Verdict:
    """Return the verdict of a check that found a fault."""
    return Verdict("failed", reason)
