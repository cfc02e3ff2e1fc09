"""The ablation of strain measures: closed forms, table, words and figures."""

import csv
import io
import math

import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from shellbench.bench.catalogue import catalog
from shellbench.problems.shell.records.portrait import ShellPortrait
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import style
from shellbench.report.studies.strains import (
    CURVATURE,
    ENERGY,
    INKS,
    STRAINS,
    VANISHES,
    bending_energies,
    exact_energy,
    findings,
    linear_energy,
    published_energy,
    strain_rows,
    strain_table,
)
from shellbench.report.studies.trace_exhibits import path_exhibits
from tests.report.nonlinear import rolled_energy, seen_curvature

ANGLES = [math.radians(degrees) for degrees in (1e-3, 30, 45, 90, 128.17, 135, 180)]


@pytest.fixture(scope="module")
def table(nonlinear):
    return strain_table(Evidence({}, nonlinear.rows, None))


@pytest.fixture(scope="module")
def figures(nonlinear):
    by_id = {record.run_id: record for record in nonlinear.records}
    with style():
        shown = path_exhibits(Evidence(by_id, nonlinear.rows, nonlinear.folder, nonlinear.known_values))
        return {one.name: one for one in shown if one.name.startswith("strain_")}


@pytest.mark.parametrize("strain", STRAINS)
@pytest.mark.parametrize("theta", ANGLES)
def test_closed_forms_are_those_of_the_strains_themselves(strain, theta):
    assert CURVATURE[strain](theta) == pytest.approx(seen_curvature(strain, theta), abs=1e-14)
    mean = quad(lambda phi: seen_curvature(strain, phi) ** 2, 0, theta)[0] / theta
    assert ENERGY[strain](theta) == pytest.approx(mean, rel=1e-9)


def test_at_rest_all_measures_agree():
    assert published_energy(0.0) == linear_energy(0.0) == 1.0


def test_the_published_stiffness_vanishes_at_128_degrees():
    root = brentq(lambda phi: seen_curvature("published", phi), 1.0, 3.0)
    assert pytest.approx(root, abs=1e-12) == VANISHES
    assert f"{math.degrees(VANISHES):.2f}" == "128.17"
    assert seen_curvature("published", math.pi) == pytest.approx(-1.0)  # turned round


def test_the_exact_energy_is_that_of_the_case():
    case = catalog.named_case("rolled_plate")
    stiffness = 1.2e7 * 0.01**3 / 12  # nu = 0
    assert ShellPortrait(case).rolling_stiffness == pytest.approx(stiffness * 0.5 / 1.0)
    assert exact_energy(math.pi / 2, ShellPortrait(case).rolling_stiffness) == pytest.approx(
        rolled_energy("exact", 0.5)
    )


def test_energies_are_the_records(nonlinear):
    by_id = {record.run_id: record for record in nonlinear.records}
    found = bending_energies(Evidence(by_id, nonlinear.rows, None), "rolled_plate")
    assert set(found) == set(STRAINS)
    for strain, by_mark in found.items():
        assert list(by_mark) == list(catalog.named_case("rolled_plate").states)
        assert by_mark[0.75] == rolled_energy(strain, 0.75)


def test_the_figure_has_each_energy_on_its_closed_form(nonlinear, figures):
    shown = figures["strain_rolled_plate"]
    left, middle, right = shown.figure.axes
    assert (left.get_ylabel(), right.get_ylabel()) == ("bending energy (J)", "curvature / exact")
    assert all("degrees" in axes.get_xlabel() for axes in shown.figure.axes)
    marks = catalog.named_case("rolled_plate").states
    for axes, value in ((left, lambda s, t: rolled_energy(s, t)), (middle, lambda s, t: ENERGY[s](math.pi * t))):
        for strain in STRAINS:
            (drawn,) = [line for line in axes.get_lines() if line.get_label() == f"{strain}, computed"]
            (form,) = [line for line in axes.get_lines() if line.get_label() == f"{strain}, closed form"]
            assert list(drawn.get_xdata()) == [180 * t for t in marks]
            assert list(drawn.get_ydata()) == pytest.approx([value(strain, t) for t in marks])
            assert drawn.get_color() == form.get_color() == INKS[strain].colour
            at = dict(zip(form.get_xdata(), form.get_ydata(), strict=True))
            assert at[90.0] == pytest.approx(value(strain, 0.5))
    (zero,) = [line for line in right.get_lines() if list(line.get_ydata()) == [0.0]]
    assert zero.get_xdata()[0] == pytest.approx(128.17, abs=5e-3)
    assert "128.17°" in right.texts[0].get_text()
    assert len(shown.run_ids) == len(STRAINS)


def test_a_curve_for_each_strain_of_a_case_with_a_path(nonlinear, figures):
    shown = figures["strain_cantilever_shear"]
    legend = [text.get_text() for text in shown.figure.legends[0].get_texts()]
    assert set(STRAINS) <= set(legend)
    assert "ndf-ritz" not in legend
    assert len(shown.run_ids) == len(STRAINS)


def test_the_table_has_a_line_for_each_quantity_energies_included(nonlinear, table):
    shown = {(line["case"], line["quantity"]) for line in table.data.to_dict("records")}
    cases = ("rolled_plate", "rigid_rotation", "cantilever_shear")
    assert shown == {(name, q.name) for name in cases for q in catalog.named_case(name).quantities}
    assert {"strain_energy", "membrane_energy", "bending_energy", "deflection_4"} <= {q for _, q in shown}


def test_a_cases_figures_stand_in_the_order_of_their_marks(table):
    for _, of_case in table.data.groupby("case", sort=False):
        assert list(of_case["at"]) == sorted(of_case["at"])


def test_the_tables_numbers_are_the_records(nonlinear, table):
    by_id = {record.run_id: record for record in nonlinear.records}
    for line in table.data.to_dict("records"):
        for strain in STRAINS:
            record = by_id[line[f"{strain}_run_id"]]
            assert record.identity.settings["strain"] == strain
            assert line[strain] == record.values[line["quantity"]].value
            if line["reference"] is not None and line["reference"] == line["reference"] and line["reference"]:
                assert line[f"{strain}_error"] == pytest.approx(line[strain] / line["reference"] - 1, abs=1e-14)


def test_errors_near_zero_are_absolute_and_without_a_known_value_departures_are_marked(table):
    text = table.write("markdown")
    turned = next(line for line in text.splitlines() if "after 180 degrees" in line)
    assert turned.split(" | ")[5] == "7.5 J"
    energy = next(line for line in text.splitlines() if line.startswith("| membrane energy at t = 1"))
    cells = energy.strip("| ").split(" | ")
    assert cells[1] == "–"
    assert cells[3].endswith("†")
    assert cells[7] == "–"  # exact against itself


def test_the_table_as_csv_has_every_digit(nonlinear, table):
    lines = list(csv.DictReader(io.StringIO(table.write("csv"))))
    line = next(d for d in lines if d["quantity"] == "bending_energy_90")
    assert float(line["published"]) == rolled_energy("published", 0.5)
    assert float(line["published_error"]) == pytest.approx(published_energy(math.pi / 2) - 1)


def test_the_words_have_the_records_figures(nonlinear):
    text = " ".join(findings(Evidence({}, nonlinear.rows, None)))
    assert "128.17°" in text
    assert "1.30 at 90°" in text
    assert "7.5 J in the published measure" in text
    assert "2 · 10⁻¹² J in the exact measure" in text


def test_a_strain_that_failed_is_said_and_one_that_is_missing_too(nonlinear):
    broken = [
        row.model_copy(update={"status": "failed", "reason": "the tangent is singular", "value": None})
        if row.label == "published" and row.case == "cantilever_shear"
        else row
        for row in nonlinear.rows
        if not (row.label == "linear" and row.case == "cantilever_shear")
    ]
    text = strain_table(Evidence({}, broken, None)).write("text")
    line = next(line for line in text.splitlines() if "along the force 4" in line)
    assert "missing" in line
    assert "run failed" in line
    assert text.count("the tangent is singular") == 1


def test_without_the_ablation_there_is_no_table_and_no_figure(nonlinear):
    others = [row for row in nonlinear.rows if "strain_ablation" not in row.suites]
    assert strain_rows(Evidence({}, others, None)) == []
    assert strain_table(Evidence({}, others, None)) is None
    by_id = {record.run_id: record for record in nonlinear.records}
    names = [one.name for one in path_exhibits(Evidence(by_id, others, nonlinear.folder, nonlinear.known_values))]
    assert not any(name.startswith("strain_") for name in names)


def test_the_exact_measure_alone_is_no_ablation(nonlinear):
    exact = [row for row in nonlinear.rows if row.label in ("", "exact")]
    assert any("strain_ablation" in row.suites for row in exact)
    assert strain_rows(Evidence({}, exact, None)) == []
    assert strain_table(Evidence({}, exact, None)) is None
