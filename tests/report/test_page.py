import base64
import gzip
import hashlib
import html
import json
import re
import subprocess
import sys
from html.parser import HTMLParser
from io import BytesIO
from pathlib import Path
from urllib.parse import unquote
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from PIL import Image

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.row import Row
from shellbench.bench.store.store import Store as Records
from shellbench.errors import InputError
from shellbench.report.data.columns import Column
from shellbench.report.data.document import command
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import Exhibit, few_colours, shrink_svg
from shellbench.report.data.runs import rows_at_home, rows_of, suites_of
from shellbench.report.data.section import Section
from shellbench.report.data.solutions import overall, shortfalls, verdict
from shellbench.report.data.table import Note, Table
from shellbench.report.page import sections
from shellbench.report.page.page import write_report
from shellbench.report.sections.tables import render
from tests.report.conftest import COURSE, Store, coarse_figures

MEGABYTE = 1_000_000
VOID = {"meta", "img", "br", "link", "hr"}


@pytest.fixture
def report(course_report: Path) -> Path:
    return course_report


class Page(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] not in ("style", "script"):
            self.words.append(data)


def pages_of(report: Path) -> dict[str, str]:
    """The text of the start page and of the pages that it links to, by name of file."""
    return {path.name: path.read_text(encoding="utf-8") for path in sorted(report.parent.glob("*.html"))}


@pytest.fixture
def course(report) -> Path:
    return report.parent / "obstacle_course.html"


def test_the_pages_stand_alone(report):
    pages = {name: Page(text) for name, text in pages_of(report).items()}
    assert {"index.html", "obstacle_course.html", "ablations.html"} <= set(pages)
    targets = {
        f"{name}#{attributes['id']}"
        for name, page in pages.items()
        for _, attributes in page.tags
        if "id" in attributes
    }
    for name, page in pages.items():
        assert not page.open  # every element is closed
        for tag, attributes in page.tags:
            assert tag not in ("link", "iframe", "object", "form")
            assert tag != "script" or "src" not in attributes
            assert not any(key.startswith("on") for key in attributes)  # the policy would refuse it
            if tag == "img":
                assert attributes["src"].startswith("data:image/")
            if tag == "a" and not attributes["href"].startswith("data:text/"):
                file, hash_, _ = attributes["href"].partition("#")
                assert file.startswith("https://") or (report.parent / (file or name)).is_file()
                assert (
                    not hash_
                    or file.startswith("https://")
                    or f"{name if not file else ''}{attributes['href']}" in targets
                )


def test_every_page_is_linked_from_every_page(report):
    pages = pages_of(report)
    for text in pages.values():
        assert set(pages) <= {a["href"] for tag, a in Page(text).tags if tag == "a"}


def test_what_has_nothing_to_say_is_absent(report):
    pages = pages_of(report)
    for name in ("displacements", "convergence", "shells", "quantities"):
        empty = {file for file, text in pages.items() if f'<section id="{name}">' in text and f"#{name}" not in text}
        assert not empty
    assert '<section id="convergence">' in pages["obstacle_course.html"]
    assert '<section id="convergence">' not in pages["ablations.html"]
    assert '<section id="quantities">' not in "".join(pages.values())
    head = re.search(r'id="table-displacements_ablations".*?</thead>', pages["ablations.html"], re.DOTALL)[0]
    assert ">Error<" in head
    assert ">Tolerance<" not in head  # nobody holds an ablation to one


def test_errors_stand_over_what_is_allowed(course):
    text = course.read_text(encoding="utf-8").partition('id="glance"')[2].partition("</table>")[0]
    assert "<b>−1.0×10<sup>−6</sup>\u202f%</b><span>pass · 1.5\xa0s</span>" in text
    assert "<b>+0.20\u202f%</b><span>fail, 0.1 % allowed · 3.2\xa0s</span>" in text


@pytest.mark.parametrize("name", ["index.html", "obstacle_course.html"])
def test_the_page_can_be_heard(report, name):
    page = Page((report.parent / name).read_text(encoding="utf-8"))
    tags = page.tags
    assert ("html", {"lang": "en"}) in tags
    assert all(len(attributes.get("alt") or "") > 20 for tag, attributes in tags if tag == "img")
    count = {tag: sum(t == tag for t, _ in tags) for tag in ("table", "caption", "main", "h1")}
    assert count["table"] == count["caption"] > 0
    assert count["main"] == count["h1"] == 1
    assert all(attributes.get("scope") in ("col", "row", "rowgroup") for tag, attributes in tags if tag == "th")


def test_the_verdict_comes_first_and_is_right(report, course, store):
    words = "".join(Page(report.read_text(encoding="utf-8")).words)
    of_course = "".join(Page(course.read_text(encoding="utf-8")).words).partition("Verdict.")[2]
    gated = [row for row in store.rows if row.passed is not None]
    held = [row for row in gated if row.passed]
    without = [row for row in gated if not row.passed and row.status != "ok"]
    short = len(gated) - len(held) - len(without)
    assert short
    assert without
    sentence = f"{len(held)} of {len(gated)} gated values pass; {short} fails; {len(without)} have no answer"
    assert sentence in words
    assert words.partition("Verdict.")[2].index(sentence) < words.partition("Verdict.")[2].index("Square plate")
    assert of_course.index(sentence) < of_course.index("Square plate") < of_course.index("Displacements")
    assert sentence in (report.parent / "report.md").read_text(encoding="utf-8")


def test_the_glance_has_a_line_for_each_case_and_a_column_for_each_solver(report, course):
    lines = (report.parent / "report.md").read_text(encoding="utf-8").splitlines()
    start = lines.index("| Case | `fem` | `ndf-ritz` | `ndf` |")
    assert [line.split("|")[1].strip() for line in lines[start + 2 : start + 6]] == [
        catalog.named_case(case).title for case in COURSE
    ]
    roof = next(line for line in lines[start:] if line.startswith("| Scordelis-Lo roof |")).split("|")
    assert [re.search("pass|fail", cell)[0] for cell in roof[2:5]] == ["pass", "pass", "fail"]
    text = course.read_text(encoding="utf-8").partition('id="glance"')[2]
    head = re.search(r"<thead><tr>(.*?)</tr>", text)[1]
    assert re.findall("<code>(.*?)</code>", head) == ["fem", "ndf-ritz", "ndf"]
    verdicts = re.findall(r'<span class="(\w+)">(.*?)</span>', head)
    assert verdicts == [("good", "4 of 4 pass"), ("good", "12 of 12 pass"), ("bad", "8 of 12 pass")]


@pytest.mark.parametrize("name", ["index.html", "report.md"])
def test_bad_runs_are_named_with_their_reasons(report, name):
    text = html.unescape((report.parent / name).read_text(encoding="utf-8")).replace("\\", "")
    for words in ("no record of this run is in the store", "the quadrature gap of 3 %", "it took longer than 60 s"):
        assert words in text


@pytest.mark.parametrize("name", ["index.html", "report.md"])
def test_each_run_can_be_traced(report, store, name):
    text = html.unescape((report.parent / name).read_text(encoding="utf-8"))
    for record in store.records:
        assert record.run_id in text
    assert "shellbench run square_plate --solver ndf-ritz --seed 2" in text
    assert "synthetic processor" in text
    assert "commit 000000000000" in text


def test_every_file_is_there(report, store):
    folder = report.parent
    names = {path.name for path in folder.rglob("*") if path.is_file()}
    assert {"index.html", "report.md", "table.csv", "table.tex", "table.json", "resolution.csv", "fields.csv"} <= names
    for stem in (
        "course_obstacle_course",
        *(f"shell_{case}" for case in COURSE),
        "convergence_obstacle_course_refinement",
    ):
        assert (folder / "figures" / f"{stem}.pdf").read_bytes().startswith(b"%PDF")
        vector = stem.startswith("convergence")
        file = folder / "figures" / f"{stem}.{'svg' if vector else 'png'}"
        assert file.read_bytes().startswith(b"<?xml" if vector else b"\x89PNG")
    assert len(json.loads((folder / "table.json").read_text())) == len(store.rows)


def test_drawings_are_embedded_as_vectors(report):
    page = Page("".join(pages_of(report).values()))
    links = [a["src"] for tag, a in page.tags if tag == "img"]
    embedded = [unquote(link.partition(",")[2]) for link in links if link.startswith("data:image/svg+xml,")]
    assert len(embedded) >= 4
    for data in embedded:
        assert ElementTree.fromstring(data).tag == "{http://www.w3.org/2000/svg}svg"


def test_only_the_pages_own_scripts_may_run(report, course):
    text = course.read_text(encoding="utf-8")
    (policy,) = re.findall(r'Content-Security-Policy" content="([^"]*)"', text)
    rules = {name: sources for name, *sources in (rule.split() for rule in html.unescape(policy).split(";"))}
    assert rules["default-src"] == ["'none'"]
    assert not any("unsafe" in source for source in rules["script-src"])
    library = json.loads(re.search(r'"[^"]*"', (report.parent / "plotly.js").read_text())[0])
    run = [*re.findall(r"<script>(.*?)</script>", text, re.DOTALL), gzip.decompress(base64.b64decode(library)).decode()]
    digests = [base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in run]
    assert rules["script-src"] == [*(f"'sha256-{digest}'" for digest in digests), "'self'"]
    assert "'self'" not in re.search(r"script-src ([^\"]*)", html.unescape(report.read_text(encoding="utf-8")))[1]
    assert 'data-library="plotly.js"' in text


def test_each_table_can_be_taken_from_the_page_alone(report, course):
    page = Page(course.read_text(encoding="utf-8"))
    held = {a["download"]: a["href"] for tag, a in page.tags if tag == "a" and "download" in a}
    data = {name: base64.b64decode(link.partition("base64,")[2]).decode() for name, link in held.items()}
    assert data["fields.csv"] == (report.parent / "fields.csv").read_text(encoding="utf-8")
    assert data["displacements_obstacle_course.csv"] in (report.parent / "table.csv").read_text(encoding="utf-8")
    assert data["displacements_obstacle_course.tex"] in (report.parent / "table.tex").read_text(encoding="utf-8")


def test_each_figure_says_how_it_was_made(course, store):
    text = course.read_text(encoding="utf-8")
    figures = re.findall(r"<figure.*?</figure>", text, re.DOTALL)
    assert len(figures) > len(COURSE)
    for figure in figures:
        made = html.unescape(figure.partition("How this was made")[2])
        assert "shellbench report" in made
        assert re.search(r"shellbench run \w+ --solver [\w-]+", made)
        assert 'href="index.html#environment-1"' in made
    picture = next(figure for figure in figures if 'data-case="square_plate"' in figure)
    for solver in ("fem", "ndf-ritz", "ndf"):  # of the picture, and of the view that takes its place
        assert f"shellbench run square_plate --solver {solver}" in picture
    assert "scordelis_lo" not in picture.partition("How this was made")[2]


def test_numbers_are_sorted_at_full_precision(course, store):
    page = Page(course.read_text(encoding="utf-8"))
    kept = {float(a["data-value"]) for tag, a in page.tags if tag == "td" and "data-value" in a}
    for row in store.rows:
        if row.seed is None and row.value is not None:
            assert {row.value, row.relative_error, row.seconds} <= kept


def section_of(evidence: Evidence) -> Section:
    """A section of two runs, drawn and tabled."""
    figure = Figure(figsize=(3, 2))
    figure.subplots().plot([1, 2], [3, 4])
    run = next(iter(evidence.records))
    table = Table(
        name="synthetic_evidence",
        title="Synthetic evidence",
        caption="Counts.",
        data=pd.DataFrame([{"block": "", "name": "all", "count": float(len(evidence.rows)) + 1 / 3}]),
        columns=(
            Column("Name", lambda line, notation: notation.escape(line["name"]), right=False),
            Column("Count", lambda line, notation: f"{line['count']:.0f}", key="count"),
        ),
        notes=(Note("Origin", "A formula.", "kairanda2023"),),
    )
    exhibit = Exhibit("synthetic_drawing", "Drawing", "A line.", "A line that rises to four", figure, (run,), True)
    return Section("synthetic", "A synthetic section", ("First & last words.",), (table,), (exhibit,))


def studied(store: Store) -> list[Row]:
    """The rows of the store, and one run that a study alone declares, and one that a study declares too."""
    first, second = (row for row in store.rows if row.solver == "fem" and row.case in COURSE[:2])
    alone = first.model_copy(
        update={"suites": ("thinness",), "label": "cells 2×2", "overrides": {"cells": 2}, "passed": False, "value": 9.0}
    )
    also = second.model_copy(update={"suites": (*second.suites, "thinness")})
    return [*(row for row in store.rows if row not in (first, second)), alone, also]


@pytest.fixture(scope="module")
def evident(store: Store, tmp_path_factory: pytest.TempPathFactory) -> Path:
    with coarse_figures(), pytest.MonkeyPatch.context() as patched:
        patched.setattr(sections, "MAKERS", (section_of, lambda evidence: None))
        out = tmp_path_factory.mktemp("evident")
        return write_report(Records(store.folder), studied(store), out, store.known_values, for_print=False)


def test_a_section_of_evidence_stands_in_all_files(evident, store):
    text = (evident.parent / "synthetic.html").read_text(encoding="utf-8")
    assert '<a href="#synthetic">A synthetic section</a>' in text
    assert '<a href="synthetic.html">A synthetic section</a>' in evident.read_text(encoding="utf-8")
    section = re.search(r'<section id="synthetic">.*?</section>', text, re.DOTALL)[0]
    count = f"{len(store.rows)}"  # every row, those of studies among them
    assert "First &amp; last words." in section
    assert f">{count}</td>" in section
    assert f'data-value="{len(store.rows) + 1 / 3!r}"' in section
    assert 'alt="A line that rises to four"' in section
    assert f"{len(store.rows) + 1 / 3!r}" in (evident.parent / "synthetic_evidence.csv").read_text()
    assert r"\label{tab:synthetic-evidence}" in (evident.parent / "table.tex").read_text()
    markdown = (evident.parent / "report.md").read_text(encoding="utf-8")
    assert "## A synthetic section" in markdown
    assert "](figures/synthetic_drawing.svg)" in markdown
    assert f"| all | {count} |" in markdown
    assert (evident.parent / "figures" / "synthetic_drawing.svg").is_file()
    assert 'id="source-kairanda2023"' in text


def test_runs_of_studies_alone_are_not_compared(evident, store):
    text = "".join(pages_of(evident).values())
    shown = [row for row in studied(store) if row.suites != ("thinness",)]
    assert overall(shown).words in html.unescape(text)
    assert "cells 2×2" not in evident.read_text(encoding="utf-8").partition('id="provenance"')[0]
    assert not [name for name, page in pages_of(evident).items() if "cells 2×2" in page and name != "index.html"]
    assert "displacements_thinness" not in text
    assert "cells 2×2" not in (evident.parent / "table.csv").read_text(encoding="utf-8")
    assert suites_of(shown) == suites_of(store.rows)
    making = text.partition('id="provenance"')[2]
    studied_run = next(row for row in studied(store) if row.suites == ("thinness",)).run_id
    assert f"<code>{studied_run}</code>" in making


def test_a_table_of_a_study_is_printed_when_it_is_asked_for(store):
    alone = [row for row in studied(store) if row.suites == ("thinness",)]
    assert "cells 2×2" not in render(studied(store), "text", store.known_values)
    assert "cells 2×2" in render(alone, "text", store.known_values)


def test_a_lean_drawing_is_the_same_drawing():
    style = 'style="fill: #d55e00; stroke-width: 0.3"'
    marks = "".join(f'<use x="{i}.123456" y="-0.001234" {style}/>' for i in range(5))
    svg = f"""<svg><style type="text/css">*{{a: b}}</style><g transform="scale(0.015625)" style="fill: red">
        <path d="M 12.345678 7 L 3 4.5 "/>{marks}</g></svg>"""
    short = shrink_svg(svg.encode()).decode()
    assert '<g transform="scale(0.015625)" style="fill: red">' in short
    assert '<path d="M 12.35 7 L 3 4.5 "/>' in short
    assert re.findall(rf'<use x="([^"]*)" y="([^"]*)" {style}/>', short) == [(f"{i}.12", "0") for i in range(5)]
    assert len(short) < len(svg)


def test_a_palette_spoils_no_picture():
    rng = np.random.default_rng(0)
    ramp = np.linspace(0, 255, 200)[None, :, None] * np.array([1.0, 0.5, 0.25]) + rng.uniform(0, 1, (100, 1, 1))
    picture = np.clip(ramp, 0, 255).astype(np.uint8)
    buffer = BytesIO()
    Image.fromarray(picture).save(buffer, "PNG")
    reduced = np.asarray(Image.open(BytesIO(few_colours(buffer.getvalue()))).convert("RGB"), dtype=float)
    assert np.abs(reduced - picture).max() <= 10  # of 255: hardly to be seen


@pytest.mark.long
@pytest.mark.parametrize("kind", ["store", "nonlinear"])
def test_the_same_records_give_the_same_light_report(kind, request, tmp_path):
    store = request.getfixturevalue(kind)
    first, second = (
        write_report(Records(store.folder), store.rows, tmp_path / name, store.known_values).parent for name in "ab"
    )
    files = sorted(path for path in first.rglob("*") if path.is_file())
    assert sum(path.stat().st_size for path in files) < 8 * MEGABYTE
    for path in files:
        assert (second / path.relative_to(first)).read_bytes() == path.read_bytes(), path.name


def test_an_empty_store_gives_a_page_that_says_so(tmp_path):
    page = write_report(Records(tmp_path / "none"), [], tmp_path / "out").read_text(encoding="utf-8")
    assert "Nothing is gated" in page
    assert not Page(page).open


def test_hostile_words_do_not_reach_the_page(store, tmp_path):
    words = "<script>alert(1)</script> $x_{$ \\input{y}"
    evil = [
        row.model_copy(update={"case_title": words, "reason": words, "solver_label": words}) for row in store.rows[:7]
    ]
    with coarse_figures():
        start = write_report(Records(store.folder), evil, tmp_path, store.known_values, for_print=False)
    page = pages_of(start)["obstacle_course.html"]
    assert "<script>alert" not in "".join(pages_of(start).values())
    assert "&lt;script&gt;alert" in page
    assert "\\input" not in (tmp_path / "table.tex").read_text(encoding="utf-8")


def test_a_file_in_the_way_is_said_in_one_sentence(store, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(InputError, match="can't be written"):
        write_report(Records(store.folder), store.rows[:1], blocked, store.known_values)


def test_reports_need_records_alone(store):
    """No solver library is imported on the way from records to the page."""
    code = (
        "import sys; from shellbench.report.page import page; from shellbench.report.sections import tables; from shellbench.bench.store.store import Store;"
        "from pathlib import Path; import tempfile;"
        "page.write_report(Store(Path(sys.argv[1])), [], Path(tempfile.mkdtemp()));"
        "print([name for name in ('torch', 'skfem', 'shellbench.solvers.fem', 'shellbench.solvers.ndf') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code, str(store.folder)], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_commands_can_be_typed(store):
    record = next(r for r in store.records if r.identity.seed == 1 and r.case_name == "square_plate")
    assert command(record, {}) == f"shellbench run square_plate --solver {record.identity.solver} --seed 1"
    nested = command(record, {"layer": {"scale": 3.5}, "name": "a b; rm -rf /"})
    assert f"--set {record.identity.solver}.layer.scale=3.5" in nested
    assert f"'{record.identity.solver}.name=a b; rm -rf /'" in nested
    own = record.model_copy(update={"own_case": True})
    assert command(own, {}).startswith("shellbench run square_plate.toml")


def test_suites_with_gates_come_first_and_rows_stand_once(store):
    rows = [row.model_copy(update={"suites": (*row.suites, "ablations")}) for row in store.rows]
    assert suites_of(list(reversed(store.rows))) == ["obstacle_course", "ablations"]
    homes = rows_at_home(rows)
    assert sum(map(len, homes.values())) == len(rows)
    assert len(rows_of(rows, "ablations")) == len(rows)
    assert list(dict.fromkeys(row.case for row in homes["obstacle_course"])) == list(COURSE)


def test_shortfalls_of_one_reason_are_one_line(store):
    lines = {(s.case, s.solution): s for s in shortfalls(store.rows) if "missing" in s.words}
    (lost,) = lines.values()
    assert lost.words.startswith("seed 2, missing")
    both = [row.model_copy(update={"seed": seed}) for row in store.rows if row.status == "missing" for seed in (2, 3)]
    assert shortfalls(both)[0].words.startswith("seeds 2, 3, missing")


def test_what_has_not_settled_is_neither_green_nor_without_an_answer(store):
    good = [row for row in store.rows if row.passed]
    moving = {"status": "not settled", "passed": False, "reason": "centre still moves by 2e-3"}
    first, *others = good
    rows = [first.model_copy(update=moving), *others]
    words = f"{len(good) - 1} of {len(good)} gated values pass; 1 has not settled."
    assert overall(rows).words == words
    (line,) = shortfalls(rows)
    assert line.words == f"not settled ({first.quantity.replace('_', ' ')}): centre still moves by 2e-3"
    assert verdict(rows[:1]) == "not settled"
    expected = first.model_copy(update=moving | {"passed": None, "open_finding": "too stiff"})
    assert verdict([expected]) == "expected failure"


def test_the_overall_verdict_counts_rows_and_runs(store):
    verdict = overall(store.rows)
    assert (verdict.gated, verdict.held, verdict.bad_runs) == (28, 24, 3)
    assert not verdict.good
    assert overall([row for row in store.rows if row.passed]).good
    assert not overall([]).good


def test_a_failed_run_that_no_gate_judges_is_counted_apart(store):
    """Ablations fail on purpose; they stay visible and turn no verdict red."""
    good = [row for row in store.rows if row.passed]
    ablation = good[0].model_copy(update={"run_id": "ablation", "passed": None, "status": "failed", "label": "ReLU", "overrides": {"activation": "relu"}})  # fmt: skip
    verdict = overall([*good, ablation])
    assert verdict.good
    assert (verdict.bad_runs, verdict.beside) == (0, 1)
    assert "1 run beside them, which no gate judges, failed" in verdict.words


@pytest.mark.long
def test_a_report_for_the_screen_alone_has_no_pdf_and_no_link_to_one(store, tmp_path):
    """The committed example has this form, with half the size."""
    page = write_report(Records(store.folder), store.rows, tmp_path, store.known_values, for_print=False)
    assert not list((tmp_path / "figures").glob("*.pdf"))
    assert list((tmp_path / "figures").glob("*.svg"))
    assert ".pdf" not in "".join(pages_of(page).values())
