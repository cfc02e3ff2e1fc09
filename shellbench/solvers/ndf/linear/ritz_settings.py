"""Settings of `ndf-ritz`, and of `ndf-conditioned`, which builds on its field."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field as PydanticField

from shellbench.problem import SeededSettings
from shellbench.protocol.schema import Positive
from shellbench.solvers.ndf.field.choices import (
    LARGEST_GAP,
    LAYER,
    MULTIPLIERS,
    Components,
    PeriodicInput,
    StrainName,
    Supports,
)

NDF_RITZ = "ndf-ritz"  # of the solver, in records and files


class RitzSettings(SeededSettings):
    """Settings of `ndf-ritz`; a value of None follows from the case.

    Attributes
    ----------
    activation
        "sine", "tanh" or "gelu"; "relu" has no curvature, and is refused.
    """

    neurons: int | None = PydanticField(None, ge=1, le=4000, description="width of the random layer")
    most_neurons: int = PydanticField(900, ge=1, le=4000, description="width up to which it refines; linear statics")
    activation: str = "sine"
    scale: Positive | None = PydanticField(None, description="standard deviation of the weights of plain inputs")
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
    mirrors: bool | None = PydanticField(None, description="build planes of symmetry in; by default if width is free")
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


class ConditionedSettings(SeededSettings):
    """Settings of `ndf-conditioned`; a value of None follows from the case."""

    neurons: int | None = PydanticField(
        None, ge=1, le=4000, description="width of the random layer, without challengers"
    )
    snapshots: int = PydanticField(
        32, ge=3, le=63, description="materials at which the output layer is solved for, at most; at rest"
    )
    tolerance: Positive = PydanticField(
        1e-6, description="change of the asked displacement, by the last two fields, that ends it; at rest"
    )
    largest_gap: Positive = PydanticField(LARGEST_GAP, description="largest admissible quadrature gap")
