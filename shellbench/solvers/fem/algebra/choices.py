"""Choices that settings name; nothing here needs more than their names."""

from __future__ import annotations

from typing import Literal

Method = Literal["auto", "dissection", "superlu", "pardiso"]
