"""What all data that is read from files has in common: frozen, strict, with errors in one sentence."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from shellbench.errors import InputError

MAX_BYTES = 1_000_000  # a case or reference file is a page of text; anything larger is a mistake

Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]
Vector = tuple[Finite, Finite, Finite]


class Model(BaseModel):
    """Immutable data that refuses unknown fields."""

    model_config = ConfigDict(frozen=True, extra="forbid")


def one_sentence(error: ValidationError) -> str:
    """Say which field is wrong, what was found and what is allowed (the first of several problems)."""
    first = error.errors(include_url=False)[0]
    field = _shown(".".join(str(part) for part in first["loc"]))
    message = first["msg"].removeprefix("Value error, ").removeprefix("Assertion failed, ")
    if first["type"] == "extra_forbidden":
        return f"field '{field}' is not known here"
    if first["type"] == "missing":
        return f"field '{field}' is missing"
    if first["type"] in {"value_error", "assertion_error"}:
        return f"field '{field}': {message}" if field else message
    found = _shown(repr(first["input"]))
    return f"field '{field}': found {found}, but {message[:1].lower()}{message[1:]}"


def _shown(text: str) -> str:
    return text if len(text) <= 60 else text[:57] + "..."


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file.

    Raises
    ------
    InputError
        If it can't be read, is too large, or is not TOML.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: can't be read ({error.strerror})") from None
    if len(data) > MAX_BYTES:
        raise InputError(f"{path}: {len(data)} bytes is more than the {MAX_BYTES} allowed")
    try:
        return tomllib.loads(data.decode("utf-8"))
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not a text file in UTF-8") from None
    except (tomllib.TOMLDecodeError, ValueError) as error:
        raise InputError(f"{path}: is not valid TOML: {error}") from None
    except RecursionError:
        raise InputError(f"{path}: is nested too deeply") from None
