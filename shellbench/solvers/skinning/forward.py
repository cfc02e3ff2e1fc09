"""Evaluation of trained networks at frames, in NumPy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.skinning.case import SkinningCase
from shellbench.problems.skinning.data import Clips
from shellbench.solvers.skinning.linear import bones, from_modes
from shellbench.solvers.skinning.solution import Arrays, Skin

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]
Given = Callable[[SkinningCase, Clips, Numbers], Array]
"""Input of a network for numbered frames, (n, m)."""


def pose(case: SkinningCase, clips: Clips, frames: Numbers) -> Array:
    """Return the body's pose, (n, 3): the direction of gravity and the stride, without any history."""
    found = clips.motion.pose
    return found.reshape(-1, found.shape[-1])[frames]


def course(clips: Clips) -> Array:
    """Return the body's poses and velocities, (k, n, 9)."""
    return clips.motion.course


def dense_skin(given: Given) -> Skin:
    """Return the function by which a perceptron computes displacements from its input."""

    def skin(arrays: Arrays, case: SkinningCase, clips: Clips, frames: Numbers) -> Array:
        found = (given(case, clips, frames) - arrays["input_mean"]) / arrays["input_spread"]
        layers = sum(name.startswith("weight_") for name in arrays)
        for layer in range(layers):
            found = found @ arrays[f"weight_{layer}"] + arrays[f"bias_{layer}"]
            found = np.maximum(found, 0.0) if layer < layers - 1 else found
        return from_modes(arrays, arrays["scale"] * found)

    return skin


bone_skin, pose_skin = dense_skin(bones), dense_skin(pose)


def recurrent_skin(arrays: Arrays, case: SkinningCase, clips: Clips, frames: Numbers) -> Array:
    """Return displacements of a gated recurrent unit, clip by clip from rest (torch's form of the gates)."""
    given = (course(clips) - arrays["input_mean"]) / arrays["input_spread"]
    into = given @ arrays["weight_ih_l0"].T + arrays["bias_ih_l0"]
    hidden = np.zeros((len(given), arrays["weight_hh_l0"].shape[1]))
    states = np.empty((*given.shape[:2], hidden.shape[1]))
    for step in range(given.shape[1]):
        reset, update, new = np.split(into[:, step], 3, axis=1)
        back = hidden @ arrays["weight_hh_l0"].T + arrays["bias_hh_l0"]
        reset_back, update_back, new_back = np.split(back, 3, axis=1)
        kept = sigmoid(update + update_back)
        hidden = kept * hidden + (1 - kept) * np.tanh(new + sigmoid(reset + reset_back) * new_back)
        states[:, step] = hidden
    found = states.reshape(-1, hidden.shape[1])[frames] @ arrays["out"] + arrays["out_bias"]
    return from_modes(arrays, arrays["scale"] * found)


def sigmoid(values: Array) -> Array:
    """Return 1/(1 + exp(-x))."""
    return np.asarray(0.5 + 0.5 * np.tanh(0.5 * values))
