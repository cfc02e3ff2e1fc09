"""The report of large displacements as a whole: its sections, its files, and one set of numbers in all of them."""

import html
import json
import re

import pytest

from shellbench.bench.store.store import Store as Records
from shellbench.report.data.evidence import Evidence
from shellbench.report.page.page import write_report
from shellbench.report.studies.strains import strain_table
from shellbench.report.studies.trace_tables import effort_table
from tests.report.conftest import Store, coarse_figures
from tests.report.nonlinear import REASON
from tests.report.test_page import Page, pages_of

FIGURES = (
    "curve_cantilever_shear",
    "curve_hinged_roof_thick",
    "states_cantilever_shear",
    "strain_rolled_plate",
    "strain_cantilever_shear",
)


@pytest.fixture(scope="module")
def report(nonlinear: Store, tmp_path_factory: pytest.TempPathFactory):
    with coarse_figures():
        out = tmp_path_factory.mktemp("nonlinear_report")
        return write_report(Records(nonlinear.folder), nonlinear.rows, out, nonlinear.known_values)


def kind_of(name: str) -> str:
    """Return the format of a figure: pictures as PNG, drawings as SVG."""
    return "png" if name.startswith("states_") else "svg"


def cells(text: str) -> str:
    """Text without mark-up, numbers as they are read."""
    return " ".join(html.unescape(re.sub(r"<[^>]*>", " ", text)).split())


def test_the_page_has_the_paths_and_the_strains(report):
    pages = pages_of(report)
    assert not any(Page(text).open for text in pages.values())
    page = Page("".join(pages.values()))
    targets = {attributes["id"] for _, attributes in page.tags if "id" in attributes}
    assert {"paths", "strains", "table-effort"} <= targets
    assert {a["href"][1:] for t, a in page.tags if t == "a" and a["href"].startswith("#")} <= targets
    pictures = [a for t, a in page.tags if t == "img"]
    assert all(len(picture["alt"]) > 20 for picture in pictures)
    linked = {a["href"] for t, a in page.tags if t == "a"}
    for name in FIGURES:
        assert f"figures/{name}.pdf" in linked
        assert (report.parent / "figures" / f"{name}.pdf").read_bytes().startswith(b"%PDF")
        kept = report.parent / "figures" / f"{name}.{kind_of(name)}"
        assert kept.read_bytes().startswith(b"\x89PNG" if kind_of(name) == "png" else b"<?xml")
    downloads = {a["href"] for t, a in page.tags if t == "a" and not a["href"].startswith(("#", "https", "data:"))}
    assert {"effort.csv", "strains.csv"} <= downloads
    assert all((report.parent / name.partition("#")[0]).is_file() for name in downloads)


def test_markdown_shows_every_figure_and_table(report):
    text = (report.parent / "report.md").read_text(encoding="utf-8")
    for name in FIGURES:
        assert f"(figures/{name}.{kind_of(name)})" in text
    assert "## Iterations and seconds" in text
    assert "## Strain measures" in text
    assert REASON in text


def test_each_table_stands_in_every_file_with_the_same_cells(nonlinear, report):
    by_id = {record.run_id: record for record in nonlinear.records}
    for table in (
        effort_table(Evidence(by_id, nonlinear.rows, None)),
        strain_table(Evidence({}, nonlinear.rows, None)),
    ):
        assert table.write("markdown") in (report.parent / "report.md").read_text(encoding="utf-8")
        assert table.write("html") in "".join(pages_of(report).values())
        assert table.write("latex") in (report.parent / "table.tex").read_text(encoding="utf-8")
        assert (report.parent / f"{table.name}.csv").read_text(encoding="utf-8") == table.write("csv")


def test_json_has_every_value_of_the_records(nonlinear, report):
    found = json.loads((report.parent / "table.json").read_text(encoding="utf-8"))
    values = {(d["run_id"], d["quantity"]): d["value"] for d in found if d["value"] is not None}
    assert values == {
        (record.run_id, name): measured.value
        for record in nonlinear.records
        for name, measured in record.values.items()
    }


def test_a_partly_failed_run_keeps_what_it_finished(nonlinear, report):
    rows = {row.quantity: row for row in nonlinear.rows if row.run_id == "cantilever_shear-ndf--1"}
    assert rows["deflection_2"].value is not None
    assert rows["deflection_4"].value is None
    assert {row.status for row in rows.values()} == {"failed"}
    assert not any(row.passed for row in rows.values())
    assert cells("".join(pages_of(report).values())).count(REASON) >= 2


def test_zero_is_judged_in_absolute_terms(nonlinear):
    exact = next(row for row in nonlinear.rows if row.case == "rigid_rotation" and row.label == "exact" and row.primary)
    assert (exact.reference, exact.relative_error, exact.tolerance_is_absolute) == (0.0, None, True)
    assert exact.absolute_error == exact.value == 2e-12
    assert exact.passed
