"""All about one case, suite or solver: nothing that judges is left out."""

from pathlib import Path

import pytest

from shellbench.bench.catalogue import about as module
from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.about import about, as_text
from shellbench.bench.plugins.registry import solver_entries
from shellbench.errors import InputError
from tests.families import with_something_new

ROOT = Path(__file__).parents[2]
TELLING = [case.values[0] for case in with_something_new(catalog.case_names()) if not case.marks]
OURS = [name for name, entry in solver_entries().items() if entry.distribution == "shellbench"]


def flat(text: str) -> str:
    return " ".join(text.split())


@pytest.mark.sampled(50)
@pytest.mark.parametrize("name", catalog.case_names())
def test_all_that_judges_a_case_is_said(name: str) -> None:
    case, text = catalog.named_case(name), flat(as_text(name))
    data = about(name)
    known = {q["name"]: q["known"] for q in data["quantities"]}
    for quantity in case.quantities:
        judge = catalog.known_values(name).judge(quantity.name, case.theory)
        judges = [value for value in known[quantity.name] if value["judges"]]
        assert [v["value"] for v in judges] == ([judge.value] if judge else [])
        if judge:
            assert f"judge: {judge.value:.13g} ± {judge.uncertainty:.2g}" in text
            assert flat(judge.origin) in text
    for quantity, asked in zip(data["quantities"], case.quantities, strict=True):
        for solver, held in quantity["tolerances"].items():
            allowed = catalog.tolerance(name, asked.name, solver)
            assert allowed is not None
            assert allowed.largest in held.values()
    for support in data["problem"].get("supports", ()):
        assert f"name = {support['name']}" in text


def test_a_variant_is_judged_by_its_cases_values() -> None:
    whole, variant = about("scordelis_lo"), about("scordelis_lo@oblique")
    assert [q["known"] for q in variant["quantities"]] == [q["known"] for q in whole["quantities"]]
    assert variant["problem"]["surface"] != whole["problem"]["surface"]
    assert "scordelis_lo@oblique" in [v["name"] for v in whole["variants"]]


def test_a_case_of_ones_own_is_judged_by_nothing(tmp_path: Path) -> None:
    """Its name may be that of a built-in one."""
    path = tmp_path / "scordelis_lo.toml"
    text = (ROOT / "cases" / "scordelis_lo.toml").read_text(encoding="utf-8")
    path.write_text(text.replace("thickness = 0.25", "thickness = 0.5"), encoding="utf-8")
    data = about(str(path))
    assert data["own_case"]
    assert not any(q["known"] or q["tolerances"] for q in data["quantities"])
    assert about(data["variants"][0]["name"])["name"] == "scordelis_lo@axes"


BUT_FOR_VARIANTS = [name for name in catalog.suite_names() if name != "shape_variants"]  # hundreds: long


@pytest.mark.sampled(13)
@pytest.mark.parametrize("name", [*BUT_FOR_VARIANTS, pytest.param("shape_variants", marks=pytest.mark.long)])
def test_a_suite_says_what_it_gates(name: str) -> None:
    data, suite = about(name), catalog.find_suite(name)
    assert len(data["runs"]) == len(suite.runs)
    assert list(data["titles"]) == [case.name for case in catalog.members(name)]
    locked = {
        solver
        for case in catalog.cases_of(name)
        for solver in catalog.tolerances()
        if solver_runs(case.name, solver, name)
    }
    assert data["gated"].keys() == locked


def solver_runs(case: str, solver: str, suite: str) -> bool:
    """Return True if a suite runs a solver with default settings on a case that gates it."""
    base = case.partition("@")[0]
    runs = catalog.find_suite(suite).runs_for(case)
    return base in catalog.tolerances()[solver] and any(r.solver == solver and not r.settings for r in runs)


@pytest.mark.sampled(11)
@pytest.mark.parametrize("name", OURS)
def test_our_settings_are_explained_and_what_is_declined_has_a_reason(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(catalog, "case_names", lambda: TELLING)
    data = about(name)
    if not data["available"]:
        pytest.skip(data["reason"])
    assert data["settings"] or name == "skin-bilinear"  # it fits nothing
    assert [s["name"] for s in data["settings"] if not s["description"]] == []
    assert all(data["declines"].values())
    assert data["tolerances"].keys() == catalog.tolerances().get(name, {}).keys()
    data["settings"].append({"name": "undescribed", "default": 1, "description": ""})
    monkeypatch.setattr(
        module, "about", lambda _: data
    )  # what a solver declines takes a second to find: once is enough
    text = as_text(name)
    assert all(s["name"] in text for s in data["settings"])


@pytest.mark.parametrize(
    ("name", "near"), [("scordelis_low", "scordelis_lo"), ("ndf-rits", "ndf-ritz"), ("shape", "shapes")]
)
def test_an_unknown_name_is_met_with_the_nearest(name: str, near: str) -> None:
    with pytest.raises(InputError, match=f"no case, suite or solver is called '{name}': .*{near}"):
        about(name)


def test_a_name_like_no_other_is_said_in_one_sentence() -> None:
    with pytest.raises(InputError, match=r"called 'xyzzy': `shellbench list` shows all$"):
        about("xyzzy")


def test_no_two_things_share_a_name() -> None:
    """Else `list NAME` would show one of them only."""
    names = [*catalog.case_names(), *catalog.suite_names(), *solver_entries()]
    assert len(names) == len(set(names))


def test_cases_are_found_by_the_names_that_others_use() -> None:
    found = {case["name"]: case["also_known_as"] for case in about("nafems FV12")["cases"]}
    assert set(found) == {"free_plate_modes"}
    assert "its frequencies are those of the case times 0.1227476" in found["free_plate_modes"][0]
    assert {case["name"] for case in about("MACNEAL")["cases"]} >= {"scordelis_lo", "hemisphere_hole"}
    assert "NAFEMS FV15" in flat(as_text("rhombic"))  # by its title
    assert "also known as: NAFEMS FV15" in flat(as_text("rhombic_plate_modes"))


def test_other_names_are_no_part_of_the_question() -> None:
    case = catalog.named_case("free_plate_modes")
    assert case.also_known_as
    assert case.model_copy(update={"also_known_as": ()}).digest() == case.digest()
