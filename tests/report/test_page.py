import base64
import html
import json
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest

from shellbench.bench.store import Store as Records
from shellbench.errors import InputError
from shellbench.report import exhibit, shells
from shellbench.report.page import write_report
from shellbench.report.provenance import command
from shellbench.report.suites import rows_at_home, rows_of, suites_of
from shellbench.report.summary import overall, shortfalls
from tests.report.conftest import COURSE, Store

MEGABYTE = 1_000_000
VOID = {"meta", "img", "br", "link", "hr"}


@pytest.fixture(scope="module")
def report(store: Store, tmp_path_factory: pytest.TempPathFactory) -> Path:
    with pytest.MonkeyPatch.context() as coarse:  # the figures' fineness is no matter here, and takes its time
        coarse.setattr(exhibit, "PRINT_DPI", 40)
        coarse.setattr(exhibit, "SCREEN_DPI", 40)
        coarse.setattr(shells, "CELLS", 8)
        return write_report(Records(store.folder), store.rows, tmp_path_factory.mktemp("report"), store.known_values)


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


def test_the_page_stands_alone(report):
    page = Page(report.read_text(encoding="utf-8"))
    assert not page.open  # every element is closed
    for tag, attributes in page.tags:
        assert tag not in ("script", "link", "iframe")
        if tag == "img":
            assert attributes["src"].startswith("data:image/")
        if tag == "a" and not attributes["href"].startswith("#"):
            target = attributes["href"]
            assert target.startswith("https://") or (report.parent / target).is_file()
    targets = {attributes["id"] for _, attributes in page.tags if "id" in attributes}
    assert {a["href"][1:] for t, a in page.tags if t == "a" and a["href"].startswith("#")} <= targets


def test_the_page_can_be_heard(report):
    page = Page(report.read_text(encoding="utf-8"))
    tags = page.tags
    assert ("html", {"lang": "en"}) in tags
    assert all(len(attributes.get("alt") or "") > 20 for tag, attributes in tags if tag == "img")
    count = {tag: sum(t == tag for t, _ in tags) for tag in ("table", "caption", "main", "h1")}
    assert count["table"] == count["caption"] > 0
    assert count["main"] == count["h1"] == 1
    assert all(attributes.get("scope") in ("col", "row", "rowgroup") for tag, attributes in tags if tag == "th")


def test_the_verdict_comes_first_and_is_right(report, store):
    words = "".join(Page(report.read_text(encoding="utf-8")).words)
    gated = [row for row in store.rows if row.passed is not None]
    short = [row for row in gated if not row.passed]
    sentence = f"{len(short)} of {len(gated)} gated figures fell short"
    assert sentence in words
    assert words.index(sentence) < words.index("At a glance") < words.index("Displacements")
    assert sentence in (report.parent / "report.md").read_text(encoding="utf-8")


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
        assert (folder / "figures" / f"{stem}.png").read_bytes().startswith(b"\x89PNG")
    assert len(json.loads((folder / "table.json").read_text())) == len(store.rows)


def test_drawings_are_embedded_as_vectors(report):
    embedded = re.findall(r"data:image/svg\+xml;base64,([A-Za-z0-9+/=]+)", report.read_text(encoding="utf-8"))
    assert len(embedded) >= 4
    assert all(b"<svg" in base64.b64decode(data) for data in embedded)


@pytest.mark.long
def test_the_same_records_give_the_same_light_report(store, tmp_path):
    first, second = (
        write_report(Records(store.folder), store.rows, tmp_path / name, store.known_values).parent for name in "ab"
    )
    files = sorted(path for path in first.rglob("*") if path.is_file())
    assert sum(path.stat().st_size for path in files) < 8 * MEGABYTE
    for path in files:
        assert (second / path.relative_to(first)).read_bytes() == path.read_bytes(), path.name


def test_an_older_reports_figures_do_not_linger(store, tmp_path):
    stale = tmp_path / "figures" / "old.png"
    stale.parent.mkdir()
    stale.write_bytes(b"")
    few = [row for row in store.rows if row.case == "square_plate" and row.solver == "fem"]
    write_report(Records(store.folder), few, tmp_path, store.known_values)
    assert not stale.exists()


def test_an_empty_store_gives_a_page_that_says_so(tmp_path):
    page = write_report(Records(tmp_path / "none"), [], tmp_path / "out").read_text(encoding="utf-8")
    assert "Nothing is gated" in page
    assert not Page(page).open


def test_hostile_words_do_not_reach_the_page(store, tmp_path):
    words = "<script>alert(1)</script> $x_{$ \\input{y}"
    evil = [
        row.model_copy(update={"case_title": words, "reason": words, "solver_label": words}) for row in store.rows[:7]
    ]
    page = write_report(Records(store.folder), evil, tmp_path, store.known_values).read_text(encoding="utf-8")
    assert "<script" not in page
    assert "&lt;script&gt;" in page
    assert "\\input" not in (tmp_path / "table.tex").read_text(encoding="utf-8")


def test_a_file_in_the_way_is_said_in_one_sentence(store, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(InputError, match="can't be written"):
        write_report(Records(store.folder), store.rows[:1], blocked, store.known_values)


def test_reports_need_records_alone(store):
    """No solver library is imported on the way from records to the page."""
    code = (
        "import sys; from shellbench.report import page, tables, exhibits; from shellbench.bench.store import Store;"
        "from pathlib import Path; import tempfile;"
        "page.write_report(Store(Path(sys.argv[1])), [], Path(tempfile.mkdtemp()));"
        "print([name for name in ('torch', 'skfem', 'shellbench.fem', 'shellbench.ndf') if name in sys.modules])"
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
    assert lost.seeds == (2,)
    both = [row.model_copy(update={"seed": seed}) for row in store.rows if row.status == "missing" for seed in (2, 3)]
    assert shortfalls(both)[0].words.startswith("seeds 2, 3, missing")


def test_the_overall_verdict_counts_rows_and_runs(store):
    verdict = overall(store.rows)
    assert (verdict.gated, verdict.held, verdict.bad_runs) == (28, 24, 3)
    assert not verdict.good
    assert overall([row for row in store.rows if row.passed]).good
    assert not overall([]).good


def test_a_report_for_the_screen_alone_has_no_pdf_and_no_link_to_one(store, tmp_path):
    """What the committed example is: half the size."""
    page = write_report(Records(store.folder), store.rows, tmp_path, store.known_values, for_print=False)
    assert not list((tmp_path / "figures").glob("*.pdf"))
    assert list((tmp_path / "figures").glob("*.svg"))
    assert ".pdf" not in page.read_text()
