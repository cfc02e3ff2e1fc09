"""Links of README and docs lead somewhere, and what scripts of docs write is up to date."""

import re
import tomllib
from pathlib import Path

import pytest

from docs import benchmarks_by_name, evidence, known_values
from shellbench.errors import InputError
from shellbench.problems.shell.case import build_case

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "derivations/README.md")),
    ROOT / "examples/solver_template/README.md",
    *sorted(page for page in DOCS.rglob("*.md") if page.parent != DOCS / "cases"),  # those are built
]
LINK = re.compile(r"\]\(([^)\s]+)\)")
CASE_PAGES = {"index.md", *(f"{path.stem}.md" for path in (ROOT / "cases").glob("*.toml"))}  # `nox -s docs` builds them
CODE = re.compile(r"^```.*?^```|`[^`\n]*`", re.MULTILINE | re.DOTALL)
NAMED_FILE = re.compile(
    r"`((?:shellbench|tests|cases|references|derivations|docs|examples|reports)/[\w./]+\.(?:py|toml|md|json|bib|csv))`"
)


def anchors(page):
    """Anchors of a Markdown page: its headings, as a site and a forge name them."""
    headings = re.findall(r"^#+ (.*)$", CODE.sub(lambda m: m[0].strip("`").split("\n")[0], page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading).strip().lower().replace(" ", "-") for heading in headings}


def broken(path, page):
    """Links of a page that lead nowhere; those to other sites are not followed."""
    found = []
    for link in LINK.findall(CODE.sub("", page)):
        if re.match(r"[a-z]+:", link):
            continue
        name, _, anchor = link.partition("#")
        target = (path.parent / name).resolve() if name else path
        outside_site = DOCS in path.parents and DOCS not in target.parents
        text = page if target == path else target.read_text("utf-8") if anchor and target.is_file() else ""
        built = target.parent == DOCS / "cases" and target.name in CASE_PAGES
        if not (target.exists() or built) or outside_site or (anchor and anchor not in anchors(text)):
            found.append(link)
    return found


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(path):
    assert broken(path, path.read_text(encoding="utf-8")) == []


def test_links_that_lead_nowhere_are_seen():
    page = "[a](using.md) [b](using.md#the-suites) [c](#here)\n\n# Here\n\n[d](usage.md) [e](using.md#suits) [f](../LICENSE)"
    page += " [g](cases/index.md) [h](cases/scordelis_lo.md) [i](cases/scordelis.md)"
    assert broken(DOCS / "index.md", page) == ["usage.md", "using.md#suits", "../LICENSE", "cases/scordelis.md"]


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_files_that_are_named_are_there(path):
    named = NAMED_FILE.findall(path.read_text(encoding="utf-8"))
    folders = ROOT, ROOT / "examples/solver_template"  # pages about the template name its files
    assert [name for name in named if not any((folder / name).exists() for folder in folders)] == []


def own_case_page():
    """Page "your own case", and the file that its fragments make."""
    page = (DOCS / "own_case.md").read_text(encoding="utf-8")
    return page, "\n".join(re.findall(r"^```toml\n(.*?)^```", page, re.MULTILINE | re.DOTALL))


def test_your_own_case_writes_the_example():
    whole = tomllib.loads((ROOT / "examples/hyperbolic_paraboloid.toml").read_text(encoding="utf-8"))
    del whole["picture"]
    case = tomllib.loads(own_case_page()[1])
    assert case.pop("known")[0]["quantity"] == "centre_deflection"  # the page adds what the file leaves open
    assert case == whole


@pytest.mark.parametrize(
    ("right", "wrong"), [("thickness = 0.01 ", "thickness = -0.01 "), ("clamped = true", 'components = ["z"]')]
)
def test_your_own_case_shows_what_is_said_of_a_wrong_one(right, wrong):
    page, text = own_case_page()
    with pytest.raises(InputError) as refused:
        build_case(tomllib.loads(text.replace(right, wrong)), "paraboloid", "paraboloid.toml")
    assert f"shellbench: {refused.value}\n" in page


def test_every_page_is_in_the_contents():
    contents = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    pages = [str(path.relative_to(DOCS)) for path in PAGES if DOCS in path.parents]
    pages = [name for name in pages if not name.startswith("board/") or name == "board/index.md"]  # it links its own
    assert [name for name in pages if not re.search(rf"[ :]{re.escape(name)}$", contents, re.MULTILINE)] == []


@pytest.mark.parametrize(
    ("word", "page"),
    [
        ("install", "install.md"),
        ("licence", "install.md"),
        ("docker", "install.md"),
        ("wsl", "install.md"),
        ("csv", "using.md"),
        ("abaqus", "benchmarks_by_name.md"),
        ("nafems", "benchmarks_by_name.md"),
        ("macneal", "benchmarks_by_name.md"),
    ],
)
def test_a_search_finds_the_right_page(word, page):
    """The site's search weighs titles and headings most: the word stands in one of this page, and of no other."""
    found = {
        str(path.relative_to(DOCS))
        for path in PAGES
        if DOCS in path.parents
        and any(word in line.lower() for line in path.read_text("utf-8").splitlines() if line.startswith("#"))
    }
    assert found == {page}


def test_the_readme_is_one_page():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 150


def test_known_values_are_those_of_the_references():
    written = known_values.PAGE.read_text(encoding="utf-8")
    assert written == known_values.page(), "write it anew by `python docs/known_values.py`"


def test_benchmarks_by_name_are_those_of_the_cases():
    written = benchmarks_by_name.PAGE.read_text(encoding="utf-8")
    assert written == benchmarks_by_name.page(), "write it anew by `python docs/benchmarks_by_name.py`"
    finding = benchmarks_by_name.FINDING.read_text(encoding="utf-8")
    assert finding == benchmarks_by_name.finding(), "write it anew by `python docs/benchmarks_by_name.py`"
    assert all(f"[{words}]" in finding for of in benchmarks_by_name.QUESTIONS.values() for words, *_ in of)


def test_the_table_of_known_values_is_that_of_the_references():
    assert known_values.TABLE.read_text(encoding="utf-8") == known_values.table(), "as above"


def test_what_the_site_needs_is_pinned():
    with (ROOT / "pyproject.toml").open("rb") as file:
        extra = tomllib.load(file)["project"]["optional-dependencies"]["docs"]
    pinned = {line.partition("==")[0] for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()}
    assert {re.match(r"[\w-]+", name)[0] for name in extra} <= pinned


def test_evidence_keeps_rows_of_gated_suites_and_headlines_of_engines():
    assert evidence.is_kept({"suites": ["resolution", "cloth"], "primary": False})
    assert evidence.is_kept({"suites": ["engines"], "primary": True})
    assert not evidence.is_kept({"suites": ["engines"], "primary": False})
    assert not evidence.is_kept({"suites": ["resolution"], "primary": True})


def test_evidence_keeps_what_pages_quote_of_a_row():
    row = {
        "case": "plate",
        "value": None,
        "seed": 0,
        "suites": ["cloth"],
        "label": "",
        "passed": False,
        "dtype": "float64",
    }
    kept = {"case": "plate", "value": None, "at": None, "seed": 0, "suites": ["cloth"], "passed": False, "settings": {}}
    assert evidence.shortened(row | {"settings": {"cells": 8}, "overrides": {}}) == kept


def test_committed_evidence_is_small():
    files = [
        path for name in ("example", "example_engines", "published") for path in (ROOT / "reports" / name).rglob("*")
    ]
    assert 0 < sum(path.stat().st_size for path in [*files, ROOT / "reports/baseline.json"]) < 5e6
    for name, tables in evidence.QUOTED_CSV.items():
        kept = {path.name for path in (ROOT / "reports" / name).iterdir()}
        assert kept == {"table.json", *(f"{table}.csv" for table in tables)}
    shown = {f"{figure}.png" for figures in evidence.SHOWN.values() for figure in figures}
    pages = "".join(
        (ROOT / f"docs/{name}.md").read_text(encoding="utf-8")
        for name in ("studies", "deep_fields", "clothing", "drape")
    )
    studied = set(re.findall(r"figures/((?:study_\w+|\w+_run)\.png)", pages))
    assert {path.name for path in evidence.FIGURES.iterdir()} == shown | studied
