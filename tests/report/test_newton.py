"""The finding: Newton's law beside the published functional, and what stands there where nothing was run."""

import re

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import minimize

from shellbench.bench.catalogue import catalog
from shellbench.bench.store.store import Store as Records
from shellbench.problems.shell.records.portrait import ShellPortrait
from shellbench.report.data import exhibit
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import style
from shellbench.report.data.section import Formula
from shellbench.report.figures import shells
from shellbench.report.page.page import write_report
from shellbench.report.studies.newton import DERIVATION, findings, free_fall, newton_exhibits, newton_table, shown_cases
from tests.report.motion import REASON, G
from tests.report.test_page import Page, pages_of


@pytest.fixture(scope="module")
def by_id(motion):
    return {record.run_id: record for record in motion.records}


def test_the_closed_forms_are_free_fall_and_the_minimum_of_the_sum():
    """The published sum over a polynomial in time with u(0) = 0 is least at the second form, found by minimising it."""
    law, stationary = free_fall(ShellPortrait(catalog.named_case("free_fall")), "fall")
    t = law.marks
    assert (t[0], t[-1]) == (0.0, 1.0)
    assert law.values == pytest.approx(G * t**2 / 2)

    def published(c):
        def density(s):
            speed = sum(k * a * s ** (k - 1) for k, a in enumerate(c, start=1))
            return speed**2 / 2 - G * sum(a * s**k for k, a in enumerate(c, start=1))

        return quad(density, 0, 1)[0]

    best = minimize(published, np.zeros(3), tol=1e-12).x
    assert stationary.values == pytest.approx(sum(a * t**k for k, a in enumerate(best, start=1)), abs=1e-4)
    half = len(t) // 2
    assert stationary.values[half] / law.values[half] == pytest.approx(3.0)
    assert stationary.values[-1] == pytest.approx(law.values[-1])


def test_a_swinging_mode_creeps_under_the_sum():
    """The formula of the text, for an oscillator: it makes the sum of energies least, and the cosine does not."""
    omega, static, end = 9.0, 0.3, 1.0
    t = np.linspace(0, end, 20001)

    def published(u):
        rate = np.gradient(u, t, edge_order=2)
        return np.trapezoid(omega**2 * u**2 / 2 - omega**2 * static * u + rate**2 / 2, t)

    creep = static * (1 - np.cosh(omega * (end - t)) / np.cosh(omega * end))
    least = published(creep)
    for change in (t, t**2, np.sin(2 * np.pi * t), np.sin(30 * t)):
        for size in (0.01, -0.01):
            assert published(creep + size * change) > least
    assert published(static * (1 - np.cos(omega * t))) > least
    assert creep.max() < static


@pytest.mark.parametrize("name", ["pendulum_strip", "napkin_plane", "napkin_moving_corners", "sleeve_twist"])
def test_only_what_falls_freely_has_a_closed_form(name):
    case = ShellPortrait(catalog.named_case(name))
    assert case.gravity is None
    assert free_fall(case, "centre_z") is None


def test_each_case_stands_beside_newton(motion, by_id):
    found = {one.case.name: one for one in findings(Evidence(by_id, motion.rows, None))}
    assert list(found) == list(shown_cases())
    assert found["free_fall"].newton_by == "closed form"
    assert found["napkin_plane"].newton_by == "fem"
    assert found["pendulum_strip"].status == {"ndf-published": "not run"}
    assert [run.name for run in found["free_fall"].runs] == ["fem", "ndf", "ndf-published"]


def test_the_ratio_at_half_of_the_time_is_three(motion, by_id):
    lines = {
        (line["case"], line["when"]): line
        for line in newton_table(Evidence(by_id, motion.rows, None)).data.to_dict("records")
    }
    half, end = lines["free_fall", "T/2 = 0.5 s"], lines["free_fall", "T = 1 s"]
    assert half["newton"] == pytest.approx(G / 8)
    assert half["stationary"] / half["newton"] == pytest.approx(3.0)
    assert half["ndf-published"] / half["newton"] == pytest.approx(3.0)
    assert half["ndf"] / half["newton"] == pytest.approx(1.0)
    assert end["ndf-published"] / end["newton"] == pytest.approx(1.0)
    napkin = lines["napkin_plane", "T = 0.5 s"]
    assert napkin["newton"] == pytest.approx(napkin["fem"])
    text = newton_table(Evidence(by_id, motion.rows, None)).write("text")
    assert "3.675 (3.00)" in text
    assert "not run" in text


def test_a_way_that_was_not_reached_is_not_made_up(motion, by_id):
    table = newton_table(Evidence(by_id, motion.rows, None))
    lines = {(line["case"], line["at"]): line for line in table.data.to_dict("records")}
    assert lines["pendulum_strip", 0.5]["ndf"] == pytest.approx(lines["pendulum_strip", 0.5]["fem"])
    assert np.isnan(lines["pendulum_strip", 1.0]["ndf"])
    assert any(REASON in note.text for note in table.notes)


def test_the_figure_has_the_three_cases_and_both_closed_forms(motion, by_id):
    with style():
        (one,) = newton_exhibits(Evidence(by_id, motion.rows, None))
    assert [axes.get_ylabel() for axes in one.figure.axes] == ["fall (m)", "centre z (m)", "centre y (m)"]
    labels = [text.get_text() for text in one.figure.legends[0].get_texts()]
    assert sum("published functional" in label for label in labels) == 1
    assert "Pendulum strip: ndf-published not run" in one.caption


def test_nobody_who_asked_for_none_of_its_cases_gets_the_finding(store):
    assert newton_table(Evidence({}, store.rows, None)) is None
    assert list(newton_exhibits(Evidence({}, store.rows, None))) == []


def test_a_run_that_departs_from_the_defaults_says_so(motion, by_id):
    change = {"overrides": {"iterations": 9}, "default_settings": False, "declared": True, "label": "reduced: 9"}
    rows = [row.model_copy(update=change) if row.solver == "ndf-published" else row for row in motion.rows]
    notes = {(note.about, note.text) for note in newton_table(Evidence(by_id, rows, None)).notes}
    assert ("Free fall, ndf-published", "reduced: 9") in notes
    assert "3.675 (3.00)" in newton_table(Evidence(by_id, rows, None)).write("text")


def test_a_solver_that_a_suite_declares_is_missed(motion, by_id):
    """The suites of free fall declare other solvers: where they have no record, the table says so."""
    rows = [row for row in motion.rows if row.solver == "fem"]
    (fall, *_) = findings(Evidence(by_id, rows, None))
    assert fall.status.items() >= dict.fromkeys(("ndf", "ndf-published", "cst-hinge"), "not run").items()
    assert "not run" in newton_table(Evidence(by_id, rows, None)).write("text")


def test_where_nothing_was_run_it_is_said(motion):
    row = next(row for row in motion.rows if row.status == "missing")
    rows = [
        row.model_copy(update={"case": case, "case_title": case, "solver": solver})
        for case in shown_cases()
        for solver in ("fem", "ndf")
    ]
    table = newton_table(Evidence({}, rows, None))
    assert table.write("text").count("not run") >= 8
    assert "3.00" in table.write("text")  # the closed forms need no run
    with style():
        (one,) = newton_exhibits(Evidence({}, rows, None))
    assert len(one.figure.axes) == 1
    assert "Free fall: fem not run" in one.caption


@pytest.fixture(scope="module")
def report(motion, tmp_path_factory):
    with pytest.MonkeyPatch.context() as coarse:
        coarse.setattr(exhibit, "PRINT_DPI", 40)
        coarse.setattr(exhibit, "SCREEN_DPI", 40)
        coarse.setattr(shells, "CELLS", 8)
        out = tmp_path_factory.mktemp("motion_report")
        return write_report(Records(motion.folder), motion.rows, out, motion.known_values, for_print=False)


@pytest.mark.long
def test_the_page_has_the_finding_and_the_cloth(report):
    page = Page((report.parent / "cloth.html").read_text(encoding="utf-8"))
    assert not page.open
    targets = {attributes["id"] for _, attributes in page.tags if "id" in attributes}
    assert {"newton", "cloth", "table-motions", "table-times_napkin_plane"} <= targets
    assert {a["href"][1:] for t, a in page.tags if t == "a" and a["href"].startswith("#")} <= targets
    assert all(len(a["alt"]) > 20 for t, a in page.tags if t == "img")
    linked = {a["href"] for t, a in page.tags if t == "a"}
    for name in ("newton", "motion_napkin_plane", "energy_free_fall", "apart_napkin_plane", "buckling_sleeve_twist"):
        assert f"figures/{name}.svg" in linked
    assert (report.parent / "figures" / "frames_sleeve_twist.png").is_file()
    start = Page(report.read_text(encoding="utf-8"))
    everywhere = linked | {a["href"] for t, a in start.tags if t == "a"}
    downloads = {href.partition("#")[0] for href in everywhere if not href.startswith(("#", "https", "data:"))}
    assert {"newton.csv", "motions.csv", "times_free_fall.csv"} <= downloads
    assert all((report.parent / name).is_file() for name in downloads)


@pytest.mark.long
def test_each_figure_of_cloth_is_on_its_page_once(report, motion):
    text = "".join(pages_of(report).values())
    drawings = list((report.parent / "figures").glob("*.svg"))
    assert drawings
    for path in drawings:
        shown = 2 if path.name.startswith("results_") else 1  # the first page shows the results, too
        assert text.count(f'href="figures/{path.name}"') == shown, path.name


@pytest.mark.long
def test_the_derivation_is_read_in_both_pages(report):
    page, text = (
        (report.parent / "cloth.html").read_text(encoding="utf-8"),
        (report.parent / "report.md").read_text(encoding="utf-8"),
    )
    formulas = [passage for passage in DERIVATION if isinstance(passage, Formula)]
    assert len(formulas) >= 5
    assert page.count('<p class="formula">') == len(formulas)
    assert len(re.findall(r"^> ", text, flags=re.MULTILINE)) == len(formulas)
    assert "3.00 times" in page
    assert "3.00 times" in text
