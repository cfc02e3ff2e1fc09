"""Sections that other packages add to the report, by the entry-point group ``shellbench.sections``.

::

    [project.entry-points."shellbench.sections"]
    mine = "my_package.report:section"

A section is made as ours are: a function takes `Evidence` and returns a `Section`, or None if there is nothing to show.
It runs in the process that writes the report, and in no other: a report judges nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator

from shellbench.bench.plugins.registry import SolverEntry, load, registered
from shellbench.bench.store.store import Say
from shellbench.errors import InputError
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import Exhibit
from shellbench.report.data.section import Section
from shellbench.report.data.table import Table

GROUP = "shellbench.sections"


def sections_brought(found: Evidence, own: Collection[str], say: Say) -> Iterator[Section]:
    """Yield the sections of other packages; one that can't be made is left out, with one sentence.

    Parameters
    ----------
    own
        Names of our sections, which no other may have.
    """
    for entry in registered(GROUP, "section").values():
        try:
            section = _made(entry, found)
            if section is not None and section.name in own:
                raise InputError(f"section '{entry.name}' can't be used: '{section.name}' is a section of the report")
        except InputError as error:
            say(f"{error} (package {entry.distribution})")
        else:
            if section is not None:
                yield section


def _made(entry: SolverEntry, found: Evidence) -> Section | None:
    try:
        section = load(entry, "section", lambda maker: maker(found))
    except SystemExit:
        raise InputError(f"section '{entry.name}' can't be used: it ends the process") from None
    if section is not None and not (isinstance(section, Section) and all(map(_is_shown, _parts(section)))):
        raise InputError(f"section '{entry.name}' can't be used: it made no section")
    return section


def _parts(section: Section) -> Iterator[object]:
    yield from (*section.words, section.title, section.name)
    yield from (*section.all_tables, *section.details, *section.all_exhibits)


def _is_shown(part: object) -> bool:
    return isinstance(part, str | Table | Exhibit)
