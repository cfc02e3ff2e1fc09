from shellbench.bench import catalog
from shellbench.report.document import read_bibliography

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
