"""The pages of a report: what stands on each, and how one is written."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from shellbench.bench.judge.row import Row
from shellbench.report.data import document
from shellbench.report.data.exhibit import Exhibit, data_uri
from shellbench.report.data.notation import HTML, Notation, anchor
from shellbench.report.data.runs import rows_at_home, suite_title
from shellbench.report.data.section import Section, all_tables
from shellbench.report.data.solutions import shortfalls
from shellbench.report.data.table import Table
from shellbench.report.figures.pictures import COMPOSITE
from shellbench.report.sections.convergence import CONVERGENCE
from shellbench.report.sections.results import RESULTS, results

START, WHOLE = "index", "report"  # files of a report that are no suite's


@dataclass
class Leaf:
    """One page: a suite's, or that of a section which several suites share.

    Attributes
    ----------
    name
        Stem of its file.
    rows
        That it compares; none of a page that only has sections.
    """

    name: str
    title: str
    rows: list[Row] = field(default_factory=list)
    sections: list[Section] = field(default_factory=list)

    @property
    def file(self) -> str:
        """Name of its file."""
        return f"{self.name}.html"

    @property
    def cases(self) -> dict[str, str]:
        """Titles of the cases that it compares, by name."""
        return {row.case: row.case_title or row.case for row in self.rows}

    @property
    def exhibits(self) -> list[Exhibit]:
        """All its figures."""
        return [exhibit for section in self.sections for exhibit in section.all_exhibits]


def leaves_of(rows: Sequence[Row], found: Sequence[Section]) -> list[Leaf]:
    """Put each table, figure and section on one page.

    Parameters
    ----------
    rows
        That are compared.
    found
        Sections of the whole report.
    """
    homes = rows_at_home(rows)
    asked = [table.suite for section in found if section.name == "displacements" for table in section.tables]
    leaves = {name: Leaf(_stem(name), suite_title(name), homes.get(name, [])) for name in [*homes, *asked]}
    owners: dict[str, str] = {}
    for suite, leaf in leaves.items():
        owners = dict.fromkeys(leaf.cases, suite) | owners
    suites, home = list(leaves), _home_of(leaves)
    alone = next(iter(leaves.values())) if len(leaves) == 1 else None
    for section in found:
        if section.place == "its suites":
            for suite in suites:
                part = _about(section, suite, owners, home)
                leaves[suite].sections += [part] if part.shows else []
        elif section.place == "one suite":
            leaves[_owner(section, owners, home)].sections.append(section)
        else:
            own = alone or leaves.setdefault(section.name, Leaf(_stem(section.name), section.title))
            own.sections.append(section)
    return list(leaves.values())


def _stem(name: str) -> str:
    return f"suite_{name}" if name in (START, WHOLE) else name


def _about(section: Section, suite: str, owners: Mapping[str, str], home: Callable[[Exhibit], str]) -> Section:
    """Return the part of a section that is about one suite."""
    return section.with_each(lambda table: _part(table, suite, owners), lambda exhibit: home(exhibit) == suite)


def _part(table: Table, suite: str, owners: Mapping[str, str]) -> Table | None:
    """Return the lines of a table that are about one suite; None if there are none."""
    if table.suite:
        return table if table.suite == suite else None
    part = part_of(table, {case for case, owner in owners.items() if owner == suite})
    return part if len(part.data) else None


def part_of(table: Table, cases: Collection[str]) -> Table:
    """Return the lines of a table that are about some cases, with its remarks but for those on other cases."""
    kept = table.data["case"].isin(list(cases))
    if kept.all():
        return table
    others = tuple(map(str, table.data.loc[~kept, "block"].unique()))
    notes = tuple(note for note in table.notes if not note.about.startswith(others))
    return replace(table, data=table.data[kept], notes=notes)


def _owner(section: Section, owners: Mapping[str, str], home: Callable[[Exhibit], str]) -> str:
    """Return the suite that a section names, or that most of its cases belong to, or most of its figures."""
    named = all_tables([section])
    cases = [owners[case] for table in named if "case" in table.data for case in table.data["case"]]
    suites = [table.suite for table in named if table.suite in owners.values()]
    return Counter(suites or cases or map(home, section.all_exhibits)).most_common(1)[0][0]


def _home_of(leaves: Mapping[str, Leaf]) -> Callable[[Exhibit], str]:
    """Return a function that gives the page of a figure: its suite's, or the one with most of its runs."""
    pages: dict[str, list[str]] = {}
    for suite, leaf in leaves.items():
        for run_id in {row.run_id for row in leaf.rows if row.run_id}:
            pages.setdefault(run_id, []).append(suite)

    def home(exhibit: Exhibit) -> str:
        for suite in leaves:
            if exhibit.name in (f"{COMPOSITE}{suite}", f"{RESULTS}{suite}") or exhibit.name.startswith(
                f"{CONVERGENCE}{suite}_"
            ):
                return suite
        found = Counter(suite for run_id in exhibit.run_ids for suite in pages.get(run_id, ()))
        return max(leaves, key=lambda suite: found[suite])

    return home


def render_page(template: str, notation: Notation, leaf: Leaf, facts: dict[str, Any]) -> str:
    """Return a page of a template of the report; `facts` are what it names beside the leaf and its tables."""
    environment = document.templates(autoescape=notation is HTML)
    environment.filters |= {"escape_words": notation.escape, "code": notation.code, "anchor": anchor}
    environment.globals |= {
        "written": lambda table: table.write(notation.name),
        "files": _table_files,
        "results_of": lambda one: results(one.rows, notation, facts.get("unchecked", {})),
        "shortfalls_of": lambda one: shortfalls(one.rows),
    }
    cited = dict.fromkeys(source for table in all_tables(leaf.sections) for source in table.cited)
    return environment.get_template(template).render(
        **facts,
        leaf=leaf,
        sources=[(key, facts["bibliography"].get(key)) for key in cited],
    )


def _table_files(table: Table) -> dict[str, str]:
    """Return links that hold a table's files, so that the page keeps them wherever it is moved."""
    return {
        "csv": data_uri("text/csv;charset=utf-8", table.write("csv").encode()),
        "tex": data_uri("text/x-tex;charset=utf-8", table.write("latex").encode()),
    }
