"""A solver that is a command: it reads a mesh and writes the displacements of its nodes, or values of quantities.

The command runs in a scratch folder of its own, once for each mesh of the ladder. It fails if it ends with another exit
status than 0, takes longer than allowed, or leaves no whole result.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, create_model

from shellbench.errors import InputError, SolveFailure
from shellbench.problem import Capabilities
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.deck.cells import Shape
from shellbench.problems.shell.deck.deck import Deck
from shellbench.problems.shell.deck.solver import LADDER, MeshSettings, MeshSolution, MeshSolver
from shellbench.problems.shell.sheet.formats import ELEMENTS
from shellbench.protocol.program import Program, callers_environment
from shellbench.protocol.schema import Flag, Positive
from shellbench.solvers.external.exchange import (
    DECKS,
    MeshFormat,
    ResultFormat,
    read_displacements,
    read_values,
    write_mesh,
)

Array = NDArray[np.float64]
T = TypeVar("T")
PLACEHOLDER = re.compile(r"\{([a-z_0-9]+)\}")
PLACES = (  # names of placeholders
    *("case", "mesh", "out"),
    *("cells", "cells_1", "cells_2"),
    *("youngs_modulus", "poissons_ratio", "thickness"),
)
CASE, OUT = "case.json", "out"  # files in the scratch folder
LAST = 65536  # bytes at the end of the output that are kept


class CommandFile(Program):
    """A file that describes a solver that is a command.

    Attributes
    ----------
    label
        What it is, in one line, such as "CalculiX 2.20, S8R".
    theory
        Of its elements: known values of this theory judge it.
    cells
        Of each mesh, from coarse to fine: cells across the shell, or along xi1 and xi2.
    shape
        Of the cells.
    mesh
        Format of {mesh}: one file of JSON, a folder of tables, or a deck as `shellbench sheet` writes it.
    result
        Format of {out}.
    quantities
        Kinds of the quantities that a file of values has; they name them as the case does.
    moments
        Whether nodes take moments.
    drilling
        Whether supports hold the rotation of nodes about the normal.
    symmetry
        Whether only the part between planes of symmetry is meshed.
    seconds
        Longest time for one mesh.
    """

    label: str = Field("", max_length=100, pattern=r"^[^\n\r]*$")
    theory: Literal["kirchhoff-love-linear", "naghdi-linear"]
    cells: tuple[int | tuple[int, int], ...] = Field(LADDER, min_length=1)
    shape: Shape = "quad4"
    mesh: MeshFormat = "json"
    result: ResultFormat = "csv"
    quantities: tuple[str, ...] = ("displacement", "largest_displacement")
    moments: Flag = True
    drilling: Flag = True
    symmetry: Flag = True
    seconds: Positive = 600.0


class CommandSolver(MeshSolver):
    """A solver that a file describes; `of` makes the one of a file.

    Attributes
    ----------
    path, described
        The file and its content.
    """

    path: ClassVar[Path]
    described: ClassVar[CommandFile]

    @classmethod
    def of(cls, path: Path) -> CommandSolver:
        """Return the solver of a file; InputError if it is malformed."""
        found = CommandFile.read(path)
        fields = MeshSettings.model_fields
        settings: Any = {
            name: (fields[name].rebuild_annotation(), Field(value, description=fields[name].description))
            for name, value in (("cells", found.cells), ("symmetry", found.symmetry))
        }
        attributes = {
            "path": path,
            "described": found,
            "name": found.name,
            "capabilities": Capabilities((found.theory,), found.label or f"the command {found.command.split()[0]}"),
            "settings_type": create_model("CommandSettings", __base__=MeshSettings, **settings),
            "shape": found.shape,
            "moments": found.moments,
        }
        shapes = sorted({element.shape for element in ELEMENTS.values()})
        if found.mesh in DECKS and found.shape not in shapes:
            raise InputError(f"{path}: field 'shape': cells of meshes .{found.mesh} are {', '.join(shapes)}")
        for name in PLACEHOLDER.findall(" ".join(found.arguments(path))):
            if name not in PLACES:
                known = ", ".join(f"{{{one}}}" for one in PLACES)
                raise InputError(f"{path}: field 'command': {{{name}}} is not known here: known are {known}")
        solver: CommandSolver = type(cls.__name__, (cls,), attributes)()
        return solver

    def command(self, deck: Deck, mesh: Path, folder: Path) -> list[str]:
        """Return the list of arguments with placeholders filled in."""
        material, counts = deck.part.case.material, deck.grid.counts
        found = (folder / CASE, mesh, folder / OUT, min(counts), *counts)
        numbers = (material.youngs_modulus, material.poissons_ratio, material.thickness)
        texts = dict(zip(PLACES, map(str, (*found, *numbers)), strict=True))
        arguments = self.described.arguments(self.path)
        return [PLACEHOLDER.sub(lambda found: texts[found[1]], part) for part in arguments]

    def solution_on(self, deck: Deck, settings: Any) -> MeshSolution:
        """Return the solution on a mesh; one without a field if the command gives values only."""
        if self.described.result != "values":
            moved, each = self._result(deck, lambda out: read_displacements(out, self.described.result, deck.nodes))
            return replace(self.solution_of(deck, moved), rounding={q.name: each for q in deck.part.whole.quantities})
        quantities = self._asked(deck.part.whole)
        given, rounding = self._result(deck, lambda out: read_values(out, quantities))
        return MeshSolution(deck, np.full_like(deck.nodes, np.nan), given=given, rounding=rounding)

    def declines_quantity(self, case: Case, quantity: Any) -> str | None:
        """Return the reason that it can't give a quantity of a case that it takes, as one clause, or None if it can."""
        if self.described.result != "values":
            return super().declines_quantity(case, quantity)
        return None if quantity.kind in self.described.quantities else "its file names no quantity of this kind"

    def _asked(self, case: Case) -> tuple[str, ...]:
        return tuple(q.name for q in case.quantities if q.kind in self.described.quantities)

    def _result(self, deck: Deck, read: Callable[[Path], T]) -> T:
        """Return the result of the command on a mesh, read by a function; SolveFailure."""
        where = f"on {deck.grid.counts[0]} x {deck.grid.counts[1]} cells"
        with tempfile.TemporaryDirectory(prefix="shellbench-", ignore_cleanup_errors=True) as scratch:
            folder = Path(scratch).resolve()
            case = deck.part.whole
            (folder / CASE).write_text(json.dumps({**case.data(), "name": case.name}), encoding="utf-8")
            held = deck.held if self.described.drilling else deck.held_without_drilling
            mesh = write_mesh(deck, held, self.described.mesh, folder)
            last = self._called(self.command(deck, mesh, folder), folder, where)
            if not (folder / OUT).is_file():
                raise SolveFailure(f"the program leaves no result {where}{last}")
            try:
                return read(folder / OUT)
            except (SolveFailure, InputError) as failure:
                raise SolveFailure(f"the program's result can't be used {where}: {failure}{last}") from None

    def _called(self, command: list[str], folder: Path, where: str) -> str:
        """Run a command in a folder; return its last line of words as a clause, or the last one that tells of an error.

        Raises
        ------
        SolveFailure
            If it does not end in time, or not with exit status 0.
        InputError
            If it can't be started.
        """
        with tempfile.TemporaryFile() as output:
            try:
                process = subprocess.Popen(
                    command,
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=subprocess.STDOUT,
                    cwd=folder,
                    env=callers_environment(),
                    start_new_session=True,  # so that all that it starts can be ended with it
                )
            except OSError as error:
                raise InputError(f"{self.path}: field 'command': can't be started ({error.strerror})") from None
            try:
                status = process.wait(self.described.seconds)
                ended = f"ended with exit status {status}" if status > 0 else f"was ended by signal {-status}"
            except subprocess.TimeoutExpired:
                status, ended = 1, f"did not end within {self.described.seconds:g} s"
            finally:
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()
            output.seek(max(0, output.seek(0, os.SEEK_END) - LAST))
            text = output.read().decode(errors="replace").strip()
        lines = [line for line in text.splitlines() if re.search(r"[^\W\d_]", line)]
        told = [line for line in lines if "error" in line.lower()] or lines
        last = "".join(c if c.isprintable() else " " for c in told[-1])[:300].strip() if told else ""
        last = f": {last}" if last else ""
        if status:
            print(text, file=sys.stderr)  # into the log of the run
            raise SolveFailure(f"the program {ended} {where}{last}")
        return last
