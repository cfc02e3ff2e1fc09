"""Results of other programs: slips in a filled sheet, the limit they tend to, and records that no gate takes."""

from functools import partial
from pathlib import Path

import pandas as pd
import pytest

import shellbench as package
from shellbench.bench.judge.board import read_board
from shellbench.bench.judge.compare import rows
from shellbench.bench.judge.expected import Scope
from shellbench.bench.judge.gate import gate
from shellbench.bench.store.pack import read_pack, write_pack
from shellbench.bench.store.record import Record, read_document
from shellbench.bench.store.store import Store
from shellbench.errors import InputError
from shellbench.protocol.limit import limit_of
from tests.bench.running import command


@pytest.fixture
def shellbench(monkeypatch, capfd):
    """Run the program; return exit code, standard output and standard error."""
    return partial(command, monkeypatch, capfd)


HEAD = "case,quantity,at,value,unit,cells,unknowns,seconds"
ROW = "scordelis_lo,edge_deflection,,0.3,m,8x8,300,2"
THIN, HARD, SOFT = 0.3005924566, 0.3014541527, 0.302024802  # references/scordelis_lo*.toml


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (ROW, r"line 1 is no heading of answers"),
        (f"{HEAD},remark\n{ROW},fine", "line 1: found the columns"),
        (f"{HEAD}\n{ROW},1", "line 2: found 9 cells, and line 1 has 8"),
        (f"{HEAD}\n\n{ROW.replace('scordelis', 'scordeli')}", "line 3, field 'case': unknown case.*scordelis_lo"),
        (
            f"{HEAD}\n{ROW.replace('edge', 'egde')}",
            "line 2, field 'quantity': found 'egde_deflection'.*edge_deflection",
        ),
        (f"{HEAD}\n{ROW.replace(',m,', ',furlong,')}", "line 2, field 'unit': found 'furlong'"),
        (f"{HEAD}\n{ROW.replace(',m,', ',,')}", "line 2, field 'unit': found '', but the quantity is in m"),
        (f"{HEAD}\n{ROW.replace(',m,', ',N mm,')}", "line 2, field 'unit': found 'N mm', but the quantity is in m"),
        (f"{HEAD}\n{ROW.replace('0.3', 'nan')}", "line 2, field 'value': found 'nan'"),
        (f"{HEAD}\n{ROW.replace('0.3', '-inf')}", "line 2, field 'value': found '-inf'"),
        (f"{HEAD}\n{ROW}".replace("0.3", "0,3").replace("case,", "case;"), "line 1"),
        (f"{HEAD}\n{ROW.replace(',0.3', ';0,3')}".replace(",", ";").replace("0;3", "0,3"), "line 2"),
        (f"{HEAD}\n{ROW.replace(',,', ',0.5,')}", "line 2, field 'at': found 0.5"),
        (f"{HEAD}\n{ROW.replace('8x8', '-4')}", "line 2, field 'cells': found '-4'"),
        (
            f"{HEAD}\n{ROW}\n{ROW}",
            "line 3: edge_deflection has a value on this mesh in answers.csv, line 2, too: judge each element",
        ),
        (
            f"{HEAD}\n{ROW}\n{ROW.replace('8x8,300', ',')}",
            "line 3, field 'cells': edge_deflection has other values: on which mesh",
        ),
        (f"{HEAD}\n{ROW.replace('0.3', '')}", "no value is filled in"),
        (HEAD.encode("utf-16").decode("latin-1"), "line 1|UTF-8"),
        ("x,y,z,ux,uy,uz\n0,0,0,0,0,0", "needs? a file, and --case"),
    ],
)
def test_a_slip_in_a_filled_sheet_is_refused(shellbench, tmp_path, text, words):
    path = tmp_path / "answers.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=f"answers.csv: .*({words})"):
        package.judge(path)
    assert shellbench("judge", path)[0] == 2


def sheet(values, unit="m", cells=(8, 16, 32), quantity="edge_deflection"):
    ladder = zip(values, cells[-len(values) :], strict=True)
    lines = [("scordelis_lo", quantity, "both edges", value, unit, f"{n} x {n}", 20 * n * n, n) for value, n in ladder]
    return pd.DataFrame(lines, columns=HEAD.split(","))


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ([-0.31, -0.302, -0.3006], "sign is against all"),
        ([310.0, 302.0, 300.6], r"1e\+3 times"),
        ([0.3e-3], r"1e-3 times"),
        ([0.3, 0.3], "2 meshes of 3"),
        ([0.3, 0.31, 0.32], "nothing is stated of largest_displacement"),
    ],
)
def test_doubts_are_told_and_the_value_is_judged(values, words):
    with pytest.warns(UserWarning, match=words):
        assert len(package.judge(sheet(values))) >= 4


@pytest.mark.filterwarnings("ignore:scordelis_lo")
@pytest.mark.parametrize("rate", [1, 2, 4])
@pytest.mark.parametrize(("limit", "case"), [(THIN, ""), (HARD, "@naghdi"), (SOFT, "@naghdi_soft")])
def test_the_limit_and_its_theory_are_found(limit, case, rate):
    meshes = (8, 16, 32) if rate == 2 else (8, 16, 32, 64)
    values = [1e3 * limit * (1 - 0.02 * (8 / n) ** rate) for n in meshes]
    found = package.judge([sheet([value], "mm", [n]) for value, n in zip(values, meshes, strict=True)][::-1])
    last = found[found["kind"] == "limit"].iloc[0]
    assert last["value"] == pytest.approx(limit, abs=5e-6)
    assert last["rate"] == pytest.approx(rate, abs=0.02)
    assert set(found["case"]) == {f"scordelis_lo{case}"}
    names = {"": "thin", "@naghdi": "hard supports", "@naghdi_soft": "soft supports"}
    assert names[case] in found[found["name"].str.endswith("*")]["name"].item()
    assert names[case] in last["tends_to"].split(";")[0]
    assert found[found["kind"] == "mesh"]["value"].tolist() == pytest.approx([1e-3 * value for value in values])


@pytest.mark.filterwarnings("ignore:scordelis_lo")
def test_no_limit_is_made_up():
    for values, words in (
        ([0.354, 0.339, 0.348], "shows no rate of convergence: the last values differ by 0.015"),
        ([0.34, 0.325, 0.32], "which is none of the known limits"),
        ([0.29, 0.296, 0.299], "too uncertain to tell the limits apart"),
        ([0.3], "one mesh shows no limit"),
    ):
        found = package.judge(sheet(values))
        told = found["tends_to"].dropna().tolist()
        assert words in told[0] if told else len(values) == 1
        assert set(found["case"]) == {"scordelis_lo"} or "no rate" not in words


@pytest.fixture
def stated(shellbench, tmp_path):
    """A store with stated values without an error."""
    sheet([0.99 * THIN, 0.999 * THIN, THIN]).to_csv(tmp_path / "a.csv", index=False)
    options = ("--name", "fem", "--program", "Abaqus 2024", "--element", "S4R", "--theory", "kirchhoff-love-linear")
    code, out, err = shellbench("judge", tmp_path / "a.csv", *options, "--store", tmp_path / "store", "--class", "1e-2")
    assert (code, "fem (stated)" in err, "0.0001" in out) == (0, True, True)
    return Store(tmp_path / "store")


def test_stated_values_are_shown_and_no_gate_takes_them(shellbench, stated, tmp_path):
    row = next(row for row in rows(stated) if row.primary)
    assert (row.solver, row.passed, row.seconds, row.value) == ("fem (stated)", None, None, THIN)
    assert "32 s on a machine that nobody knows" in row.remark
    with pytest.raises(InputError, match="nothing was judged"):
        gate(stated, None, Scope())
    for more in ([], ["--suite", "quick"], ["--solver", "fem"]):
        assert shellbench("gate", *more, "--store", stated.folder)[0] != 0
    for asked in (["table"], ["report", "--out", tmp_path / "r", "--no-print"], ["compare", stated.folder]):
        code, out, _ = shellbench(*asked, *([stated.folder] if "compare" in asked else ["--store", stated.folder]))
        assert code == 0
        assert "fem (stated)" in (tmp_path / "r/index.html").read_text() if "report" in asked else "fem (stated)" in out
    (tmp_path / "packs").mkdir()
    write_pack(stated, "fem (stated)", tmp_path / "packs/a.zip")
    assert read_pack(tmp_path / "packs/a.zip").records[0].stated.files.keys() == {"a.csv"}
    (entry,) = read_board(tmp_path / "packs", stated)
    assert (entry.name, entry.marks, bool(entry.pack.unchecked)) == ("fem (stated) Abaqus 2024", {}, True)


def test_a_stated_record_cannot_pass_for_a_computed_one(stated):
    (record,) = stated.read().records
    for changes in ({"stated": None}, {"identity": record.identity.model_copy(update={"solver": "fem"})}):
        forged = record.model_copy(update=changes)
        with pytest.raises(InputError, match="names of stated results"):
            read_document(forged.model_dump_json(exclude={"sequence"}).encode())
    assert Record.model_validate_json(record.model_dump_json()) == record


def test_a_missed_class_is_exit_code_1(shellbench, tmp_path):
    sheet([0.29, 0.31]).to_csv(tmp_path / "a.csv", index=False)
    assert shellbench("judge", tmp_path / "a.csv", "--class", "1e-2")[0] == 1
    assert shellbench("judge", tmp_path / "a.csv", "--class", "0.1", "--format", "json")[0] == 0
    assert shellbench("judge", tmp_path / "a.csv", "--theory", "membrane")[0] == 2
    assert shellbench("judge", Path("nowhere.vtu"), "--case", "scordelis_lo")[0] == 2
    assert limit_of([1, 0.5], [0.29, 0.31]).value == pytest.approx(0.31 + 0.02 / 3)
