"""CalculiX as an engine: where its program is, which one it is, and one run of it.

The program is that of the environment variable CCX, else `ccx` on the path. Its identity is what `ccx -v` prints, and a
checksum of the program.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from shellbench.errors import InputError, SolveFailure
from shellbench.problems.shell.deck.solver import MeshSettings

VARIABLE, NAME = "CCX", "ccx"
VERSION = re.compile(r"Version\s+(\d[\w.]*)")
NUMBER = r"\s*([-+]?\d\.\d+(?:E?[-+]\d+))"
ROW = re.compile(rf"^\s*(\d+){3 * NUMBER}\s*$", re.MULTILINE)  # of the file DAT: node and displacement
EXPONENT = re.compile(r"(?<=\d)([-+]\d{3})$")  # of three digits, which Fortran prints without E
CHECKSUM_DIGITS = 8


@cache
def program() -> Path:
    """Return the path of the program; InputError if there is none."""
    found = shutil.which(os.environ.get(VARIABLE) or NAME)
    if found is None:
        raise InputError(f"CalculiX is not found: install its package calculix-ccx, or name the program in {VARIABLE}")
    return Path(found).resolve()


@cache
def installed() -> str:
    """Return name, version and checksum of the program, such as "CalculiX-2.20-1a2b3c4d"."""
    with tempfile.TemporaryDirectory() as folder:
        said = subprocess.run([program(), "-v"], cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    found = VERSION.search(said.stdout)
    digest = hashlib.sha256(program().read_bytes()).hexdigest()[:CHECKSUM_DIGITS]
    return f"CalculiX-{found[1] if found else 'unknown'}-{digest}"


class CalculixSettings(MeshSettings):
    """Settings of all elements of CalculiX."""

    symmetry: bool = Field(False, description="whether to solve only the part that planes of symmetry leave")
    normals: bool = Field(False, description="give the midsurface's normals (*NORMAL); else CalculiX finds its own")
    engine: str = Field(default_factory=installed, description="the program, its version and checksum; the one found")

    @field_validator("engine")
    @classmethod
    def _engine_is_installed(cls, engine: str) -> str:
        if engine != installed():
            raise ValueError(f"the program found is {installed()}, and no other can be asked for")
        return engine


def displacements(deck: str, count: int) -> NDArray[np.float64]:
    """Run a deck that prints displacements of the nodes 1 to `count`; return them (count, 3), to seven digits.

    Raises
    ------
    SolveFailure
        If the program ends without the displacement of each node; with its own first error.
    """
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "deck.inp").write_text(deck, encoding="ascii")
        run = subprocess.run(
            [program(), "-i", "deck"], cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, text=True
        )
        output = Path(folder, "deck.dat")
        rows = ROW.findall(output.read_text(encoding="ascii")) if output.exists() else []
    found = {int(row[0]): [float(EXPONENT.sub(r"E\1", word)) for word in row[1:]] for row in rows}
    if len(found) != count or "*ERROR" in run.stdout:
        errors = [line.strip(" *") for line in run.stdout.splitlines() if "*ERROR" in line]
        raise SolveFailure(f"CalculiX stopped: {errors[0] if errors else f'exit code {run.returncode}'}")
    return np.array([found[node] for node in range(1, count + 1)])
