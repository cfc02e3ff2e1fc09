"""The shell elements of Kratos that linear statics uses, on ladders of meshes: what each is, and how it is used.

Kratos assembles the stiffness at rest, and the linear system is solved outside of it as for `kratos-thin`. Kratos 10.4
registers neither ShellThinElement3D4N nor ShellThickElement3D3N (its issue 11375): the corotational element of each is
used, as in Kratos' own linear tests, and no large motion is. All elements have six unknowns a node.

Supports are the case's, and soft unless it asks for hard ones. Loads are nodal forces of the displacement's bilinear or
linear shape functions, where Kratos' surface conditions spread them over flat cells; moments act on the rotations.

Sources: headers and code of Kratos' shell elements (StructuralMechanicsApplication/custom_elements/shell_elements).
Kratos' own example of these four, a pinched cylinder, gives its reference to 4e-9: plugins/kratos/decks/own_example.py.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from shellbench.problem import Capabilities, Settings
from shellbench.problems.shell.deck.cells import Shape
from shellbench.problems.shell.deck.deck import Deck
from shellbench.problems.shell.deck.solver import MeshSettings, MeshSolver
from shellbench_kratos.settings import KratosSettings

THIN, SHEARED = ("kirchhoff-love-linear",), ("naghdi-linear",)
PLANE_STRESS, REISSNER_MINDLIN = "LinearElasticPlaneStress2DLaw", "ReissnerMindlinShellElasticConstitutiveLaw"


class KratosMeshSettings(MeshSettings, KratosSettings):
    """Settings of all these elements."""


class Element(MeshSolver):
    """An element of Kratos; `entry` is its name there, `law` that of its constitutive law."""

    settings_type: ClassVar[type[Settings]] = KratosMeshSettings
    entry: ClassVar[str]
    law: ClassVar[str] = PLANE_STRESS

    def solve_mesh(self, deck: Deck, settings: Settings) -> NDArray[np.float64]:
        """Return the displacements (v, 3) of the nodes, m; SolveFailure if Kratos fails or the matrix is singular."""
        from shellbench_kratos.engine import failing_with_kratos
        from shellbench_kratos.thin_elements import Elements
        from shellbench_kratos.thin_static import LinearSystem

        elements = Elements(deck.nodes, deck.cells, deck.part.case.isotropic, self.entry, self.law)
        with failing_with_kratos(lambda: None, "the mesh"):
            system = LinearSystem.at_rest(elements, np.flatnonzero(~deck.held.ravel()))
            return system.solve(deck.forces, np.where(deck.held, deck.prescribed, 0.0))[:, :3]


class Dkq(Element):
    """ShellThinElementCorotational3D4N at rest: discrete Kirchhoff bending (DKQ) and an ANDES membrane.

    Flat. The membrane's corners turn, so that no drilling spring is needed. `kratos-thin` is the same element. It fails
    the membrane's patch test on cells that are no parallelograms: plugins/kratos/decks/patch.py.
    """

    name: ClassVar[str] = "kratos-dkq"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=THIN, label="Kratos ShellThinElementCorotational3D4N: flat thin quadrilaterals (DKQ, ANDES)"
    )
    entry: ClassVar[str] = "ShellThinElementCorotational3D4N"


class Dkt(Element):
    """ShellThinElement3D3N: discrete Kirchhoff bending (DKT) and an ANDES membrane, whose corners turn; flat."""

    name: ClassVar[str] = "kratos-dkt"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=THIN, label="Kratos ShellThinElement3D3N: flat thin triangles (DKT, ANDES)"
    )
    entry: ClassVar[str] = "ShellThinElement3D3N"
    shape: ClassVar[Shape] = "tri3"


class Thick4(Element):
    """ShellThickElement3D4N: bilinear, MITC4 shear, five enhanced strains in the membrane, a drilling penalty.

    Since 10.4 the name stands for MITCThickShellElement3D4N, which takes a law of Reissner and Mindlin's shells alone.
    The penalty is a tenth of the shear modulus (STABILIZATION_FACTOR, left at its default). Warp is kept.
    """

    name: ClassVar[str] = "kratos-thick4"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=SHEARED, label="Kratos ShellThickElement3D4N: shear-flexible quadrilaterals (MITC4, enhanced strains)"
    )
    entry: ClassVar[str] = "ShellThickElement3D4N"
    law: ClassVar[str] = REISSNER_MINDLIN


class Thick3(Element):
    """ShellThickElementCorotational3D3N at rest: constant strains, discrete shear gaps (DSG), drilling penalty; flat.

    Shear stiffness is reduced by h^2 / (h^2 + l^2 / 10), l the longest side (Lyly). The stiffness depends on which
    corner is a cell's first: plugins/kratos/decks/deck.py. That of CSDSG3ThickShellLinearElement3D3N does not, which
    Kratos' maintainers advise in its place (issue 14454). It stiffens on thin doubly curved shells as cells shrink.
    """

    name: ClassVar[str] = "kratos-thick3"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=SHEARED, label="Kratos ShellThickElementCorotational3D3N: flat shear-flexible triangles (DSG)"
    )
    entry: ClassVar[str] = "ShellThickElementCorotational3D3N"
    shape: ClassVar[Shape] = "tri3"
