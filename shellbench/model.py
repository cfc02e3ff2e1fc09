"""What all data that is read from files has in common: frozen, strict, with errors in one sentence."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from shellbench.errors import InputError

LONGEST_TITLE = 200  # characters
MAX_BYTES = 1_000_000  # a case or reference file is a page of text; anything larger is a mistake

NAME_PATTERN = r"^[A-Za-z][A-Za-z0-9_]*$"

Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]
Vector = tuple[Finite, Finite, Finite]
Name = Annotated[str, Field(pattern=NAME_PATTERN, max_length=60)]


class Model(BaseModel):
    """Immutable data that refuses unknown fields."""

    model_config = ConfigDict(frozen=True, extra="forbid")


def one_sentence(error: ValidationError, data: Any = None) -> str:
    """Say which field is wrong, what was found and what is allowed (the first of several problems).

    Parameters
    ----------
    error
        What validating has raised.
    data
        What was validated. With it the field is named as in the file; without it the kind of a table may stand in
        the middle of the name.
    """
    problems = error.errors(include_url=False)
    first = problems[0]
    kind, context = first["type"], first.get("ctx", {})
    field = _shown(_field(first["loc"], data, absent=kind == "missing"))
    if kind == "extra_forbidden":
        return f"field '{field}' is not known here"
    if kind == "missing":
        return f"field '{field}' is missing"
    if kind == "union_tag_not_found":
        return f"field '{_tag(field, context)}' is missing"
    if kind in {"value_error", "assertion_error"}:
        message = _on_one_line(first["msg"].removeprefix("Value error, ").removeprefix("Assertion failed, "))
        return f"field '{field}': {message}" if field else message
    if kind == "json_invalid":
        return f"it is not valid JSON: {context.get('error', 'cut off')}"
    if kind == "union_tag_invalid":
        return f"field '{_tag(field, context)}': found {context['tag']!r}, but {_either(context['expected_tags'])}"
    found = _shown(repr(first["input"]))
    of_union = [other for other in problems if other["loc"][:-1] == first["loc"][:-1]] if _is_member(first) else [first]
    allowed = " or ".join(dict.fromkeys(_allowed(other["type"], other.get("ctx", {})) for other in of_union))
    return f"field '{field}': found {found}, but it must be {allowed}" if field else f"it must be {allowed}"


MEMBERS = {"float", "int", "str", "bool"}  # the end of a problem's place, where a field may be of several types


def _on_one_line(text: str) -> str:
    """Write what can't be printed, such as a line break in a name, as Python does."""
    return "".join(sign if sign.isprintable() else repr(sign)[1:-1] for sign in text)


def _shown(text: str) -> str:
    text = _on_one_line(text)
    return text if len(text) <= 60 else text[:57] + "..."


def _is_member(problem: Any) -> bool:
    return bool(problem["loc"]) and problem["loc"][-1] in MEMBERS


def _field(places: tuple[int | str, ...], data: Any, *, absent: bool) -> str:
    """Return the name of a field; what is no key of the data, such as the kind of a table, is no part of it."""
    if places and places[-1] in MEMBERS:
        places = places[:-1]
    places = tuple(place for place in places if place != "[key]")
    if data is None:
        return ".".join(map(str, places))
    named: list[str] = []
    for number, place in enumerate(places):
        there = place in data if isinstance(data, dict) else isinstance(data, list) and isinstance(place, int)
        if there or (absent and number == len(places) - 1):
            named.append(str(place))
        if there:
            data = data[place] if isinstance(data, dict) or int(place) < len(data) else None
    return ".".join(named)


def _tag(field: str, context: Mapping[str, Any]) -> str:
    name = str(context.get("discriminator", "kind")).strip("'")
    return f"{field}.{name}" if field else name


def _either(choices: str) -> str:
    """Return choices, quoted and with commas between them, as what a field must be."""
    listed = choices.split(", ")
    return f"it must be {' or '.join(filter(None, (', '.join(listed[:-1]), listed[-1])))}"


def _allowed(kind: str, context: Mapping[str, Any]) -> str:
    """Return what a field must be, in words, from the kind of the problem and its context."""
    if words := ALLOWED.get(kind):
        return words.format(**context)
    if kind == "string_pattern_mismatch":
        return NAMES.get(context["pattern"], f"text of the form {context['pattern']}")
    if kind in {"too_short", "too_long"}:
        count = context["min_length" if kind == "too_short" else "max_length"]
        return f"of {'at least' if kind == 'too_short' else 'at most'} {count} entr{'y' if count == 1 else 'ies'}"
    return "of another kind"


NAMES = {NAME_PATTERN: "a name: letters, digits and _, the first a letter"}
ALLOWED = {
    "float_type": "a number",
    "float_parsing": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_parsing_size": "a whole number that is not as large",
    "int_from_float": "a whole number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "string_type": "text",
    "string_unicode": "text in UTF-8",
    "string_too_short": "text of at least {min_length} characters",
    "string_too_long": "text of at most {max_length} characters",
    "literal_error": "{expected}",
    "enum": "{expected}",
    "greater_than": "greater than {gt}",
    "greater_than_equal": "greater than or equal to {ge}",
    "less_than": "less than {lt}",
    "less_than_equal": "less than or equal to {le}",
    "multiple_of": "a multiple of {multiple_of}",
    "tuple_type": "a list",
    "list_type": "a list",
    "set_type": "a list",
    "frozen_set_type": "a list",
    "iterable_type": "a list",
    "dict_type": "a table",
    "mapping_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "dataclass_type": "a table",
    "none_required": "left out",
    "json_type": "JSON",
}
"""What a field must be, by the type of pydantic's problem: its own words name classes and parsers, not fields."""


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
