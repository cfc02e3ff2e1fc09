"""The table `[shell]` of a file whose shell is solved many times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Self

from pydantic import ValidationError, model_validator

from shellbench.problem import Problem
from shellbench.problems.shell.case import Case
from shellbench.protocol.schema import one_sentence

OF_THE_FILE = ("name", "kind", "title", "theory", "quantities", "suites")  # what no table of a shell has


class SeriesCase(Problem):
    """A problem whose shell is solved many times.

    Attributes
    ----------
    shell
        Its table of the file, as in a case of kind `shell`, without title, theory and quantities.
    """

    shell: dict[str, Any]

    @model_validator(mode="after")
    def _has_each_field_once(self) -> Self:
        for name in OF_THE_FILE:
            if name in self.shell:
                raise ValueError(f"field 'shell.{name}' is not known here: that of the file counts")
        return self

    def shell_case(self, table: Mapping[str, Any], name: str, asked: Sequence[Mapping[str, Any]], where: str) -> Case:
        """Return a table as a case of kind `shell`, in the theory of shells that this one begins with.

        Raises
        ------
        ValueError
            If it is no such case; the sentence begins with `where`.
        """
        theory = self.theory.rpartition("-")[0]
        whole = {**table, "name": name, "title": self.title, "theory": theory, "quantities": list(asked)}
        try:
            return Case.model_validate(whole)
        except ValidationError as error:
            raise ValueError(f"{where}, {one_sentence(error, whole)}") from None
