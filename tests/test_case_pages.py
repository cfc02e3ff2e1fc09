"""Pages of the cases: all that judges a case stands on its page, and its picture shows it."""

import re
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from docs import benchmarks_by_name, cases, contents
from shellbench.bench.catalogue import catalog
from shellbench.bench.store.store import Store
from tests.bench.conftest import full, made_once, plugin, store, toys  # noqa: F401 - fixtures


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    where = tmp_path_factory.mktemp("pages")
    cases.write(["hemisphere_hole", "hanging_chain"], None, where)
    return where


@pytest.mark.parametrize("name", ["hemisphere_hole", "hanging_chain"])
def test_all_that_judges_stands_on_the_page_with_its_source(folder: Path, name: str) -> None:
    case, known = catalog.named_case(name), catalog.known_values(name)
    page = (folder / f"{name}.md").read_text(encoding="utf-8")
    sources = cases.read_bibliography(cases.BIBLIOGRAPHY)
    lines = [line for line in page.splitlines() if "| judge |" in line]
    judges = [judge for q in case.quantities if (judge := known.judge(q.name, case.theory))]
    assert len(lines) == len(judges) > 3
    for judge, line in zip(judges, lines, strict=True):
        unit = case.quantity(judge.quantity).unit
        assert f"| `{judge.quantity}` | judge | **{judge.value:.13g} ± {judge.uncertainty:.2g} {unit}** |" in line
        assert f"`{judge.source}`" in line
        assert cases.words(judge.origin) in line
        assert f"- `{judge.source}`: {cases.words(sources[judge.source].words)}" in page
    for value in known.values:
        assert f"{value.value:.13g}" in page
    for solver, held in catalog.tolerances().items():
        for quantity, allowed in held.get(name, {}).items():
            (line,) = [line for line in page.splitlines() if re.match(rf"\| `{quantity}` \| [^|]*{solver} ", line)]
            assert f"{solver} {allowed.largest:g}" in line


def test_text_is_shown_as_it_is_and_no_column_is_empty() -> None:
    assert cases.words("Scordelis & Lo | a_1 <b>") == r"Scordelis &amp; Lo \| a\_1 &lt;b\>"
    assert list(cases.table(("a", "b"), [("1", ""), ("", "")])) == ["| a |", "|---|", "| 1 |", "|  |", ""]
    assert list(cases.table(("a", "b"), [])) == []


def test_the_picture_shows_the_shell(folder: Path) -> None:
    assert "](hemisphere_hole.png)" in (folder / "hemisphere_hole.md").read_text(encoding="utf-8")
    image = matplotlib.image.imread(folder / "hemisphere_hole.png")[..., :3]
    inked = np.abs(image - 1.0).max(axis=-1) > 0.05
    assert 0.1 < inked.mean() < 0.9
    orange = (image[..., 0] - image[..., 2] > 0.5) & inked
    assert orange.sum() > 50  # the arrows of its forces
    assert not (folder / "hanging_chain.png").exists()  # nothing can be drawn of it


def test_ropes_and_shells_of_a_series_are_drawn_too() -> None:
    for name in ("rope_pendulum", "conditioned_roof", "edit_cantilever_pose"):
        assert cases.picture(catalog.named_case(name), None, []) is not None, name
    for name in ("hanging_chain", "field_sine"):
        assert cases.picture(catalog.named_case(name), None, []) is None, name
    (axes,) = cases.picture(catalog.named_case("rope_crowd_400"), None, []).axes
    assert 1 < len(axes.lines) <= cases.CHAINS_DRAWN + 1  # the root beside them


def test_the_index_leads_to_each_page(folder: Path) -> None:
    links = re.findall(r"\]\(([^)]+)\)", (folder / "index.md").read_text(encoding="utf-8"))
    assert links == ["hemisphere_hole.md", "hemisphere_hole.md", "hanging_chain.md"]  # the first by its other names
    assert all((folder / link).is_file() for link in links)


def test_results_are_those_of_the_store(full: Store, tmp_path: Path) -> None:  # noqa: F811
    """A line for each quantity and solver; of several seeds the worst."""
    cases.write(["strip"], full, tmp_path / "with")
    cases.write(["strip"], None, tmp_path / "without")
    page = (tmp_path / "with" / "strip.md").read_text(encoding="utf-8")
    lines = [line for line in page.partition("## Results")[2].splitlines() if line.startswith("| `")]
    assert sorted({line.split(" | ")[1] for line in lines}) == ["`toy-noisy`", "`toy`"]
    (noisy,) = [line for line in lines if "`centre`" in line and "toy-noisy" in line]
    assert "0, 1, 2" in noisy
    assert noisy.endswith("| pass |")
    assert cases.NO_RESULTS.format("strip") in (tmp_path / "without" / "strip.md").read_text(encoding="utf-8")


def test_the_cases_are_the_third_entry_of_the_contents(tmp_path: Path) -> None:
    def nav(docs: Path) -> list[object]:
        config = {"docs_dir": str(docs), "nav": [{"Start": []}, {"Use it": []}, {"Reference": []}]}
        return contents.on_config(config)["nav"]

    assert len(nav(tmp_path)) == 3
    (tmp_path / "cases").mkdir()
    (tmp_path / "cases" / "index.md").write_text("# The cases", encoding="utf-8")
    assert nav(tmp_path)[2] == {"The cases": "cases/index.md"}
    sections = re.findall(
        r"^  - (.*?):", (cases.ROOT / "mkdocs.yml").read_text("utf-8").partition("\nnav:\n")[2], re.MULTILINE
    )
    assert sections[:2] == ["Start", "Use it"]


def test_the_site_is_built_with_the_pages_of_the_cases() -> None:
    body = (cases.ROOT / "noxfile.py").read_text(encoding="utf-8").partition("def build_site")[2]
    assert body.index('"docs/cases.py"') < body.index('"mkdocs"')


def test_other_names_come_first_on_their_page_and_have_a_source(folder: Path) -> None:
    page = (folder / "hemisphere_hole.md").read_text(encoding="utf-8")
    assert "MacNeal-Harder" in page.partition("## Problem")[0]
    sources = (cases.ROOT / "references/bibliography.bib").read_text(encoding="utf-8")
    for case in benchmarks_by_name.known_elsewhere():
        for other in case.also_known_as:
            assert re.match(r"\w+", other.name)[0] in sources, other.name


def test_without_a_store_the_results_are_the_committed_rows(tmp_path: Path) -> None:
    rows = cases.kept_rows()
    keys = [(row.case, row.solver, row.quantity, row.seed) for row in rows]
    assert len(keys) == len(set(keys)) > 300
    cases.write(["square_plate"], None, tmp_path)
    page = (tmp_path / "square_plate.md").read_text(encoding="utf-8").partition("## Results")[2]
    (line,) = [line for line in page.splitlines() if line.startswith("| `centre_deflection` | `fem` |")]
    (row,) = [
        row for row in rows if (row.case, row.solver, row.quantity) == ("square_plate", "fem", "centre_deflection")
    ]
    assert f"| {row.value:.8g} m |" in line
    assert line.endswith("| pass |")


def test_a_result_without_a_tolerance_on_its_page_is_not_gated() -> None:
    (row,) = [
        row
        for row in cases.kept_rows()
        if (row.case, row.solver, row.quantity) == ("square_plate", "fem", "centre_deflection")
    ]
    (gated,), (free,) = cases.results([row], {("centre_deflection", "fem")}), cases.results([row], set())
    assert (gated[-1], free[-1]) == ("pass", "not gated")


def test_cases_with_published_numbers_tell_their_units() -> None:
    names = set(catalog.case_names())
    assert set(cases.UNITS) <= names
    (remark,) = cases.units_read(catalog.named_case("scordelis_lo"))
    assert "feet and pounds" in remark
    assert cases.units_read(catalog.named_case("square_plate")) == []
