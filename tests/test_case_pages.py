"""Pages of the cases: all that judges a case stands on its page, and its picture shows it."""

import re
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from docs import cases, contents
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


def test_the_index_leads_to_each_page(folder: Path) -> None:
    links = re.findall(r"\]\(([^)]+)\)", (folder / "index.md").read_text(encoding="utf-8"))
    assert links == ["hemisphere_hole.md", "hanging_chain.md"]
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
    assert noisy.endswith("| holds |")
    assert "built without a store" in (tmp_path / "without" / "strip.md").read_text(encoding="utf-8")


def test_the_contents_have_the_pages_if_they_are_built(folder: Path, tmp_path: Path) -> None:
    def nav(docs: Path) -> list[object]:
        config = {"docs_dir": str(docs), "nav": [{"Start": "index.md"}, {"Trust": []}]}
        return contents.on_config(config)["nav"][1]["Trust"]

    assert nav(tmp_path) == []
    (tmp_path / "cases").mkdir()
    (tmp_path / "cases" / "index.md").write_text("# The cases", encoding="utf-8")
    assert nav(tmp_path) == [{"The cases": "cases/index.md"}]
