"""What stands on which page: a page for each suite, and one for each section that several suites share."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from shellbench.bench.row import Row
from shellbench.report.contents import Tables
from shellbench.report.evidence import Section
from shellbench.report.exhibit import Exhibit
from shellbench.report.exhibits import COMPOSITE, CONVERGENCE
from shellbench.report.strains import SUITE as STRAINS
from shellbench.report.suites import rows_at_home, suite_title
from shellbench.report.table import Table

START = "index"
DISPLACEMENTS, QUANTITIES = "displacements_", "quantities_"  # how names of tables begin


@dataclass
class Leaf:
    """One page.

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
    tables: Tables = field(default_factory=Tables)
    exhibits: list[Exhibit] = field(default_factory=list)
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
    def solvers(self) -> list[str]:
        """Solvers that it compares."""
        return list(dict.fromkeys(row.solver for row in self.rows))

    @property
    def run_ids(self) -> set[str]:
        """Runs that it compares."""
        return {row.run_id for row in self.rows if row.run_id}


def leaves_of(
    rows: Sequence[Row], tables: Tables, exhibits: Sequence[Exhibit], sections: Sequence[Section]
) -> list[Leaf]:
    """Put each table, figure and section on one page.

    Parameters
    ----------
    rows
        That are compared.
    tables, exhibits, sections
        Of the whole report. A table of several suites is split by its cases. A section stands on the page of the only
        suite, or of the suite that has its name, or else on a page of its own.
    """
    homes = rows_at_home(rows)
    suites = dict.fromkeys([*homes, *(table.name.removeprefix(DISPLACEMENTS) for table in tables.displacements)])
    leaves = {suite: Leaf(_file(suite), suite_title(suite), homes.get(suite, [])) for suite in suites}
    owners: dict[str, str] = {}
    for suite, leaf in leaves.items():
        owners = dict.fromkeys(leaf.cases, suite) | owners
    for suite, leaf in leaves.items():
        leaf.tables = _tables_of(suite, [case for case, owner in owners.items() if owner == suite], tables)
    for table in tables.strains:
        leaves[STRAINS if STRAINS in leaves else _owner(table, owners)].tables.strains.append(table)
    for table in tables.newton:
        leaves[_owner(table, owners)].tables.newton.append(table)
    for exhibit in exhibits:
        _home(exhibit, leaves).exhibits.append(exhibit)
    if len(leaves) == 1:
        next(iter(leaves.values())).sections += sections
    else:
        for section in sections:
            leaves.setdefault(section.name, Leaf(_file(section.name), section.title)).sections.append(section)
    return list(leaves.values())


def _file(name: str) -> str:
    return f"suite_{name}" if name in (START, "report") else name


def _tables_of(suite: str, cases: Sequence[str], tables: Tables) -> Tables:
    """Return the tables of a suite, and the parts of those of several suites that are about its cases."""
    return Tables(
        displacements=[table for table in tables.displacements if table.name == f"{DISPLACEMENTS}{suite}"],
        quantities=[table for table in tables.quantities if table.name == f"{QUANTITIES}{suite}"],
        fields=_parts(tables.fields, cases),
        paths=_parts(tables.paths, cases),
        motions=_parts(tables.motions, cases),
    )


def _parts(tables: Sequence[Table], cases: Collection[str]) -> list[Table]:
    return [part for table in tables if len((part := part_of(table, cases)).data)]


def part_of(table: Table, cases: Collection[str]) -> Table:
    """Return the lines of a table that are about some cases, with its remarks but for those on other cases."""
    kept = table.data["case"].isin(list(cases))
    if kept.all():
        return table
    others = tuple(map(str, table.data.loc[~kept, "block"].unique()))
    notes = tuple(note for note in table.notes if not note.about.startswith(others))
    return replace(table, data=table.data[kept], notes=notes)


def _owner(table: Table, owners: Mapping[str, str]) -> str:
    """Return the suite that most cases of a table belong to."""
    return Counter(owners[case] for case in table.data["case"]).most_common(1)[0][0]


def _home(exhibit: Exhibit, leaves: Mapping[str, Leaf]) -> Leaf:
    """Return the page of a figure: that of its suite, or the one that most of its runs are on, or its table."""
    for suite, leaf in leaves.items():
        if exhibit.name == f"{COMPOSITE}{suite}" or exhibit.name.startswith(f"{CONVERGENCE}{suite}_"):
            return leaf
    found = Counter(leaf.name for leaf in leaves.values() for run_id in exhibit.run_ids if run_id in leaf.run_ids)
    if not found:
        return next((leaf for leaf in leaves.values() if leaf.tables.newton), next(iter(leaves.values())))
    return next(leaf for leaf in leaves.values() if leaf.name == found.most_common(1)[0][0])
