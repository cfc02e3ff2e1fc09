"""Skinning: find a cape's mesh from a few bones in it, frame by frame, for frames that were held out.

The interface is that of Jin et al., section 7: bones are points of the mesh, in chains from the neck down, and all data
are in the frame of the neck, which removes the rigid motion of the body. A solver gets the meshes of the training
frames. Of held-out frames it gets the bones and the body's motion only. With a table `[ropes]`, the bones of these
frames are not vertices of the simulated mesh but nodes of rope chains (section 9). Then no mesh is the true one:
quantities tell what is in the body, how long edges are, how far the mesh is from its bones, and how it jitters.
"""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from shellbench.problem import Problem
from shellbench.problems.skinning.body import Capsule
from shellbench.problems.skinning.cape import WHOLE, Cape
from shellbench.problems.skinning.quantities import Jitter, SkinningQuantity
from shellbench.protocol.schema import Finite, Model

Numbers = NDArray[np.int64]
RIGID = 330.0  # degrees: a cape that is open by less would cross itself


class Bones(Model):
    """The bones: vertices of the mesh, evenly spread, in chains from the neck down."""

    chains: int = Field(10, ge=2, strict=True, description="number of chains, from side to side")
    nodes: int = Field(13, ge=2, strict=True, description="bones of each chain, from the neck to the hem")

    def on(self, cape: Cape) -> tuple[Numbers, Numbers]:
        """Return rows and columns of the mesh on which they are."""
        rows = np.linspace(0, cape.rows - 1, self.nodes).round().astype(int)
        columns = np.linspace(0, cape.columns - 1 + cape.closed, self.chains + cape.closed).round().astype(int)
        return rows, columns[: self.chains]


class Ropes(Model):
    """Rope chains in place of the mesh's bones: weak springs between them, and dampers along them."""

    lateral: Annotated[Finite, Field(ge=0)] = Field(description="stiffness of springs to the next chain, N/m")
    damping: Annotated[Finite, Field(ge=0)] = Field(description="force over velocity relative to the node before, kg/s")
    steps_per_second: Finite = Field(240.0, ge=60, le=1e5, description="of the ropes")


class ByClips(Model):
    """Whole clips are held out: their motion is not in the training frames."""

    by: Literal["clips"]
    held_out: Annotated[tuple[Annotated[int, Field(ge=0, strict=True)], ...], Field(min_length=1)] = Field(
        description="numbers of the clips that are held out, from 0"
    )


class ByFrames(Model):
    """Frames of all clips are held out at random. Most have a training frame 1/60 s away, so that data leak."""

    by: Literal["frames"]
    share: Annotated[Finite, Field(gt=0, lt=1)] = Field(description="share of the frames that are held out")
    seed: int = Field(0, ge=0, le=2**31 - 1, strict=True, description="of the draw")


class SkinningCase(Problem):
    """A cape whose mesh is to be found from bones.

    Attributes
    ----------
    cape
        The cloth, its clips, and the seed of their motions.
    body
        The body under the cape.
    margin
        Least distance of the cloth from the body, m.
    bones
        Vertices that are given in each frame.
    split
        Choice of the held-out frames.
    ropes
        Chains that are the bones of held-out clips.
    quantities
        Quantities asked of every answer; exactly one is primary.
    """

    kind: Literal["skinning"]
    theory: Literal["skinning"]
    cape: Cape
    body: Annotated[tuple[Capsule, ...], Field(min_length=1)]
    margin: Annotated[Finite, Field(ge=0)] = 0.005
    bones: Bones
    split: Annotated[ByClips | ByFrames, Field(discriminator="by")]
    ropes: Ropes | None = None
    quantities: Annotated[tuple[SkinningQuantity, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _fits(self) -> Self:
        for name, bones, vertices in (
            ("nodes", self.bones.nodes, self.cape.rows),
            ("chains", self.bones.chains, self.cape.columns),
        ):
            if bones > vertices:
                raise ValueError(f"there are {bones} {name} of bones, but only {vertices} vertices to put them on")
        if RIGID < self.cape.around < WHOLE:
            raise ValueError(f"the cape is open by {WHOLE - self.cape.around:g} degrees: at least 30 must be, or none")
        moves = [q.name for q in self.quantities if isinstance(q, Jitter)]
        if not isinstance(self.split, ByClips) and (self.ropes or moves):
            raise ValueError(f"{'ropes move' if self.ropes else f'{moves[0]} is of'} whole clips: hold out by clips")
        if isinstance(self.split, ByClips):
            held = self.split.held_out
            if len(set(held)) != len(held):
                raise ValueError(f"a clip is held out twice: {', '.join(map(str, held))}")
            if max(held) >= self.cape.clips:
                raise ValueError(f"clip {max(held)} is held out, but there are only {self.cape.clips}, from 0")
            if len(held) == self.cape.clips:
                raise ValueError("all clips are held out, so that nothing is left to learn from")
        elif not 0 < self._drawn < self.cape.clips * self.cape.frames:
            raise ValueError(
                f"a share of {self.split.share:g} holds out {self._drawn} frames: some must be, and not all"
            )
        return self

    @property
    def _drawn(self) -> int:
        assert isinstance(self.split, ByFrames)
        return round(self.split.share * self.cape.clips * self.cape.frames)

    @cached_property
    def held_out(self) -> Numbers:
        """Increasing numbers of the held-out frames; the frames of all clips are counted one after another."""
        each, total = self.cape.frames, self.cape.clips * self.cape.frames
        if isinstance(self.split, ByClips):
            return np.concatenate([np.arange(each * clip, each * (clip + 1)) for clip in sorted(self.split.held_out)])
        return np.sort(np.random.default_rng(self.split.seed).permutation(total)[: self._drawn])

    @cached_property
    def seen(self) -> Numbers:
        """Increasing numbers of the training frames."""
        return np.setdiff1d(np.arange(self.cape.clips * self.cape.frames), self.held_out)

    @cached_property
    def groups(self) -> Numbers:
        """Group of each training frame in cross validation: its clip, or one of five parts."""
        if isinstance(self.split, ByClips):
            return self.seen // self.cape.frames
        return np.asarray(np.random.default_rng([self.split.seed, 1]).integers(0, 5, len(self.seen)))

    @property
    def held_clips(self) -> tuple[int, ...]:
        """Increasing numbers of the clips that are held out."""
        assert isinstance(self.split, ByClips)
        return tuple(sorted(self.split.held_out))

    @cached_property
    def grid(self) -> tuple[Numbers, Numbers]:
        """Rows and columns of the mesh on which the bones are."""
        return self.bones.on(self.cape)
