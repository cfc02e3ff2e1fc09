"""Faults of a file are reported in words of the file, never in those of the library that checks it."""

import copy
import json
import math
import re

import pytest
from pydantic_core._pydantic_core import list_all_errors

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.reference import read_known_values
from shellbench.bench.catalogue.suite import read_suite
from shellbench.bench.judge.baseline import read_baseline
from shellbench.errors import InputError
from shellbench.problems.shell.case import build_case
from shellbench.protocol.schema import read_toml

PLACEHOLDER = re.compile(r"\\\{[a-z_]+\\\}")
RAW = [
    re.compile(PLACEHOLDER.sub(".*", re.escape(error["message_template_python"])))
    for error in list_all_errors()
    if len(re.sub(r"\{[a-z_]+\}|\W", "", error["message_template_python"])) > len("value error")
]
WORDS = ("Input should", "Input tag", "discriminator", "tagged", "after validation", "[key]", "[type=", "pydantic")
WRONG = ("far", -1, 1e400, math.nan, 0, True, [], ["x", "y", "z", "t"], [[1]], {}, {"kind": "blob"}, "x" * 999)
BASELINES = ("", "{", "[]", '{"values": []}', '{"values": 1, "costs": []}', '{"values": [{}], "costs": []}')
BASELINES = (*BASELINES, '{"schema_version": 9, "values": [], "costs": []}')
CASES = ("scordelis_lo", pytest.param("sleeve_compression", marks=pytest.mark.long))


def places(data, prefix=()):
    """Yield all places in nested data."""
    for key, value in data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ():
        yield (*prefix, key)
        yield from places(value, (*prefix, key))


def keys_of(data):
    return {key for place in places(data) for key in place if isinstance(key, str)}


def named_parts(message):
    """Return the parts of the name of a field in which something was found; its kind may be what is wrong."""
    named = re.match(r"case\.toml: field '([^']+)': found", message)
    return {part for part in named[1].split(".") if not part.isdigit()} - {"kind"} if named else set()


def damaged(data):
    """Yield data with something wrong in one place."""
    for place in places(data):
        for value in (*WRONG, None, "extra"):
            broken = copy.deepcopy(data)
            inner = broken
            for key in place[:-1]:
                inner = inner[key]
            if value is None:
                del inner[place[-1]]
            elif value == "extra" and isinstance(inner[place[-1]], dict):
                inner[place[-1]]["superfluous"] = 1
            elif value != "extra":
                inner[place[-1]] = value
            yield broken


def check(message, where):
    assert message.startswith(f"{where}: ")
    assert "\n" not in message
    assert not [raw.pattern for raw in RAW if raw.search(message)], message
    assert not [word for word in WORDS if word in message], message


@pytest.mark.parametrize("name", CASES)
def test_a_broken_case_is_told_in_words_of_the_file(name):
    data = read_toml(catalog.data_folder("cases") / f"{name}.toml")
    refused, strange = 0, set()
    for broken in damaged(data):
        try:
            build_case(broken, name, "case.toml")
        except InputError as error:
            refused += 1
            check(str(error), "case.toml")
            strange.update(named_parts(str(error)) - keys_of(broken))
    assert refused > 100
    assert not strange  # each field that is named is one of the file's


def written(path, data):
    """Write data as TOML, which takes JSON's values but for its tables."""

    def value(of):
        if isinstance(of, dict):
            return "{ " + ", ".join(f"{json.dumps(k)} = {value(v)}" for k, v in of.items()) + " }"
        if isinstance(of, list):
            return "[" + ", ".join(map(value, of)) + "]"
        if isinstance(of, float) and not math.isfinite(of):
            return "nan" if math.isnan(of) else "inf"
        return json.dumps(of)

    path.write_text("".join(f"{json.dumps(key)} = {value(of)}\n" for key, of in data.items()), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("folder", "name", "read"),
    [
        pytest.param("cases/suites", "resolution", read_suite, marks=pytest.mark.long),
        ("cases/suites", "nonlinear", read_suite),
        ("references", "square_plate", read_known_values),
    ],
)
def test_other_broken_files_are_told_in_words_of_the_file(folder, name, read, tmp_path):
    top, _, below = folder.partition("/")
    data = read_toml(catalog.data_folder(top) / below / f"{name}.toml")
    refused = 0
    for number, broken in enumerate(damaged(shortened(data))):
        path = written(tmp_path / f"n{number}.toml", broken)
        try:
            read(path)
        except InputError as error:
            refused += 1
            check(str(error), str(path))
    assert refused > 50


def shortened(data):
    """Return data with at most three tables in each list of tables: the others are alike."""
    return {key: value[:3] if isinstance(value, list) else value for key, value in data.items()}


@pytest.mark.parametrize("text", BASELINES)
def test_a_broken_baseline_is_told_in_words_of_the_file(text, tmp_path):
    path = tmp_path / "baseline.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_baseline(path)
    check(str(caught.value), str(path))
