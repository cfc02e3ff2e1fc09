"""Names of choices in settings."""

from __future__ import annotations

from typing import Literal

Method = Literal["auto", "dissection", "superlu", "pardiso"]
