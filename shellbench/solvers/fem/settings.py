"""Settings of `fem`, and the cases whose degree they may raise."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, PositiveInt

from shellbench.problem import Settings
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.loads import MomentLoad
from shellbench.problems.shell.question.places import Edge
from shellbench.solvers.fem.algebra.choices import Method


class FemSettings(Settings):
    """Settings of `fem`.

    Attributes
    ----------
    tolerance
        Relative uncertainty at which every quantity of the case counts as converged. None: 6e-7, or 5e-6 where a force
        acts at a point (2.5e-5 in degree 3); in the non-linear theory 4e-6, and 5e-4 where a force acts at a point or a
        load is narrow; 1e-4 of a motion. Strain energies may be ten times less certain, forces and moments in the shell
        fifty times. The diagnostic `not_converged` of a shell at rest names the quantities that are less certain. The
        distance of an edge of contact in the last cell of its line from the end is stated, but does not count.
    max_unknowns
        Largest number of degrees of freedom that are solved for on a mesh. None: 165,000, or 40,000 in the non-linear
        theory unless all is prescribed. A motion is bounded by its cells and steps instead.
    cells
        One fixed mesh: along each coordinate the cells from a graded point to the end of its influence, which is
        half the way to the next one, or half of the side. None: refine.
    grading
        Exponent of the mesh lines' distances from a graded point: 1 is uniform, and 3 spoils the conditioning. None:
        2, or 2.5 in degree 5. Unless it is 1, meshes of the linear theory grade besides toward singular corners, as
        their exponents ask, and toward thin layers (`layers`).
    degree
        Of the basis functions in each coordinate, joined C1: 3 (Bogner, Fox & Schmit), 4 or 5. None: 5, or 3 if no
        other is possible: for motions, and in the non-linear theory unless the whole field is prescribed.
    quadrature_order
        Degree to which the Gauss rule of a cell is exact.
    direct_solver
        "dissection" is the project's own, "superlu" is SciPy's, "pardiso" needs pypardiso; "auto" is "dissection". The
        non-linear theory always takes "dissection", which counts negative eigenvalues.
    symmetry
        Solve a linear case that is its own mirror image on a part of the mesh: the answer is that on the whole mesh,
        with fewer degrees of freedom to solve for.
    time_step
        Of a motion, s: one fixed level, cut only if necessary; loads are evaluated once a step. None: refine.
    spectral_radius
        Of the generalised-alpha method at infinite frequency: a smaller radius damps unresolved frequencies more
        strongly.
    """

    tolerance: float | None = Field(None, gt=0, lt=1)
    max_unknowns: int | None = Field(None, ge=100)
    cells: tuple[PositiveInt, PositiveInt] | None = None
    grading: float | None = Field(None, ge=1, le=3)
    degree: Literal[3, 4, 5] | None = None
    quadrature_order: int = Field(7, ge=5, le=19)
    direct_solver: Method = "auto"
    symmetry: bool = True
    time_step: float | None = Field(None, gt=0)
    spectral_radius: float = Field(0.5, ge=0, lt=1)


def takes_bubbles(case: Case) -> bool:
    """Return True if a case can be solved in degree 4 and 5."""
    if case.dynamics is not None:
        return False
    if case.prescribed:  # interpolated; following loads are known in cubics only
        return case.linear or not (case.following or any(isinstance(load, MomentLoad) for load in case.loads))
    if not case.linear:
        return False
    # The conditions on bubbles support whole edges only, and directions that do not turn along them.
    held = case.supported_places()
    return all(not support.local and (not isinstance(place, Edge) or place.whole) for support, place in held)
