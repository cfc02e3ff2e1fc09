"""Base of all quantities of shells."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

from shellbench.problem import Quantity


class ShellQuantity(Quantity):
    """Base of all quantities of shells.

    Attributes
    ----------
    at
        State at which it is measured: a time, s, in a motion, else a load factor. On a path with another control than
        "load" it is the value of the path's displacement quantity, m
        (see `shellbench.problems.shell.question.path.Path`).
    series
        Kind of case in which it is recorded all along: "motion", "path" (both), or none.
    of_field
        True if the displacement field at its state defines it.
    powers
        Powers of length and of force in its unit, if these are the same in every case.
    """

    series: ClassVar[Literal["motion", "path", ""]] = "motion"
    of_field: ClassVar[bool] = False

    powers: ClassVar[tuple[int, int]] = (1, 0)

    @property
    def places(self) -> tuple[str, ...]:
        """Names of the places that it is measured at."""
        return ()

    def dimension(self, shell: Any) -> tuple[int, int]:
        """Return the powers of length and of force in its unit."""
        return self.powers

    def check(self, shell: Any) -> None:
        """Raise ValueError if it does not fit the shell that it is asked of."""

    def check_path(self, shell: Any) -> None:
        """Raise ValueError if a static case can't be asked for it."""

    def check_motion(self, shell: Any, constant: bool) -> None:
        """Raise ValueError if a motion can't be asked for it; `constant`: supports and loads do not depend on time."""
