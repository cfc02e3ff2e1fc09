"""Settings of `ndf-published` and of `ndf-material`, and the key of those that affect a training."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Literal

from pydantic import Field as PydanticField

from shellbench.problem import SeededSettings
from shellbench.problems.shell.case import Case
from shellbench.protocol.schema import Positive
from shellbench.solvers.ndf.field.choices import Components, PeriodicInput, Pins, StrainName

OMEGA0, LEARNING_RATE = 15.0, 1e-4  # the paper's values (Kairanda et al. 2023, section 5.2)
NDF_PUBLISHED = "ndf-published"  # of the solver, in records and files

NOT_OF_THE_TRAINING = {"device", "checkpoint", "checkpoint_every"}
OF_FIXED_LENGTH = "cosine"  # a schedule whose steps depend on the number of iterations


class PublishedSettings(SeededSettings):
    """Settings of `ndf-published`; the defaults are the paper's.

    Departures from the paper are settings of their own: `pins`, `unit`, `schedule`, `averaging`, `keep`,
    `resample_every`, `activation`, `dtype`, `optimiser` and `singular`.

    Attributes
    ----------
    learning_rate
        At its start: the step of Adam, or the share of a natural step.
    """

    iterations: int = PydanticField(2000, ge=1, description="of Adam; the paper has 2500 for the plate")
    layers: int = PydanticField(5, ge=1, le=20, description="hidden layers")
    width: int = PydanticField(512, ge=1, le=4096, description="of each hidden layer")
    omega0: Positive = PydanticField(OMEGA0, description="frequency of the sines")
    learning_rate: Positive = LEARNING_RATE
    cells: tuple[int, int] = PydanticField((20, 20), description="of the grid of samples, along xi1 and xi2")
    times: int = PydanticField(20, ge=1, le=1000, description="samples of time, one in each of so many intervals")
    modulus_factor: Positive | None = PydanticField(
        None, description="of Young's modulus in training, linear theory; None follows from the case"
    )
    periodic_input: PeriodicInput = PydanticField("both", description='"both", "cosine" or "none" (a slit shell)')
    pins: Pins = PydanticField(
        "points",
        description='of a shell that nothing holds: "points" as printed, "cells" wide enough for samples, "none"',
    )
    components: Components = PydanticField("cartesian", description="what the output layer gives")
    unit: Literal["modulus", "load"] = PydanticField(
        "modulus", description='of the output: 1 m at the scaled modulus, or "load", the deflection of a like plate'
    )
    schedule: Literal["constant", "cosine"] = PydanticField(
        "constant", description='of the learning rate: "cosine" falls to nothing at the last iteration'
    )
    averaging: float = PydanticField(
        0.0, ge=0.0, lt=1.0, description="share of the running average of weights that an iteration keeps; 0 for none"
    )
    keep: Literal["last", "best"] = PydanticField(
        "last", description='which weights are the answer: "best" are those of least certified energy'
    )
    singular: int = PydanticField(
        0, ge=0, le=6, description="singular features of the output layer a point force; as printed none"
    )
    optimiser: Literal["adam", "natural"] = PydanticField(
        "adam", description='"natural": Gauss-Newton in the energy norm over all weights of a narrow network, at rest'
    )
    resample_every: int = PydanticField(1, ge=1, description="iterations on the same samples")
    activation: Literal["sine", "tanh", "gelu"] = PydanticField(
        "sine", description="of the hidden layers; omega0 belongs to the sine"
    )
    certify_every: int = PydanticField(
        250, ge=0, description="iterations between two certified energies of the course; 0 for none"
    )
    strain: StrainName | None = PydanticField(
        None, description="strains of the loss; None is linear where nothing moves, and eq. (30) in motion"
    )
    dtype: Literal["float32", "float64"] = PydanticField("float32", description="precision of the training")
    checkpoint: str | None = PydanticField(
        None, description="folder for checkpoints: an interrupted training goes on from its own; None for none"
    )
    checkpoint_every: int = PydanticField(100, ge=1, description="iterations between two checkpoints, at least 25")


def training_key(case: Case, settings: PublishedSettings) -> str:
    """Return a digest of a training: of the case and of all settings that its course depends on."""
    free = NOT_OF_THE_TRAINING if settings.schedule == OF_FIXED_LENGTH else {*NOT_OF_THE_TRAINING, "iterations"}
    facts = {"case": case.digest(), **settings.model_dump(mode="json", exclude=free)}
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()


def checkpoint_path(case: Case, settings: PublishedSettings) -> Path | None:
    """Return the file of a training's checkpoints; None if it keeps none."""
    if settings.checkpoint is None:
        return None
    return Path(settings.checkpoint) / f"{case.name}-{training_key(case, settings)[:16]}.safetensors"


class ConditionedPublishedSettings(SeededSettings):
    """Settings of `ndf-material`; the defaults are the paper's."""

    iterations: int = PydanticField(2000, ge=1, description="of Adam, each at one random material")
    layers: int = PydanticField(5, ge=1, le=20, description="hidden layers")
    width: int = PydanticField(512, ge=1, le=4096, description="of each hidden layer")
    omega0: Positive = PydanticField(OMEGA0, description="frequency of the sines")
    learning_rate: Positive = PydanticField(LEARNING_RATE, description="of Adam")
    cells: tuple[int, int] = PydanticField((20, 20), description="of the grid of samples, along xi1 and xi2")
    dtype: Literal["float32", "float64"] = PydanticField("float32", description="precision of the training")
