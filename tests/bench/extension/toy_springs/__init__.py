"""A package that brings all that a package can: a kind of problem, a solver, data, a section and a command."""

import os
from pathlib import Path

if place := os.environ.get("TOY_SPRINGS_IMPORTED"):  # who imports it is written down
    with Path(place).open("a", encoding="utf-8") as file:
        file.write(f"{os.getpid()}\n")
