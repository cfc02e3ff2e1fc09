"""The solvers `grid`, `grid-adaptive`, `grid-printed` and `mlp`: fields over the unit square, solved for or trained.

    Shu et al., "Spatially Adaptive Cloth Regression with Implicit Neural Representations"

`grid` is solved for: a grid without layers is linear in its coefficients. `grid-adaptive` weighs losses by the density
of the paper's samples. `grid-printed` is the paper's grid with its four layers, and half of the samples where losses
are large; `mlp` is the paper's comparison. Both are trained.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from shellbench.errors import InputError
from shellbench.problem import Capabilities, ProgressCallback, SeededSettings
from shellbench.problems.field.case import FieldCase
from shellbench.problems.field.solution import FieldSolution
from shellbench.problems.field.solving import FieldSolver, measured, told_by_levels
from shellbench.protocol.schema import Finite

Share = Annotated[Finite, Field(ge=0, le=1)]
SamplerName = Literal["uniform", "stratified", "adaptive"]
Meshed = SamplerName | Literal["mesh"]
DEGREES = {"bilinear": 1, "cubic": 3}
VERTICES = 127  # cells of a grid that has as many coefficients as the paper's mesh has free variables
MATCHING, MINIMISING, FOLDING = 64, 16, 48  # cells along a side
FEWEST = 12  # of the grids that a sheet folds on first
HIDDEN = 3  # layers beside the last
SPENT = {"epochs": 200, "samples": 64}  # by trainings if the case states no limits
FEWEST_NODES = 4  # of a mesh along a side
LOOKS = 10  # at the figures of a training


class SampledSettings(SeededSettings):
    """Settings of all solvers here: where losses are sampled."""

    sampler: SamplerName = Field("uniform", description="points by chance, one in each cell, or where losses are large")
    weighted: bool = Field(True, description="whether adaptive samples are weighed by their area; the paper's are not")
    adaptive_share: Share = Field(0.5, description="of samples that follow the density, mu of algorithm 1")
    density_cells: int = Field(32, ge=1, le=500, strict=True, description="of the density along a side")


class GridSettings(SampledSettings):
    """Settings of `GridSolver`."""

    basis: Literal["bilinear", "cubic"] = Field("cubic", description="splines of the grid")
    resolution: int | None = Field(
        None,
        ge=2,
        le=400,
        strict=True,
        description="cells a side, and half as many; None: 64 to match, 16 to minimise, 48 (and 36) to meet a body",
    )
    symmetric: bool = Field(True, description="whether a question that is symmetric about a body gets such an answer")
    points: int | None = Field(
        None, ge=1, le=12, strict=True, description="Gauss points of a cell along a side, to minimise; None: degree's"
    )


class TrainedSettings(SampledSettings):
    """Settings of solvers that train."""

    epochs: int | None = Field(None, ge=1, le=1_000_000, strict=True, description="None: what the case says, or 200")
    samples: int | None = Field(
        None, ge=1, le=1000, strict=True, description="None: what the case says, or 64, squared"
    )
    learning_rate: Finite = Field(1e-2, gt=0, le=1, description="of Adam; table 4 has 5e-4")
    activation: Literal["relu", "sine"] = Field("relu", description="of layers; the paper does not say")
    kept_density: Share = Field(0.9, description="part of a density that an epoch keeps, gamma of eq. (7)")
    lloyd: int = Field(
        0, ge=0, le=1000, strict=True, description="steps of Lloyd's relaxation; the paper gives no number"
    )
    every: int | None = Field(None, ge=1, strict=True, description="epochs between two looks; None: 10 looks in all")
    settled: Finite | None = Field(
        None,
        gt=0,
        lt=1,
        description="change of the energy in 200 epochs, relative to it, at which it ends; None: never",
    )
    precision: Literal["float32", "float64"] = Field("float64", description="of weights")


class PrintedSettings(TrainedSettings):
    """Settings of `PrintedGridSolver`: the choices that the paper makes, where it says them."""

    sampler: Meshed | None = Field(  # type: ignore[assignment]
        None,
        description="as of others, or the triangles of a mesh with so many samples as nodes; None: one in each cell to"
        " match a function, adaptive to minimise",
    )
    weighted: bool = Field(False, description="whether adaptive samples are weighed by their area; the paper's are not")
    basis: Literal["bilinear", "cubic"] = Field("bilinear", description="splines of the grid")
    levels: int = Field(
        2, ge=1, le=8, strict=True, description="of the grid; each has half the cells of the one before"
    )
    resolution: int = Field(100, ge=2, le=400, strict=True, description="cells along a side of the finest level")
    features: int = Field(3, ge=1, le=32, strict=True, description="of each level")
    width: int = Field(64, ge=0, le=1024, strict=True, description="of the layers; 0: none, and levels are added")


class MlpSettings(TrainedSettings):
    """Settings of `MlpSolver`."""

    encoding: Literal["plain", "positional"] = Field("plain", description="of the point")
    learning_rate: Finite = Field(1e-3, gt=0, le=1, description="of Adam; table 4 has 5e-4")
    sampler: SamplerName = Field(
        "stratified", description="points by chance, one in each cell, or where losses are large"
    )


class OfFields(FieldSolver):
    """A solver whose answer is a field."""

    def load(self, path: Path) -> FieldSolution:
        """Read the file of a field; InputError in one sentence if it is no such file."""
        from shellbench.solvers.field.field import LayeredField

        return LayeredField.load(path)


class GridSolver(OfFields):
    """A grid of splines that is solved for."""

    name: ClassVar[str] = "grid"
    capabilities: ClassVar[Capabilities] = Capabilities(
        ("fit", "local-structures"), "grid of cubic B-splines, solved for"
    )
    settings_type: ClassVar[type[GridSettings]] = GridSettings

    def refuses(self, case: FieldCase) -> str | None:
        """Return the reason that it declines a case, or None: it takes no case that asks for a network with layers."""
        if case.network in (None, "vertices"):
            return None
        return f"its field has no layers, and the case asks for the network '{case.network}'"

    def answer(self, case: FieldCase, settings: GridSettings, progress: ProgressCallback) -> FieldSolution:
        """Solve on two grids, of which the finer one answers."""
        from shellbench.solvers.field.direct import SampleWeights, fit_grid, minimise
        from shellbench.solvers.field.field import LayeredField

        degree = DEGREES[settings.basis]
        cells = settings.resolution or (MATCHING if case.match else FOLDING if case.body else MINIMISING)
        if settings.sampler == "stratified":
            raise InputError(f"{case.name}: what is solved for has even samples (uniform), or adaptive ones")
        if case.network == "vertices":
            degree, cells = 1, VERTICES
        share = settings.adaptive_share if settings.sampler == "adaptive" else 0.0
        if share and case.disc:
            raise InputError(f"{case.name}: adaptive samples that are solved for need a square cloth")
        play = SampleWeights(share, settings.weighted, settings.density_cells)

        levels = [-(-cells * 3 // 4) if case.body else -(-cells // 2), cells]
        while case.body and levels[0] >= 2 * FEWEST:  # a sheet folds on few cells, and each grid starts from a coarser
            levels.insert(0, levels[0] // 2)
        solved = list[LayeredField]()
        for count in levels:
            if case.match:
                solved.append(fit_grid(case, count, degree))
            else:
                start = solved[-1] if case.body and solved else None
                solved.append(minimise(case, count, degree, play, progress, start, settings.symmetric, settings.points))
        coarse, fine = solved[-2:]
        uncertainty = told_by_levels([measured(case, coarse), measured(case, fine)])
        return replace(fine, uncertainty=uncertainty | own_uncertainties(case, fine))


class AdaptiveSettings(GridSettings):
    """Settings of `AdaptiveGridSolver`."""

    sampler: SamplerName = Field(
        "adaptive", description="points by chance, one in each cell, or where losses are large"
    )
    weighted: bool = Field(False, description="whether adaptive samples are weighed by their area; the paper's are not")


class AdaptiveGridSolver(GridSolver):
    """The same grid on the mean of all draws of the paper's samples, at the equilibrium of both players."""

    name: ClassVar[str] = "grid-adaptive"
    capabilities: ClassVar[Capabilities] = Capabilities(
        ("local-structures",), "the same grid on half adaptive samples, unweighted, as published"
    )
    settings_type: ClassVar[type[GridSettings]] = AdaptiveSettings


def own_uncertainties(case: FieldCase, found: FieldSolution) -> dict[str, float]:
    """Return uncertainties that need no second level: 0 of parameters; of an RMS error, its value on another grid."""
    known = {q.name: 0.0 for q in case.quantities if q.kind == "parameters"}
    for quantity in case.quantities:
        if quantity.kind == "rms_error":
            known[quantity.name] = quantity.model_copy(update={"lattice": quantity.lattice - 1}).measure(found)
    return known


class PrintedGridSolver(OfFields):
    """The paper's multi-resolution grid with layers, trained by Adam on samples where losses are large."""

    name: ClassVar[str] = "grid-printed"
    capabilities: ClassVar[Capabilities] = Capabilities(
        ("fit", "local-structures"), "multi-resolution grid with layers, as published", devices=("cpu", "cuda")
    )
    settings_type: ClassVar[type[PrintedSettings]] = PrintedSettings

    def refuses(self, case: FieldCase) -> str | None:
        """Return the reason that it declines a case, or None if it takes it."""
        if case.network not in (None, "grid"):
            return f"the case asks for the network '{case.network}'"
        return why_not_trained(case)

    def answer(self, case: FieldCase, settings: PrintedSettings, progress: ProgressCallback) -> FieldSolution:
        """Train it."""
        cells = [settings.resolution // 2**level for level in range(settings.levels)]
        if min(cells) < 1:
            raise InputError(f"{case.name}: {settings.levels} levels are too many for {settings.resolution} cells")
        layers = HIDDEN + 1 if settings.width else 0
        if not layers and settings.features != len("xyz"):
            raise InputError(f"{case.name}: without layers a level has 3 features, not {settings.features}")
        form = {"cells": cells, "degree": DEGREES[settings.basis], "frequencies": 0, "layers": layers}
        return train_field(case, settings, form, settings.features, settings.width, progress)


class MlpSolver(OfFields):
    """A network of the point itself, or of its sines and cosines."""

    name: ClassVar[str] = "mlp"
    capabilities: ClassVar[Capabilities] = Capabilities(
        ("fit", "local-structures"), "network without a grid, as published", devices=("cpu", "cuda")
    )
    settings_type: ClassVar[type[MlpSettings]] = MlpSettings

    def refuses(self, case: FieldCase) -> str | None:
        """Return the reason that it declines a case, or None if it takes it."""
        if case.network in ("grid", "vertices"):
            return f"the case asks for the network '{case.network}'"
        return why_not_trained(case)

    def answer(self, case: FieldCase, settings: MlpSettings, progress: ProgressCallback) -> FieldSolution:
        """Train it: 152 neurons a layer, or 148 with the encoding (section 4.1)."""
        encodes = (case.network or settings.encoding) == "positional"
        form = {"cells": [], "degree": 1, "frequencies": 4 if encodes else 0, "layers": HIDDEN + 1}
        return train_field(case, settings, form, 0, 148 if encodes else 152, progress)


def why_not_trained(case: FieldCase) -> str | None:
    """Return the reason that a case can't be trained, or None: its pins must not move."""
    moved = [value for pin in case.pins for value in pin.displacement if value not in (0.0, "0")]
    return "what is trained can be pinned where it is only, and here pins move" if moved else None


def train_field(
    case: FieldCase, settings: TrainedSettings, form: dict[str, Any], features: int, width: int, tell: ProgressCallback
) -> FieldSolution:
    """Train a field of a form; see `shellbench.solvers.field.training`."""
    from shellbench.solvers.field.training import WINDOW, Choice, Sampler, train

    spent = SPENT | ({"epochs": case.training.epochs, "samples": case.training.samples} if case.training else {})
    epochs = settings.epochs or spent["epochs"]
    sampler = Sampler(
        settings.sampler or ("stratified" if case.match else "adaptive"),
        settings.weighted,
        settings.adaptive_share,
        settings.kept_density,
        settings.density_cells,
        settings.lloyd,
    )
    held = [edge for pin in case.pins for edge in pin.on]
    pinned = [list(point) for pin in case.pins for point in pin.at]
    form |= {"activation": settings.activation, "held": held} | ({"pinned": pinned} if pinned else {})
    form["confined"] = list(case.cloth.confined) if case.cloth else []
    choice = Choice(
        form,
        features,
        width,
        epochs,
        settings.samples or spent["samples"],
        settings.learning_rate,
        settings.seed,
        settings.device,
        settings.precision == "float64",
        sampler,
        settings.every or max(1, epochs // LOOKS),
        settings.settled,
        case.disc,
    )
    if (case.match or case.disc or choice.samples < FEWEST_NODES) and sampler.kind == "mesh":
        raise InputError(
            f"{case.name}: a mesh has losses of a square cloth, and {FEWEST_NODES} nodes along a side or more"
        )
    if settings.settled is not None and (case.match or WINDOW % choice.every):
        raise InputError(f"{case.name}: a cloth can settle, where {WINDOW} epochs are a multiple of 'every'")
    return train(case, choice, tell)
