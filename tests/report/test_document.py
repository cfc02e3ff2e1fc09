import json

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.store.store import Store as Records
from shellbench.report.data import exhibit
from shellbench.report.data.document import (
    EXAM_SCORE,
    MANIFEST,
    exam_words,
    list_own,
    makings,
    read_bibliography,
    remove_older,
)
from shellbench.report.data.runs import told_apart
from shellbench.report.figures import shells
from shellbench.report.page.page import write_report
from shellbench.report.page.paper import write_paper
from tests.report.conftest import COURSE, record, row

BIBTEX = r"""
@article{someone1999,
  author  = {G{\"u}nther, A. and Lo, K. S.},
  title   = {The {Shell} and its {NDF}},
  journal = "Journal of Shells",
  volume  = 12, number = {3},
  pages   = {1--10},
  year    = 1999,
  doi     = {10.1000/xyz},
}
@book{other2001, title = {Plates}, url = {javascript:alert(1)}, year = {2001}}
"""


def test_entries_in_plain_words(tmp_path):
    path = tmp_path / "b.bib"
    path.write_text(BIBTEX, encoding="utf-8")
    sources = read_bibliography(path)
    assert set(sources) == {"someone1999", "other2001"}
    words = sources["someone1999"].words
    assert words.startswith("Gu\u0308nther, A., Lo, K. S. (1999). The Shell and its NDF. Journal of Shells")
    assert "1–10" in words
    assert not set(words) & set("{}\\")
    assert sources["someone1999"].link == "https://doi.org/10.1000/xyz"


def test_only_web_addresses_become_links(tmp_path):
    path = tmp_path / "b.bib"
    path.write_text(BIBTEX, encoding="utf-8")
    assert read_bibliography(path)["other2001"].link is None


def test_a_missing_or_torn_file_gives_what_there_is(tmp_path):
    assert read_bibliography(tmp_path / "none.bib") == {}
    torn = tmp_path / "torn.bib"
    torn.write_text("@article{torn, title = {never closed", encoding="utf-8")
    assert read_bibliography(torn)["torn"].fields["title"].startswith("never")


def test_the_suites_own_sources_all_have_words():
    sources = read_bibliography(catalog.data_folder("references") / "bibliography.bib")
    cited = {value.source for name in catalog.case_names() for value in catalog.known_values(name).values}
    assert cited <= set(sources)
    assert all(len(source.words) > 20 for source in sources.values())


def test_an_older_report_goes_and_nobody_elses_files(tmp_path):
    out = tmp_path / "out"
    (out / "figures").mkdir(parents=True)
    mine, theirs, outside = out / "figures" / "old.png", out / "figures" / "photo.png", tmp_path / "outside.txt"
    for path in (mine, theirs, outside):
        path.write_text("x")
    list_own(out, [mine, out / "never_written.png"])
    (out / MANIFEST).write_text(
        (out / MANIFEST).read_text() + "../outside.txt\n"
    )  # a damaged list can reach no further
    remove_older(out)
    assert not mine.exists()
    assert theirs.exists()
    assert outside.exists()
    remove_older(out)  # there is none any more


@pytest.mark.long
def test_a_report_into_a_folder_in_use_leaves_what_is_there(store, tmp_path, monkeypatch):
    monkeypatch.setattr(exhibit, "SCREEN_DPI", 40)
    monkeypatch.setattr(shells, "CELLS", 8)
    rows = [row for row in store.rows if row.case == COURSE[0] and row.solver == "fem"]
    for write in (write_report, write_paper):
        out = tmp_path / write.__name__
        for name in ("figures/mine.png", "tables/mine.tex"):
            (out / name).parent.mkdir(parents=True, exist_ok=True)
            (out / name).write_text("mine")
        write(Records(store.folder), rows, out, store.known_values)
        first = {path for path in out.rglob("*") if path.is_file()}
        write(Records(store.folder), rows[:1], out, store.known_values)
        second = {path for path in out.rglob("*") if path.is_file()}
        assert second <= first
        assert (out / "figures" / "mine.png").read_text() == "mine"
        assert (out / "tables" / "mine.tex").read_text() == "mine"


def test_an_own_case_with_a_known_name_is_another_case(store):
    row = next(row for row in store.rows if row.case == COURSE[0])
    record = next(record for record in store.records if record.run_id == row.run_id)
    rows, records = told_apart(
        [row.model_copy(update={"own_case": True}), row],
        {"own": record.model_copy(update={"own_case": True}), "same": record},
    )
    assert rows[0].case == records["own"].case_name != COURSE[0]
    assert rows[1].case == records["same"].case_name == COURSE[0]
    assert "own case" in rows[0].case_title
    assert rows[0].run_id == row.run_id


def test_an_environment_says_by_which_exams_its_runs_were_judged(tmp_path):
    """Runs of one environment under two versions of the exam: one environment, both versions in its words."""
    case = catalog.named_case("square_plate")
    made = [
        record(tmp_path, case, solver, 0).model_copy(update={"exam": exam}) for solver, exam in (("one", 1), ("two", 2))
    ]
    found, words = makings({one.run_id: one for one in made}, [row(one) for one in made])
    assert [making.environment for making in found] == [1, 1]
    assert len(words) == 1
    assert words[0].endswith("exam 1, 2")


def test_the_score_of_the_exam_in_words(tmp_path, monkeypatch):
    monkeypatch.setattr(catalog, "data_folder", lambda name: tmp_path)
    assert exam_words() == ""
    figures = {"drawn": 10, "red": 7, "equivalent": 2, "holes": 1}
    mechanics = {"drawn": 5, "red": 4, "equivalent": 1, "holes": 0}
    draws = [
        {"target": "fem", "seed": seed, "unseen": seed > 2, **figures, "mechanics": mechanics} for seed in (2, 3, 4)
    ]
    (tmp_path / EXAM_SCORE).write_text(json.dumps({"schema_version": 2, "draws": draws}))
    said = exam_words()
    assert "8 of 8 in mechanics" in said
    assert "of the newest draw 4 of 4 (seed 4)" in said
    assert "14 of 16 in all statements" in said
