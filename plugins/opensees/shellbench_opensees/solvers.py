"""The shell elements of OpenSees: what each is, and how it is used.

All have six unknowns a node and a stiffness against turning about the normal that none has to choose. The section is
ElasticMembranePlateSection, whose shear factor is 5/6. Supports are the case's, and soft unless it asks for hard ones.
Loads are nodal forces of the displacement's bilinear or linear shape functions; moments act on the rotations.

Sources: the manual's pages of the elements, and the notes in the code of OpenSees (SRC/element/shell). OpenSees' own
EXAMPLES/verification/PinchedCylinder.tcl gives with this version errors of 1.2 % (ShellMITC4) and 1.0 % (ShellDKGQ) on
32 x 32 cells, within the 5 % that it allows.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from shellbench.problem import Capabilities, Settings
from shellbench.problems.shell.deck.cells import Shape
from shellbench.problems.shell.deck.deck import Deck
from shellbench.problems.shell.deck.solver import MeshSolver
from shellbench_opensees.program import OpenSeesSettings, displacements

THIN, SHEARED = ("kirchhoff-love-linear",), ("naghdi-linear",)


class Element(MeshSolver):
    """An element of OpenSees; `entry` is its name in a script."""

    settings_type: ClassVar[type[Settings]] = OpenSeesSettings
    entry: ClassVar[str]

    def solve_mesh(self, deck: Deck, settings: Settings) -> NDArray[np.float64]:
        """Return the displacements (v, 3) of the nodes, m; SolveFailure if OpenSees fails."""
        return displacements(deck, self.entry, ())


class Dkgq(Element):
    """ShellDKGQ: discrete Kirchhoff bending (DKQ) and the membrane GQ12, whose corners turn; flat, warp is ignored."""

    name: ClassVar[str] = "opensees-dkgq"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=THIN, label="OpenSees ShellDKGQ: flat thin quadrilaterals (discrete Kirchhoff, GQ12)"
    )
    entry: ClassVar[str] = "ShellDKGQ"


class Dkgt(Element):
    """ShellDKGT: discrete Kirchhoff bending (DKT) and the membrane GT9, whose corners turn; flat."""

    name: ClassVar[str] = "opensees-dkgt"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=THIN, label="OpenSees ShellDKGT: flat thin triangles (discrete Kirchhoff, GT9)"
    )
    entry: ClassVar[str] = "ShellDKGT"
    shape: ClassVar[Shape] = "tri3"


class Mitc4(Element):
    """ShellMITC4: bilinear, shear strains interpolated, drilling penalty of the membrane's least stiffness; flat."""

    name: ClassVar[str] = "opensees-mitc4"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=SHEARED, label="OpenSees ShellMITC4: flat shear-flexible quadrilaterals (MITC4)"
    )
    entry: ClassVar[str] = "ShellMITC4"


class AsdShellQ4(Element):
    """ASDShellQ4: MITC4 bending, a membrane with drilling rotations (AGQI) and enhanced strains; warp is kept."""

    name: ClassVar[str] = "opensees-asdshellq4"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=SHEARED, label="OpenSees ASDShellQ4: shear-flexible quadrilaterals (MITC4, AGQI)"
    )
    entry: ClassVar[str] = "ASDShellQ4"


class AsdShellT3(Element):
    """ASDShellT3: MITC3 bending and a membrane with drilling rotations (ANDES); flat."""

    name: ClassVar[str] = "opensees-asdshellt3"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=SHEARED, label="OpenSees ASDShellT3: flat shear-flexible triangles"
    )
    entry: ClassVar[str] = "ASDShellT3"
    shape: ClassVar[Shape] = "tri3"
