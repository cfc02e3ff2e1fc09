"""What a gate says of one row."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from shellbench.bench.row import Row

Colour = Literal["green", "red", "expected failure", "not compared"]


@dataclass(frozen=True)
class Finding:
    """What a gate says of one row, in one clause."""

    row: Row
    colour: Colour
    sentence: str
