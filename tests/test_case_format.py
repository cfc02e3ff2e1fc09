"""The reference of the case format is that of the models, and its examples are cases."""

import tomllib
from typing import Literal

import pytest

from docs import case_format
from shellbench.bench.plugins import kinds
from shellbench.errors import InputError
from shellbench.problems import obstacle
from shellbench.problems.shell.case import Case, build_case
from shellbench.problems.shell.quantities import quantities
from shellbench.protocol.schema import Model

MODELS = Case.model_json_schema()["$defs"]


def parts(value):
    """A model and all models in it."""
    if isinstance(value, Model):
        yield value
        for name in type(value).model_fields:
            yield from parts(getattr(value, name))
    elif isinstance(value, tuple | dict):
        for entry in value.values() if isinstance(value, dict) else value:
            yield from parts(entry)


@pytest.mark.parametrize(
    ("page", "written"),
    [(case_format.page, case_format.PAGE), (case_format.kinds_page, case_format.KINDS_PAGE)],
    ids=["shells", "kinds"],
)
def test_the_pages_are_what_the_models_say(page, written):
    assert written.read_text(encoding="utf-8") == page(), "write them anew by `python docs/case_format.py`"


def test_every_model_and_every_key_is_there():
    sections = {name: case_format.section(*each) for each in case_format.SECTIONS for name in each[-1]}
    assert set(sections) == set(MODELS)
    for name, model in MODELS.items():
        missing = [key for key in model["properties"] if key != "kind" and f"|`{key}`|" not in sections[name]]
        assert missing == [], name
        for kind in case_format.kinds(case_format.model_class(name)):
            assert f'`"{kind}"`' in sections[name]
    page = case_format.page()
    assert [key for key in Case.model_fields if key != "name" and f"|`{key}`|" not in page] == []
    assert all(text in page for text in sections.values())


def test_each_key_stands_below_its_own_model():
    """A key that two models of a section share has a row of each."""
    page = case_format.page()
    for name, model in MODELS.items():
        rows = case_format.group("name", case_format.model_class(name), ())[1:]
        assert len(rows) == len([key for key in model["properties"] if key != "kind"])
    for key, count in (("`vector`", 3), ("`support`", 2), ("`scale`", 4), ("`radius`", 3)):
        assert page.count(f"|{key}|") == count, key


@pytest.mark.parametrize("each", case_format.OTHERS, ids=lambda each: each[0])
def test_every_key_of_another_kind_is_there(each):
    case, page = each[3], case_format.other(*each)
    schema = case.model_json_schema()
    shared = {
        "name",
        "kind",
        "title",
        "description",
        "also_known_as",
        "units",
        "suites",
        "known",
        "shell",
        "quantities",
    }
    assert [key for key in case.model_fields if key not in shared and f"|`{key}`|" not in page] == []
    common = {"kind", *quantities.ShellQuantity.model_fields}
    obstacles = (
        {cls.__name__ for cls in case_format.subclasses(obstacle.Body)} if "obstacles" in case.model_fields else set()
    )
    for name, model in schema["$defs"].items():
        if name in {"Known", "OtherName", *obstacles}:  # on the page of shells
            continue
        of_page = {key for key in model["properties"] if key not in common or name == "Capsule"}
        chosen = {"by"} if name in ("ByClips", "ByFrames") else set()
        assert [key for key in of_page - chosen - {"kind"} if f"|`{key}`|" not in page] == [], name
        choices = model["properties"].get("kind", {})
        assert [
            kind for kind in choices.get("enum", [choices.get("const")]) if kind and f'`"{kind}"`' not in page
        ] == []


@pytest.mark.parametrize("each", case_format.OTHERS, ids=lambda each: each[0])
def test_the_example_of_another_kind_is_a_case(each, tmp_path):
    file = tmp_path / "example.toml"
    file.write_text(case_format.excerpt(*each[-2:]), encoding="utf-8")
    assert type(kinds.read_problem(file)) is each[3]


@pytest.mark.parametrize("heading", case_format.EXAMPLES)
def test_an_example_is_part_of_a_case_and_shows_its_section(heading):
    example = case_format.EXAMPLES[heading]
    case = build_case(example.case(), "example", "the example")
    (classes,) = [each[-1] for each in case_format.SECTIONS if each[0] == heading]
    assert {type(part).__name__ for part in parts(case)} & set(classes)
    assert build_case(tomllib.loads(case_format.WHOLE[example.whole]), "whole", "the whole") != case


def test_each_section_has_an_example():
    assert list(case_format.EXAMPLES) == [each[0] for each in case_format.SECTIONS]


def test_a_wrong_example_is_refused():
    wrong = case_format.Example(case_format.EXAMPLES["Loads"].text.replace("xi1_max,xi2_min", "xi3_max"))
    with pytest.raises(InputError, match="xi3_max"):
        build_case(wrong.case(), "example", "the example")


class Above(Model):
    """The model that comes first.

    Attributes
    ----------
    x, y
        Component, m; it goes
        on in a second line.
    z
        Upward.
    """

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


class Below(Above):
    """The model that comes second.

    Attributes
    ----------
    z
        Downward.

    Notes
    -----
    none
        Of this is an attribute.
    """

    kind: Literal["below"] = "below"
    dark: bool = False


def test_descriptions_come_from_the_class_and_from_those_above():
    words = case_format.attributes(Below)
    assert words == {"x": "Component, m; it goes on in a second line.", "y": words["x"], "z": "Downward."}


def test_a_field_that_nothing_describes_is_an_error():
    with pytest.raises(case_format.UndescribedError, match=r"Below\.dark"):
        case_format.keys(Below, ["z", "dark"])


def test_bounds_defaults_choices_and_units_are_said():
    rows = case_format.keys(case_format.model_class("Material"), ["poissons_ratio", "areal_density"])
    assert rows == [
        "|`poissons_ratio`|number > -1, < 0.5||required|nu.|",
        "|`areal_density`|number >= 0|kg/m^2|`0.0`|rho.|",
    ]
    assert '|`axis`|`"x"`, `"y"`, `"z"`||`"y"`|Axis of the cylinder.|' in case_format.page()
    assert case_format.allowed(
        {"type": "array", "minItems": 1, "items": {"type": "array", "items": {"type": "number"}}}
    ) == ("lists of numbers, at least one")


def test_a_description_with_several_units_keeps_them():
    cls = case_format.model_class("DisplacementQuantity")
    unit, meaning = case_format.description(cls, "at")
    assert unit == ""
    assert "a time, s, in a motion" in meaning
