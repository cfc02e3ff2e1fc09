"""NGSolve's shells as solvers: curved triangles of high degree on a ladder of meshes.

Displacements are given at the corners of triangles and the middles of their sides, and between them by quadratic
interpolation. Loads are the work of the true load on the true midsurface, supports hold whole edges of it.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from shellbench.problem import Capabilities, Settings
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.deck.cells import Shape
from shellbench.problems.shell.deck.deck import Deck
from shellbench.problems.shell.deck.solver import MeshSettings, MeshSolver
from shellbench.problems.shell.declining import Beyond
from shellbench.protocol.engine import engine_version, need

DISTRIBUTION = "ngsolve"
need("", (DISTRIBUTION,), "./plugins/ngsolve")  # without it there is no solver to declare
DEGREE = 3


def installed() -> str:
    """Return name and version of NGSolve."""
    return str(engine_version(DISTRIBUTION))


class NGSolveSettings(MeshSettings):
    """Settings of NGSolve's shells."""

    cells: tuple[int | tuple[int, int], ...] = Field(
        (4, 8, 16),
        min_length=1,
        description="of each mesh, from coarse to fine: squares of two triangles across the part, or along xi1 and xi2",
    )
    degree: int = Field(DEGREE, ge=2, le=6, description="of the displacement and of the surface; moments have one less")
    engine: str = Field(default_factory=installed, description="the engine and its version; the installed one")

    @field_validator("engine")
    @classmethod
    def _engine_is_installed(cls, engine: str) -> str:
        if engine != installed():
            raise ValueError(f"{installed()} is installed, and no other can be asked for")
        return engine


class HHJ(MeshSolver):
    """Hellan-Herrmann-Johnson elements for thin shells, with membrane strains in Regge's space."""

    name: ClassVar[str] = "ngsolve-hhj"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=("kirchhoff-love-linear",), label="NGSolve: curved thin triangles of high degree (HHJ, Regge)"
    )
    settings_type: ClassVar[type[Settings]] = NGSolveSettings
    takes: ClassVar[frozenset[Beyond]] = frozenset({"transverse shear", "local supports"})
    shape: ClassVar[Shape] = "tri6"
    moments: ClassVar[bool] = False
    scales_bending: ClassVar[bool] = True

    def declines(self, case: Case) -> str | None:
        """Return the reason that the solver declines a case, as one clause, or None if it takes it."""
        moved = any(support.motion is not None for support in case.supports)
        return super().declines(case) or ("a support moves, which this solver does not take" if moved else None)

    def solve_mesh(self, deck: Deck, settings: Settings) -> tuple[NDArray[np.float64], int]:
        """Return displacements (v, 3) of the nodes, m, and the number of unknowns; SolveFailure if NGSolve fails."""
        from shellbench_ngsolve.solving import solve

        assert isinstance(settings, NGSolveSettings)
        return solve(deck, settings.degree, shear="naghdi-linear" in self.capabilities.theories)


class TDNNS(HHJ):
    """Elements with tangential displacement and normal-normal stress, for shells with shear; membrane as `HHJ`.

    At free edges and soft supports such shells have a layer as wide as they are thick. Meshes are uniform: until cells
    are as small, answers miss what the layer adds (.2 % on the Scordelis-Lo roof), and so does the limit of the ladder.
    """

    name: ClassVar[str] = "ngsolve-tdnns"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=("naghdi-linear",), label="NGSolve: curved triangles of high degree with shear (TDNNS, Regge)"
    )
