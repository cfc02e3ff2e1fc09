"""Choices that a solve is made by, as settings name them."""

from __future__ import annotations

from typing import Literal

Method = Literal["auto", "dissection", "superlu", "pardiso"]
