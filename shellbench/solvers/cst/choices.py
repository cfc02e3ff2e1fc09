"""Choices that a solve is made by, as settings name them."""

from __future__ import annotations

from typing import Literal

Diagonal = Literal["right", "left", "alternating"]
