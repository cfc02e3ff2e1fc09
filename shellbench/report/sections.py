"""The sections of evidence, in the order in which the page and the paper show them."""

from __future__ import annotations

from shellbench.report import (
    consistency,
    cost,
    engines,
    held_supports,
    memory,
    sampling_study,
    seeds,
    thinness,
    training_time,
)
from shellbench.report.evidence import Evidence, Maker, Section
from shellbench.report.palette import style

MAKERS: tuple[Maker, ...] = (
    engines.section,
    cost.section,
    consistency.section,
    memory.section,
    seeds.section,
    training_time.section,
    sampling_study.section,
    thinness.section,
    held_supports.section,
)


def sections(evidence: Evidence) -> list[Section]:
    """Return the sections that have something to show."""
    with style():
        made = [maker(evidence) for maker in MAKERS]
    return [section for section in made if section is not None]
