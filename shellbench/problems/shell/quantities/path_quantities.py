"""Quantities of a path as a whole: loads, limit points and the first critical point."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

from pydantic import Field

from shellbench.problems.shell.field import DisplacementField
from shellbench.problems.shell.quantities.quantity import ShellQuantity
from shellbench.protocol.load_curve import Curve
from shellbench.protocol.schema import Finite, Name


class PathQuantity(ShellQuantity):
    """Base of quantities that belong to a path as a whole, not to one of its kept states.

    Attributes
    ----------
    scale
        Load at the load factor 1, N.
    """

    series: ClassVar[Literal["motion", "path", ""]] = ""
    powers: ClassVar[tuple[int, int]] = (0, 0)  # a load is given by `scale`, in whatever unit that is
    scale: Finite = 1.0
    unit: str = "N"

    def check_path(self, shell: Any) -> None:
        """Raise ValueError if a load alone controls the path."""
        if shell.path.quantity is None:
            raise ValueError(f"quantity '{self.name}' needs a path with control 'displacement' or 'arc_length'")

    def check_motion(self, shell: Any, constant: bool) -> None:
        """Raise ValueError: a motion has no path."""
        raise ValueError(f"quantity '{self.name}' belongs to a [path], not to [dynamics]")


class LoadQuantity(PathQuantity):
    """The load at which the path's displacement first is `at`: the load factor times `scale`, N."""

    kind: Literal["load"]

    def measure(self, solution: DisplacementField) -> float:
        """Return the load, N."""
        return self.scale * curve(solution).factor_at(self.at)


class Unmarked(PathQuantity):
    """A quantity of a state that the path itself marks."""

    @property
    def mark(self) -> float | None:
        """None."""
        return None


class LimitPoint(Unmarked):
    """A turning point of the path, counted from rest.

    Attributes
    ----------
    turning
        The value with an extremum there: the load at a limit point, the displacement where the path snaps back.
    number
        Its number, from 1.
    gives
        Its load, the load factor times `scale` (N), or the path's displacement there (m).
    """

    kind: Literal["limit_point"]
    turning: Literal["load", "displacement"] = "load"
    number: int = Field(1, ge=1, strict=True)
    gives: Literal["load", "displacement"] = "load"

    def dimension(self, shell: Any) -> tuple[int, int]:
        """Return the powers of length and of force in its unit."""
        return (0, 0) if self.gives == "load" else (1, 0)

    def measure(self, solution: DisplacementField) -> float:
        """Return the load, N, or the displacement, m."""
        factor, displacement = curve(solution).turning_point(self.turning, self.number)
        return self.scale * factor if self.gives == "load" else displacement


class CriticalPoint(Unmarked):
    """The first state of a path at which the shell can buckle: its stiffness ceases to be positive definite.

    Attributes
    ----------
    gives
        "load", the load factor times `scale`; or the name of another quantity, whose value there is given.
    """

    kind: Literal["critical_point"]
    gives: Name = "load"

    def check(self, shell: Any) -> None:
        """Raise ValueError if it gives a quantity that the case does not have."""
        others = [q.name for q in shell.quantities if q.mark is not None]
        if self.gives not in ("load", *others):
            raise ValueError(f"quantity '{self.name}' gives '{self.gives}'; known are {others}")

    def check_path(self, shell: Any) -> None:
        """Raise ValueError if the path is not controlled by its load, or there is none."""
        if shell.linear or shell.path.control != "load":
            raise ValueError(f"quantity '{self.name}' needs the non-linear theory and a path with control = 'load'")

    def dimension(self, shell: Any) -> tuple[int, int]:
        """Return the powers of length and of force in its unit."""
        given: tuple[int, int] = (0, 0) if self.gives == "load" else shell.quantity(self.gives).dimension(shell)
        return given

    def measure(self, solution: DisplacementField) -> float:
        """Return the load factor of the first critical state, or the value there of the named quantity."""
        step = next((step for step in solution.history if step.phase == "critical"), None)
        if step is None:
            raise ValueError("the path has no critical state")
        if self.gives == "load":
            return float(self.scale * step.at)
        other = solution.case.quantity(self.gives)
        return float(other.model_copy(update={"at": step.at}).measure(solution))


def curve(solution: DisplacementField) -> Curve:
    """Return the load-displacement curve of a solution along its case's path; ValueError if it has none."""
    quantity = solution.case.path.quantity
    if quantity is None:
        raise ValueError("the case's path has no displacement quantity")
    return Curve.of(solution.history, quantity)
