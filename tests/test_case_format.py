"""The reference of the case format is that of the models, and its examples are cases."""

import tomllib
from typing import Literal

import pytest

from docs import case_format
from shellbench.errors import InputError
from shellbench.problems.shell.case import Case, build_case
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


def test_the_page_is_what_the_models_say():
    written = case_format.PAGE.read_text(encoding="utf-8")
    assert written == case_format.page(), "write it anew by `python docs/case_format.py`"


def test_every_model_and_every_field_is_there():
    sections = {name: case_format.section(*each) for each in case_format.SECTIONS for name in each[-1]}
    assert set(sections) == set(MODELS)
    for name, model in MODELS.items():
        missing = [field for field in model["properties"] if field != "kind" and f"| `{field}` |" not in sections[name]]
        assert missing == [], name
        for kind in case_format.kinds(case_format.model_class(name)):
            assert f"`{kind}`" in sections[name]
    page = case_format.page()
    assert [field for field in Case.model_fields if field != "name" and f"| `{field}` |" not in page] == []
    assert all(text in page for text in sections.values())


@pytest.mark.parametrize("name", MODELS)
def test_an_example_is_part_of_a_case(name):
    example = case_format.EXAMPLES[name]
    case = build_case(example.case(), "example", "the example")
    assert name in {type(part).__name__ for part in parts(case)}
    assert build_case(tomllib.loads(case_format.WHOLE[example.whole]), "whole", "the whole") != case


def test_every_kind_of_table_that_has_choices_names_them_in_its_examples():
    """An example of another kind would still be a case: what is shown is the kind whose section it is in."""
    for name in MODELS:
        chosen = case_format.kinds(case_format.model_class(name))
        text = case_format.EXAMPLES[name].text
        assert not chosen or any(f'kind = "{kind}"' in text for kind in chosen), name


def test_a_wrong_example_is_refused():
    wrong = case_format.Example(case_format.EXAMPLES["EdgeLoad"].text.replace("xi1_max", "xi3_max"))
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
        case_format.table(Below, ["z", "dark"])


def test_bounds_defaults_and_choices_are_said():
    rows = case_format.table(case_format.model_class("Material"), ["poissons_ratio", "areal_density"]).splitlines()[2:]
    assert rows[0].startswith("| `poissons_ratio` | number > -1, < 0.5 | required |")
    assert rows[1].startswith("| `areal_density` | number >= 0 | `0.0` |")
    assert '| `axis` | `"x"` or `"y"` or `"z"` | `"y"` |' in case_format.page()
