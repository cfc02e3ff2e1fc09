"""OpenSees as an engine, and one static solution of a deck.

OpenSees has one model a process, and `wipe` empties it. Its C++ code prints to the process's output and error streams,
not through `sys`: they are redirected while it works.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from shellbench.errors import InputError, SolveFailure
from shellbench.problems.shell.deck.deck import Deck
from shellbench.problems.shell.deck.solver import MeshSettings
from shellbench.protocol.engine import engine_version, need

DISTRIBUTION, MODULE = "openseespy", "openseespy.opensees"
STREAMS = (1, 2)  # descriptors of output and errors, whatever sys.stdout is
BALANCE, ITERATIONS = 1e-6, 4  # out-of-balance forces, relative to all; a second iteration takes out rounding
SECTION, SERIES, PATTERN = 1, 1, 1  # tags

need("", (DISTRIBUTION,), "./plugins/opensees")  # without it there is no solver to declare


def installed() -> str:
    """Return name and version of the program, such as "openseespy 3.7.1.2"."""
    return str(engine_version(DISTRIBUTION))


class OpenSeesSettings(MeshSettings):
    """Settings of all elements of OpenSees."""

    engine: str = Field(default_factory=installed, description="the package and its version; the one installed")

    @field_validator("engine")
    @classmethod
    def _engine_is_installed(cls, engine: str) -> str:
        if engine != installed():
            raise ValueError(f"{installed()} is installed, and no other can be asked for")
        return engine


@contextmanager
def silent() -> Iterator[None]:
    """Discard output to the process's streams."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = [os.dup(stream) for stream in STREAMS]
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        for stream in STREAMS:
            os.dup2(nowhere, stream)
        yield
    finally:
        for stream, copy in zip(STREAMS, kept, strict=True):
            os.dup2(copy, stream)
            os.close(copy)
        os.close(nowhere)


def displacements(deck: Deck, element: str, options: tuple[str, ...]) -> NDArray[np.float64]:
    """Return the displacements (v, 3) of a deck's nodes with an element such as "ShellDKGQ" and options of it, m.

    Raises
    ------
    SolveFailure
        If OpenSees refuses the model or finds no equilibrium.
    InputError
        If its library can't be loaded.
    """
    with silent():
        try:
            ops: Any = import_module(MODULE)
        except (ImportError, RuntimeError, OSError) as error:
            raise InputError(f"{installed()} can't be loaded: {str(error).splitlines()[0]}") from None
        try:
            _build(ops, deck, element, options)
            if ops.analyze(1) != 0:
                raise SolveFailure("OpenSees finds no equilibrium: its matrix is singular or nearly so")
            found = [ops.nodeDisp(v + 1)[:3] for v in range(len(deck.nodes))]
        except ops.OpenSeesError as error:
            raise SolveFailure(f"OpenSees stopped: {error}") from None
        finally:
            ops.wipe()
    return np.array(found)


def _build(ops: Any, deck: Deck, element: str, options: tuple[str, ...]) -> None:
    """Make the model of a deck: nodes, elements, nodal loads, prescribed components, and a linear static analysis."""
    ops.wipe()
    ops.model("basic", "-ndm", 3, "-ndf", 6)
    for v, (place, held) in enumerate(zip(deck.nodes.tolist(), deck.held.tolist(), strict=True), 1):
        ops.node(v, *place)
        if any(held):
            ops.fix(v, *map(int, held))
    modulus, thickness = float(deck.youngs_modulus[0]), float(deck.thickness[0])
    ops.section("ElasticMembranePlateSection", SECTION, modulus, deck.poissons_ratio, thickness, 0.0)
    for e, nodes in enumerate((deck.cells + 1).tolist(), 1):
        ops.element(element, e, *nodes, SECTION, *options)
    ops.timeSeries("Linear", SERIES)
    ops.pattern("Plain", PATTERN, SERIES)
    for v in np.flatnonzero(deck.forces.any(axis=-1)).tolist():
        ops.load(v + 1, *deck.forces[v].tolist())
    moved = np.argwhere(deck.held & (deck.prescribed != 0)).tolist()
    for v, c in moved:
        ops.remove("sp", v + 1, c + 1)
        ops.sp(v + 1, c + 1, float(deck.prescribed[v, c]))
    ops.constraints("Transformation" if moved else "Plain")
    ops.numberer("RCM")
    ops.system("UmfPack")
    ops.integrator("LoadControl", 1.0)
    ops.test("NormUnbalance", BALANCE * float(np.linalg.norm(deck.forces)) or BALANCE, ITERATIONS)
    ops.algorithm("Newton")
    ops.analysis("Static")
