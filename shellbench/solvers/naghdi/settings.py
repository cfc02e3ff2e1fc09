"""Settings of the solver `pinn-naghdi`, and the digest of a training."""

from __future__ import annotations

import hashlib
import json
from typing import Literal

from pydantic import Field

from shellbench.problem import SeededSettings
from shellbench.problems.shell.case import Case


class NaghdiSettings(SeededSettings):
    """Settings of `pinn-naghdi`; the defaults are the authors', `iterations`, `sampling` and `points` apart.

    The authors take up to 20,000 iterations on 65,536 points of a Sobol sequence. Gauss points integrate the energy of
    a smooth network as well with fewer (see docs/naghdi.md).
    """

    device: Literal["cpu"] = Field("cpu", description="where to run")
    iterations: int = Field(5000, ge=1, description="of L-BFGS")
    adam_iterations: int = Field(0, ge=0, description="of Adam, before L-BFGS")
    learning_rate: float = Field(1e-3, gt=0, description="of Adam")
    layers: int = Field(3, ge=1, le=20, description="hidden layers")
    width: int = Field(50, ge=1, le=1024, description="of each hidden layer")
    activation: Literal["gelu", "tanh", "sine"] = Field("gelu", description="of the hidden layers")
    sampling: Literal["gauss", "sobol"] = Field("gauss", description="points of the loss")
    points: int = Field(
        576,
        ge=16,
        le=2**18,
        description="of the loss, rounded down: Gauss points to a square, others to a power of two",
    )
    certify_every: int = Field(100, ge=1, description="iterations between two certified energies, and checkpoints")
    settle: float = Field(
        1e-5,
        ge=0,
        lt=1,
        description="relative gain of certified energy over five looks at it, below which training ends",
    )
    checkpoint: str | None = Field(
        None, description="folder for checkpoints: an interrupted training goes on from its own; None for none"
    )


def training_key(case: Case, settings: NaghdiSettings) -> str:
    """Return a digest of a training: of the case and of all settings that its course depends on."""
    facts = {"case": case.digest(), **settings.model_dump(mode="json", exclude={"checkpoint", "device", "iterations"})}
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()
