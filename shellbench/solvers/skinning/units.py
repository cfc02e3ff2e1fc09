"""Gated recurrent units (Cho et al. 2014), evaluated in NumPy: one to modes, or one a chain to its bones.

Units read the body's motion, clip by clip from rest. Arrays of chain j have names that begin with `chain_j_`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.skinning.case import SkinningCase
from shellbench.problems.skinning.data import Clips
from shellbench.solvers.skinning.driven import bone_grid, bone_places

Array = NDArray[np.float64]
Arrays = Mapping[str, NDArray[Any]]
Numbers = NDArray[np.int64]


def part(arrays: Arrays, prefix: str) -> dict[str, NDArray[Any]]:
    """Return the arrays whose names begin with a prefix, by the rest of their names."""
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}


def chain(number: int) -> str:
    """Return the prefix of a chain's arrays."""
    return f"chain_{number}_"


def course(clips: Clips) -> Array:
    """Return the body's poses and velocities, (k, n, 9)."""
    return clips.motion.course


def unit_values(arrays: Arrays, clips: Clips) -> Array:
    """Return the output of a unit at all frames of all clips, (n, m) (torch's form of the gates)."""
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
    return np.asarray(arrays["scale"] * (states.reshape(-1, hidden.shape[1]) @ arrays["out"] + arrays["out_bias"]))


def sigmoid(values: Array) -> Array:
    """Return 1/(1 + exp(-x))."""
    return np.asarray(0.5 + 0.5 * np.tanh(0.5 * values))


def bones_used(arrays: Arrays, case: SkinningCase, clips: Clips, frames: Numbers) -> Array:
    """Return the places of the bones, (n, nodes, chains, 3), m, from which a solver makes numbered frames.

    They are what its units infer, or else the given ones.
    """
    if not part(arrays, chain(0)):
        return bone_places(case, clips, frames)
    shape = len(frames), case.bones.nodes, 3
    each = [unit_values(part(arrays, chain(j)), clips)[frames].reshape(shape) for j in range(case.bones.chains)]
    return np.asarray(bone_grid(case, clips.rest[None]) + np.stack(each, axis=2))
