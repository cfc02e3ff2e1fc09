"""The sections of a report, in the order in which page, Markdown and paper show them, and the page of each.

A new section here is a module that makes it and a line below; packages add others (`shellbench.report.page.brought`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import Record
from shellbench.bench.store.store import Say, Store, silent
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import Exhibit, style
from shellbench.report.data.runs import Known, rows_at_home, told_apart
from shellbench.report.data.section import Maker, Section
from shellbench.report.figures.pictures import COMPOSITE, PICTURE, pictures
from shellbench.report.page.brought import sections_brought
from shellbench.report.sections import (
    calibration,
    consistency,
    cost,
    kept,
    memory,
    replication,
    results,
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


def drawn(name: str, title: str, *prefixes: str) -> Maker:
    """Return a maker of a section that consists of figures only."""
    return lambda found: Section(name, title, exhibits=found.figures(*prefixes), place="its suites")


MAKERS: tuple[Maker, ...] = (
    tables.displacements,
    drawn("shells", "Shells", COMPOSITE, results.RESULTS, PICTURE),
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
    """Return the evidence of a report, the records as stored, and the sections."""
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
            *results.cost_exhibits(evidence),
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
