"""Cases of the suite that have something new, and shells of their data with something changed."""

import copy
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from typing import Any

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.kinds import kind_name
from shellbench.errors import InputError
from shellbench.problems.shell.case import Case as Shell
from shellbench.problems.shell.case import build_case
from shellbench.protocol.schema import read_toml


@cache
def stated(name: str) -> dict[str, Any]:
    """Return the data of a case's file: building all cases takes many times longer, and each worker collects tests."""
    return read_toml(catalog.case_file(name))


def shells() -> list[str]:
    """Return the names of the cases that are shells."""
    return [name for name in catalog.case_names() if kind_name(stated(name)) == "shell"]


def features(name: str) -> set[str]:
    """Return the features of a case: its surface, the kinds of its supports and loads, and its other parts."""
    given = stated(name)
    surface = given.get("surface", {})
    found = {f"surface {surface.get('kind')} {surface.get('closed')} {surface.get('periodic')}"}
    for support in given.get("supports", ()):
        motion = (support.get("motion") or {}).get("kind")
        found |= {f"motion {motion}", f"clamped {support.get('clamped')}", f"held {support.get('components')}"}
        found |= {f"symmetry {support.get('symmetry')}"}
    found |= {f"load {load['kind']} {load.get('frame')}" for load in given.get("loads", ())}
    found |= {name for name in ("springs", "obstacles", "dynamics", "remove_rigid_motions") if given.get(name)}
    found |= {f"formula of {name}" for name, value in given.get("material", {}).items() if isinstance(value, str)}
    return {f"{kind_name(given)} {given.get('theory')} {feature}" for feature in found}


def with_something_new(names: Iterable[str]) -> list[Any]:
    """Return parameters of a test: cases with a feature that none before has, and for the long tests the others."""
    seen: set[str] = set()
    parameters = []
    for name in names:
        known = features(name)
        parameters.append(pytest.param(name, marks=[pytest.mark.long] if known <= seen else []))
        seen |= known
    return parameters


def altered(data: Mapping[str, Any], change: Callable[[dict[str, Any]], object] = lambda data: None) -> Shell:
    """Build a shell of data, in which something is changed; the data themselves stay as they are."""
    own = copy.deepcopy({key: value for key, value in data.items() if key != "name"})
    change(own)
    return build_case(own, name="case", where="case.toml")


def refusal(data: Mapping[str, Any], change: Callable[[dict[str, Any]], object]) -> str:
    """Return the sentence in which changed data are refused: it names the file first."""
    with pytest.raises(InputError, match=r"^case\.toml: [^\n]*$") as caught:
        altered(data, change)
    return str(caught.value)
