"""Every number that a table prints, in any format, is the records' number, rounded to the digits printed.

The expected figures are computed here from records and known values, not by the report. The comparison itself is put to
the test: a digit changed in any cell must be found.
"""

import csv
import html
import io
import json
import re
from collections.abc import Iterator

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.store import store as bench
from shellbench.report.data.evidence import Evidence
from shellbench.report.page.page import write_report
from shellbench.report.sections.resolution import resolution_table
from shellbench.report.sections.tables import displacement_tables, render
from tests.report.conftest import COURSE, Store
from tests.report.test_tables import lines, number

PRINTED = ("text", "markdown", "latex", "html")
COLUMNS = ("Value", "Error", "Worst seed", "Tolerance", "Unknowns", "Time (s)", "Memory")
UNITS = {"B": 1.0, "kB": 1e3, "MB": 1e6, "GB": 1e9}
SLACK = 1e-6  # of half a digit: what adding doubles in another order changes
Line = dict[str, float]
Expected = dict[tuple[str, str], Line]
Grid = dict[tuple[str, str], dict[str, str]]


def expected_lines(store: Store) -> Expected:
    """Expected content of each line of the table of the course, from the records; by case and solution."""
    found: Expected = {}
    rows = [row for row in store.rows if row.suite == "obstacle_course"]
    records = {record.run_id: record for record in store.records}
    for case in COURSE:
        quantity = catalog.named_case(case).primary.name
        known = store.known_values(case).values
        truth = next(value.value for value in known if value.role == "judge")
        for value in known:
            if not value.label:
                name = {"judge": "Converged"}.get(value.role, value.role)
                error = {} if value.role == "judge" else {"Error": value.value / truth - 1}
                found[case, name] = {"Value": value.value, **error}
        for solver in ("fem", "ndf-ritz", "ndf"):
            of_line = [row for row in rows if (row.case, row.solver) == (case, solver)]
            made = [records[row.run_id] for row in of_line if row.run_id]
            values = [record.values[quantity].value for record in made if record.values]
            errors = [value / truth - 1 for value in values]
            tolerance = of_line[0].tolerance
            assert tolerance is not None
            found[case, solver] = {
                "Value": float(np.mean(values)),
                "Error": float(np.mean(errors)),
                **({"Worst seed": max(errors, key=abs)} if len(errors) > 1 else {}),
                "Tolerance": tolerance,
                "Unknowns": max(record.parameters or 0 for record in made),
                "Time (s)": float(np.mean([record.seconds for record in made])),
                "Memory": max(record.peak_memory_bytes or 0 for record in made),
            }
    return found


def words(cell: str) -> str:
    """A cell without markup."""
    plain = re.sub(r"<.*?>|\\(texttt|textbf|emph)|[{}*`$\\]", "", cell)
    return html.unescape(plain).replace("&", "").strip()


def grid(text: str, format: str) -> Grid:
    """Cells of a printed table by case and solution, and by heading."""
    if format == "text":
        listed = [
            re.split(r"\s{2,}", line.strip()) if line.startswith(" ") else [line]
            for line in text.splitlines()
            if line and not line.startswith("---")
        ]
    else:
        listed = lines(text, format)
    titles = {catalog.named_case(name).title: name for name in COURSE}
    heads: list[str] = []
    case, found = "", {}
    for cells in listed:
        filled = [words(cell) for cell in cells]
        if filled[0] == "Solution":
            heads = filled
        elif sum(map(bool, filled)) == 1:
            text_of = re.sub(r"^multicolumn\d+l", "", filled[0])
            case = next((name for title, name in titles.items() if text_of.startswith(title)), case)
        elif heads and case:
            name = re.sub(r"( ?\[\w+\]| ?cite\w+)$", "", filled[0])
            # In text a cell with nothing in it leaves no trace: known values have but value and error.
            known = [heads[0], "Value", "Error"]
            of_line = heads if len(cells) == len(heads) else known
            found[case, name] = dict(zip(of_line, cells, strict=False))
    return found


def size(cell: str) -> tuple[float, float] | None:
    """A number of bytes, and half a unit of its last digit."""
    parts = re.fullmatch(r"([\d.]+)[\s~]*(B|kB|MB|GB)", words(cell.replace("\\,", " ")))
    if not parts:
        return None
    decimals = len(parts[1].partition(".")[2])
    return float(parts[1]) * UNITS[parts[2]], 0.5 * 10.0**-decimals * UNITS[parts[2]]


def misprints(text: str, format: str, expected: Expected) -> list[str]:
    """Return the differences between a printed table and the records, omissions included."""
    found = grid(text, format)
    wrong = [f"{key} is not printed" for key in expected if key not in found]
    wrong += [f"{key} is printed" for key in found if key not in expected]
    for key in set(found) & set(expected):
        for column in COLUMNS:
            cell = found[key].get(column, "")
            read = size(cell) if column == "Memory" else number(cell)
            value = expected[key].get(column)
            agree = read is value is None
            if read is not None and value is not None:
                agree = abs(read[0] - value) <= read[1] * (1 + SLACK)
            if not agree:
                wrong.append(f"{key} {column}: {cell!r}, and the records say {value}")
    return wrong


def misprints_of_csv(text: str, expected: Expected) -> list[str]:
    """The same of CSV, which has every digit."""
    columns = {
        "Value": "value", "Error": "mean_error", "Worst seed": "worst_error", "Tolerance": "tolerance",
        "Unknowns": "parameters", "Time (s)": "seconds", "Memory": "peak_memory_bytes",
    }  # fmt: skip
    wrong, seen = [], set()
    for line in csv.DictReader(io.StringIO(text)):
        key = line["case"], line["solution"]
        seen.add(key)
        for column, value in expected.get(key, {}).items():
            read = float(line[columns[column]])
            if not np.isclose(read, value, rtol=1e-12, atol=1e-15):
                wrong.append(f"{key} {column}: {read}, and the records say {value}")
    return wrong + [f"{key} is not there" for key in set(expected) ^ seen]


def misprints_of_json(text: str, store: Store) -> list[str]:
    """The same of JSON, an object a run."""
    records = {record.run_id: record for record in store.records}
    wrong = []
    for found in json.loads(text):
        if found["run_id"] is None:
            continue
        record = records[found["run_id"]]
        measured = record.values.get(found["quantity"])
        truth = store.known_values(record.case_name).judge(found["quantity"], "kirchhoff-love-linear")
        assert truth is not None
        said = {
            "value": measured.value if measured else None,
            "reference": truth.value,
            "relative_error": measured.value / truth.value - 1 if measured else None,
            "seconds": record.seconds,
            "parameters": record.parameters,
            "peak_memory_bytes": record.peak_memory_bytes,
            "storage_bytes": record.storage_bytes,
            "seed": record.identity.seed,
        }
        wrong += [f"{record.run_id} {name}" for name, value in said.items() if found[name] != value]
    return wrong


def with_other_digit(cell: str) -> str | None:
    """A cell with its first digit that is not zero changed; None if it has none."""
    at = re.search(r"[1-9]", cell)
    return f"{cell[: at.start()]}{int(at[0]) % 9 + 1}{cell[at.end() :]}" if at else None


def mutants(text: str, format: str, expected: Expected) -> Iterator[str]:
    """The text with one number changed, for each number that stands in it once."""
    for key, cells in grid(text, format).items():
        for column in expected.get(key, {}):
            cell = cells[column]
            changed = with_other_digit(cell)
            if changed and text.count(cell) == 1:
                yield text.replace(cell, changed)


@pytest.fixture(scope="module")
def rows(store: Store):
    return [row for row in store.rows if row.suite == "obstacle_course"]


@pytest.mark.parametrize("format", PRINTED)
def test_every_printed_number_is_the_records(store: Store, rows, format: str) -> None:
    text = render(rows, format, store.known_values)
    assert misprints(text, format, expected_lines(store)) == []


def test_csv_and_json_have_the_records_digits(store: Store, rows) -> None:
    assert misprints_of_csv(render(rows, "csv", store.known_values), expected_lines(store)) == []
    assert misprints_of_json(render(rows, "json", store.known_values), store) == []


@pytest.mark.parametrize("format", PRINTED)
def test_a_changed_digit_is_found(store: Store, rows, format: str) -> None:
    text, expected = render(rows, format, store.known_values), expected_lines(store)
    changed = list(mutants(text, format, expected))
    assert len(changed) > 20
    assert all(misprints(mutant, format, expected) for mutant in changed)


def test_a_changed_digit_is_found_in_csv_and_json(store: Store, rows) -> None:
    expected = expected_lines(store)
    for format in ("csv", "json"):
        text = render(rows, format, store.known_values)
        number_in_it = repr(next(iter(store.records)).values[rows[0].quantity].value)
        changed = text.replace(number_in_it, with_other_digit(number_in_it) or "", 1)
        assert changed != text
        found = misprints_of_csv(changed, expected) if format == "csv" else misprints_of_json(changed, store)
        assert found, format


def test_a_line_that_is_lost_or_moved_is_found(store: Store, rows) -> None:
    expected = expected_lines(store)
    lost = render([row for row in rows if row.solver != "fem"], "markdown", store.known_values)
    assert len(misprints(lost, "markdown", expected)) == len(COURSE)


def numbers_of(text: str, format: str) -> list[tuple[float, float]]:
    """All numbers in the cells of a table, in order."""
    return [read for row in lines(text, format) for cell in row if (read := number(cell) or size(cell))]


def test_other_tables_print_the_same_numbers_in_all_formats(store: Store, nonlinear: Store) -> None:
    found = []
    for made in (store, nonlinear):
        evidence = Evidence({record.run_id: record for record in made.records}, made.rows, made.folder)
        found.append(resolution_table(evidence))
        found += displacement_tables(made.rows, made.known_values)
    tables = [table for table in found if len(table.data)]
    assert len(tables) > 3
    for table in tables:
        of_markup = [numbers_of(table.write(format), format) for format in ("markdown", "html", "latex")]
        assert of_markup[0]
        assert of_markup[0] == of_markup[1] == of_markup[2], table.name


def test_resolution_is_printed_as_recorded(store: Store) -> None:
    records = {record.run_id: record for record in store.records}
    table = resolution_table(Evidence(records, [row for row in store.rows if row.solver == "fem"], store.folder))
    assert len(table.data)
    heads, *rows = lines(table.write("markdown"), "markdown")
    seen = 0
    for row in rows:
        for head, cell in zip(heads, row, strict=True):
            if words(row[0]) == "fem" and (mesh := re.fullmatch(r"Mesh (\d+)×\1", head)):
                step = next(s for s in store.records[0].resolution if s.points == int(mesh[1]))
                share = step.interpolation_difference / step.largest_displacement  # the same in all of these records
                read, half = number(cell) or (np.nan, 0.0)
                assert abs(read - share) <= half * (1 + SLACK)
                seen += 1
    assert seen == 4 * len(COURSE)


@pytest.mark.long
def test_the_files_of_a_report_agree_with_the_records(store: Store, tmp_path) -> None:
    """Apply the same test to the files of `shellbench report`, including the page."""
    rows = [row for row in store.rows if row.suite == "obstacle_course"]
    write_report(bench.Store(store.folder), rows, tmp_path, store.known_values, for_print=False)
    expected = expected_lines(store)
    places = {
        ("report.md", "markdown"): ("## Displacements", "\n## "),
        ("obstacle_course.html", "html"): ('<table id="table-displacements_obstacle_course"', "</table>"),
        ("table.tex", "latex"): (r"\label{tab:displacements-obstacle-course}", r"\end{table*}"),
    }
    for (file, format), (begin, end) in places.items():
        text = (tmp_path / file).read_text(encoding="utf-8").partition(begin)[2].partition(end)[0]
        assert misprints(begin + text, format, expected) == [], file
    assert misprints_of_csv((tmp_path / "table.csv").read_text(encoding="utf-8"), expected) == []
    assert misprints_of_json((tmp_path / "table.json").read_text(encoding="utf-8"), store) == []
