"""Settings of the solvers of capes."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from shellbench.problem import SeededSettings, Settings
from shellbench.protocol.schema import Finite, Positive

MODES = 100  # as in the paper: "about 100"
Count = Annotated[int, Field(ge=1, strict=True)]


class ModeSettings(Settings):
    """Settings of solvers with PCA modes."""

    modes: Count = Field(MODES, description="PCA modes, at most")


class FloorSettings(ModeSettings):
    """Settings of `skin-floor`."""

    of: Literal["seen", "held out"] = Field("seen", description="frames whose PCA modes are taken")


class BlendSettings(Settings):
    """Settings of `skin-blend`."""

    near: Count = Field(8, description="nearest bones that a vertex may follow")


class RidgeSettings(ModeSettings):
    """Settings of `skin-ridge`."""

    penalty: Positive | None = Field(
        None, description="over the mean variance of a bone's coordinate; chosen by cross validation if left out"
    )


class TrainingSettings(SeededSettings):
    """Settings of solvers that train."""

    modes: Count = Field(MODES, description="PCA modes, at most")
    epochs: Count = Field(40, description="passes over the frames that are seen; the paper says nothing")


class NetworkSettings(TrainingSettings):
    """Settings of perceptrons; learning rate, widths and weights are the paper's."""

    widths: Annotated[tuple[Count, ...], Field(min_length=1)] = Field((500, 500), description="of the hidden layers")
    learning_rate: Positive = Field(1e-4, description="of Adam at the start; a cosine leads it to 0")
    batch: Count = Field(16, description="frames of a step; the paper says nothing")
    collision: bool = Field(True, strict=True, description="whether the loss counts vertices inside the body")
    data_weight: Positive = Field(0.1, description="of squared distances from the simulation")
    collision_weight: Positive = Field(1000.0, description="of squared pushes out of the body")
    expansion: Annotated[Finite, Field(ge=0)] = Field(0.0025, description="of the body in the loss, m; ours")


class ShapeSettings(NetworkSettings):
    """Settings of `skin-shape`: those of both networks, which differ in the learning rate."""

    shape_rate: Positive = Field(1e-5, description="learning rate of the second network at the start")


class QuasistaticSettings(NetworkSettings):
    """Settings of `skin-quasistatic`: no collision loss unless asked for."""

    collision: bool = Field(False, strict=True, description="whether the loss counts vertices inside the body")


class RecurrentSettings(TrainingSettings):
    """Settings of `skin-recurrent`; the paper gives none."""

    width: Count = Field(200, description="of the hidden state")
    learning_rate: Positive = Field(2e-3, description="of Adam at the start; a cosine leads it to 0")
    batch: Count = Field(2, description="clips of a step")


class ChainSettings(RecurrentSettings):
    """Settings of `skin-recurrent-chains`: the perceptron is that of `skin-network`, with the same seed."""

    width: Count = Field(100, description="of the hidden state of each unit")
    skin_epochs: Count = Field(40, description="epochs of the perceptron")
