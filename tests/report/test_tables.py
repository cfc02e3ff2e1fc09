"""The same numbers stand in every format, and they are the records' numbers."""

import csv
import html
import io
import re
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest

from shellbench.bench.catalogue.reference import KnownValue, KnownValues
from shellbench.report.data.table import Table
from shellbench.report.sections.tables import displacement_tables, render
from tests.report.conftest import COURSE, TRUTH, UNCERTAINTY, Store, missing_of_course, row

SUPERSCRIPTS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
MARKUP_FORMATS = ("markdown", "latex", "html")
VALUE, OWN, ERROR, WORST, TOLERANCE, VERDICT, UNKNOWNS, SECONDS = -9, -8, -7, -6, -5, -4, -3, -2


def number(cell: str) -> tuple[float, float] | None:
    """A printed number and half a unit of its last digit; percents as fractions."""
    text = html.unescape(re.sub(r"<sup>(.*?)</sup>", r"e\1", cell)).replace("×10e", "e")
    text = re.sub(r"×10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)", lambda m: "e" + m[1].translate(SUPERSCRIPTS), text)
    text = re.sub(r"\\times10\^\{(-?\d+)\}", r"e\1", text)
    text = re.sub(r"<.*?>|[$*\\\s]|\(\d+\)|textbf|[{}]", "", text.replace("−", "-")).replace("\\,", "").replace(",", "")
    found = re.fullmatch(r"([+-]?\d+)(\.\d+)?(?:e(-?\d+))?(%?)", text)
    if not found:
        return None
    power = float(f"1e{found[3] or 0}") * (0.01 if found[4] else 1.0)
    decimals = len(found[2] or ".") - 1
    return float(found[1] + (found[2] or "")) * power, 0.5 * 10.0**-decimals * power


COLUMNS = (
    *("Solution", "Theory", "Seeds", "Value", "Uncertainty", "Error", "Worst"),
    *("Tolerance", "Verdict", "Unknowns", "Time", "Memory"),
)


class Cells(HTMLParser):
    """Rows of cells of all tables in a page, markup of cells kept."""

    def __init__(self) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.inside = False

    def handle_starttag(self, tag, attrs):
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")
            self.inside = True
        elif tag == "sup":
            self.handle_data("<sup>")

    def handle_endtag(self, tag):
        if tag in ("td", "th"):
            self.inside = False
        elif tag == "sup":
            self.handle_data("</sup>")

    def handle_data(self, data):
        if self.inside:
            self.rows[-1][-1] += data


def lines(text: str, format: str) -> list[list[str]]:
    """Rows of a table in a format: block headings are rows with one cell that is not empty."""
    if format == "html":
        parser = Cells()
        parser.feed(text)
        return parser.rows
    if format == "markdown":
        return [[c.strip() for c in line[1:-1].split(" | ")] for line in text.splitlines() if line.startswith("|")]
    if format == "latex":
        body = text.partition(r"\toprule")[2].partition(r"\bottomrule")[0]
        return [re.split(r"(?<!\\)&", line.rstrip("\\ ")) for line in body.splitlines() if line.strip().endswith(r"\\")]
    return [re.split(r"\s{2,}", line.strip()) for line in text.splitlines() if line.startswith("  ")]


def whole(rows: list[list[str]], format: str) -> list[list[str]]:
    """Rows of the course's table with the columns that a page leaves out, for nothing stands in them."""
    heads = [head.strip() for head in rows[0]]
    absent = [number for number, name in enumerate(COLUMNS) if not any(head.startswith(name) for head in heads)]
    for line in rows if format == "html" else ():
        for number in absent if len(line) == len(heads) else ():
            line.insert(number, "–")
    return rows


def solver_lines(text: str, format: str) -> dict[tuple[str, str], list[str]]:
    """Lines of solvers by case and solver."""
    titles = {"Square plate": COURSE[0], "Scordelis": COURSE[1], "rigid": COURSE[2], "free ends": COURSE[3]}
    found, case = {}, ""
    if format == "text":  # a heading is not indented
        parts = [([line], not line.startswith(" ")) for line in text.splitlines()]
        rows = [([p[0]], True) if head else (re.split(r"\s{2,}", p[0].strip()), False) for p, head in parts]
    else:
        rows = [(row, sum(bool(c.strip()) for c in row) == 1) for row in whole(lines(text, format), format)]
    for cells, heading in rows:
        if heading:
            case = next((name for words, name in titles.items() if words in " ".join(cells)), case)
        name = re.sub(r"\\texttt\{(.*)\}|`(.*)`", r"\1\2", cells[0].strip())
        if name in ("fem", "ndf", "ndf-ritz"):
            found[case, name] = cells
    return found


@pytest.fixture(scope="module")
def course_rows(store: Store):
    return [row for row in store.rows if row.suite == "obstacle_course"]


def test_values_have_as_many_digits_as_their_errors_and_spreads_ask_for(store, course_rows):
    """That they are right is shown by tests/report/test_formats_agree.py."""
    written = solver_lines(render(course_rows, "text", store.known_values), "text")
    assert set(written) == {(case, solver) for case in COURSE for solver in ("fem", "ndf", "ndf-ritz")}
    for (case, solver), cells in written.items():
        values = [r.value for r in course_rows if (r.case, r.solver) == (case, solver) and r.value is not None]
        spread = np.std(values, ddof=1) if len(values) > 1 else 0.0
        error = abs(np.mean(values) - TRUTH[case])
        assert number(cells[VALUE])[1] <= max(0.06 * error, UNCERTAINTY * TRUTH[case], spread)


@pytest.mark.parametrize("format", ["text", *MARKUP_FORMATS])
def test_failed_late_and_missing_runs_are_said_with_their_reason(store, course_rows, format):
    text = html.unescape(render(course_rows, format, store.known_values)).replace("\\", "")
    written = solver_lines(render(course_rows, format, store.known_values), format)
    assert "fail" in written["scordelis_lo", "ndf"][VERDICT]
    assert "missing" in written["pinched_cylinder_diaphragm", "ndf"][VERDICT]
    assert "run failed" in written["pinched_cylinder_free", "ndf"][VERDICT]
    assert "pass" in written["square_plate", "ndf"][VERDICT]
    for reason in ("no record of this run is in the store", "beyond the bound of 1 %", "it took longer than 60 s"):
        assert reason in text


def test_one_bad_seed_spoils_the_verdict_of_its_line(store, course_rows):
    of_roof = [row for row in course_rows if row.case == "scordelis_lo" and row.solver == "ndf"]
    assert [row.passed for row in of_roof] == [True, False, True]
    data = displacement_tables(of_roof, store.known_values)[0].data
    assert data.loc[data["kind"] == "solver", "verdict"].tolist() == ["fail"]


def test_an_expected_failure_is_neither_pass_nor_fail(store, course_rows):
    finding = course_rows[0].model_copy(update={"passed": None, "open_finding": "known to drift"})
    text = render([finding], "text", store.known_values)
    assert "expected failure" in text
    assert "known to drift" in text


def test_known_values_stand_beside_with_theory_and_source(store, course_rows):
    text = render(course_rows, "markdown", store.known_values)
    assert "book_1985" in text
    assert "mixed theories" in text
    assert "elements shear" in text  # the note that explains the difference
    assert "0.48750000(10)" in text  # the judge with its uncertainty
    latex = render(course_rows, "latex", store.known_values)
    assert r"\cite{series1900}" in latex
    assert "linear Kirchhoff--Love" in latex.partition(r"\label")[0]  # the caption says what judges


def test_a_variants_published_figure_stands_only_beside_the_variant(store):
    course = render([row for row in store.rows if row.suite == "obstacle_course"], "text", store.known_values)
    ablations = render([row for row in store.rows if row.suite == "ablations"], "text", store.known_values)
    assert "GELU, published" not in course
    assert "GELU, published" in ablations
    assert "not gated" in ablations
    assert "ndf-ritz, GELU" in ablations


def test_an_error_below_the_known_values_uncertainty_is_marked(store, course_rows):
    cells = solver_lines(render(course_rows, "text", store.known_values), "text")
    assert cells["square_plate", "fem"][ERROR].endswith("*")
    assert not cells["square_plate", "ndf"][ERROR].endswith("*")


def test_without_a_known_value_the_disagreement_is_reported(store):
    lonely = [
        row.model_copy(
            update={
                "reference": None,
                "reference_uncertainty": None,
                "relative_error": None,
                "absolute_error": None,
                "passed": None,
                "tolerance": None,
                "own_case": True,
                "disagreement": None if row.solver == "fem" else 0.0123,
                "disagreement_with": None if row.solver == "fem" else "fem",
            }
        )
        for row in store.rows
        if row.case == "square_plate" and row.seed in (None, 0) and not row.label
    ]
    text = render(lonely, "text", store.known_values)
    assert "no known value; differs by +1.2 % from fem" in text
    assert "book" not in text  # a user's own case has none of the suite's figures


def test_near_zero_references_are_judged_in_absolute_terms(store, course_rows):
    tiny = course_rows[0].model_copy(
        update={
            "reference": 0.0,
            "relative_error": None,
            "absolute_error": 3e-9,
            "tolerance": 1e-8,
            "tolerance_is_absolute": True,
        }
    )
    text = render([tiny], "text", lambda name: KnownValues())
    assert "3.00e-9 m" in text or "3.0e-9 m" in text
    assert "1e-8 m" in text


def test_hostile_words_are_harmless_everywhere(store, course_rows):
    words = '<img src=x onerror=alert(1)> | \\input{x} $y$ & 5% "q" _z_\n# new'
    hostile = course_rows[0].model_copy(
        update={
            "case_title": words,
            "description": words,
            "reason": words,
            "passed": False,
            "unit": words,
            "case": "hostile",
        }
    )
    facts = {"theory": "mixed", "origin": words, "source": "a}\\evil", "note": words, "label": words}
    known = KnownValues(values=(KnownValue(quantity=hostile.quantity, role="literature", value=1.0, **facts),))
    page = render([hostile], "html", lambda name: known)
    assert "<img" not in page
    latex = render([hostile], "latex", lambda name: known)
    assert "\\input" not in latex
    assert "\\evil" not in latex
    markdown = render([hostile], "markdown", lambda name: known)
    widths = {len(re.findall(r"(?<!\\)\|", line)) for line in markdown.splitlines() if line.startswith("|")}
    assert len(widths) == 1
    assert not re.search(r"(?<!\\)<img", markdown)
    assert "\n# new" not in markdown


def test_nothing_at_all_is_still_a_table():
    for format in ("text", "markdown", "latex", "csv", "html", "json"):
        assert isinstance(render([], format), str)


def test_a_case_where_every_run_is_missing(store):
    lost = missing_of_course("square_plate", "ndf", 0).model_copy(update={"reference": None, "settings": {}})
    text = render([lost], "text", store.known_values)
    assert "missing" in text


def test_a_later_seed_joins_the_line_of_its_solver(store):
    records = [r for r in store.records if r.case_name == "square_plate" and r.identity.solver == "ndf-ritz"]
    plain = [row(r, 1e-3) for r in records if r.identity.settings == {"width": 600}]
    data = displacement_tables(plain, store.known_values)[0].data
    assert data.loc[data["kind"] == "solver", "seeds"].tolist() == ["0 1 2"]
    assert data.loc[data["kind"] == "solver", "run_ids"].tolist() == [" ".join(r.run_id for r in plain)]


@pytest.mark.parametrize("format", ["text", *MARKUP_FORMATS])
def test_cases_stand_in_the_order_of_their_suite(store, course_rows, format):
    text = html.unescape(render(sorted(course_rows, key=lambda row: row.case), format, store.known_values))
    body = text[: text.index("The book's figure")]  # without the remarks
    places = [
        body.index(words) for words in ("Square plate: ", "Scordelis-Lo roof: ", "rigid diaphragms: ", "free ends: ")
    ]
    assert places == sorted(places)


FORMULAS = ["=1+1", "+cmd", "-2+3", "@SUM(A1)", "\t=1", " =1", "\n=1", "-", "=HYPERLINK(0)"]
PLAIN = ["-1.5e-3", "+2", "-.5", "word", "a=b", "x-1", "", "'quoted"]


def test_a_carriage_return_does_not_begin_a_formula_in_csv() -> None:
    written = Table("t", "", "", pd.DataFrame({"text": ["word\r=1", "\r=1"]}), ()).write("csv")
    assert written == "text\nword =1\n' =1\n"


def test_no_cell_of_csv_is_a_formula_to_a_spreadsheet() -> None:
    """Text that begins like a formula is quoted; numbers and other text stay as they are."""
    data = pd.DataFrame(
        {"text": FORMULAS + PLAIN, "=key": [-1.0] * 9 + [None] * 8, "mixed": [None, -2, "=1", -0.5] + [1] * 13}
    )
    written = Table("t", "", "", data, ()).write("csv")
    read = list(csv.DictReader(io.StringIO(written, newline="")))
    assert [line["text"] for line in read] == [f"'{text}" for text in FORMULAS] + PLAIN
    assert [line["'=key"] for line in read] == ["-1.0"] * 9 + [""] * 8
    assert [line["mixed"] for line in read] == ["", "-2", "'=1", "-0.5"] + ["1"] * 13


def test_a_solvers_own_uncertainty_is_shown_and_that_it_did_not_converge(store, course_rows):
    stated = {"fem": {"uncertainty": 1.25e-7, "converged": True}, "ndf": {"uncertainty": 3e-6, "converged": False}}
    told = [
        row.model_copy(update=stated.get(row.solver, {}))
        for row in course_rows
        if row.case == "square_plate" and row.primary
    ]
    for format in ("text", "markdown"):
        cells = solver_lines(render(told, format, store.known_values), format)
        assert number(cells["square_plate", "fem"][OWN])[0] == pytest.approx(1.25e-7)
        assert "not converged" not in cells["square_plate", "fem"][OWN]
        assert number(cells["square_plate", "ndf"][OWN].partition(" (")[0])[0] == pytest.approx(3e-6)
        assert "not converged" in cells["square_plate", "ndf"][OWN]
        assert number(cells["square_plate", "ndf-ritz"][OWN]) is None


def test_each_run_is_shown_once_unless_suites_are_asked_for(store, course_rows):
    shared = [row.model_copy(update={"suites": ("obstacle_course", "ablations")}) for row in course_rows]
    headings = ["Obstacle course", "Ablations"]
    once = render(shared, "text", store.known_values)
    assert [once.count(words) for words in headings] == [1, 0]
    whole = render(shared, "text", store.known_values, whole=True)
    assert [whole.count(words) for words in headings] == [1, 1]
