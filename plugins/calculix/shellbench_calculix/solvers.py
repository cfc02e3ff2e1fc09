"""The shell elements of CalculiX: what each is, and how it is used.

CalculiX expands each shell element to one solid through the thickness (manual, sections "Three-node shell element" to
"Eight-node shell element"). None of them has a thin-shell theory: normals shear and stretch. Supports are the case's,
and soft unless it asks for hard ones. Loads are nodal forces of the displacement's shape functions.

The displacement is at most quadratic through the thickness. Shear strains are then constant or linear in it, and their
stiffness is that of a shear-flexible shell with factor 1 in place of 5/6. A softly supported plate of S8R has the
deflection of that theory.

CalculiX's own tests shell1lin, shell2, shell4, shellf and beamfsh1 give their reference values to 7e-8 of the largest.

The manual's golden rules advise quadratic elements: for linear ones "the results must be considered with care".
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from shellbench.problem import Capabilities, Settings
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.deck.cells import Shape
from shellbench.problems.shell.deck.deck import Deck
from shellbench.problems.shell.deck.solver import MeshSolver
from shellbench_calculix.input_deck import input_deck
from shellbench_calculix.program import CalculixSettings, displacements, program

program()  # without it there is no solver to declare

NOT_FOR_BENDING = (
    "S4R is one C3D8R solid through the thickness, of which CalculiX's manual says that it is not stiff enough in "
    "bending: hourglass control alone resists that"
)


def _sheared(element: str, solid: str) -> Capabilities:
    return Capabilities(theories=("naghdi-linear",), label=f"CalculiX {element}: {solid}")


class Element(MeshSolver):
    """An element of CalculiX; `entry` is its name in a deck."""

    settings_type: ClassVar[type[Settings]] = CalculixSettings
    entry: ClassVar[str]

    def solve_mesh(self, deck: Deck, settings: Settings) -> NDArray[np.float64]:
        """Return the displacements (v, 3) of the nodes, m; SolveFailure if CalculiX fails."""
        assert isinstance(settings, CalculixSettings)
        return displacements(input_deck(deck, self.entry, settings.normals), len(deck.nodes))


class S3(Element):
    """C3D6, a linear wedge: it locks in bending."""

    name: ClassVar[str] = "calculix-s3"
    capabilities: ClassVar[Capabilities] = _sheared("S3", "triangles, expanded to linear wedges (C3D6)")
    entry: ClassVar[str] = "S3"
    shape: ClassVar[Shape] = "tri3"


class S4(Element):
    """C3D8I, a linear brick with incompatible modes; it fails the patch test on distorted cells (CalculiX issue 88)."""

    name: ClassVar[str] = "calculix-s4"
    capabilities: ClassVar[Capabilities] = _sheared("S4", "quadrilaterals, expanded to incompatible bricks (C3D8I)")
    entry: ClassVar[str] = "S4"


class S4R(Element):
    """C3D8R, a linear brick with one integration point; declined."""

    name: ClassVar[str] = "calculix-s4r"
    capabilities: ClassVar[Capabilities] = _sheared(
        "S4R", "quadrilaterals, expanded to under-integrated bricks (C3D8R)"
    )
    entry: ClassVar[str] = "S4R"

    def declines(self, case: Case) -> str | None:
        """Return the reason that the solver declines all cases, as one clause."""
        return super().declines(case) or NOT_FOR_BENDING


class S6(Element):
    """C3D15, a quadratic wedge."""

    name: ClassVar[str] = "calculix-s6"
    capabilities: ClassVar[Capabilities] = _sheared("S6", "curved triangles, expanded to quadratic wedges (C3D15)")
    entry: ClassVar[str] = "S6"
    shape: ClassVar[Shape] = "tri6"


class S8(Element):
    """C3D20, a quadratic brick with full integration."""

    name: ClassVar[str] = "calculix-s8"
    capabilities: ClassVar[Capabilities] = _sheared("S8", "curved quadrilaterals, expanded to quadratic bricks (C3D20)")
    entry: ClassVar[str] = "S8"
    shape: ClassVar[Shape] = "quad8"


class S8R(Element):
    """C3D20R, a quadratic brick with reduced integration."""

    name: ClassVar[str] = "calculix-s8r"
    capabilities: ClassVar[Capabilities] = _sheared(
        "S8R", "curved quadrilaterals, expanded to quadratic bricks with reduced integration (C3D20R)"
    )
    entry: ClassVar[str] = "S8R"
    shape: ClassVar[Shape] = "quad8"
