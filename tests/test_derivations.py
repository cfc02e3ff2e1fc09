"""`python -m derivations`: what it names, what it prints, and what the references say of it."""

import re
import tomllib
from pathlib import Path

import pytest

from derivations.__main__ import CASES, main

ROOT = Path(__file__).parents[1]
QUICK = ("square_plate", "roof_thinness_1e_3", "annular_plate", "sleeve_torque", "rolled_plate", "cantilever_moment")


def judges(case):
    text = (ROOT / "references" / f"{case}.toml").read_text(encoding="utf-8")
    return {v["quantity"]: v for v in tomllib.loads(text)["values"] if v["role"] == "judge"}


def test_every_name_is_that_of_a_case():
    assert {name for name in CASES if not (ROOT / "references" / f"{name}.toml").is_file()} == set()


def test_the_file_that_a_reference_names_is_there():
    named = set()
    for path in (ROOT / "references").glob("*.toml"):
        named |= set(re.findall(r"derivations/\w+\.py", path.read_text(encoding="utf-8")))
    assert len(named) > 10
    assert [name for name in named if not (ROOT / name).is_file()] == []


def test_every_module_is_explained():
    page = (ROOT / "derivations/README.md").read_text(encoding="utf-8")
    modules = {path.stem for path in (ROOT / "derivations").glob("[!_]*.py")}
    assert {name for name in modules if f"`{name}`" not in page} == set()
    unnamed = {name for name in CASES if f"`{name}`" not in page and not name.startswith("roof_thinness_")}
    assert unnamed == set()


@pytest.mark.parametrize("case", QUICK)
def test_what_is_printed_is_what_judges(case, capsys):
    main([case])
    head, *lines = capsys.readouterr().out.splitlines()
    assert head.split() == ["case", "quantity", "value", "uncertainty", "unit"]
    printed = {quantity: float(value) for name, quantity, value, *_ in map(str.split, lines) if name == case}
    known = judges(case)
    shared = printed.keys() & known.keys()
    assert shared
    for quantity in shared:
        allowed = 3 * known[quantity]["uncertainty"] + 1e-11 * abs(
            known[quantity]["value"]
        )  # twelve digits are printed
        assert printed[quantity] == pytest.approx(known[quantity]["value"], rel=0, abs=allowed)


def test_a_name_that_nothing_is_derived_for_is_refused(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["square_plates"])
    assert ended.value.code == 2
    assert "nothing is derived for 'square_plates'" in capsys.readouterr().err
