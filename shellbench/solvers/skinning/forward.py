"""Evaluation of trained networks at frames, in NumPy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.skinning.case import SkinningCase
from shellbench.problems.skinning.data import Clips
from shellbench.solvers.skinning.driven import bone_grid
from shellbench.solvers.skinning.linear import bones, from_modes
from shellbench.solvers.skinning.solution import Arrays, Skin
from shellbench.solvers.skinning.units import bones_used, part, unit_values

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]
Given = Callable[[SkinningCase, Clips, Numbers], Array]
"""Input of a network for numbered frames, (n, m)."""
SHAPE = "shape_"  # prefix of the arrays of a shape network


def pose(case: SkinningCase, clips: Clips, frames: Numbers) -> Array:
    """Return the body's pose, (n, 3): the direction of gravity and the stride, without any history."""
    found = clips.motion.pose
    return found.reshape(-1, found.shape[-1])[frames]


def dense_skin(given: Given) -> Skin:
    """Return the function by which a perceptron computes displacements from its input."""

    def skin(arrays: Arrays, case: SkinningCase, clips: Clips, frames: Numbers) -> Array:
        return dense(arrays, given(case, clips, frames))

    return skin


def dense(arrays: Arrays, given: Array) -> Array:
    """Return the displacements (n, 3 v), m, of a perceptron from its input (n, m)."""
    found = (given - arrays["input_mean"]) / arrays["input_spread"]
    layers = sum(name.startswith("weight_") for name in arrays)
    for layer in range(layers):
        found = found @ arrays[f"weight_{layer}"] + arrays[f"bias_{layer}"]
        found = np.maximum(found, 0.0) if layer < layers - 1 else found
    return from_modes(arrays, arrays["scale"] * found)


bone_skin, pose_skin = dense_skin(bones), dense_skin(pose)


def shape_skin(arrays: Arrays, case: SkinningCase, clips: Clips, frames: Numbers) -> Array:
    """Return displacements of a skinning network, and those that a shape network adds (section 8)."""
    return bone_skin(arrays, case, clips, frames) + bone_skin(part(arrays, SHAPE), case, clips, frames)


def recurrent_skin(arrays: Arrays, case: SkinningCase, clips: Clips, frames: Numbers) -> Array:
    """Return displacements by the modes of a gated recurrent unit."""
    return from_modes(arrays, unit_values(arrays, clips)[frames])


def chains_skin(arrays: Arrays, case: SkinningCase, clips: Clips, frames: Numbers) -> Array:
    """Return displacements of a skinning network from bones that recurrent units infer, one a chain."""
    moved = bones_used(arrays, case, clips, frames) - bone_grid(case, clips.rest[None])
    return dense(arrays, moved.reshape(len(frames), -1))
