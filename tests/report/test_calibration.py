import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.calibration import MOST, calibrations
from shellbench.report.data.evidence import Evidence
from shellbench.report.sections.calibration import calibration_figure, calibration_table, section
from tests.report.conftest import COURSE, TRUTH, UNCERTAINTY, record, row


def stating(folder, solver, errors, stated, status="ok"):
    """Records and rows of the course by a solver that is wrong by relative errors and states a relative uncertainty."""
    found = []
    for name, error in zip(COURSE, errors, strict=True):
        made = record(folder, catalog.named_case(name), solver, None, error)
        update = {"uncertainty": None if stated is None else stated * TRUTH[name], "status": status}
        found.append((made, row(made).model_copy(update=update)))
    return found


@pytest.fixture
def runs(tmp_path):
    sure = stating(tmp_path, "ndf-ritz", (0.0, 0.0, 0.0, 1e-3), 1e-6)  # wrong by 1e-3 once, and sure to 1e-6
    return [
        *stating(tmp_path, "fem", (1e-5, -1e-5, 5e-6, 0.0), 2e-5),
        *sure,
        *stating(tmp_path, "ndf", [0.1] * 4, None),
    ]


def evidence(runs):
    return Evidence({made.run_id: made for made, _ in runs}, [of for _, of in runs], None)


def test_an_overconfident_solver_is_named(runs):
    found = section(evidence(runs))
    (table,) = found.tables
    lines = table.data.set_index("solver")
    assert lines["verdict"].to_dict() == {"fem": "well calibrated", "ndf": "states none", "ndf-ritz": "over-confident"}
    assert lines["where"]["ndf-ritz"] == f"{COURSE[-1]} {catalog.named_case(COURSE[-1]).primary.name}"
    assert lines["worst"]["ndf-ritz"] == pytest.approx(1e-3 / (1e-6 + UNCERTAINTY), rel=1e-3)
    assert [note.about for note in table.notes] == [f"ndf-ritz, {lines['where']['ndf-ritz']}"]
    assert "over-confident" in table.write("markdown")
    assert "ndf-ritz: 75 % of 4 errors" in found.exhibits[0].description


def test_shares_silence_and_figures_are_counted(runs):
    lines = section(evidence(runs)).tables[0].data.set_index("solver")
    assert lines.loc["fem", ["figures", "within_1", "within_2", "within_5", "silent"]].tolist() == [4, 1, 1, 1, 0]
    assert lines.loc["ndf-ritz", ["figures", "within_1", "within_5"]].tolist() == [4, 0.75, 0.75]
    assert lines.loc["ndf", ["figures", "silent"]].tolist() == [0, 4]


def test_a_share_that_is_not_all_is_not_rounded_to_all(tmp_path):
    (one,) = stating(tmp_path, "fem", (1e-3, 0.0, 0.0, 0.0), 1e-6)[:1]
    good = stating(tmp_path, "fem", (0.0,) * 4, 1e-6)[1:2] * 4999
    text = calibration_table(calibrations([of for _, of in (one, *good)])).write("text")
    assert "99.9 %" in text
    assert "100 %" not in text


def test_what_has_not_settled_is_counted_and_no_overconfidence(tmp_path):
    runs = stating(tmp_path, "fem", (1e-3, 0.0, 0.0, 0.0), 1e-6, status="not settled")
    found = section(evidence(runs))
    assert found.tables[0].data["within_5"].tolist() == [0.75]
    assert found.tables[0].notes == ()
    assert found.tables[0].data["verdict"].tolist() == ["over-confident"]  # 95 % are asked of all


def test_the_long_table_has_every_figure_the_worst_first(runs):
    (details,) = section(evidence(runs)).details
    assert details.data["block"].tolist() == ["fem"] * 4 + ["ndf-ritz"] * 4
    ratios = details.data.loc[details.data["block"] == "ndf-ritz", "ratio"]
    assert ratios.iloc[0] == max(ratios)
    assert ratios.iloc[0] > MOST > ratios.iloc[1]


def test_the_figure_has_a_mark_for_each_figure_and_lines_at_the_ratios(runs):
    found = evidence(runs)
    (axes,) = calibration_figure(calibrations(found.compared), found.inks).axes
    marks = [line for line in axes.get_lines() if line.get_linestyle() == "None"]
    assert sum(len(line.get_xdata()) for line in marks) == 8
    largest = max(float(np.max(line.get_ydata())) for line in marks)
    assert largest == pytest.approx(1e-3, rel=1e-6)
    ratios = [line.get_ydata()[0] / line.get_xdata()[0] for line in axes.get_lines() if line not in marks]
    assert ratios == pytest.approx([1.0, 2.0, 5.0])
    assert axes.get_xscale() == axes.get_yscale() == "log"


def test_without_any_stated_uncertainty_there_is_no_section(tmp_path):
    assert section(evidence(stating(tmp_path, "ndf", [0.1] * 4, None))) is None
    assert section(evidence([])) is None
