"""Files of tolerances: read whole, refused in one sentence, and of our cases the only place."""

from pathlib import Path

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.reference import Tolerance, read_tolerances
from shellbench.bench.judge.classes import LOOSEST, judged_by_class
from shellbench.bench.judge.compare import rows
from shellbench.bench.judge.expected import Scope
from shellbench.bench.judge.gate import gate
from shellbench.bench.judge.lock import write_lock
from shellbench.bench.judge.row import Row
from shellbench.bench.judge.verdicts import as_text
from shellbench.bench.plugins.registry import find_solver
from shellbench.bench.store.conformance import note_conformance
from shellbench.bench.store.store import Store
from shellbench.errors import InputError
from tests.bench import strip
from tests.bench.conftest import forget, tolerances_of
from tests.bench.running import run
from tests.bench.test_compare import edit, only


def read(tmp_path: Path, entry: str) -> Tolerance:
    path = tmp_path / "mine.toml"
    path.write_text(f"[strip]\ncentre = {entry}\n", encoding="utf-8")
    return read_tolerances(path)["strip"]["centre"]


def test_a_number_is_relative_and_a_table_says_what_it_is(tmp_path: Path) -> None:
    plain, table = read(tmp_path, "1e-3"), read(tmp_path, '{ absolute = 2, open_finding = "locks" }')
    assert (plain.largest, plain.is_absolute, plain.open_finding) == (1e-3, False, None)
    assert (table.largest, table.is_absolute, table.open_finding) == (2.0, True, "locks")


def test_an_open_finding_may_be_of_a_variant_alone(tmp_path: Path) -> None:
    held = read(tmp_path, '{ relative = 1e-3, variants = { oblique = "few cells" } }')
    assert [held.of_variant(name).open_finding for name in ("", "oblique", "turned")] == [None, "few cells", None]


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ("-1e-3", "field 'strip.centre': found -0.001, but it must be greater than 0.0"),
        ("1.0", "field 'strip.centre': found 1.0, but it must be less than 1"),
        ("nan", "field 'strip.centre': found nan, but it must be a finite number"),
        ("true", "field 'strip.centre': found True, but it must be a number"),
        ("{ absolute = 0 }", "field 'strip.centre.absolute': found 0, but it must be greater than 0.0"),
        ("{ relative = 1e-3, absolute = 1 }", "field 'strip.centre': it must have one of `relative` and `absolute`"),
        ('{ open_finding = "locks" }', "field 'strip.centre': it must have one of `relative` and `absolute`"),
        ("{ relative = 1e-3, until = 1 }", "field 'strip.centre.until' is not known here"),
    ],
)
def test_a_bad_value_is_one_sentence_with_file_and_field(tmp_path: Path, entry: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        read(tmp_path, entry)
    assert str(caught.value) == f"{tmp_path / 'mine.toml'}: {words}"


def test_frozen_tolerances_are_of_cases_and_quantities_that_are_there() -> None:
    for held in catalog.tolerances().values():
        for name, quantities in held.items():
            assert set(quantities) <= {quantity.name for quantity in catalog.named_case(name).quantities}


@pytest.mark.usefixtures("toys")
@pytest.mark.parametrize("line", ["tolerance = { toy = 1.0 }", 'open_finding = { toy = "locks" }'])
def test_a_case_of_the_suite_states_no_tolerance(line: str) -> None:
    path = catalog.data_folder("cases") / "strip.toml"
    edit(path, "primary = true", f"primary = true\n{line}")
    with pytest.raises(InputError) as caught:
        catalog.named_case("strip")
    assert str(caught.value).startswith(f"{path}: field 'quantities.0.{line.partition(' ')[0]}' is no field of")


@pytest.mark.usefixtures("toys")
def test_a_users_own_case_may_and_no_gate_takes_it(store: Store, tmp_path: Path) -> None:
    path = tmp_path / "strip.toml"  # a namesake of the suite's, but another shell
    text = strip.CASE.replace("thickness = 0.1", "thickness = 0.2")
    path.write_text(text.replace("primary = true", "primary = true\ntolerance = { toy = 1.0 }"), encoding="utf-8")
    forget()
    run(store, str(path), solvers=("toy",))
    row = only(rows(store), quantity="centre")
    assert (row.own_case, row.tolerance, row.passed) == (True, None, None)


@pytest.mark.parametrize(("claim", "said"), [("1e-7", "1 ok"), ("1e-9", "1 not held")])
def test_a_plug_ins_own_file_is_a_claim_and_no_verdict(full: Store, plugin: Path, claim: str, said: str) -> None:
    tolerances_of("toy-noisy").unlink()
    forget()
    write_lock()
    for record in full.read().records:
        if record.identity.solver == "toy-noisy" and record.identity.seed:
            (full.folder / f"{record.run_id}.json").unlink()
    (plugin / "toy_shells" / "tolerances").mkdir()
    (plugin / "toy_shells" / "tolerances" / "toy-noisy.toml").write_text(f"[strip]\ncentre = {claim}\n")
    note_conformance(full, find_solver("toy-noisy"), "shell", {}, ())
    verdict = gate(full, None, Scope())
    noisy = [finding.row for finding in verdict.accuracy if finding.row.solver == "toy-noisy"]
    assert {row.tolerance for row in noisy if not row.tolerance_is_absolute} == {LOOSEST}  # by class, not by its claim
    assert verdict.good()
    assert f"claims (reported only): {said}" in as_text(verdict, "baseline")
    assert only(rows(full), solver="toy-noisy", quantity="centre").tolerance is None


def test_a_claim_does_not_widen_what_is_frozen_and_a_bad_one_does_no_harm(full: Store, plugin: Path) -> None:
    edit(catalog.data_folder("references") / "strip.toml", repr(strip.CENTRE), repr(strip.CENTRE * 1.1))
    write_lock()
    (plugin / "toy_shells" / "tolerances").mkdir()
    file = plugin / "toy_shells" / "tolerances" / "toy.toml"
    file.write_text("[strip]\ncentre = 0.5\n")
    verdict = gate(full, None, Scope(solvers=("toy",)))
    assert [f.colour for f in verdict.claims] == ["green"]
    assert not verdict.good()
    file.write_text("[strip]\ncentre = 5\n")
    verdict = gate(full, None, Scope(solvers=("toy",)))
    assert verdict.claims == ()
    assert "what solver 'toy' claims can't be read" in verdict.warnings[-1]


def test_a_strangers_error_without_a_unit_is_relative_already() -> None:
    """The known error of a manufactured solution's field is zero: a class is compared with it directly."""
    row = Row(
        case="manufactured_hypar",
        suite="shapes",
        solver="stranger",
        settings={},
        seed=None,
        quantity="field_error",
        primary=False,
        at=1.0,
        value=1e-3,
        reference=0.0,
        reference_uncertainty=1e-11,
        tolerance_is_absolute=True,
        status="ok",
        seconds=1.0,
    )
    assert judged_by_class(row).tolerance == LOOSEST
