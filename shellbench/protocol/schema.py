"""Base of all data that are read from files: frozen, strict, with errors in one sentence."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StrictBool, ValidationError

from shellbench.errors import InputError, without_middle
from shellbench.files import read_file
from shellbench.protocol.spelling import did_you_mean

LONGEST_TITLE = 200  # characters
MAX_BYTES = 1_000_000  # a case or reference file is a page of text; anything larger is a mistake
MOST_PARTS = 100  # parts of a dotted key: the time of `tomllib` is the square of their number
LARGEST_WHOLE = 2**63 - 1  # of TOML
LONGEST_VALUE = 60  # characters of a value, or of a field's name, that a sentence quotes

NAME_PATTERN = r"^[A-Za-z][A-Za-z0-9_]*$"

LARGEST = 1e100  # largest value: none in SI units is larger, and its square is still a double
SMALLEST = 1 / LARGEST  # smallest positive value, so that division is possible


def _not_tiny(value: float) -> float:
    if value < SMALLEST:
        raise ValueError(f"found {value:g}, but it must be at least {SMALLEST:g}")
    return value


# `LARGEST` is not a bound of these types: fields with their own bounds would lose them. See `check_sizes`.
Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False), AfterValidator(_not_tiny)]
Vector = tuple[Finite, Finite, Finite]
Name = Annotated[str, Field(pattern=NAME_PATTERN, max_length=60)]
Flag = StrictBool  # true or false; "yes" and 1 are neither


class Model(BaseModel):
    """Immutable data that refuses unknown fields."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    limits: ClassVar[str] = ""
    """Clause on the abilities of the files of a kind; it follows a name or kind that is not known."""


def one_sentence(error: ValidationError, data: Any = None) -> str:
    """Describe the wrong field, its value and the allowed values (the first of several problems).

    Parameters
    ----------
    error
        The error of the validation.
    data
        The validated data. With them the field has its name in the file; without them the name may contain the kind of
        a table.
    """
    problems = error.errors(include_url=False)
    first = _first_error(problems)
    kind, context = first["type"], first.get("ctx", {})
    field = _shown(_field(first["loc"], data, absent=kind == "missing"))
    models = _models_at(error.title, first["loc"][:-1] if kind == "extra_forbidden" else first["loc"])
    limits = "".join(dict.fromkeys(f"; {model.limits}" for model in models if model.limits))
    if kind == "extra_forbidden":
        name, known = (
            str(first["loc"][-1]),
            list(dict.fromkeys(name for model in models for name in model.model_fields)),
        )
        hint = did_you_mean(name, known)
        if limits and not (hint and all(one not in name for one in known)):  # youngs_modulus_1 is no slip of the pen
            return f"field '{field}' is not known here{hint}{limits}"
        return f"field '{field}' is not known here{hint}" + (
            f": known are {', '.join(known)}" if known and not hint else ""
        )
    if kind == "missing":
        return f"field '{field}' is missing"
    if kind == "union_tag_not_found":
        return f"field '{_tag(field, context)}' is missing"
    if kind in {"value_error", "assertion_error"}:
        message = first["msg"].removeprefix("Value error, ").removeprefix("Assertion failed, ")
        message = _on_one_line(_with_short_texts(message, first["input"]))
        return f"field '{field}': {message}" if field else message
    if kind == "json_invalid":
        return f"it is not valid JSON: {context.get('error', 'cut off')}"
    if kind == "union_tag_invalid":
        found = _shown(repr(context["tag"]))
        return f"field '{_tag(field, context)}': found {found}, but {_choices(context['expected_tags'])}{limits}"
    found = _shown(_repr(first["input"]))
    of_union = [other for other in problems if other["loc"][:-1] == first["loc"][:-1]] if _is_member(first) else [first]
    allowed = " or ".join(dict.fromkeys(_valid_values(other["type"], other.get("ctx", {})) for other in of_union))
    return f"field '{field}': found {found}, but it must be {allowed}" if field else f"it must be {allowed}"


def _first_error(problems: list[Any]) -> Any:
    """Return the problem to report: unknown names come before missing ones, because they may be misspelt."""
    first = problems[0]
    if first["type"] != "missing":
        return first
    unknown = [problem for problem in problems if problem["type"] == "extra_forbidden"]
    beside = [problem for problem in unknown if problem["loc"][:-1] == first["loc"][:-1]]
    return next(iter([*beside, *unknown]), first)


def _models_at(title: str, places: tuple[int | str, ...]) -> list[type[Model]]:
    """Return the models that are possible at a place of the model of this name."""
    models = [model for model in _subclasses(Model) if model.__name__ == title]
    for place in places:
        tagged = [model for model in models if place in _tags(model)] if len(models) > 1 else []
        fields = [model.model_fields[str(place)] for model in models if place in model.model_fields]
        if tagged or fields:
            models = tagged or list(dict.fromkeys(m for field in fields for m in _models_in(field.annotation)))
    return models


def _subclasses(model: type[Model]) -> Iterable[type[Model]]:
    for one in model.__subclasses__():
        yield one
        yield from _subclasses(one)


def _tags(model: type[Model]) -> tuple[Any, ...]:
    return get_args(model.model_fields["kind"].annotation) if "kind" in model.model_fields else ()


def _models_in(annotation: Any) -> Iterable[type[Model]]:
    """Yield the models in an annotation, also within unions, lists and tables."""
    if isinstance(annotation, type) and issubclass(annotation, Model):
        yield annotation
    for argument in get_args(annotation):
        yield from _models_in(argument)


def _with_short_texts(message: str, data: Any) -> str:
    """Return a message with shortened quotations of the texts in the data."""
    parts = [data]
    while parts:
        part = parts.pop()
        if isinstance(part, Mapping):
            parts += [*part, *part.values()]
        elif isinstance(part, list | tuple):
            parts += part
        elif isinstance(part, str) and len(part) > len(short := without_middle(part)):
            message = message.replace(part, short)
    return message


MEMBERS = {"float", "int", "str", "bool"}  # the end of a problem's place, where a field may be of several types


def _on_one_line(text: str) -> str:
    """Escape characters that can't be printed, such as a line break in a name, as Python does."""
    return "".join(sign if sign.isprintable() else repr(sign)[1:-1] for sign in text)


def _shown(text: str) -> str:
    return without_middle(_on_one_line(text), LONGEST_VALUE)


def _repr(value: Any) -> str:
    try:
        return repr(value)
    except (ValueError, RecursionError):  # a whole number of thousands of digits; a nest
        return f"a value of kind '{type(value).__name__}' that is too long to show"


def _is_member(problem: Any) -> bool:
    return bool(problem["loc"]) and problem["loc"][-1] in MEMBERS


def _field(places: tuple[int | str, ...], data: Any, *, absent: bool) -> str:
    """Return the name of a field, without parts that are no keys of the data, such as the kind of a table."""
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
    name = str(context.get("discriminator", "kind")).strip("'_()")  # a field, or the function that reads it
    return f"{field}.{name}" if field else name


def _choices(choices: str) -> str:
    """Return the valid choices of a field, quoted and with commas between them."""
    listed = choices.split(", ")
    return f"it must be {' or '.join(filter(None, (', '.join(listed[:-1]), listed[-1])))}"


def _valid_values(kind: str, context: Mapping[str, Any]) -> str:
    """Return the description of a field's valid values, from the kind of the problem and its context."""
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
"""Requirement on a field, by the type of pydantic's error: its own words name classes and parsers, not fields."""


CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]")  # control characters, without tabs and ends of lines

# A bare or quoted key of too many parts, where a key may begin. Possessive quantifiers do not backtrack, so that it is
# found in linear time.
PART = r"""(?:[A-Za-z0-9_-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')"""
LONG_KEY = re.compile(rf"(?:^|[\[{{,])[ \t]*+{PART}(?:[ \t]*+\.[ \t]*+{PART}){{{MOST_PARTS}}}", re.MULTILINE)


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file.

    Raises
    ------
    InputError
        If it can't be read, is too large, or is not TOML.
    """
    try:
        return parse_toml(read_file(path, MAX_BYTES).decode("utf-8"))
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not a text file in UTF-8") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: is not valid TOML: {error}") from None
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def parse_toml(text: str) -> dict[str, Any]:
    """Return the data of a TOML text.

    Raises
    ------
    TOMLDecodeError
        If it is not TOML.
    InputError
        As a clause, if it is TOML that records can't keep: nested too deeply, with a number that is too large, or with
        a control character.
    """
    if LONG_KEY.search(text):
        raise InputError(f"a key has more than {MOST_PARTS} parts: it is nested too deeply")
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except RecursionError:
        raise InputError("it is nested too deeply") from None
    except ValueError:  # Python reads whole numbers of at most some thousands of digits
        raise InputError(TOO_LARGE) from None
    parts: list[Any] = [data]
    while parts:
        part = parts.pop()
        if isinstance(part, dict | list):
            parts += (*part, *part.values()) if isinstance(part, dict) else part
        elif isinstance(part, int) and abs(part) > LARGEST_WHOLE:
            raise InputError(TOO_LARGE)
        elif isinstance(part, str) and (found := CONTROL.search(part)) is not None:
            raise InputError(f"a text has the control character U+{ord(found[0]):04X}")
    check_sizes(data)
    return data


def check_sizes(data: Any) -> None:
    """Raise InputError, as a clause with the field, if a number of a file's data is above `LARGEST` in size."""
    parts: list[tuple[str, Any]] = [("", data)]
    while parts:
        where, part = parts.pop()
        inner = part.items() if isinstance(part, Mapping) else enumerate(part) if isinstance(part, list | tuple) else ()
        parts += [(f"{where}.{key}" if where else str(key), value) for key, value in inner]
        if isinstance(part, float) and LARGEST < abs(part) < math.inf:
            found = f"found {part:g}, but it must be at most {LARGEST:g} in size"
            raise InputError(f"field '{_shown(where)}': {found}")


TOO_LARGE = "a whole number in it is too large: it may have 63 bits"
