"""A shell and an edit of it, both declared in one file.

The table `[shell]` holds the shell as it was, `[edit]` the change by a user. The theory is the shell's with the suffix
`-edited`, so that no solver of shells takes the file for a shell.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from functools import cached_property
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from shellbench.problems.series.quantities import EditedDisplacement
from shellbench.problems.series.shell_table import SeriesCase
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.variants.edit import why_no_edit
from shellbench.protocol.schema import Finite, Model, Positive

What = Literal["force", "pose", "thickness"]
WITHIN: dict[What, str] = {"force": "loads.", "pose": "supports.", "thickness": "material.thickness"}
Scalar = Finite | str
To = Scalar | tuple[Scalar, Scalar, Scalar]


class Change(Model):
    """One field of the shell, and its new value."""

    field: str = Field(description='where it stands in `[shell]`, such as "loads.0.vector"; lists count from 0')
    to: To = Field(description="number, formula or vector")


class Edit(Model):
    """An edit by a user: a change of a force, of the pose of a support, or of the thickness."""

    what: What = Field(description="force: of loads; pose: motion of supports; thickness: of the material")
    changes: Annotated[tuple[Change, ...], Field(min_length=1)] = Field(description="fields, and what they become")

    @model_validator(mode="after")
    def _is_what_it_says(self) -> Self:
        for change in self.changes:
            if not f"{change.field}.".startswith(WITHIN[self.what].rstrip(".") + "."):
                raise ValueError(f"field '{change.field}' is no part of an edit of the {self.what}")
        return self


class EditingCase(SeriesCase):
    """A shell, and an edit of it.

    Attributes
    ----------
    shell
        Its table of the file, as in a case of kind `shell`, without title, theory and quantities.
    edit
        The change.
    accuracy
        Share of the energy by which two answers may differ and count as equally accurate.
    quantities
        Quantities asked of the edited shell; exactly one is primary.
    """

    kind: Literal["editing"]
    theory: Literal["kirchhoff-love-linear-edited", "kirchhoff-love-nonlinear-edited"]
    edit: Edit
    accuracy: Positive = Field(1e-5, lt=1)
    quantities: Annotated[tuple[EditedDisplacement, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _makes_two_shells(self) -> Self:
        if self.original.physics() == self.edited.physics():
            raise ValueError("the edit changes nothing")
        if reason := why_no_edit(self.original, self.edited):
            raise ValueError(f"the edit is none: the original {reason.removeprefix('it ')}")
        return self

    @cached_property
    def original(self) -> Case:
        """The shell as it was."""
        return self._shell(self.shell, "original")

    @cached_property
    def edited(self) -> Case:
        """The shell with its edit."""
        table = copy.deepcopy(self.shell)
        for change in self.edit.changes:
            to = list(change.to) if isinstance(change.to, tuple) else change.to
            _set(table, change.field, to)
        return self._shell(table, "edited")

    def _shell(self, table: dict[str, Any], which: str) -> Case:
        asked = [{**q.model_dump(exclude={"kind"}), "kind": "displacement"} for q in self.quantities]
        return self.shell_case(table, f"{self.base}_{which}", asked, f"of the {which} shell")


def _set(table: dict[str, Any], field: str, value: Any) -> None:
    *way, last = _steps(field)
    place: Any = table
    for step in way:
        place = _at(place, step, field)
    _at(place, last, field)
    place[last] = value


def _at(place: Any, step: str | int, field: str) -> Any:
    there = place[step] if isinstance(place, dict) and step in place else None
    if isinstance(place, list) and isinstance(step, int) and step < len(place):
        there = place[step]
    if there is None:
        raise ValueError(
            f"field 'edit.changes': '{field}' is no field of the table 'shell', which has no '{step}' there"
        )
    return there


def _steps(field: str) -> Iterator[str | int]:
    for step in field.split("."):
        yield int(step) if step.isdigit() else step
