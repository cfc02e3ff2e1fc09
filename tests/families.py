"""Cases that have something new: what is true of every case is shown by these, and by all of them in the long tests."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.problem import Problem


def features(case: Problem) -> set[str]:
    """Return what a case has: its surface, the kinds of its supports and loads, and what is beside them."""
    given = case.model_dump()
    surface = given.get("surface", {})
    found = {f"surface {surface.get('kind')} {surface.get('closed')} {surface.get('periodic')}"}
    for support in given.get("supports", ()):
        motion = (support.get("motion") or {}).get("kind")
        found |= {f"motion {motion}", f"clamped {support.get('clamped')}", f"held {support.get('components')}"}
        found |= {f"symmetry {support.get('symmetry')}"}
    found |= {f"load {load['kind']} {load.get('frame')}" for load in given.get("loads", ())}
    found |= {name for name in ("springs", "obstacles", "dynamics", "remove_rigid_motions") if given.get(name)}
    found |= {f"formula of {name}" for name, value in given.get("material", {}).items() if isinstance(value, str)}
    return {f"{case.kind} {case.theory} {feature}" for feature in found}


def with_something_new(names: Iterable[str]) -> list[Any]:
    """Return parameters of a test: cases with a feature that none before has, and for the long tests the others."""
    seen: set[str] = set()
    parameters = []
    for name in names:
        known = features(catalog.named_case(name))
        parameters.append(pytest.param(name, marks=[pytest.mark.long] if known <= seen else []))
        seen |= known
    return parameters
