"""A package that brings a kind of problem, a solver, data, a section and a command; and packages that are broken."""

import os
import shutil
import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

from shellbench.bench.catalogue import about, brought, catalog, listing
from shellbench.bench.judge.expected import Scope
from shellbench.bench.judge.lock import check_lock
from shellbench.bench.plugins import kinds
from shellbench.bench.plugins.registry import find_solver
from shellbench.bench.store.store import Store
from shellbench.errors import InputError
from shellbench.report.data.evidence import Evidence
from shellbench.report.page import brought as sections_of_others
from shellbench.report.page import sections
from tests.bench.running import command
from tests.test_faults import accuracy_gate, findings

ROOT = Path(__file__).resolve().parents[2]
TOY = Path(__file__).parent / "extension"
POINTS = "toy_springs-1.0.dist-info/entry_points.txt"


class Done(NamedTuple):
    """Exit code and output of a command."""

    returncode: int
    stdout: str
    stderr: str


Call = Callable[..., Done]


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """A folder in which the package is installed."""
    return Path(shutil.copytree(TOY, tmp_path / "site", ignore=shutil.ignore_patterns("__pycache__")))


CACHED = ("named_case", "find_suite", "known_values", "suites_named_by", "variants_asked")


def forget() -> None:
    """Have what is installed looked for again."""
    caches = (getattr(catalog, name) for name in CACHED)
    for one in (*caches, kinds.kind_entries, kinds.find_kind, brought._brought):
        one.cache_clear()
    for name in [name for name in sys.modules if name.partition(".")[0] == "toy_springs"]:
        del sys.modules[name]


@pytest.fixture
def here(site: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The package, installed for this process."""
    for name in CACHED:  # what was read of our own cases is kept: reading all of them takes long
        monkeypatch.setattr(catalog, name, cache(getattr(catalog, name).__wrapped__))
    monkeypatch.syspath_prepend(site)
    forget()
    yield site
    forget()


@pytest.fixture
def shellbench(here: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Call:
    """The program where the package is installed, in an empty folder: it begins anew with each command."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(here), str(ROOT)]))

    def call(*arguments: str) -> Done:
        forget()
        return Done(*command(monkeypatch, capfd, *arguments))

    return call


@pytest.mark.parametrize(
    "gates", [False, pytest.param(True, marks=pytest.mark.long)]
)  # of all our cases: half a minute
def test_a_package_brings_all_that_it_can_and_leaves_nothing(
    shellbench: Call, site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, gates: bool
) -> None:
    monkeypatch.setattr(sections, "exhibits", lambda evidence: [])  # tests of the report draw figures
    solved = shellbench("run", "--suite", "toy_springs")
    assert (solved.returncode, solved.stdout.splitlines()[-1]) == (0, "2 solved"), solved.stderr
    if gates:
        unchecked = shellbench("gate", "--suite", "toy_springs")
        assert unchecked.returncode == 1
        assert "hooke is not checked and holds no class" in unchecked.stdout
        assert shellbench("check-solver", "hooke").returncode == 0
        judged = shellbench("gate", "--suite", "toy_springs", "--verbose")
        assert judged.returncode == 0, judged.stdout
        assert "as locked" in judged.stdout
    assert shellbench("report", "--suite", "toy_springs", "--no-print").returncode == 0
    report = tmp_path / "reports" / "latest" / "report.md"
    assert "Springs go as far as Hooke says." in report.read_text(encoding="utf-8")
    assert shellbench("pull", "toy_spring", "--times", "2").stdout == "0.5 m\n"

    shutil.rmtree(site)
    for asked in (("list", "hooke"), ("pull", "toy_spring"), ("run", "toy_spring"), ("gate", "--suite", "toy_springs")):
        done = shellbench(*asked)
        assert done.returncode == 2
        assert "Traceback" not in done.stderr
    told = shellbench("gate" if gates else "table")  # what fem answered, and nothing of a solver that is gone
    assert told.returncode == 0
    assert "is left out, for there is no case 'toy_spring'" in told.stderr
    assert "hooke" not in told.stdout
    assert shellbench("report", "--no-print").returncode == 0
    assert "Hooke" not in report.read_text(encoding="utf-8")


def test_lists_say_which_package_something_is_from(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(catalog, "own_case_names", lambda: ["square_plate"])  # the solver is asked about each
    brings = {"case": "toy_spring", "suite": "toy_springs", "solver": "hooke"}
    assert {what: about.about(name)["package"] for what, name in brings.items()} == dict.fromkeys(brings, "toy-springs")
    assert about.about("square_plate")["package"] == "shellbench"
    for name in ("toy_spring", "toy_springs"):
        assert "package: toy-springs" in about.as_text(name)
    assert listing.list_suite("toy_springs")["package"] == "toy-springs"


def test_what_judges_imports_nothing_of_it(shellbench: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shellbench("run", "toy_spring", "--solver", "hooke")
    shellbench("list", "toy_spring")  # what its kind says of the case is known from now on
    place = tmp_path / "imported"
    monkeypatch.setenv("TOY_SPRINGS_IMPORTED", str(place))
    for asked in (("list", "toy_spring"), ("list", "toy_springs"), ("table",), ("--help",)):
        shellbench(*asked)
        assert not place.exists(), asked
    assert shellbench("pull", "toy_spring").returncode == 0
    assert place.exists()


@pytest.mark.long  # all our cases are read anew
def test_the_lock_holds_ours_whatever_a_package_brings(here: Path) -> None:
    assert "toy_spring" in catalog.case_names()
    assert "toy_spring" not in catalog.own_case_names()
    found = check_lock()
    assert not found.broken
    assert not found.unlocked


def test_a_suite_of_ours_is_extended_and_a_case_of_ours_is_asked(here: Path) -> None:
    suite, own = catalog.find_suite("verification"), catalog.own_suite("verification")
    assert suite.runs[: len(own.runs)] == own.runs
    assert [run.solver for run in suite.runs[len(own.runs) :]] == ["hooke"]
    assert "more_verification" not in catalog.suite_names()
    assert [case.name for case in catalog.cases_of("toy_springs")] == ["toy_spring", "square_plate"]
    assert catalog.named_case("square_plate").suites[-1] == "toy_springs"


def test_a_study_is_judged_only_if_it_is_named(here: Path, tmp_path: Path) -> None:
    """Its solvers may need packages that are not installed; the judgement then omits them."""
    findings(Store(tmp_path), "fem", "square_plate")

    def solvers(*suites: str) -> set[str]:
        return {row.solver for row in (f.row for f in accuracy_gate(Store(tmp_path), Scope(suites)).accuracy)}

    assert solvers() >= {"fem"}
    assert "hooke" not in solvers()
    assert "hooke" in solvers("toy_springs")


def clash_of_cases(site: Path) -> None:
    data = site / "toy_springs" / "data" / "cases"
    shutil.copy(data / "toy_spring.toml", data / "square_plate.toml")


def clash_of_suites(site: Path) -> None:
    suites = site / "toy_springs" / "data" / "cases" / "suites"
    shutil.copy(suites / "toy_springs.toml", suites / "obstacle_course.toml")


def known_value_of_ours(site: Path) -> None:
    references = site / "toy_springs" / "data" / "references"
    shutil.copy(references / "toy_spring.toml", references / "square_plate.toml")


def tolerance_of_ours(site: Path) -> None:
    file = site / "toy_springs" / "data" / "references" / "tolerances" / "fem.toml"
    file.write_text("[square_plate]\ncentre_deflection = 0.9\n")


def no_folder(site: Path) -> None:
    points = site / POINTS
    points.write_text(points.read_text().replace("toy_springs.data", "toy_springs.nothing"))


def no_package(site: Path) -> None:
    points = site / POINTS
    points.write_text(points.read_text().replace("toy_springs.data", "not there:at all"))


def no_suite_to_extend(site: Path) -> None:
    file = site / "toy_springs" / "data" / "cases" / "suites" / "more_verification.toml"
    file.write_text(file.read_text().replace('extends = "verification"', 'extends = "verfication"'))


def malformed_suite(site: Path) -> None:
    (site / "toy_springs" / "data" / "cases" / "suites" / "toy_springs.toml").write_bytes(b"\xff\x00[[")


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (clash_of_cases, "two installed packages call a case 'square_plate': shellbench and toy-springs"),
        (clash_of_suites, "two installed packages call a suite 'obstacle_course': shellbench and toy-springs"),
        (known_value_of_ours, "package toy-springs has no case 'square_plate', and may judge no other"),
        (tolerance_of_ours, "has neither the case 'square_plate' nor the solver 'fem'"),
        (no_folder, "data 'springs' of package toy-springs can't be used: there is no folder 'toy_springs.nothing'"),
        (no_package, "data 'springs' of package toy-springs can't be used: there is no folder"),
        (no_suite_to_extend, "package toy-springs extends the unknown suite 'verfication'"),
        (malformed_suite, "toy_springs.toml"),
    ],
)
def test_broken_data_are_one_sentence(here: Path, spoil: Callable[[Path], None], words: str) -> None:
    spoil(here)
    with pytest.raises(InputError) as found:
        catalog.case_names(), catalog.suite_names()
    assert words in str(found.value)
    assert "\n" not in str(found.value)


def test_broken_data_are_no_good_exit(shellbench: Call, site: Path) -> None:
    tolerance_of_ours(site)
    done = shellbench("gate", "--suite", "obstacle_course")
    assert done.returncode == 2, done.stdout + done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith("shellbench: ")


def test_a_claim_of_its_own_solver_is_none_of_our_tolerances(here: Path) -> None:
    file = here / "toy_springs" / "data" / "references" / "tolerances" / "hooke.toml"
    file.write_text(file.read_text() + "\n[square_plate]\ncentre_deflection = 0.5\n")
    brought._brought.cache_clear()
    assert brought.claimed(find_solver("hooke")).keys() == {"square_plate"}
    assert catalog.tolerance("square_plate", "centre_deflection", "hooke") is None
    assert catalog.tolerance("toy_spring", "extension", "hooke").relative == 1e-12
    assert "hooke" not in catalog.tolerances()


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("raise ValueError('two\\nlines')", "section 'springs' can't be used: two lines (package toy-springs)"),
        ("raise SystemExit(0)", "section 'springs' can't be used: it ends the process (package toy-springs)"),
        ("return 3", "section 'springs' can't be used: it made no section (package toy-springs)"),
        ("return Section('x', 'X', (3,))", "section 'springs' can't be used: it made no section"),
        ("return Section('displacements', 'X')", "'displacements' is a section of the report"),
    ],
)
def test_a_broken_section_is_left_out_with_a_sentence(here: Path, tmp_path: Path, body: str, words: str) -> None:
    file = here / "toy_springs" / "report.py"
    file.write_text(f"from shellbench.report.data.section import Section\ndef section(found):\n    {body}\n")
    for name in [name for name in sys.modules if name.partition(".")[0] == "toy_springs"]:
        del sys.modules[name]
    said: list[str] = []
    found = Evidence({}, [], Store(tmp_path / "none").folder)
    assert not list(sections_of_others.sections_brought(found, {"displacements"}, said.append))
    assert len(said) == 1
    assert words in said[0]


def test_a_section_without_a_module_is_left_out(here: Path, tmp_path: Path) -> None:
    (here / "toy_springs" / "report.py").write_text("import not_there\n")
    for name in [name for name in sys.modules if name.partition(".")[0] == "toy_springs"]:
        del sys.modules[name]
    said: list[str] = []
    assert not list(sections_of_others.sections_brought(Evidence({}, [], tmp_path), (), said.append))
    assert said == ["section 'springs' can't be used: No module named 'not_there' (package toy-springs)"]


def test_a_broken_command_is_one_sentence_and_ours_stay_ours(shellbench: Call, site: Path) -> None:
    points = site / POINTS
    points.write_text(points.read_text() + "gate = toy_springs.cli:pull\nlost = toy_springs.cli:lost\n")
    gate = shellbench("gate")
    assert (gate.returncode, gate.stderr) == (
        2,
        "shellbench: store reports/runs: is not there; `shellbench run` makes one\n",
    )
    lost = shellbench("lost")
    assert (lost.returncode, lost.stderr) == (
        2,
        "shellbench: command 'lost' can't be used: module 'toy_springs.cli' has no attribute 'lost'\n",
    )
    raised = shellbench("pull", "nothing")
    assert raised.returncode == 2
    assert "Traceback" not in raised.stderr
    (site / "toy_springs" / "cli.py").write_text("def pull():\n    raise ZeroDivisionError('by\\nzero')\n")
    raised = shellbench("pull")
    assert (raised.returncode, raised.stderr) == (1, "shellbench: command 'pull' failed: ZeroDivisionError: by zero\n")


def test_names_that_two_packages_use_are_refused() -> None:
    with pytest.raises(InputError, match="two installed packages call a case 'a': shellbench and one"):
        brought.distinct("case", ["a"], [("one", "a")])
    with pytest.raises(InputError, match="two installed packages call a case 'b': one and two"):
        brought.distinct("case", ["a"], [("one", "b"), ("two", "b")])
