"""From a case and a few choices to the parts of a field: what a file of weights needs beside its tensors."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator
from pydantic import Field as PydanticField

from shellbench.model import Model, Positive
from shellbench.problems.shell.case import Case
from shellbench.solvers.ndf.choices import LAYER, MULTIPLIERS, Components, PeriodicInput, StrainName, Supports
from shellbench.solvers.ndf.factors import BoundaryFactors, Lift
from shellbench.solvers.ndf.field import Ansatz, Features
from shellbench.solvers.ndf.inputs import Inputs, mirrored_axes
from shellbench.solvers.ndf.jets import Array, Placement
from shellbench.solvers.ndf.lengths import edge_layers, foci
from shellbench.solvers.ndf.network import Network
from shellbench.solvers.ndf.singular import FixedFeatures
from shellbench.solvers.ndf.soft import NoFactors, NoLift
from shellbench.solvers.ndf.turning import TurnedFactors, Turning, turns


def _from_bool(value: Any) -> Any:
    """Return what a boolean said in files of earlier versions."""
    return {True: "both", False: "none"}[value] if isinstance(value, bool) else value


SavedPeriodicInput = Annotated[PeriodicInput, BeforeValidator(_from_bool)]


class FieldSpec(Model):
    """The choices that turn a case into a field.

    Attributes
    ----------
    activation
        Of the network.
    periodic_input
        How a periodic coordinate enters: as (cos, sin); as its cosine, so that the field is even about the seam; or
        plainly, so that it answers for a slit shell.
    components
        What the output layer gives: Cartesian components, or covariant ones.
    supports
        Whether boundary factors or springs hold the supports.
    stretched
        Whether stretched coordinates are added about points that carry a force.
    layer
        Their length l in units of sqrt(h R).
    edge_stretched
        Whether they are added toward the edges of a curved shell that carries no force at points.
    multipliers
        Functions that multiply r^2 log r^2 about each such point; 0 leaves the singular features out.
    t
        Load factor.
    strain
        Strain measure.
    """

    activation: str = "sine"
    periodic_input: SavedPeriodicInput = "both"
    components: Components = "cartesian"
    supports: Supports = "hard"
    stretched: bool = True
    layer: Positive = LAYER
    edge_stretched: bool = False
    multipliers: int = PydanticField(MULTIPLIERS, ge=0, le=6)
    t: float = 1.0
    strain: StrainName = "linear"


def build_inputs(case: Case, spec: FieldSpec) -> Inputs:
    """Return the input coordinates."""
    around = foci(case, spec.layer)
    edges = edge_layers(case) if spec.edge_stretched and not around else None
    return Inputs.from_case(case, spec.periodic_input, around if spec.stretched else (), edges)


def build_features(case: Case, spec: FieldSpec, network: Network, placement: Placement, inputs: Inputs) -> Features:
    """Return the features of which the field is a linear combination."""
    mirrored = mirrored_axes(case.surface.domain, spec.periodic_input)
    fixed = FixedFeatures.from_case(case, foci(case, spec.layer), spec.multipliers, mirrored)
    return Features(inputs, network, fixed, placement)


def build_ansatz(case: Case, spec: FieldSpec) -> Ansatz:
    """Return the way the case's supports are built in."""
    if spec.supports == "soft":
        return Ansatz(case, NoFactors(case, spec.components == "covariant"), NoLift(), spec.t, soft=True)
    factors = BoundaryFactors(case, spec.components == "covariant")
    if turns(case):
        turning = Turning(case, spec.t)
        return Ansatz(case, TurnedFactors(factors, turning), turning, spec.t)
    return Ansatz(case, factors, Lift(case, spec.t), spec.t)


def focal_points(case: Case) -> Array:
    """Return the points (k, 2) toward which quadrature is graded."""
    return np.array([focus.xi for focus in foci(case)]).reshape(-1, 2)


def graded_points(case: Case, spec: FieldSpec) -> Array:
    """Return the points (k, 2) toward which the quadrature of a field is graded: forces, or else stretched edges.

    A coordinate toward which nothing is graded is NaN.
    """
    focal, domain = focal_points(case), case.surface.domain
    if len(focal) or not spec.edge_stretched or edge_layers(case) is None:
        return focal
    return np.where(domain.periodic, np.nan, np.array([domain.lower, domain.upper]))
