"""Ropes whose links stay taut and in the plane (x, z), so that angles describe the motion."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import SolveFailure
from shellbench.problems.rope.case import RopeCase
from shellbench.problems.rope.solving import start_of

Array = NDArray[np.float64]
SHORT = 1e-9  # of a length: a link that is shorter by more is slack
PUSHED = 1e-9  # of the weight: a push that is no larger is rounding


def why_not_planar(case: Any) -> str | None:
    """Return the reason that angles of the links can't describe the motion, as one clause, or None if they can."""
    if not isinstance(case, RopeCase) or case.rope is None:
        return "it solves ropes in motion only"
    if case.obstacles:
        return "it knows no obstacles"
    if case.rope.count > 1:
        return "it solves one chain only"
    places, velocities = start_of(case)
    wind = case.wind.velocity[1] if case.wind else 0.0
    if case.rope.root[1] != 0 or wind != 0 or places[:, 1].any() or velocities[:, 1].any():
        return "it solves motions in the plane (x, z) only"
    lengths, arms, apart = np.array(case.rope.link_lengths), np.diff(places, axis=0), np.diff(velocities, axis=0)
    if np.any(np.linalg.norm(arms, axis=1) < lengths * (1 - SHORT)):
        return "a link is slack at the start"
    if np.any(np.abs(np.sum(arms * apart, axis=1)) > SHORT * lengths * np.abs(apart).max(initial=0.0)):
        return "velocities at the start change the length of a link"
    return None


def start_angles(case: RopeCase) -> tuple[Array, Array]:
    """Return each link's angle at the start, from straight down toward x, rad, and its rate, rad/s, (n,)."""
    arms, apart = (np.diff(each, axis=0)[:, ::2] for each in start_of(case))
    rates = (arms[:, 0] * apart[:, 1] - arms[:, 1] * apart[:, 0]) / np.sum(arms**2, axis=1)
    return np.arctan2(arms[:, 0], -arms[:, 1]), rates


def pulling(case: RopeCase, at: float, tensions: Array, before: list[Any]) -> Array:
    """Return tensions without rounding below zero; SolveFailure, with the states before, if a link would push."""
    weight = float(case.masses.sum()) * case.gravity
    if tensions.min() < -PUSHED * max(weight, float(tensions.max())):
        raise SolveFailure(f"a link lets go before t = {at:g}", before)
    return np.maximum(tensions, 0.0)
