"""How a case is folded on its meshes: as it stands, or turned into the frame of its mirrors and turned back after."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.symmetry.mirror_frame import in_frame_of_mirrors
from shellbench.solvers.fem.linear.equilibrium import Equilibrium
from shellbench.solvers.fem.linear.symmetry import FoldedMesh
from shellbench.solvers.fem.mesh.mesh import TensorMesh


@dataclass(frozen=True)
class Folding:
    """How a case is folded.

    Attributes
    ----------
    case
        The case.
    """

    case: Case

    @cached_property
    def _turned(self) -> tuple[Case, NDArray[np.float64]] | None:
        return in_frame_of_mirrors(self.case)

    def fold(self, mesh: TensorMesh, quadrature_order: int) -> FoldedMesh | None:
        """Return the case on a mesh, folded, in the frame in which its part is the smaller one; None if it can't be."""
        cases = (self.case,) if self._turned is None else (self.case, self._turned[0])
        found = [folded for case in cases if (folded := FoldedMesh.from_case(case, mesh, quadrature_order))]
        return min(found, key=lambda folded: folded.mesh.dof_count, default=None)

    def unfolded(self, folded: FoldedMesh, found: Equilibrium) -> Equilibrium:
        """Return the answer to the case, as it stands, of that on its folded part."""
        whole = folded.unfolded(found)
        if folded.part.whole is self.case or self._turned is None:
            return whole
        solution, back = whole.solution, self._turned[1].T
        answer = replace(
            solution,
            case=self.case,
            coefficients=np.einsum("cd,ndks->ncks", back, solution.coefficients),
            support_forces=np.einsum("cd,mndks->mncks", back, solution.support_forces),
        )
        return replace(whole, solution=answer)
