"""Shells as a kind of problem: the data of their solutions for records, and their exports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module

import numpy as np
from numpy.typing import NDArray

from shellbench.problem import FIELDS, Kind
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.field import DisplacementField
from shellbench.problems.shell.mesh.template import case_of_mesh
from shellbench.problems.shell.records.portrait import ShellPortrait
from shellbench.problems.shell.records.sampling import (
    energies_of_states,
    frame_rate_study,
    kept_fields,
    precision_study,
    resolution_study,
)
from shellbench.problems.shell.records.self_intersection import self_intersection_study
from shellbench.problems.shell.records.series import series_of
from shellbench.problems.shell.variants.variants import TWINS, VARIANTS
from shellbench.protocol.history import (
    FrameRateStep,
    PrecisionStep,
    ResolutionStep,
    SelfIntersection,
    Series,
    StateEnergies,
)
from shellbench.protocol.sample import Sample
from shellbench.protocol.sheet import Request, Sheet

Values = Mapping[str, float]

STRAIN_COMPONENTS = ("11", "22", "12")
COMPONENTS = {
    "xi": ("xi1", "xi2"),
    "displacement": ("x", "y", "z"),
    "membrane_strain": STRAIN_COMPONENTS,
    "bending_strain": STRAIN_COMPONENTS,
}
HEADLINES = {
    "Hz": "Frequencies",
    "": "Load factors",
    "N": "Forces and moments",
    "N/m": "Forces and moments",
    "N m": "Forces and moments",
    "kN": "Forces and moments",
    "J": "Energies",
    "rad": "Angles",
}
"""Names of headline values that are no displacements, by unit."""
LIMITS = {
    "kirchhoff-love-linear": "thin limit",
    "kirchhoff-love-nonlinear": "thin limit at finite strain",
    "naghdi-linear": "shear-flexible limit",
    "naghdi": "shear-flexible limit with hard supports",
    "naghdi_soft": "shear-flexible limit with soft supports",
}
ENERGY_DENSITY = "strain_energy_density"
ENERGY_PARTS = ("membrane_energy_density", "bending_energy_density")


def energies(solution: DisplacementField, case: Case, values: Values) -> Sequence[StateEnergies]:
    """Return the energies of each kept state of a path."""
    return energies_of_states(solution, case)


def series(solution: DisplacementField, case: Case, values: Values) -> Sequence[Series]:
    """Return the quantities along the path or motion."""
    return series_of(solution, case)


def resolution(solution: DisplacementField, case: Case, values: Values) -> Sequence[ResolutionStep]:
    """Return the study of the field on sampling grids."""
    return resolution_study(solution, case)


def frame_rates(solution: DisplacementField, case: Case, values: Values) -> Sequence[FrameRateStep]:
    """Return the study of a motion at several frame rates."""
    return frame_rate_study(solution, case)


def precision(solution: DisplacementField, case: Case, values: Values) -> Sequence[PrecisionStep]:
    """Return the study of the solution's sensitivity to rounding."""
    return precision_study(solution, case, values)


def self_intersection(solution: DisplacementField, case: Case, values: Values) -> Sequence[SelfIntersection]:
    """Return the first state at which the surface passes through itself."""
    return self_intersection_study(solution, case)


def sample(solution: DisplacementField, points: int, at: float | None, title: str) -> Sample:
    """Sample a solution on a regular grid of so many points a side.

    Parameters
    ----------
    at
        Time, s, or mark of a kept state of a path; the last state if None.

    Raises
    ------
    InputError
        If the solution has no state there.
    """
    surface = solution.case.surface
    xi = surface.domain.grid(points, points)
    fields: dict[str, NDArray[np.float64]] = {name: np.asarray(solution.evaluate(name, xi, at=at)) for name in FIELDS}
    fields[ENERGY_DENSITY] = np.sum([fields[name] for name in ENERGY_PARTS], axis=0)
    return Sample(
        xi=xi,
        position=surface.position(xi),
        displacement=solution.displacement(xi, at=at),
        fields=fields,
        title=title,
        periodic=surface.domain.periodic,
        at=at,
        components=COMPONENTS,
        scalar=ENERGY_DENSITY,
    )


def sheet(case: Case, request: Request) -> Sheet:
    """Return the sheet of a case; see `shellbench.problems.shell.sheet.sheet`."""
    # The name is computed, because sheets measure nothing and must not be part of the digest of records.
    made: Sheet = import_module(f"{__package__}.sheet.sheet").sheet(case, request)
    return made


SHELL = Kind(
    problem=Case,
    keep=kept_fields,
    accounts={"energies": energies, "series": series, "resolution": resolution},
    studies={"frame_rates": frame_rates, "precision": precision, "self_intersection": self_intersection},
    portrait=ShellPortrait,
    headline="Displacements",
    headlines=HEADLINES,
    variants=VARIANTS,
    twins=TWINS,
    sample=sample,
    from_file=case_of_mesh,
    sheet=sheet,
    nodes="shellbench.problems.shell.deck.nodal_field:measure_nodes",
    limits=LIMITS,
    exam=("obstacle_course", "verification", "variants", "shapes", "nonlinear"),
    quick=("quick",),
)
