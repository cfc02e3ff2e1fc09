"""Portrait of a rope: the data from which a report draws it."""

from __future__ import annotations

from typing import Any

from shellbench.problems.rope.solution import PICTURES
from shellbench.protocol.picture import Portrait, Scene

VIEW = (12.0, -75.0)  # elevation and azimuth of the eye, degrees: nearly along y, across which most chains swing


class RopePortrait(Portrait):
    """A rope, or loose masses."""

    problem: Any

    @property
    def steps_in_time(self) -> bool:
        """True if anything moves."""
        return self.problem.moving is not None

    @property
    def frames(self) -> tuple[str, str] | None:
        """Names of the arrays of times and nodes of a chain that moves alone."""
        return (PICTURES[0], PICTURES[1]) if self.problem.chains == 1 and self.problem.rope else None

    @property
    def chains(self) -> tuple[int, int] | None:
        """Number of chains that move, and of links of each."""
        rope = self.problem.rope
        return (rope.count, len(rope.masses)) if rope else None

    @property
    def scene(self) -> Scene | None:
        """Scene of a moving chain: true to scale, held at its root; None without frames."""
        if self.frames is None:
            return None
        length = float(sum(self.problem.rope.link_lengths))
        return Scene((length, 0.0), 1.0, True, None, VIEW, "z", ((0, "min"),), (), ())
