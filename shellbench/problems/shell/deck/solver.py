"""Base of solvers on programs with shell elements of their own: nodes' displacements on ever finer meshes.

The answer is that of the finest mesh. Its stated uncertainty is its distance from the limit of all meshes and that
limit's own uncertainty. Between nodes the displacement is that of the cells' shape functions. Such a solver knows
displacements only: other quantities are declined.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from shellbench.errors import InputError, SolveFailure
from shellbench.problem import Progress, ProgressCallback, Settings, Solution, Step
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.deck.cells import Shape
from shellbench.problems.shell.deck.deck import Deck
from shellbench.problems.shell.deck.grid import square_cells
from shellbench.problems.shell.deck.nodal import why_not_held
from shellbench.problems.shell.declining import Beyond
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.problems.shell.quantities.quantities import (
    CentreOfMass,
    DisplacementQuantity,
    FieldError,
    LargestDisplacement,
    PositionQuantity,
)
from shellbench.problems.shell.question.loads import MomentLoad, PointLoad
from shellbench.problems.shell.solution import Arrays, ShellSolution, ShellSolver, Words
from shellbench.problems.shell.symmetry.symmetry import part_of, whole_of
from shellbench.protocol.limit import limit_of
from shellbench.protocol.schema import Flag

Array = NDArray[np.float64]
OF_DISPLACEMENTS = (DisplacementQuantity, PositionQuantity, CentreOfMass, LargestDisplacement, FieldError)
LADDER = (8, 16, 32)
MOST_CELLS = 1024


class MeshSettings(Settings):
    """Settings of `MeshSolver`."""

    cells: tuple[int | tuple[int, int], ...] = Field(
        LADDER,
        min_length=1,
        description="of each mesh, from coarse to fine: cells across the part, or along xi1 and xi2",
    )
    symmetry: Flag = Field(True, description="whether to solve only the part that planes of symmetry leave")
    distortion: float = Field(0.0, ge=0, le=0.3, description="by which inner nodes are moved at random, in cells")


class MeshSolver(ShellSolver):
    """Shell elements of another program on a ladder of meshes; a subclass gives `solve_mesh`.

    Attributes
    ----------
    shape
        Of the element's cells.
    moments
        Whether the element takes moments on its nodes.
    scales_bending
        Whether it takes a bending stiffness that is not that of a homogeneous shell.
    """

    settings_type: ClassVar[type[Settings]] = MeshSettings
    takes: ClassVar[frozenset[Beyond]] = frozenset({"transverse shear", "local supports", "local loads", "kinks"})
    reactions: ClassVar[bool] = False
    shape: ClassVar[Shape] = "quad4"
    moments: ClassVar[bool] = True
    scales_bending: ClassVar[bool] = False

    def declines(self, case: Case) -> str | None:
        """Return the reason that the solver declines a case, as one clause, or None if it takes it."""
        return super().declines(case) or self._beyond(case)

    def _beyond(self, case: Case) -> str | None:
        if not case.linear or case.dynamics is not None or case.prescribed:
            return "it is no linear static case, and this solver takes no other"
        if len(case.states) != 1:
            return "it asks for several states, and this solver gives one"
        if not self.scales_bending and case.isotropic.bending_factor != 1.0:
            return "its bending stiffness is not that of a homogeneous shell"
        if not self.moments and any(isinstance(load, MomentLoad) for load in case.loads):
            return "moments act on its edges, which this element does not take"
        if case.theory == "naghdi-linear" and any(isinstance(load, PointLoad) for load in case.loads):
            return "a force acts at a point, under which a shell with shear has no limit"
        return why_not_held(case)

    def declines_quantity(self, case: Case, quantity: object) -> str | None:
        """Return the reason that it can't give a quantity of a case that it takes, as one clause, or None if it can."""
        if isinstance(quantity, OF_DISPLACEMENTS):
            return None
        return "this solver knows the displacements of nodes only"

    def solve_mesh(self, deck: Deck, settings: Settings) -> Array | tuple[Array, int]:
        """Return the displacements (v, 3) of the nodes, m, and the number of unknowns if it is not the deck's.

        Raises
        ------
        SolveFailure
            If the program does not solve it.
        InputError
            If the program is missing.
        """
        raise NotImplementedError

    def solution_on(self, deck: Deck, settings: Settings) -> MeshSolution:
        """Return the solution on a mesh; SolveFailure if nodes have no finite displacement."""
        told = self.solve_mesh(deck, settings)
        return self.solution_of(deck, *told) if isinstance(told, tuple) else self.solution_of(deck, told)

    def solution_of(self, deck: Deck, solved: Array, unknowns: int | None = None) -> MeshSolution:
        """Return the solution of displacements (v, 3) of a mesh's nodes; SolveFailure if one is not finite."""
        moved = np.asarray(solved, float)
        if moved.shape != deck.nodes.shape or not np.all(np.isfinite(moved)):
            counts = list(deck.grid.counts)
            raise SolveFailure(f"the program gives no finite displacement for each node of {counts} cells")
        energy = -deck.part.copies * float(np.sum(deck.forces[:, :3] * moved)) / 2
        return MeshSolution(deck, deck.without_rigid(moved), energy=energy, unknowns=unknowns)

    def answer(
        self, case: Case, settings: MeshSettings, start: Solution | Path | None, progress: ProgressCallback
    ) -> MeshSolution:
        """Solve a case on each mesh of the ladder.

        Raises
        ------
        SolveFailure
            If the program fails; the answer on the meshes before comes with it.
        """
        began, part = time.perf_counter(), part_of(case) if settings.symmetry else whole_of(case)
        history: list[Step] = []
        sizes: list[float] = []
        found: MeshSolution | None = None
        for given in settings.cells:
            counts = given if isinstance(given, tuple) else square_cells(part, given)
            if max(counts) > MOST_CELLS:
                raise InputError(f"field 'cells': found {list(counts)}, at most {MOST_CELLS} are possible")
            deck = Deck.of(part, counts, self.shape, settings.distortion, case.states[0])
            try:
                found = self.solution_on(deck, settings)
            except SolveFailure as failure:
                raise SolveFailure(str(failure), partial=found) from None
            values = found.given or measure_all(found)
            spent = time.perf_counter() - began
            history.append(Step(len(history), spent, found.energy, found.parameters, quantities=values))
            sizes.append(float(np.prod(counts)) ** -0.5)
            progress(Progress(len(history), len(settings.cells), f"{counts[0]} x {counts[1]} cells"))
        assert found is not None
        limits = {n: limit_of(sizes, [s.quantities[n] for s in history], found.rounding.get(n, 0.0)) for n in values}
        sure = {name: abs(limit.value - values[name]) + limit.uncertainty for name, limit in limits.items()}
        return replace(
            found,
            history=tuple(history),
            uncertainty={} if len(history) == 1 else sure,
            extrapolated={name: limit.value for name, limit in limits.items() if limit.rate is not None},
            diagnostics={
                "element": self.name,
                "cells": list(counts),
                "copies": part.copies,
                "rates": {name: limit.rate for name, limit in limits.items() if limit.rate is not None},
            },
        )

    def load(self, path: Path) -> MeshSolution:
        """Read a file of `save`; InputError in one sentence if it is no such file."""
        return MeshSolution.load(path)


@dataclass(frozen=True)
class MeshSolution(ShellSolution):
    """Displacements of a mesh's nodes, and between them those of its cells' shape functions.

    Attributes
    ----------
    deck
        The solved part on its finest mesh.
    moved
        (v, 3) displacements of the nodes, m; not finite if the program gives values only.
    energy
        Total potential energy, J: minus half the work of the loads.
    given
        Values by name of quantity, where the program gives no field but these.
    unknowns
        Numbers that were solved for, if not the deck's displacements and rotations.
    rounding
        By name of quantity: half a unit of the last digit that the program has printed; none if that is not known.
    """

    formats: ClassVar[tuple[str | int, ...]] = ("mesh, format 1",)
    numbers: ClassVar[tuple[str, ...]] = ("moved",)

    deck: Deck
    moved: Array
    energy: float = 0.0
    given: Mapping[str, float] = field(default_factory=dict)
    unknowns: int | None = None
    rounding: Mapping[str, float] = field(default_factory=dict)

    @property
    def case(self) -> Case:
        """The case it answers."""
        return self.deck.part.whole

    @property
    def parameters(self) -> int:
        """Numbers that were solved for."""
        return self.deck.unknowns if self.unknowns is None else self.unknowns

    @cached_property
    def _seamed(self) -> Array:
        return self.moved[self.deck.grid.merged]

    def displacement_at(self, xi: Array, at: float | None) -> Array:
        """Return the displacement (N, 3) at points (N, 2)."""
        folded = self.deck.part.fold(xi)
        return self.deck.grid.mesh.interpolate(self._seamed, folded.points) * folded.signs

    def field_at(self, name: str, xi: Array, at: float | None) -> Array:
        """Raise InputError: strains are not known."""
        raise InputError(f"{self.case.name}: this solution knows displacements only")

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Raise InputError: energies are not known."""
        raise InputError(f"{self.case.name}: this solution knows displacements only")

    def kept(self) -> tuple[Words, Arrays]:
        """Return the data of a file beside the case and the history."""
        grid = self.deck.grid
        words = {"counts": grid.counts, "shape": grid.shape, "distortion": grid.distortion}
        more = {"whole": not self.deck.part.mirrors, "energy": self.energy, "given": dict(self.given)}
        more["unknowns"] = self.unknowns
        return {**words, **more}, {"moved": self.moved}

    @classmethod
    def restored(cls, case: Case, words: Words, arrays: Arrays) -> MeshSolution:
        """Make a solution from the content of a file; ValueError or KeyError if it is inconsistent."""
        part = whole_of(case) if words["whole"] else part_of(case)
        counts = int(words["counts"][0]), int(words["counts"][1])
        deck = Deck.of(part, counts, words["shape"], float(words["distortion"]), case.states[0])
        if arrays["moved"].shape != deck.nodes.shape:
            raise ValueError("displacements do not fit the mesh")
        energy, given = float(words.get("energy", 0.0)), words.get("given", {})
        return cls(deck, arrays["moved"], energy=energy, given=given, unknowns=words.get("unknowns"))
