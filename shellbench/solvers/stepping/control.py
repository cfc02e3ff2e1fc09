"""The length of a step: its end, its cuts and growth, and the bracketing of a root of the path.

A step that does not converge is cut to `CUT` of itself, and an easy one grows by `GROWTH`. A step is easy if it took at
most `EASY` iterations of Newton's method. These three constants are common to all kinds of steps: by load, by
displacement, by arc length, and over an edit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

EASY = 6  # Newton iterations: with quadratic convergence a step that takes more began outside of its range
GROWTH, CUT = 2.0, 0.5  # of a step after an easy one, and after one that did not converge
ARC_GROWTH, ARC_CUT = GROWTH**0.5, CUT**0.5  # of an arc after an easy step, and after a slow one that converged
SMALLEST_STEP = 1e-4  # of the whole path: where a shorter one were needed, the path ends
SAME = 1e-9  # relative difference of two load factors or displacements that is rounding
UNMOVED = 1e-12  # rate of a displacement, relative to its bound, that counts as rounding
LONGEST_ARC = 1.5  # in units of the first one
STRAIGHT = 0.7  # cosine between a step and the tangent it started along: less may lead to another branch
CLOSE, CLOSER = 1 / 8, 1 / 4  # of the longest step: largest step over a turning point, and the cut of a longer one


class NotConvergedError(ArithmeticError):
    """Newton's method did not converge from here: the step was too long, or there is no equilibrium."""


class PathEndsError(Exception):
    """The path can't be followed further; the message is a clause with the reason."""


class State(Protocol):
    """A state of equilibrium, as step control sees it."""

    @property
    def t(self) -> float:
        """Load factor."""

    @property
    def stable(self) -> bool:
        """True for a minimum of the potential energy."""

    @property
    def iterations(self) -> int:
        """Newton iterations that led here."""


def equal_marks(value: float, mark: float) -> bool:
    """Return True if a value equals a mark up to rounding."""
    return bool(abs(value - mark) <= SAME * abs(mark))


def number_of_state(marks: Sequence[float], t: float) -> int:
    """Return the number of the state of an earlier path at a load factor; PathEndsError if there is none."""
    number = min(range(len(marks)), key=lambda k: abs(marks[k] - t))
    if not equal_marks(marks[number], t):
        raise PathEndsError(f"the start has no state at the load factor {t:.6g}")
    return number


def step_end(value: float, mark: float, step: float) -> float:
    """Return the end of the next of equal steps to a mark, none longer than `step`."""
    # Equal parts leave no short step before a mark. The factor forgives rounding in the count.
    parts = math.ceil((mark - value) / step * (1 - SAME))
    return mark if parts <= 1 else value + (mark - value) / parts


def checked_rate(rate: float, largest: float) -> float:
    """Return the rate at rest of the displacement that a path is followed by.

    Raises
    ------
    PathEndsError
        If it is rounding, compared with the `largest` rate by its row and the drift (Cauchy and Schwarz).
    """
    if not abs(rate) > UNMOVED * largest:
        raise PathEndsError("the loads do not move the displacement that the path is followed to")
    return rate


@dataclass
class Illinois:
    """Regula falsi for a root between two ends, the value at an end that stays twice halved (Dowell & Jarratt 1971).

    Dowell & Jarratt (1971), A modified regula falsi method for computing the root of an equation, BIT 11.

    Attributes
    ----------
    at_low, at_high
        Values at the ends, of opposite sign; None at an upper end that has none: then the interval is bisected.
    side
        +1 after the lower end has moved, -1 after the upper one.
    """

    at_low: float
    at_high: float | None
    side: int = 0

    @property
    def trial_share(self) -> float:
        """The place of the next trial, as a share of the interval from its lower end."""
        return 0.5 if self.at_high is None else self.at_low / (self.at_low - self.at_high)

    def raise_low(self, value: float) -> None:
        """Move the lower end to a trial with this value."""
        self.at_low = value
        if self.side > 0 and self.at_high is not None:
            self.at_high /= 2
        self.side = 1

    def lower_high(self, value: float | None) -> None:
        """Move the upper end to a trial with this value, or without one."""
        if self.side < 0:
            self.at_low /= 2
        self.at_high, self.side = value, -1
