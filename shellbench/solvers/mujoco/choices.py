"""Choices that a motion is followed by, as settings name them."""

from __future__ import annotations

from typing import Literal

Integrator = Literal["Euler", "discrete", "RK4"]
