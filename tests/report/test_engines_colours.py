"""Colours of the solvers of all suites: each has its own, and those that came later left the others what they were."""

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.suite import Suite, SuiteRun
from shellbench.report.data.exhibit import COLOURS, MARKERS, OKABE_ITO, companies, declared_solvers, inks


def test_every_solver_has_a_colour_and_a_marker_of_its_own_among_those_that_suites_join():
    every = inks(declared_solvers())
    for company in companies():
        found = [every[solver] for solver in company]
        assert len({ink.colour for ink in found}) == len(found) == len({ink.marker for ink in found}), company


def test_solvers_of_engines_choose_last(monkeypatch):
    """A suite of engines, whatever its name, takes no colour from the solvers of the others, but from peers."""
    names, find = catalog.suite_names(), catalog.find_suite
    suites = [suite for suite in map(find, names) if suite.study != "engines"]
    others = {run.solver for suite in suites for run in suite.runs if not run.label}
    before = inks(others)
    guests = tuple(SuiteRun(solver=f"guest-{i}") for i in range(len(COLOURS)))
    first = Suite(name="a_first", title="", study="engines", runs=guests)
    monkeypatch.setattr(catalog, "suite_names", lambda: (first.name, *names))
    monkeypatch.setattr(catalog, "find_suite", lambda name: first if name == first.name else find(name))
    assert "guest-0" in declared_solvers()
    assert inks(others) == before


def test_further_colours_are_taken_only_when_the_first_are():
    assert COLOURS[: len(OKABE_ITO)] == OKABE_ITO
    assert len(COLOURS) == len(MARKERS) == len(set(COLOURS)) == len(set(MARKERS))


def seen(colour: str, matrix: list[list[float]]) -> tuple[float, ...]:
    """CIELAB of a colour as eyes see it whose linear RGB goes through a matrix."""
    sRGB = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in sRGB]
    dimmed = [min(1.0, max(0.0, sum(m * c for m, c in zip(row, linear, strict=True)))) for row in matrix]
    to_xyz = ((0.4124564, 0.3575761, 0.1804375), (0.2126729, 0.7151522, 0.0721750), (0.0193339, 0.1191920, 0.9503041))
    white = (0.95047, 1.0, 1.08883)
    xyz = [sum(m * c for m, c in zip(row, dimmed, strict=True)) / w for row, w in zip(to_xyz, white, strict=True)]
    x, y, z = (t ** (1 / 3) if t > (6 / 29) ** 3 else t / (3 * (6 / 29) ** 2) + 4 / 29 for t in xyz)
    return (116 * y - 16, 500 * (x - y), 200 * (y - z))


EYES = {  # Machado, Oliveira & Fernandes 2009, severity 1
    "normal": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}


def apart(one: str, other: str) -> float:
    """Least distance in CIELAB between two colours, over all eyes."""
    return min(
        sum((a - b) ** 2 for a, b in zip(seen(one, eyes), seen(other, eyes), strict=True)) ** 0.5
        for eyes in EYES.values()
    )


def test_further_colours_are_as_far_from_the_others_as_these_are_from_each_other():
    least = min(apart(one, other) for one in OKABE_ITO for other in OKABE_ITO if one < other)
    for further in COLOURS[len(OKABE_ITO) :]:
        assert all(apart(further, other) > least for other in COLOURS if other != further)
