"""The sections of a report, in the order in which page, Markdown and paper show them, and the page of each.

A new section of ours is a module that makes it and a line here; packages add others (`shellbench.report.page.brought`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import Record
from shellbench.bench.store.store import Say, Store, silent
from shellbench.report.data.evidence import Evidence, Maker, Section, all_tables
from shellbench.report.data.exhibit import Exhibit, style
from shellbench.report.data.runs import rows_at_home, suite_title, told_apart
from shellbench.report.data.solutions import Known
from shellbench.report.data.table import Table
from shellbench.report.figures.pictures import COMPOSITE, PICTURE, pictures
from shellbench.report.page.brought import sections_brought
from shellbench.report.sections import (
    calibration,
    consistency,
    cost,
    engines,
    kept,
    memory,
    replication,
    seeds,
    tables,
    whole_fields,
)
from shellbench.report.sections.convergence import CONVERGENCE, convergence_exhibits
from shellbench.report.studies import (
    clothing,
    conditioned,
    editing,
    learned,
    newton,
    paper_studies,
    passport,
    ropes,
    samples,
    strains,
    thinness,
    trace_tables,
)
from shellbench.report.studies.newton import newton_exhibits
from shellbench.report.studies.trace_exhibits import motion_exhibits, path_exhibits

START, WHOLE = "index", "report"  # files of a report that are no suite's


def drawn(name: str, title: str, *prefixes: str) -> Maker:
    """Return how to make a section of figures alone."""
    return lambda found: Section(name, title, exhibits=found.figures(*prefixes), place="its suites")


MAKERS: tuple[Maker, ...] = (
    tables.displacements,
    drawn("shells", "Shells", COMPOSITE, PICTURE),
    trace_tables.paths,
    strains.section,
    newton.section,
    trace_tables.cloth,
    ropes.section,
    clothing.section,
    learned.section,
    samples.section,
    conditioned.section,
    editing.section,
    replication.section,
    passport.section,
    kept.section,
    drawn("convergence", "Convergence", CONVERGENCE),
    whole_fields.section,
    calibration.section,
    engines.section,
    cost.section,
    consistency.section,
    memory.section,
    seeds.section,
    paper_studies.training,
    paper_studies.sampling,
    thinness.section,
    paper_studies.supports,
    tables.quantities,
)


OF_VARIANTS: tuple[Maker, ...] = (
    tables.displacements,
    calibration.section,
    tables.quantities,
)  # that tell of variants too


def gather(
    store: Store, rows: Sequence[Row], known: Known, whole: bool, say: Say
) -> tuple[Evidence, dict[str, Record], list[Section]]:
    """Return what a report is made from, the records as they are stored, and the sections."""
    stored = store.records_of({row.run_id for row in rows}, say)
    rows, records = told_apart(rows, stored)
    rows = [row for of_suite in rows_at_home(rows).values() for row in of_suite]
    found = Evidence(records, rows, store.folder, known, whole)
    found = replace(found, drawn=exhibits(as_declared(found)))
    return found, stored, sections(found, say)


def exhibits(evidence: Evidence) -> list[Exhibit]:
    """Return the figures of the report that compare solvers, case by case."""
    with style():
        return [
            *pictures(evidence),
            *path_exhibits(evidence),
            *motion_exhibits(evidence),
            *newton_exhibits(evidence),
            *convergence_exhibits(evidence),
        ]


def as_declared(found: Evidence) -> Evidence:
    """Return evidence without variants: they say whether a solver is right, and nothing new of cost or looks."""
    return replace(found, rows=[row for row in found.rows if not row.variant])


def sections(found: Evidence, say: Say = silent) -> list[Section]:
    """Return the sections that have something to show, those of other packages last."""
    declared = as_declared(found)
    with style():
        made = [maker(found if maker in OF_VARIANTS else declared) for maker in MAKERS]
        own = [section for section in made if section is not None]
        made += sections_brought(declared, {section.name for section in own}, say)
    return [section for section in made if section is not None and section.shows]


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
    def solvers(self) -> dict[str, str]:
        """Solvers that it compares, with what they say of themselves."""
        return {row.solver: row.solver_label for row in self.rows}

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
    """Return what a section has about a suite."""
    return section.with_each(lambda table: _part(table, suite, owners), lambda exhibit: home(exhibit) == suite)


def _part(table: Table, suite: str, owners: Mapping[str, str]) -> Table | None:
    """Return what a table has about a suite; None if it has nothing."""
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
    """Return how to find the page of a figure: that of its suite, or the one that most of its runs are on."""
    pages: dict[str, list[str]] = {}
    for suite, leaf in leaves.items():
        for run_id in {row.run_id for row in leaf.rows if row.run_id}:
            pages.setdefault(run_id, []).append(suite)

    def home(exhibit: Exhibit) -> str:
        for suite in leaves:
            if exhibit.name == f"{COMPOSITE}{suite}" or exhibit.name.startswith(f"{CONVERGENCE}{suite}_"):
                return suite
        found = Counter(suite for run_id in exhibit.run_ids for suite in pages.get(run_id, ()))
        return max(leaves, key=lambda suite: found[suite])

    return home
