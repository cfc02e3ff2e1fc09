"""The motion of a chain, or of loose masses: its states at the asked times."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError
from shellbench.problem import Step
from shellbench.problems.rope.case import RopeCase

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RopeState:
    """One instant.

    Attributes
    ----------
    nodes, velocities
        (n, 3), m and m/s; chain after chain, the root first.
    tensions
        Of the links, chain after chain, N; none of loose masses.
    stretch, penetration
        The largest at the end of any step so far: relative, and m.
    """

    nodes: Array
    velocities: Array
    tensions: Array
    stretch: float = 0.0
    penetration: float = 0.0


ARRAYS = ("nodes", "velocities", "tensions", "stretch", "penetration")
PICTURES = ("frame_times", "frames")


@dataclass(frozen=True)
class RopeMotion:
    """States (`RopeState`) at the case's times, in order; a failed solve has fewer.

    `frames` (k, n, 3), m, at `frame_times` (k,), s, are for pictures; of many nodes they hold a subset.
    """

    case: RopeCase
    kept: tuple[RopeState, ...]
    history: tuple[Step, ...] = ()
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    diagnostics: Mapping[str, Any] = field(default_factory=dict)
    extrapolated: Mapping[str, float] = field(default_factory=dict)
    frame_times: Array = field(default_factory=lambda: np.zeros(0))
    frames: Array = field(default_factory=lambda: np.zeros((0, 0, 3)))

    def state(self, at: float) -> RopeState:
        """Return the state at a time; ValueError if it was not reached."""
        number = self.case.states.index(at)
        if number >= len(self.kept):
            raise ValueError(f"the motion ended before t = {at:g}")
        return self.kept[number]

    @property
    def parameters(self) -> int:
        """Number of coordinates that move freely."""
        return 3 * len(self.case.masses)

    @property
    def storage_bytes(self) -> int:
        """Bytes of all states."""
        return sum(np.asarray(getattr(state, name)).nbytes for state in self.kept for name in ARRAYS)

    def stacked(self) -> dict[str, Array]:
        """Return the arrays of all states by name, the first axis the state, and those of the frames."""
        states = {name: np.array([getattr(state, name) for state in self.kept]) for name in ARRAYS}
        return states | {name: getattr(self, name) for name in PICTURES}

    def save(self, path: Path) -> Path:
        """Write the states as npz."""
        file = path.with_suffix(".npz")
        np.savez(file, case=self.case.model_dump_json(), **self.stacked())  # type: ignore[arg-type]
        return file

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a file of `save`; InputError in one sentence if it is no such file."""
        try:
            with np.load(path, allow_pickle=False) as data:
                case = RopeCase.model_validate_json(str(data["case"]))
                columns, pictures = [data[name] for name in ARRAYS], {name: data[name] for name in PICTURES}
        except (OSError, KeyError, ValueError) as error:
            raise InputError(f"{path} holds no motion of a rope: {' '.join(str(error).split())}") from None
        rows = zip(*columns, strict=True)
        states = (RopeState(nodes, moves, pulls, float(s), float(d)) for nodes, moves, pulls, s, d in rows)
        return cls(case, tuple(states), **pictures)
