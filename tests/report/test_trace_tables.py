"""Iterations, states and seconds of paths: the records' own, in every format."""

import csv
import html
import io

import numpy as np
import pytest

from shellbench.report.data.evidence import Evidence
from shellbench.report.data.notation import byte_size
from shellbench.report.studies.trace_tables import effort_table
from tests.report.nonlinear import REASON
from tests.report.test_tables import MARKUP_FORMATS, lines, number


@pytest.fixture(scope="module")
def table(nonlinear):
    return effort_table(Evidence({record.run_id: record for record in nonlinear.records}, nonlinear.rows, None))


def records_of(nonlinear, line):
    named = set(line["run_ids"].split(" "))
    return [record for record in nonlinear.records if record.run_id in named]


def test_each_count_is_the_records(nonlinear, table):
    solutions = [(line["case"], line["solution"]) for line in table.data.to_dict("records")]
    assert ("cantilever_shear", "ndf-ritz, published") in solutions
    assert ("hinged_roof_thick", "fem") in solutions
    assert not {"rolled_plate", "rigid_rotation"} & {case for case, _ in solutions}  # they follow no path
    for line in table.data.to_dict("records"):
        records = records_of(nonlinear, line)
        paths = [[step for step in record.history if step.phase == "path"] for record in records]
        assert line["seeds"] == len(records)
        assert line["states"] == max(len(path) for path in paths)
        assert line["iterations"] == max(sum(step.iterations for step in path) for path in paths)
        assert line["most_in_a_step"] == max(step.iterations for path in paths for step in path)
        assert line["unknowns"] == max(step.unknowns for path in paths for step in path)
        assert line["seconds"] == pytest.approx(np.mean([record.seconds for record in records]))
        assert line["peak_memory_bytes"] == max(record.peak_memory_bytes for record in records)


@pytest.mark.parametrize("format", ["text", *MARKUP_FORMATS])
def test_every_format_prints_the_same_counts(nonlinear, table, format):
    data = table.data.to_dict("records")
    printed = [
        [html.unescape(cell).strip() for cell in cells]
        for cells in lines(table.write(format), format)
        if len(cells) == len(table.columns) and any(c.isdigit() for c in cells[1]) and "Runs" not in cells
    ]
    assert len(printed) == len(data)
    for line, cells in zip(data, printed, strict=True):
        assert [int(number(cell)[0]) for cell in cells[1:6]] == [
            line[name] for name in ("seeds", "states", "iterations", "most_in_a_step", "unknowns")
        ]
        seconds, half = number(cells[6])
        assert abs(seconds - line["seconds"]) <= half * (1 + 1e-6)
        assert cells[7] == byte_size(line["peak_memory_bytes"])


def test_csv_has_every_digit(nonlinear, table):
    lines = list(csv.DictReader(io.StringIO(table.write("csv"))))
    for line in lines:
        records = records_of(nonlinear, line)
        assert float(line["seconds"]) == np.mean([record.seconds for record in records])
        assert int(line["peak_memory_bytes"]) == max(record.peak_memory_bytes for record in records)


def test_a_failed_run_counts_and_is_said_once_with_its_seed(table):
    notes = [note for note in table.notes if note.text == REASON]
    assert [note.about for note in notes] == ["Cantilever, end shear, ndf, seed 1 (failed)"]


def test_iterations_that_nobody_counted_are_no_number(nonlinear):
    bare = {
        record.run_id: record.model_copy(
            update={"history": tuple(step.model_copy(update={"iterations": None}) for step in record.history)}
        )
        for record in nonlinear.records
    }
    found = effort_table(Evidence(bare, nonlinear.rows, None))
    assert found.data["iterations"].isna().all()
    assert " nan " not in found.write("text").lower()
    assert "<NA>" not in found.write("markdown")


def test_without_paths_there_is_no_table(store):
    assert effort_table(Evidence({record.run_id: record for record in store.records}, store.rows, None)).data.empty
