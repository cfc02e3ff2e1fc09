"""The kind `identification`, as its entry point names it."""

from __future__ import annotations

from shellbench.problem import Kind
from shellbench.problems.series.identification import IdentificationCase
from shellbench.problems.series.kind import keep

IDENTIFICATION = Kind(problem=IdentificationCase, keep=keep, headline="Identified parameters")
