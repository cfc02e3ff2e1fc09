"""Suite files: lines that sweep over a setting, studies, and what is refused in one sentence."""

from pathlib import Path

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.suite import read_suite
from shellbench.errors import InputError


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "mine.toml"
    path.write_text(f'title = "Mine"\n{text}')
    return path


def test_a_sweep_is_read_as_a_line_for_each_value(tmp_path):
    text = '[[runs]]\nsolver = "a"\nseeds = [3]\nsettings = { order = 2 }\nsweep = { cells = [[4, 4], [8, 9]] }\n'
    runs = read_suite(write(tmp_path, text)).runs
    assert [(run.settings, run.label, run.seeds) for run in runs] == [
        ({"order": 2, "cells": [4, 4]}, "cells 4×4", (3,)),
        ({"order": 2, "cells": [8, 9]}, "cells 8×9", (3,)),
    ]


def test_a_label_stands_before_the_value(tmp_path):
    text = '[[runs]]\nsolver = "a"\nlabel = "fine"\nsweep = { step = [0.5] }\n[[runs]]\nsolver = "b"\n'
    first, second = read_suite(write(tmp_path, text)).runs
    assert (first.label, second.label, second.settings) == ("fine, step 0.5", "", {})


@pytest.mark.parametrize(
    "sweep",
    ["{}", "{ a = [1], b = [2] }", "{ a = 1 }", "{ a = [] }", "{ a = [1, 1] }", "{ set = [1] }", "[1, 2]", '"cells"'],
    ids=str,
)
def test_what_is_no_sweep_is_one_sentence(tmp_path, sweep):
    path = write(tmp_path, f'[[runs]]\nsolver = "a"\nsettings = {{ set = 2 }}\nsweep = {sweep}\n')
    with pytest.raises(
        InputError, match=r"runs\.0\.sweep: found .* one setting, .* with a list of different values"
    ) as caught:
        read_suite(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_what_is_no_name_of_a_study_is_refused(tmp_path):
    with pytest.raises(InputError, match="study"):
        read_suite(write(tmp_path, 'study = "two words"\n[[runs]]\nsolver = "a"\n'))


def test_our_suites_study_what_a_section_shows():
    """A study may have any name, because packages bring their own; a misspelt built-in one would vanish from the report."""
    studies = {suite.study for suite in map(catalog.own_suite, catalog.own_suite_names())} - {None}
    assert studies == {"resolution", "sampling", "training", "thinness", "speed"}


BUT_FOR_VARIANTS = [name for name in catalog.suite_names() if name != "shape_variants"]  # hundreds: long


@pytest.mark.parametrize("name", [*BUT_FOR_VARIANTS, pytest.param("shape_variants", marks=pytest.mark.long)])
def test_a_suite_names_cases_that_belong_to_it(name):
    suite = catalog.find_suite(name)
    members = {case.base for case in catalog.cases_of(name)}
    assert members
    assert set(suite.order) == members
    for run in suite.runs:
        assert set(run.cases) <= members


@pytest.mark.parametrize("name", [name for name in catalog.own_suite_names() if catalog.own_suite(name).study])
def test_a_study_gates_nothing_of_its_own(name):
    """A gate judges runs with default settings: a study's lines that have none are never red or green."""
    suite = catalog.find_suite(name)
    gated = [case for case in catalog.cases_of(name) if set(case.suites) <= {name}]
    for case in gated:
        assert not any(case.name in held for held in catalog.tolerances().values())
    assert suite.title.endswith("not gated")
