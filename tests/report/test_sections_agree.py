"""The tables of the sections of evidence print the same numbers in every notation; their data are tested by section."""

import re
from dataclasses import replace

import pytest

from shellbench.report.sections import consistency, cost, memory, seeds
from shellbench.report.studies import paper_studies
from tests.report import resolutions, studied
from tests.report.test_formats_agree import lines, numbers_of, words

MARKUP = ("markdown", "html", "latex")


@pytest.fixture
def of_resolution(tmp_path, monkeypatch):
    resolutions.only_suites(monkeypatch, ("resolution",))
    runs = [*resolutions.plate_runs(tmp_path), *resolutions.napkin_runs(tmp_path)]
    return resolutions.evidence(tmp_path, runs)


@pytest.fixture
def of_studies(tmp_path):
    meshes = [
        studied.studied(tmp_path, "resolution", "mesh", {"cells": [n, n]}, n**-4.0, unknowns=12 * n * n)
        for n in (4, 8, 16, 32)
    ]
    fields = [
        studied.studied(tmp_path, "resolution", "field", {"width": n}, (1 + seed) * n**-3.0, seed=seed, unknowns=3 * n)
        for n in (10, 20, 40)
        for seed in (0, 1, 2)
    ]
    sampled = [
        studied.studied(tmp_path, "sampling", "field", {"cells": [n, n]}, 1 / n, seed=seed, gap=0.01 / n)
        for n in (5, 25)
        for seed in (0, 1)
    ]
    soft = [
        studied.studied(
            tmp_path, "sampling", "soft", {"penalty": w}, 1 / w, diagnostics={"penalty": w, "support_error": 0.01 / w}
        )
        for w in (1.0, 100.0)
    ]
    return studied.evidence(tmp_path, [*meshes, *fields, *sampled, *soft])


def tables_of(section):
    assert section is not None
    return [*section.tables, *section.details]


def sizes_of(text, format):
    """Sizes in cells that hold more than a number, such as "8.3 kB (float32)"."""
    cells = (words(cell) for row in lines(text, format) for cell in row)
    return [size for cell in cells for size in re.findall(r"([\d.]+)\s*([kMG]?B)\b", cell)]


def assert_they_agree(tables):
    for table in tables:
        shown = replace(table, columns=tuple(column for column in table.declared if not column.wide))
        first, *others = (
            [*numbers_of(text, format), *sizes_of(text, format)] for format in MARKUP for text in (shown.write(format),)
        )
        assert first, table.name
        assert all(table.write(format) for format in ("text", "csv", *MARKUP)), table.name
        assert all(other == first for other in others), table.name


def test_consistency_and_memory(of_resolution):
    tables = [*tables_of(consistency.section(of_resolution)), *tables_of(memory.section(of_resolution))]
    assert len(tables) >= 6
    assert_they_agree(tables)


def test_cost_seeds_sampling_and_supports(of_studies):
    makers = (cost.section, seeds.section, paper_studies.sampling, paper_studies.supports)
    tables = [table for maker in makers for table in tables_of(maker(of_studies))]
    assert len(tables) >= 5
    assert_they_agree(tables)


def test_a_number_that_differs_is_found(of_studies):
    table = tables_of(paper_studies.sampling(of_studies))[0]
    changed = replace(table, data=table.data.assign(largest_error=2 * table.data["largest_error"]))
    assert numbers_of(changed.write("html"), "html") != numbers_of(table.write("markdown"), "markdown")
