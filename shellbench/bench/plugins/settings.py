"""Settings of a solver: made from overrides, compared with its defaults, and read from the command line."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError

from shellbench.errors import InputError, without_middle
from shellbench.problem import SeededSettings, Settings, Solver
from shellbench.protocol.schema import one_sentence, parse_toml

APART = {"seed", "device"}  # settings that an identity keeps in fields of their own


def dump_settings(settings: Settings) -> dict[str, Any]:
    """Return all settings except seed and device, as JSON data."""
    return plain(settings.model_dump(mode="json", exclude=APART))


def plain(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the data as after a round trip through JSON."""
    result: dict[str, Any] = json.loads(json.dumps(dict(data)))
    return result


def make_settings(solver: Solver, overrides: Mapping[str, Any], seed: int, device: str) -> Settings:
    """Return a solver's settings with overrides; seed and device where it has them.

    Raises
    ------
    InputError
        In one sentence with the setting, the found value and the allowed values.
    """
    for key, option in (("seed", "--seed"), ("device", "--device")):
        if key in overrides:
            raise InputError(f"setting '{solver.name}.{key}' is given by the option {option}")
    apart = {"seed": seed, "device": device} if issubclass(solver.settings_type, SeededSettings) else {}
    try:
        return solver.settings_type.model_validate({**overrides, **apart})
    except ValidationError as error:
        raise InputError(f"settings of solver '{solver.name}': {one_sentence(error)}") from None


def with_overrides(defaults: Mapping[str, Any], overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Return default settings with overrides, tables within settings merged as well."""
    result = dict(defaults)
    for key, value in overrides.items():
        old = result.get(key)
        nested = isinstance(old, Mapping) and isinstance(value, Mapping)
        result[key] = with_overrides(old, value) if nested else value  # type: ignore[arg-type]
    return plain(result)


def difference(defaults: Mapping[str, Any], settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings that differ from the defaults."""
    return {key: value for key, value in settings.items() if key not in defaults or defaults[key] != value}


def parse_setting(text: str) -> tuple[str, str, Any]:
    """Read ``SOLVER.KEY=VALUE``; the value is TOML (a number, true, a list, a quoted text) or else a text.

    Raises
    ------
    InputError
        If it is not of this form.
    """
    path, equals, raw = text.partition("=")
    solver, dot, key = path.strip().partition(".")
    if not (equals and dot and solver and key):
        raise InputError(
            f"--set: found {without_middle(text)!r}, but expected SOLVER.KEY=VALUE, such as fem.tolerance=1e-6"
        )
    try:
        document = parse_toml(f"value = {raw}")
        value = document["value"] if set(document) == {"value"} else raw
    except tomllib.TOMLDecodeError:
        value = raw
    except InputError as error:
        raise InputError(f"--set {without_middle(path)}: {error}") from None
    return solver, key, value
