"""The thinness study from synthetic records: errors, shares of energy and failures that are known beforehand."""

import json

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.reference import KnownValue, KnownValues
from shellbench.bench.store.record import Measured
from shellbench.problems.shell.records.portrait import ShellPortrait
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.table import WRITERS
from shellbench.report.studies.thinness import bending_share, findings, runs_by_shell, section
from tests.report.conftest import headline_of, record
from tests.report.test_tables import number

RATIOS = {"roof_thinness_1e_2": 1e-2, "roof_thinness_1e_3": 1e-3, "roof_thinness_1e_4": 1e-4}
TRUTH = dict(zip(RATIOS, (2.0, 30.0, 400.0), strict=True))
DOUBT = 1e-9
KNOWN_SHARE = dict(zip(RATIOS, (0.5, 0.25, 0.4), strict=True))
ENERGY = 8.0
LOCKING = dict(zip(RATIOS, (-0.001, -0.1, -0.9), strict=True))
REASON = "the field exploits its quadrature"


def known(name):
    if name not in RATIOS:
        return KnownValues()
    share = KNOWN_SHARE[name]
    values = {"edge_deflection": TRUTH[name], "membrane_energy": (1 - share) * ENERGY, "bending_energy": share * ENERGY}
    facts = {"role": "judge", "theory": "kirchhoff-love-linear", "origin": "made up", "source": "series1900"}
    return KnownValues(
        values=tuple(KnownValue(quantity=q, value=v, uncertainty=DOUBT * v, **facts) for q, v in values.items())
    )


def run(folder, name, solver, error, share, seed=None, status="ok", case=None):
    """A run whose headline is off by a relative error and whose energy splits with a share of bending."""
    case = case or catalog.named_case(name)
    made = record(folder, case, solver, seed, status=status, reason=None if status == "ok" else REASON)
    values = {"edge_deflection": TRUTH.get(name, 1.0) * (1 + error)}
    values |= {"membrane_energy": (1 - share) * ENERGY, "bending_energy": share * ENERGY}
    return made.model_copy(
        update={
            "case_name": name,
            "run_id": f"{name}-{solver}-{seed}",
            "values": {q: Measured(value=v) for q, v in values.items()},
            "parameters": 100 * (1 + len(solver)),
        }
    )


def row_of(made, label="", suites=("thinness",)):
    truth = TRUTH.get(made.case_name, 1.0)
    value, seed = made.values["edge_deflection"].value, made.identity.seed
    stated = {} if seed is None else {"uncertainty": 0.02 * abs(value), "energy_gap": 1e-7 * (1 + seed)}
    return headline_of(
        made,
        value,
        suite=suites[0] if suites else None,
        suites=suites,
        declared=True,
        settings={},
        reference=truth,
        reference_uncertainty=DOUBT * truth,
        relative_error=value / truth - 1,
        label=label,
        overrides={"neurons": 9} if label else {},
        default_settings=not label,
        case_title="",
        **stated,
    )


def evidence(folder, records, rows=None):
    rows = [row_of(made) for made in records] if rows is None else rows
    return Evidence({made.run_id: made for made in records}, rows, folder, known)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A solver that is exact but for 1e-6, one that locks, and one of three seeds that fails where it is thinnest."""
    folder = tmp_path_factory.mktemp("thin")
    found = []
    for name, ratio in RATIOS.items():
        share = KNOWN_SHARE[name]
        found.append(run(folder, name, "exact", 1e-6, share))
        found.append(run(folder, name, "locked", LOCKING[name], share * (1 + LOCKING[name])))
        for seed, sign in enumerate((1, -1, -3)):
            fails = ratio == 1e-4 and seed == 2
            status = "failed" if fails else "ok"
            found.append(run(folder, name, "field", sign * 1e-6 / ratio, share + 0.01 * sign * ratio, seed, status))
    return folder, found


@pytest.fixture(scope="module")
def made(runs):
    return section(evidence(*runs))


def lines_of(made, solver):
    data = made.tables[0].data
    return data[data["solver"] == solver].set_index("case")


def test_errors_and_shares_are_the_records(made):
    (table,) = made.tables
    assert table.data["case"].tolist() == [name for name in RATIOS for _ in range(3)]
    for name, ratio in RATIOS.items():
        locked, field = lines_of(made, "locked").loc[name], lines_of(made, "field").loc[name]
        assert locked["ratio"] == pytest.approx(ratio)
        assert locked["mean_error"] == locked["worst_error"] == pytest.approx(LOCKING[name])
        assert locked["share"] == pytest.approx(KNOWN_SHARE[name] * (1 + LOCKING[name]))
        assert locked["known_share"] == pytest.approx(KNOWN_SHARE[name])
        assert locked["share_departure"] == pytest.approx(KNOWN_SHARE[name] * LOCKING[name])
        size = 1e-6 / ratio
        assert field["mean_error"] == pytest.approx(-size, rel=1e-6)  # of +1, -1 and -3
        assert field["worst_error"] == pytest.approx(-3 * size, rel=1e-6)
        sizes = field[["least_size", "mean_size", "largest_size"]].tolist()
        assert sizes == pytest.approx([size, 5 / 3 * size, 3 * size], rel=1e-6)
        assert field["share_departure"] == pytest.approx(-0.03 * ratio)
        assert field["gap"] == pytest.approx(3e-7)
        assert field["own_estimate"] == pytest.approx(0.02)
        assert np.isnan(locked["own_estimate"])
        assert field["known_doubt"] == pytest.approx(DOUBT)


def test_runs_that_failed_are_counted_and_said(made):
    field = lines_of(made, "field")
    assert field["runs"].tolist() == [3, 3, 3]
    assert field["good"].tolist() == [3, 3, 2]
    assert [(note.about, note.text) for note in made.tables[0].notes] == [
        ("roof_thinness_1e_4, field, seed 2 (failed)", REASON)
    ]


def test_the_words_say_what_the_records_say(made):
    text = {words.split(": ")[0].removeprefix("Scordelis-Lo roof. "): words for words in made.words[1:4]}
    assert list(text) == ["exact", "field", "locked"]
    assert "\N{MINUS SIGN}0.10\N{NARROW NO-BREAK SPACE}% at h/L = 1e-2" in text["locked"]
    assert "\N{MINUS SIGN}90\N{NARROW NO-BREAK SPACE}% at h/L = 1e-4" in text["locked"]
    assert "\N{MINUS SIGN}36 percentage points (at h/L = 1e-4)" in text["locked"]  # 0.4 of the energy, times 0.9
    assert "1 of 9 runs failed (at h/L = 1e-4)" in text["field"]
    assert "energy gap 3.0×10⁻⁵\N{NARROW NO-BREAK SPACE}% at h/L = 1e-4" in text["field"]
    assert "energy gap" not in text["locked"]
    assert "failed" not in text["exact"] + text["locked"]
    assert "h/L from 1e-2 to 1e-4" in made.words[0]
    assert "from 120000 to 1.20×10⁹" in made.words[0]  # 12 (L/h)^2


def test_the_figure_draws_the_table(made):
    (exhibit,) = made.exhibits
    errors, shares, unknowns, seconds = exhibit.figure.axes
    assert errors.xaxis_inverted()
    data = made.tables[0].data
    for axes, name, factor in ((errors, "mean_size", 100), (shares, "share", 100), (seconds, "seconds", 1)):
        curves = [line.get_ydata() for line in axes.get_lines() if line.get_linestyle() != "None"]
        for solver in ("exact", "locked", "field"):
            expected = factor * lines_of(made, solver)[name].to_numpy(float)
            assert any(np.shape(c) == expected.shape and np.allclose(c, expected, rtol=1e-12) for c in curves), solver
    known_line = max(shares.get_lines(), key=lambda line: line.get_linewidth())
    assert known_line.get_ydata() == pytest.approx([100 * share for share in KNOWN_SHARE.values()])
    assert known_line.get_xdata() == pytest.approx(list(RATIOS.values()))
    shade = errors.collections[-1].get_paths()[0].vertices[:, 1]
    assert shade.max() == pytest.approx(100 * DOUBT)
    assert unknowns.get_yscale() == "log"
    assert set(exhibit.run_ids) == set(" ".join(data["run_ids"]).split(" "))


def test_marks_are_open_only_where_a_run_failed(made):
    errors = made.exhibits[0].figure.axes[0]
    opened = [x for line in errors.get_lines() if line.get_markerfacecolor() == "white" for x in line.get_xdata()]
    assert opened == pytest.approx([1e-4], rel=0.1)


def test_figure_and_page_are_written(made, tmp_path):
    made.exhibits[0].save(tmp_path)
    assert (tmp_path / "thinness_scordelis_lo_roof.svg").stat().st_size > 1000
    for format in WRITERS:
        text = made.tables[0].write(format)
        assert "locked" in text
        assert " nan" not in text.lower()


def test_errors_are_printed_in_per_cent(made):
    lines = [line.split() for line in made.tables[0].write("text").splitlines() if line.strip().startswith("locked")]
    assert [(number(cells[2])[0], cells[3]) for cells in lines] == [(-0.1, "%"), (-10, "%"), (-90, "%")]
    exact = next(line for line in made.tables[0].write("text").splitlines() if line.strip().startswith("exact"))
    assert "*" not in exact  # 1e-6 is more than the uncertainty


def test_an_error_below_the_uncertainty_is_marked(tmp_path):
    records = [run(tmp_path, name, "exact", 0.1 * DOUBT, 0.5) for name in RATIOS]
    text = section(evidence(tmp_path, records)).tables[0].write("text")
    assert sum("%*" in line for line in text.splitlines()) == len(RATIOS)


def test_variants_follow_their_solver_and_have_dashes_of_their_own(tmp_path):
    records = [run(tmp_path, name, "field", 1e-3, 0.5, seed) for name in RATIOS for seed in (0, 1)]
    rows = [row_of(made, label="" if made.identity.seed else "wide") for made in records]
    made = section(evidence(tmp_path, records, rows))
    assert made.tables[0].data["solution"].tolist() == ["field", "field, wide"] * len(RATIOS)
    curves = [line for line in made.exhibits[0].figure.axes[0].get_lines() if line.get_linestyle() != "None"]
    assert len({line.get_color() for line in curves}) == 1
    assert len({line.get_linestyle() for line in curves}) == 2


@pytest.mark.parametrize(
    ("name", "metres"), [("scordelis_lo", 50.0), ("square_plate", 100.0), ("pinched_cylinder_free", 600.0)]
)
def test_length_is_the_largest_extent_in_space(name, metres):
    assert ShellPortrait(catalog.named_case(name)).extent == pytest.approx(metres)


def test_share_of_bending():
    case = ShellPortrait(catalog.named_case("scordelis_lo"))
    assert bending_share(case, {"membrane_energy": 3.0, "bending_energy": 1.0}) == 0.25
    assert bending_share(case, {"membrane_energy": 3.0}) is None
    assert bending_share(case, {"membrane_energy": 0.0, "bending_energy": 0.0}) is None


def test_other_shells_are_families_of_their_own(tmp_path):
    thick, thin = (catalog.named_case(name) for name in ("roof_thinness_1e_2", "roof_thinness_1e_3"))
    records = [run(tmp_path, case.name, "exact", 1e-6, 0.5) for case in (thick, thin)]
    shorter = {"surface": thin.surface.model_copy(update={"xi2": (0.0, 40.0)})}
    loads = {"loads": tuple(load.model_copy(update={"vector": (0.0, -1.0, 0.0)}) for load in thin.loads)}
    for change, families in ((shorter, 0), (loads, 1)):
        other = json.loads(thin.model_copy(update=change).model_dump_json())
        changed = [records[0], records[1].model_copy(update={"case": other})]
        found = runs_by_shell(evidence(tmp_path, changed))
        assert len(found) == families


def test_without_two_thicknesses_of_the_study_there_is_no_section(tmp_path, store, runs):
    assert section(Evidence({r.run_id: r for r in store.records}, store.rows, store.folder, known)) is None
    _, records = runs
    assert section(evidence(tmp_path, [made for made in records if made.case_name == "roof_thinness_1e_2"])) is None
    elsewhere = [row_of(made, suites=("obstacle_course",)) for made in records]
    assert section(evidence(tmp_path, records, elsewhere)) is None


def test_runs_that_left_nothing_do_no_harm(tmp_path, runs):
    folder, records = runs
    silent = [
        made.model_copy(update={"values": {}, "status": "failed", "reason": REASON})
        if made.identity.solver == "locked"
        else made
        for made in records
    ]
    bare = {"value": None, "relative_error": None, "status": "failed", "seconds": None, "parameters": None}
    rows = [row_of(made) for made in records]
    rows = [row.model_copy(update=bare) if row.solver == "locked" else row for row in rows]
    found = section(evidence(folder, silent, rows))
    locked = found.tables[0].data.query("solver == 'locked'")
    assert locked["good"].tolist() == [0, 0, 0]
    assert locked["mean_error"].isna().all()
    assert "locked: 3 of 3 runs failed (at h/L = 1e-2, 1e-3, 1e-4)." in findings(found.tables[0].data)
    for exhibit in found.exhibits:
        exhibit.save(tmp_path)
    for format in WRITERS:
        assert "<NA>" not in found.tables[0].write(format)


def test_without_known_values_shares_are_shown_all_the_same(runs):
    folder, records = runs
    rows = [row_of(made).model_copy(update={"reference": None, "relative_error": None}) for made in records]
    blind = Evidence({made.run_id: made for made in records}, rows, folder, lambda name: KnownValues())
    data = section(blind).tables[0].data
    assert data["known_share"].isna().all()
    assert data["share"].notna().all()
    assert section(blind).exhibits[0].figure.axes
