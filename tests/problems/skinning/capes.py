"""Small capes, simulated in milliseconds."""

from typing import Any

from shellbench.problems.skinning.case import SkinningCase

SMALL: dict[str, Any] = {
    "kind": "skinning",
    "title": "A small cape",
    "theory": "skinning",
    "cape": {"rows": 8, "columns": 6, "clips": 2, "frames": 10, "iterations": 4, "settling": 5},
    "body": [
        {"name": "trunk", "start": [0.0, 0.0, -0.1], "end": [0.0, 0.0, -0.5], "radius": 0.14},
        {"name": "legs", "start": [0.0, 0.0, -0.5], "end": [0.0, 0.0, -1.3], "radius": 0.35, "swings": True},
    ],
    "bones": {"chains": 3, "nodes": 4},
    "split": {"by": "clips", "held_out": [1]},
    "quantities": [
        {"name": "error", "kind": "error", "primary": True},
        {"name": "worst_frame", "kind": "worst_error"},
        {"name": "fitted_error", "kind": "fitted_error"},
        {"name": "inside", "kind": "penetration_share"},
        {"name": "depth", "kind": "penetration_depth"},
        {"name": "deepest", "kind": "deepest"},
    ],
}


def small(**changes: Any) -> SkinningCase:
    """Return a small cape with tables changed: fields of a table that is given join those that it has."""
    data = {
        name: {**value, **changes.pop(name, {})} if isinstance(value, dict) and name != "split" else value
        for name, value in SMALL.items()
    }
    return SkinningCase.build(data | changes, "small", "small.toml")
