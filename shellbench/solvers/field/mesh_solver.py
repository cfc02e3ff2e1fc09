"""The solver `vertex-mesh`: a cloth as a mesh of triangles, the reference for cases without a closed form."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from shellbench.problem import Capabilities, Progress, ProgressCallback, Settings, Step
from shellbench.problems.field.case import FieldCase
from shellbench.problems.field.quantities import AXES
from shellbench.problems.field.solution import FieldSolution
from shellbench.problems.field.solving import FieldSolver, measured, told_by_levels
from shellbench.protocol.schema import Finite

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MeshField(FieldSolution):
    """A field by the displacement (n, 3) of `vertices`, linear in triangles; `form` has the data that rebuild it."""

    @cached_property
    def mesh(self) -> Any:
        """The mesh."""
        from shellbench.solvers.field.mesh import Mesh

        return Mesh(self.case, **self.form)

    def displacement(self, points: Array, orders: tuple[int, int] = (0, 0)) -> Array:
        """Return the displacement (n, 3), m; ValueError for derivatives."""
        if sum(orders):
            raise ValueError("a mesh of flat triangles has no derivatives at points")
        found, shares = self.mesh.lattice.within(points)
        return np.asarray(np.einsum("nk,nka->na", shares, self.tensors["vertices"][self.mesh.lattice.triangles[found]]))

    def losses(self, points: Array, turns: int = 1) -> dict[str, Array]:
        """Return the mesh's own mean losses, at each of points (n, 2) alike: structures would see its folds."""
        means = self.mesh.means(self.mesh.rest + self.tensors["vertices"])
        return {name: np.full(len(points), mean) for name, mean in means.items()}


class MeshSettings(Settings):
    """Settings of `VertexMeshSolver`."""

    resolution: int = Field(
        48, ge=4, le=400, multiple_of=4, strict=True, description="edges along a side; half as many say the uncertainty"
    )
    turn: Finite | None = Field(
        None, ge=0, lt=60, description="angle of a lattice from u about the middle, degrees; None: rows along u"
    )


class VertexMeshSolver(FieldSolver):
    """A mesh of almost equilateral triangles whose edges stretch and whose hinges bend."""

    name: ClassVar[str] = "vertex-mesh"
    capabilities: ClassVar[Capabilities] = Capabilities(
        ("local-structures",), "mesh of triangles with the structures' limit, Newton's method"
    )
    settings_type: ClassVar[type[MeshSettings]] = MeshSettings

    def refuses(self, case: FieldCase) -> str | None:
        """Return the reason that it declines a case, or None: it takes no case that asks for a network."""
        if case.network is not None:
            return f"the case asks for the network '{case.network}'"
        return None

    def declines_quantity(self, case: FieldCase, quantity: Any) -> str | None:
        """Return the reason that it can't give a quantity, or None: it has no derivatives."""
        if quantity.kind == "value" and sum(quantity.orders):
            return "a mesh of flat triangles has no derivatives at points"
        return None

    def answer(self, case: FieldCase, settings: MeshSettings, progress: ProgressCallback) -> MeshField:
        """Solve on two meshes, of which the finer one answers."""
        from shellbench.solvers.field.mesh import DIRECTIONS

        counts = settings.resolution // 2, settings.resolution
        coarse, fine = (solve_mesh(case, count, progress, settings.turn) for count in counts)
        uncertainty = told_by_levels([measured(case, coarse), measured(case, fine)])
        # A mean over more directions estimates the error of the mesh's few directions.
        more = measured(case, replace(fine, form={**fine.form, "directions": 2 * DIRECTIONS}))
        for name, value in measured(case, fine).items():
            uncertainty[name] += abs(value - more[name])
        return replace(fine, uncertainty=uncertainty)

    def load(self, path: Path) -> MeshField:
        """Read the file of a field; InputError in one sentence if it is no such file."""
        return MeshField.load(path)


def solve_mesh(case: FieldCase, columns: int, progress: ProgressCallback, turn: float | None = None) -> MeshField:
    """Return the mesh of least energy; `turn` is the angle of its lattice, degrees, None for rows along u."""
    from shellbench.solvers.field.mesh import Mesh

    began, mesh, history = time.perf_counter(), Mesh(case, columns, turn=turn), list[Step]()
    free = len(mesh.rest) * (len(AXES) - len(mesh.cloth.confined))
    found = mesh.rest
    for energy, places in mesh.minimise_energy():
        found = places
        history.append(Step(len(history), time.perf_counter() - began, energy, free))
        progress(Progress(len(history), None, f"energy {energy:.6g}"))
    form = {"columns": columns} | ({} if turn is None else {"turn": turn})
    return MeshField(case, {"vertices": found - mesh.rest}, form, tuple(history))
