"""What stands in a report: all its tables, for the page and for the paper."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from shellbench.report.effort import effort_table
from shellbench.report.evidence import Evidence, Section
from shellbench.report.fields import field_table
from shellbench.report.motion_tables import motion_tables
from shellbench.report.newton import newton_table
from shellbench.report.strains import strain_table
from shellbench.report.suites import compared
from shellbench.report.table import Table
from shellbench.report.tables import displacement_tables, quantity_tables


@dataclass(frozen=True)
class Tables:
    """All tables of a report."""

    displacements: list[Table] = field(default_factory=list)
    fields: list[Table] = field(default_factory=list)
    paths: list[Table] = field(default_factory=list)
    strains: list[Table] = field(default_factory=list)
    quantities: list[Table] = field(default_factory=list)
    motions: list[Table] = field(default_factory=list)
    newton: list[Table] = field(default_factory=list)
    evidence: list[Table] = field(default_factory=list)

    @property
    def printed(self) -> list[Table]:
        """Those that fit a printed page."""
        return [*self.displacements, *self.apart]

    @property
    def apart(self) -> list[Table]:
        """Those with columns of their own, each a file of its own."""
        return [*self.paths, *self.strains, *self.newton, *self.motions, *self.fields, *self.evidence]

    @property
    def all(self) -> list[Table]:
        """All of them, in the order of the page."""
        return [*self.printed, *self.quantities]


def tables_of(found: Evidence, sections: Sequence[Section], *, whole: bool = False) -> Tables:
    """Return the tables that compare solvers, and those of the sections of evidence."""
    records, rows = dict(found.records), compared(found.rows)
    return Tables(
        displacements=displacement_tables(rows, found.known, whole=whole),
        fields=_there(field_table(records, rows, found.folder)),
        paths=_there(effort_table(records, rows)),
        strains=_there(strain_table(rows)),
        quantities=quantity_tables(rows, found.known),
        motions=motion_tables(records, rows, found.folder),
        newton=_there(newton_table(records, rows)),
        evidence=[table for section in sections for table in section.tables],
    )


def _there(table: Table | None) -> list[Table]:
    return [] if table is None else [table]
