"""Hook of the site: pages of the cases are in the contents if they were built (`docs/cases.py`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

SECTION, ENTRY = "Trust", {"The cases": "cases/index.md"}


def on_config(config: Any) -> Any:
    """Add the pages of the cases to the contents."""
    if (Path(config["docs_dir"]) / ENTRY["The cases"]).is_file():
        next(section[SECTION] for section in config["nav"] if SECTION in section).append(ENTRY)
    return config
