"""Settings of `ndf`."""

from __future__ import annotations

from typing import Literal

from pydantic import Field as PydanticField

from shellbench.problem import SeededSettings
from shellbench.protocol.schema import Positive
from shellbench.solvers.ndf.field.choices import LARGEST_GAP, Components, PeriodicInput, StrainName

NDF = "ndf"  # of the solver, in records and files

TRAINED_LAYER = (
    2.2  # l of stretched inputs in sqrt(h R): between 2 and 2.5 the certified energy of pinched cylinders is flat
)
TRAINED_MULTIPLIERS = 4  # singular features a point force; more of them gained less than a tenth of the remaining error
INNER = (8, 8)  # hidden layers before the last; wider ones gained nothing certified


class TrainerSettings(SeededSettings):
    """Settings of `ndf`; a value of None follows from the case.

    Attributes
    ----------
    activation
        "sine", "tanh" or "gelu"; "relu" has no curvature, and is refused.
    """

    inner: tuple[int, ...] = PydanticField(INNER, description="widths of the hidden layers before the last")
    widths: tuple[int, ...] | None = PydanticField(None, description="widths of the last hidden layer, tried in turn")
    most_neurons: int = PydanticField(
        900, ge=1, le=4000, description="width up to which it widens; at rest, without widths and iterations"
    )
    activation: str = "sine"
    start: Literal["fitted", "random"] = PydanticField(
        "fitted",
        description="hidden layers to start from: fitted to random features of one layer, or drawn as usual",
    )
    iterations: int | None = PydanticField(
        None,
        ge=0,
        le=100_000,
        description="at most; None for 3, for 2 on curved shells under forces at points, for 12 along paths",
    )
    tolerance: Positive = PydanticField(2e-6, description="certified relative gain below which training ends")
    gap: Positive = PydanticField(1e-5, description="gap of a training state beyond which more points are taken")
    damping: Positive = PydanticField(0.1, description="Marquardt's, at the start")
    layer: Positive = PydanticField(TRAINED_LAYER, description="length of stretched inputs, in sqrt(h R)")
    singular: int = PydanticField(
        TRAINED_MULTIPLIERS, ge=0, le=6, description="singular features a point force; 0 for none"
    )
    stretched: bool = PydanticField(True, description="whether inputs are stretched toward point forces")
    mirrors: bool | None = PydanticField(
        None, description="whether planes of symmetry are built in; None: on curved shells under forces at points"
    )
    periodic_input: PeriodicInput = PydanticField("both", description='"both", "cosine" or "none" (a slit shell)')
    components: Components = PydanticField("cartesian", description="what the output layer gives")
    largest_gap: Positive = PydanticField(LARGEST_GAP, description="largest admissible quadrature gap")
    strain: StrainName | None = PydanticField(None, description="strain measure; exact in the non-linear theory")
