"""The shell elements of MYSTRAN: what each is, and how it is used.

Flat elements meet at angles on a curved shell. MYSTRAN's have no stiffness against turning about their normal: moments
leak from one element into that free rotation of the next. Springs on it (K6ROT) lead to ground in version 18.0: they
resist rigid motions, and the answer depends on them (MYSTRAN's pull request 175; its manual, section 6.2). Version 19
has other springs (pull request 251). The remedy in version 18.0 is QUAD4TYP MITC4+ with the surface's normals (SNORM).
The manual offers CQUAD4, CTRIA3 and CQUAD8, and calls CTRIA3K and CQUAD4K legacy elements.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from shellbench.problem import Capabilities, Settings
from shellbench.problems.shell.deck.cells import Shape
from shellbench.problems.shell.deck.deck import Deck
from shellbench.problems.shell.deck.solver import MeshSolver
from shellbench.protocol.schema import Finite, Flag
from shellbench_nastran.bulk_data import bulk_data
from shellbench_nastran.program import EngineSettings, displacements, program

program()  # without it there is no solver to declare

THIN, SHEARED = ("kirchhoff-love-linear",), ("naghdi-linear",)


class DrillingSettings(EngineSettings):
    """Settings of elements with springs against drilling rotations."""

    k6rot: Finite = Field(0.0, ge=0, description="PARAM K6ROT: springs from drilling rotations to ground; 0: none")


class NormalSettings(EngineSettings):
    """Settings of elements whose directors may be given."""

    normals: bool = Field(
        True, description="SNORM: directors along the surface's normals; else each element has its own"
    )
    plus: Flag = Field(True, description="MITC4+, which interpolates membrane strains too; else MITC4")


class Element(MeshSolver):
    """An element of MYSTRAN; `entry` is its name in a deck.

    Supports are the case's: a hard one also holds a rotation. Loads are nodal forces of the displacement's bilinear or
    linear shape functions. The thickness is the surface element's on both sides.
    """

    settings_type: ClassVar[type[Settings]] = EngineSettings
    scales_bending: ClassVar[bool] = True
    entry: ClassVar[str]

    def solve_mesh(self, deck: Deck, settings: Settings) -> NDArray[np.float64]:
        """Return the displacements (v, 3) of the nodes, m; SolveFailure if MYSTRAN fails."""
        return displacements(self.deck(deck, settings), len(deck.nodes))

    def deck(self, deck: Deck, settings: Settings) -> str:
        """Return the deck that MYSTRAN reads."""
        return bulk_data(deck, self.entry)


class Quad4K(Element):
    """Discrete Kirchhoff quadrilateral (DKQ) with a bilinear membrane; a legacy element, not supported any more."""

    name: ClassVar[str] = "mystran-cquad4k"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=THIN, label="MYSTRAN CQUAD4K: flat thin quadrilaterals (discrete Kirchhoff)"
    )
    entry: ClassVar[str] = "CQUAD4K"


class Tria3K(Element):
    """Discrete Kirchhoff triangle (DKT) with a constant-strain membrane; a legacy element, not supported any more."""

    name: ClassVar[str] = "mystran-ctria3k"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=THIN, label="MYSTRAN CTRIA3K: flat thin triangles (discrete Kirchhoff)"
    )
    entry: ClassVar[str] = "CTRIA3K"
    shape: ClassVar[Shape] = "tri3"


class Quad4(Element):
    """MYSTRAN's usual quadrilateral, Tessler and Hughes' MIN4: flat, shear stiffness scaled by the element's size."""

    name: ClassVar[str] = "mystran-cquad4"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=SHEARED, label="MYSTRAN CQUAD4: flat shear-flexible quadrilaterals (MIN4)"
    )
    settings_type: ClassVar[type[Settings]] = DrillingSettings
    entry: ClassVar[str] = "CQUAD4"
    board: ClassVar[dict[str, dict[str, float]]] = {"K6ROT 0 (default)": {}, "K6ROT 100": {"k6rot": 100.0}}

    def deck(self, deck: Deck, settings: Settings) -> str:
        """Return the deck that MYSTRAN reads."""
        assert isinstance(settings, DrillingSettings)
        return bulk_data(deck, self.entry, [("K6ROT", settings.k6rot)] if settings.k6rot else [])


class Tria3(Quad4):
    """MYSTRAN's usual triangle, Tessler and Hughes' MIN3: flat, shear stiffness scaled by the element's size."""

    name: ClassVar[str] = "mystran-ctria3"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=SHEARED, label="MYSTRAN CTRIA3: flat shear-flexible triangles (MIN3)"
    )
    entry: ClassVar[str] = "CTRIA3"
    shape: ClassVar[Shape] = "tri3"


class Mitc4(Element):
    """CQUAD4 with QUAD4TYP MITC4+ (Ko, Lee & Bathe 2017), and with the surface's normals as directors."""

    name: ClassVar[str] = "mystran-mitc4"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=SHEARED, label="MYSTRAN CQUAD4, QUAD4TYP MITC4+: shear-flexible quadrilaterals with directors"
    )
    settings_type: ClassVar[type[Settings]] = NormalSettings
    entry: ClassVar[str] = "CQUAD4"
    board: ClassVar[dict[str, dict[str, bool]]] = {
        "MITC4+ with SNORM": {},
        "MITC4": {"normals": False, "plus": False},
    }

    def deck(self, deck: Deck, settings: Settings) -> str:
        """Return the deck that MYSTRAN reads."""
        assert isinstance(settings, NormalSettings)
        return bulk_data(deck, self.entry, [("QUAD4TYP", "MITC4+" if settings.plus else "MITC4")], settings.normals)


class Quad8(Element):
    """CQUAD8: MITC8 (Bathe & Dvorkin 1986), quadratic and curved, whose directors are normal to its own surface."""

    name: ClassVar[str] = "mystran-cquad8"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=SHEARED, label="MYSTRAN CQUAD8: curved shear-flexible quadrilaterals of eight nodes (MITC8)"
    )
    scales_bending: ClassVar[bool] = False
    entry: ClassVar[str] = "CQUAD8"
    shape: ClassVar[Shape] = "quad8"
