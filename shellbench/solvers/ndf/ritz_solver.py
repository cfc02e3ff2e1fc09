"""The solver `ndf-ritz` and its settings; what solves is `ritz`, which is imported when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field as PydanticField

from shellbench.model import Positive
from shellbench.problem import Capabilities, ProgressCallback, SeededSettings, Solution
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.solution import Beyond, why_not_plain
from shellbench.solvers.ndf.choices import (
    LARGEST_GAP,
    LAYER,
    MULTIPLIERS,
    Components,
    PeriodicInput,
    StrainName,
    Supports,
)
from shellbench.solvers.ndf.field_solver import FieldSolver

if TYPE_CHECKING:
    from shellbench.solvers.ndf.motion_solution import MotionSolution
    from shellbench.solvers.ndf.solution import NdfSolution, PathSolution


class RitzSettings(SeededSettings):
    """Settings of `ndf-ritz`; what is None follows from the case.

    Attributes
    ----------
    activation
        "sine", "tanh" or "gelu"; "relu" has no curvature, and is refused.
    """

    neurons: int | None = PydanticField(None, ge=1, le=4000, description="width of the random layer")
    most_neurons: int = PydanticField(900, ge=1, le=4000, description="width up to which it refines; linear statics")
    activation: str = "sine"
    scale: Positive | None = PydanticField(None, description="standard deviation of the weights of plain inputs")
    stretched_scale: Positive | None = PydanticField(None, description="the same of stretched inputs")
    layer: Positive = PydanticField(LAYER, description="length of stretched inputs, in sqrt(h R)")
    degrees: tuple[Annotated[int, PydanticField(ge=1, le=60)], ...] | None = PydanticField(
        None,
        description="of motions: degrees of the fields along the longest side, tried in turn; not with neurons",
    )
    hidden: Literal["drawn", "placed"] = PydanticField(
        "drawn",
        description="of motions: hidden weights drawn at random, or placed on a lattice that leaves no gaps;"
        " on planes whose edges are free or held as products",
    )
    grow: bool = PydanticField(
        False, description="of products: begin with few, and add more on the way as the motion asks for them"
    )
    singular: int = PydanticField(MULTIPLIERS, ge=0, le=6, description="singular features a point force; 0 for none")
    stretched: bool = PydanticField(True, description="whether inputs are stretched toward point forces and edges")
    periodic_input: PeriodicInput = PydanticField("both", description='"both", "cosine" or "none" (a slit shell)')
    components: Components = PydanticField("cartesian", description="what the output layer gives")
    supports: Supports = PydanticField("hard", description="held by boundary factors, or about by springs, linear only")
    penalty: float | None = PydanticField(
        None, ge=1e-6, le=1e12, description="of soft supports: stiffness in D / sqrt(area); 1e4 if not given"
    )
    panels: tuple[int, int] | None = PydanticField(None, description="panels of the training quadrature")
    order: int | None = PydanticField(None, ge=1, le=20, description="Gauss points along a panel")
    largest_gap: Positive = PydanticField(LARGEST_GAP, description="largest admissible quadrature gap")
    strain: StrainName | None = PydanticField(None, description="strain measure; exact in the non-linear theory")


class RitzSolver(FieldSolver):
    """Random features with a solved output layer; see `shellbench.problem.Solver`."""

    name: ClassVar[str] = "ndf-ritz"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=("kirchhoff-love-linear", "kirchhoff-love-nonlinear"),
        label="neural field: fixed random sine layer, output layer solved for (Ritz); trains nothing",
        devices=("cpu", "cuda"),
    )
    settings_type: ClassVar[type[RitzSettings]] = RitzSettings
    uses_start: ClassVar[bool] = True
    takes: ClassVar[frozenset[Beyond]] = frozenset(
        {
            "varying stiffness",
            "bending Poisson's ratio",
            "foundation",
            "loaded parts",
            "local loads",
            "kinks",
            "modes",
            "contact",
            "resultants",
            "narrow formulas",
        }
    )

    def declines(self, case: Case) -> str | None:
        """Return why the usual field can't hold this case, as one clause, or None if it can."""
        return self.declines_with(case, RitzSettings())

    def load(self, path: Path) -> NdfSolution | PathSolution | MotionSolution:
        """Read a solution of this recipe; InputError in one sentence if it is none."""
        from shellbench.solvers.ndf.motion_solution import load_solution

        return load_solution(path, self.name)

    def declines_with(self, case: Case, settings: RitzSettings) -> str | None:
        """Return why the field that settings ask for can't hold this case, as one clause, or None if it can."""
        from shellbench.solvers.ndf.declines import why_declined
        from shellbench.solvers.ndf.modes import why_no_modes
        from shellbench.solvers.ndf.ritz import field_spec

        spec = field_spec(case, settings)
        if case.modal and (reason := why_no_modes(case, spec)):
            return reason
        return why_not_plain(case, self.takes) or why_declined(case, spec)

    def answer(
        self, case: Case, settings: RitzSettings, start: Solution | Path | None, progress: ProgressCallback
    ) -> NdfSolution | PathSolution | MotionSolution:
        """Solve a case; with `start`, an earlier path of this recipe (or its file), go on from its states.

        Raises
        ------
        SolveFailure
            If the energies on the two quadratures disagree by more than the largest admissible gap, or the path of a
            non-linear case ends early.
        InputError
            If the case can't be solved with these settings.
        """
        from shellbench.solvers.ndf import ritz

        return ritz.solve(case, settings, start, progress)
