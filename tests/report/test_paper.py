"""The paper's files: whole LaTeX, captions that say theory and sources, a document that compiles and fits."""

import re
import shutil
import subprocess
from pathlib import Path

import pandas as pd
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.store import store as bench
from shellbench.errors import InputError
from shellbench.report.data.columns import Column
from shellbench.report.data.document import read_bibliography
from shellbench.report.data.notation import quoted
from shellbench.report.data.table import PAGE_LINES, Note, Table, with_letters_of_latex, write_latex
from shellbench.report.page.paper import write_paper
from tests.patience import GUARD
from tests.report.conftest import Store, coarse_figures

WIDEST_OVERFLOW = 20.0  # pt; what a reader does not see
ENVIRONMENT = re.compile(r"\\(begin|end)\{(\w+\*?)\}")
SPECIAL = re.compile(r"(?<!\\)[#&_^~%]")


@pytest.fixture(scope="module")
def paper(store: Store, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("paper") / "paper"
    with coarse_figures():
        return write_paper(bench.Store(store.folder), store.rows, out, store.known_values).parent


def tables(folder: Path) -> list[Path]:
    return sorted((folder / "tables").glob("*.tex"))


def check_whole(latex: str) -> None:
    """Braces and environments close in order; nothing special stands bare."""
    text = re.sub(r"(?m)^%.*$|(?<=[{}])%$", "", latex)  # remarks, and line ends that mean no blank
    depth, opened = 0, []
    for token in re.finditer(r"\\[{}\\]|[{}]", text):
        depth += {"{": 1, "}": -1}.get(token[0], 0)
        assert depth >= 0
    assert depth == 0
    for kind, name in ENVIRONMENT.findall(text):
        if kind == "begin":
            opened.append(name)
        else:
            assert opened.pop() == name
    assert opened == []
    outside = re.sub(r"\$[^$]*\$|\\(cite|ref|label|input|includegraphics)(\[[^\]]*\])?\{[^}]*\}", "", text)
    outside = re.sub(r"\\ensuremath\{(\{\}[\^_]\{[^}]*\}|[^{}]*)\}", "", outside)
    for line in outside.splitlines():
        bare = SPECIAL.findall(line)
        if line.rstrip().endswith(r"\\"):
            bare = [mark for mark in bare if mark != "&"]  # they part its cells
        assert set(bare) <= {"~"}, line


def test_each_table_is_a_file_of_its_own(paper: Path) -> None:
    names = {path.stem for path in tables(paper)}
    assert {"displacements_obstacle_course", "displacements_ablations", "resolution", "seeds"} <= names
    document = (paper / "paper.tex").read_text(encoding="utf-8")
    assert set(re.findall(r"\\input\{tables/(.*?)\}", document)) == names
    figures = {path.name for path in (paper / "figures").iterdir()}
    assert figures
    assert set(re.findall(r"\\includegraphics\[.*?\]\{figures/(.*?)\}", document)) == figures
    assert all(name.endswith(".pdf") for name in figures)


def test_all_latex_is_whole(paper: Path) -> None:
    for path in [*tables(paper), paper / "paper.tex"]:
        check_whole(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("broken", [r"\textbf{a", r"\begin{tabular}{l}", "a_b", "50 % a & b", r"\emph{a}}"])
def test_the_check_of_latex_finds_what_is_broken(broken: str) -> None:
    with pytest.raises((AssertionError, IndexError)):
        check_whole(f"{broken} \n")


def test_every_table_has_rules_a_caption_with_theory_and_a_label(paper: Path) -> None:
    labels = set()
    for path in tables(paper):
        latex = path.read_text(encoding="utf-8")
        assert all(rule in latex for rule in (r"\toprule", r"\midrule", r"\bottomrule"))
        assert "|" not in re.findall(r"\\begin\{tabular\}\{(.*)\}", latex)[0]  # booktabs has no vertical rules
        caption = latex.partition(r"\caption[")[2].partition(r"\label")[0]
        assert "linear Kirchhoff--Love" in caption, path.name
        labels |= set(re.findall(r"\\label\{(.*?)\}", latex))
    assert len(labels) == len(tables(paper))


def test_captions_cite_what_judges_and_nothing_else(paper: Path) -> None:
    captions = {path.stem: path.read_text(encoding="utf-8").partition(r"\label")[0] for path in tables(paper)}
    assert r"\cite{series1900}" in captions["displacements_obstacle_course"]
    for name in ("fields", "resolution"):  # of solvers among themselves: no known value has a part in them
        assert r"\cite" not in captions[name], name


def test_every_key_of_the_catalog_is_in_the_bibliography(paper: Path) -> None:
    entries = set(read_bibliography(paper / "bibliography.bib"))
    used = {value.source for name in catalog.case_names() for value in catalog.known_values(name).values}
    assert {source for source in used if source} <= entries


def test_a_file_in_the_way_is_one_sentence(store: Store, tmp_path: Path) -> None:
    (tmp_path / "paper").write_text("", encoding="utf-8")
    with pytest.raises(InputError, match="the paper can't be written"):
        write_paper(bench.Store(store.folder), [], tmp_path / "paper", store.known_values)


def long_table(rows: int, words: int = 5, notes: int = 0) -> Table:
    data = pd.DataFrame({"block": [f"block {i // 10}" for i in range(rows)], "value": [float(i) for i in range(rows)]})
    data["name"] = "word " * words
    columns = (
        Column("Name", lambda line, notation: notation.escape(line["name"]), right=False),
        Column("Value", lambda line, notation: notation.number(quoted(line["value"]))),
    )
    remarks = tuple(Note(f"remark {i}", "words " * 60) for i in range(notes))
    return Table("long", "Long", "A caption.", data, columns, remarks)


@pytest.mark.parametrize(("rows", "notes"), [(3, 0), (300, 0), (3, 60), (300, 60)])
def test_a_long_table_is_parted_and_loses_nothing(rows: int, notes: int) -> None:
    latex = write_latex(long_table(rows, notes=notes))
    check_whole(latex)
    floats = latex.split(r"\begin{table*}")[1:]
    assert all(part.count("\\\\\n") <= PAGE_LINES for part in floats)
    assert re.findall(r"\$(\d+)\$", latex) == [str(i) for i in range(rows)]
    assert re.findall(r"remark (\d+)", latex) == [str(i) for i in range(notes)]
    assert latex.count(r"\caption[") == latex.count(r"\label{") == 1
    assert len(floats) > 1 if rows + notes > 50 else len(floats) == 1


def test_wide_words_are_broken_into_lines_and_numbers_are_not() -> None:
    narrow, wide = write_latex(long_table(3)), write_latex(long_table(3, words=60))
    assert r"\begin{tabular}{lr}" in narrow
    assert re.search(r"\\begin\{tabular\}\{>\{\\raggedright\\arraybackslash\}p\{[\d.]+em\}r\}", wide)


def test_letters_that_fonts_lack_are_written_by_others() -> None:
    assert with_letters_of_latex("10⁻⁶ m") == r"10\ensuremath{{}^{-6}} m"
    assert with_letters_of_latex("κ ≤ é") == r"\ensuremath{\kappa} \ensuremath{\leq} é"
    assert with_letters_of_latex("☃") == "[U+2603]"


def overflows(log: str) -> list[float]:
    return [float(width) for width in re.findall(r"Overfull \\[hv]box \(([\d.]+)pt", log)]


@pytest.mark.long
@pytest.mark.parametrize("kind", ["store", "nonlinear", "motion"])
def test_the_document_compiles_and_fits_its_pages(kind: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    if not shutil.which("pdflatex"):
        pytest.skip("pdflatex is not installed: the document can't be compiled")
    made = request.getfixturevalue(kind)
    folder = write_paper(bench.Store(made.folder), made.rows, tmp_path, made.known_values).parent
    for _ in range(2):
        command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "paper.tex"]
        ended = subprocess.run(command, cwd=folder, capture_output=True, timeout=GUARD, check=False)
        assert ended.returncode == 0, ended.stdout.decode(errors="replace")[-2000:]
    log = (folder / "paper.log").read_text(encoding="utf-8", errors="replace")
    assert all(width <= WIDEST_OVERFLOW for width in overflows(log))
    assert "Float too large" not in log
    assert "multiply defined" not in log
    assert not re.findall(r"Reference `.*?' .* undefined", log)
