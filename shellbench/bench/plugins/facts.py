"""Facts about a loaded solver, as JSON data."""

from __future__ import annotations

import inspect
import re
from typing import Any

from shellbench.problem import SeededSettings, Settings, Solver
from shellbench.protocol.engine import ENGINE


def facts_of(solver: Solver) -> dict[str, Any]:
    """Return the facts that a list shows of a loaded solver; TypeError if it has a setting without a default."""
    for name, field in solver.settings_type.model_fields.items():
        if field.is_required():
            raise TypeError(f"its setting '{name}' has no default")
    return {
        "label": solver.capabilities.label,
        "engine": _engine(solver.settings_type),
        "theories": list(solver.capabilities.theories),
        "devices": list(solver.capabilities.devices),
        "seeded": issubclass(solver.settings_type, SeededSettings),
        "settings": _settings(solver.settings_type),
        "uses_start": bool(getattr(solver, "uses_start", False)),
    }


def _engine(settings: type[Settings]) -> str | None:
    """Return name and version of a solver's engine, the default of its setting; None if it has no engine."""
    field = settings.model_fields.get(ENGINE)
    found = field.get_default(call_default_factory=True, validated_data={}) if field else None
    return found if isinstance(found, str) else None


def _settings(settings: type[Settings]) -> list[dict[str, Any]]:
    properties: dict[str, Any] = settings.model_json_schema().get("properties", {})
    return [
        {
            "name": name,
            "default": _engine(settings) if name == ENGINE else schema.get("default"),
            "description": schema.get("description") or attributes(settings).get(name, ""),
        }
        for name, schema in properties.items()
        if name not in {"seed", "device"}
    ]


def attributes(cls: type) -> dict[str, str]:
    """Return the texts of the section "Attributes" by field, of a class and its bases; the class's own texts win."""
    found: dict[str, str] = {}
    for one in reversed(cls.__mro__):
        text = inspect.cleandoc(one.__dict__.get("__doc__") or "")
        section = re.search(r"^Attributes\n-+\n(.*?)(?=^\w+\n-+\n|\Z)", text, re.MULTILINE | re.DOTALL)
        for names, words in re.findall(r"^(\S.*)\n((?:(?: +.*)?\n?)+)", section[1] if section else "", re.MULTILINE):
            found |= dict.fromkeys(names.split(", "), " ".join(words.split()))
    return found
