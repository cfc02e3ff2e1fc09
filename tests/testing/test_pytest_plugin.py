"""The gate in pytest: right answers pass, everything else fails or is skipped with one sentence."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from shellbench.bench.store.store import Store
from shellbench.testing import pytest_gate  # noqa: F401 - imported once, for the runs within this process
from shellbench.testing.pytest_plugin import REPEATABLE, SINGLE
from tests.bench import strip
from tests.bench.conftest import forget, plugin, tolerances_of, toys  # noqa: F401 - fixtures

pytest_plugins = ["pytester"]
ROOT = Path(__file__).resolve().parents[2]
STRANGER = """

class StrangerSolver(ExactSolver):
    name = "stranger"  # shellbench freezes no tolerance for it
"""
NEEDY = 'from shellbench.protocol.engine import need\n\nneed("kratos", ["NoSuchEngine"])\n'
HEADLINE = "shellbench::toys::strip::{}::centre"


@pytest.fixture
def course(toys: Path, plugin: Path) -> Path:  # noqa: F811
    """The toy catalog, and beside its solvers one that no case knows and one on an engine that is not installed."""
    with (plugin / "toy_shells" / "solver.py").open("a") as file:
        file.write(STRANGER)
    (plugin / "toy_shells" / "needy.py").write_text(NEEDY)
    with (plugin / "toy_shells-1.0.dist-info" / "entry_points.txt").open("a") as file:
        file.write("stranger = toy_shells.solver:StrangerSolver\nneedy = toy_shells.needy:Needy\n")
    return toys


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Finished runs of all tests of this file: the plug-in keeps them by identity."""
    return tmp_path_factory.mktemp("runs")


@pytest.fixture
def gate(course: Path, runs: Path, pytester: pytest.Pytester):
    """Run pytest within this process on the toy suite; with `store` in a folder of the test's own."""

    def run(solver: str, *more: str, store: Path = runs) -> pytest.RunResult:
        named = [f"--shellbench-solver={solver}"] if solver else []
        return pytester.runpytest_inprocess("--shellbench=toys", *named, f"--shellbench-store={store}", *more)

    return run


def curve_the_strip(course: Path, suite: str) -> None:
    """Add a case that the toy declines."""
    text = strip.CASE.replace('kind = "plane"', 'kind = "cylinder"\nradius = 5.0').replace('"toys"', f'"{suite}"')
    (course / "cases" / "curved.toml").write_text(text)
    references = strip.REFERENCES
    (course / "references" / "curved.toml").write_text(references)
    (course / "cases" / "suites" / f"{suite}.toml").write_text(strip.SUITE)
    forget()


def one_line(result: pytest.RunResult) -> str:
    """The single sentence of a usage error."""
    lines = [line for line in result.errlines if line.strip()]
    assert len(lines) == 1, result.errlines
    return lines[0]


def test_an_exact_solver_passes_beside_ordinary_tests_and_is_solved_once(gate, pytester: pytest.Pytester) -> None:
    pytester.makepyfile("def test_ordinary(): pass")
    result = gate("toy", "-v", store=Path("runs"))
    assert result.ret == 0
    result.assert_outcomes(passed=3)
    result.stdout.fnmatch_lines(["*test_ordinary PASSED*", HEADLINE.format("toy") + " PASSED*"])
    result.stdout.re_match_lines([r"strip +toy +centre +0\.00625 +0\.00625 .* 1\.0e-09 .* pass"])
    again = gate("toy", store=Path("runs"))
    again.assert_outcomes(passed=3)
    again.stdout.fnmatch_lines(["(k) kept from an earlier session*"])
    assert len(Store(pytester.path / "runs").read().records) == 1


def test_a_wrong_answer_fails_with_one_sentence(gate) -> None:
    result = gate("toy", "--shellbench-set=toy.factor=1.02", "--shellbench-tolerance=0.5")
    assert result.ret == 1
    result.assert_outcomes(passed=1, failed=1)  # no tolerance that is given widens what is frozen
    result.stdout.fnmatch_lines(
        [
            "centre is 0.006375 m, and its known value 0.00625 m (closed form [[]timoshenko[]],"
            " kirchhoff-love-linear): error +2.00e-02, 1e-09 allowed"
        ]
    )
    assert "Traceback" not in result.stdout.str()
    assert "pytest_gate.py" not in result.stdout.str()


def test_a_stranger_is_judged_by_the_tolerance_that_is_given(gate) -> None:
    for tolerances, passes in (
        ([], True),
        (["1e-3"], False),
        (["1e-3", "strip=0.1"], True),
        (["0.1", "strip=0.1", "strip.centre=1e-3"], False),
    ):
        given = [f"--shellbench-tolerance={text}" for text in tolerances]
        result = gate("stranger", "--shellbench-set=stranger.factor=1.005", *given)
        assert result.ret == (0 if passes else 1)
        result.assert_outcomes(passed=int(passes), failed=int(not passes), skipped=1)
        result.stdout.fnmatch_lines(
            [f"shellbench: *, relative tolerance {float(given[0].split('=')[1]) if given else 0.01:g} *"]
        )
    result.stdout.fnmatch_lines(["strip stranger membrane: no relative tolerance*strip.membrane=TOL"])
    absolute = gate("stranger", "--shellbench-set=stranger.factor=1.005", "--shellbench-tolerance=strip.membrane=1e-12")
    absolute.assert_outcomes(passed=2)


@pytest.mark.parametrize(
    ("behaviour", "words"),
    [
        ("fail", "the run failed: the strip would not converge"),
        *(
            pytest.param(*pair, marks=pytest.mark.long)
            for pair in (
                ("refuse", "the solver refused its input: setting 'behaviour' does not fit the case"),
                ("crash", "the run failed: the solving process was ended by SIGSEGV"),
                ("fail_with_partial", "the run failed: the strip stopped half way"),
                ("raise", "the run failed: the solver stopped unexpectedly: ZeroDivisionError: a bug in the solver"),
                ('"nan"', "the run failed: the solution has no finite value for centre, energy"),
            )
        ),
    ],
)
def test_a_run_that_fails_is_red_says_why_and_is_tried_again_by_the_next_session(
    gate, pytester: pytest.Pytester, behaviour: str, words: str
) -> None:
    for sessions in (1, 2):
        result = gate("toy", f"--shellbench-set=toy.behaviour={behaviour}", store=Path("runs"))
        assert result.ret == 1
        result.assert_outcomes(failed=2)
        result.stdout.fnmatch_lines([f"{words}*"])
        assert "Traceback" not in result.stdout.str()
        records = Store(pytester.path / "runs").read().records
        assert len(records) == (0 if behaviour == "refuse" else sessions)


@pytest.mark.long
def test_a_run_is_stopped_after_the_timeout(gate) -> None:
    result = gate("toy", "--shellbench-set=toy.behaviour=hang", "--shellbench-timeout=0.3")
    result.assert_outcomes(failed=2)
    result.stdout.fnmatch_lines(["the run failed: stopped after 0.3 s"])


@pytest.mark.long
def test_each_seed_that_the_suite_declares_is_judged(gate) -> None:
    result = gate("toy-noisy", "--shellbench-set=toy-noisy.noise=0.1", "-v", "-k", "centre")
    assert result.ret == 1
    result.assert_outcomes(failed=3)
    result.stdout.fnmatch_lines([HEADLINE.format("toy-noisy") + f"[[]seed {seed}[]] FAILED*" for seed in (0, 1, 2)])


def test_a_declined_case_is_skipped(gate, course: Path) -> None:
    curve_the_strip(course, "toys")
    result = gate("toy", "-rs")
    assert result.ret == 0
    result.assert_outcomes(passed=2, skipped=2)
    result.stdout.fnmatch_lines(["curved toy: not applicable: it solves planes only"])


def test_a_gate_that_judges_nothing_fails(gate, course: Path, pytester: pytest.Pytester) -> None:
    curve_the_strip(course, "curves")
    pytester.makepyfile("def test_ordinary(): pass")
    result = gate("toy", "--shellbench=curves")
    assert result.ret == 1
    result.assert_outcomes(passed=3, skipped=2)
    result.stdout.fnmatch_lines(["shellbench: nothing was judged: no case of suite 'curves'*applies to 'toy'"])


def test_a_known_value_of_another_theory_does_not_judge(gate, course: Path) -> None:
    file = course / "references" / "strip.toml"
    file.write_text(file.read_text().replace("kirchhoff-love-linear", "reissner-mindlin"))
    forget()
    result = gate("toy", "-k", "centre")
    assert result.ret == 1
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        ["no known value of its theory, kirchhoff-love-linear, judges centre (only one of reissner-mindlin)"]
    )


def test_an_open_finding_is_an_expected_failure_and_red_once_it_passes(gate, course: Path) -> None:
    file, frozen = tolerances_of("toy"), "centre = 1e-9"
    assert frozen in file.read_text()
    file.write_text(file.read_text().replace(frozen, 'centre = { relative = 1e-9, open_finding = "too stiff" }'))
    forget()
    gate("toy", "-k", "centre", "--shellbench-set=toy.factor=1.02").assert_outcomes(xfailed=1)
    result = gate("toy", "-k", "centre")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["it passes, but is an open finding: too stiff"])


@pytest.mark.parametrize(
    ("solver", "more", "words"),
    [
        ("toy", ["--shellbench=nowhere"], "unknown suite 'nowhere'"),
        ("nobody", [], "unknown solver 'nobody': solvers are"),
        ("toy-broken", [], "solver 'toy-broken' can't be used: No module named 'toy_shells.missing'"),
        ("needy", [], "NoSuchEngine is not installed: python -m pip install 'shellbench[kratos]'"),
        ("", [], "--shellbench needs a solver: --shellbench-solver=NAME"),
        ("toy", ["--shellbench-tolerance=-1"], "found '-1', but expected a positive number"),
        ("toy", ["--shellbench-tolerance=1e9"], "a relative tolerance is below 1, or 0 would pass"),
        ("toy", ["--shellbench-tolerance=strip=1"], "a relative tolerance is below 1, or 0 would pass"),
        ("toy", ["--shellbench-tolerance=strip.middle=1"], "quantities of strip are centre, energy, membrane"),
        ("toy", ["--shellbench-tolerance=roof=0.1"], "unknown case 'roof'"),
        ("toy", ["--shellbench-timeout=soon"], "found 'soon', but expected a positive number"),
        ("toy", ["--shellbench-set=toy-noisy.noise=1"], "solver 'toy-noisy' is not gated here"),
        ("toy", ["--shellbench-set=factor"], "expected SOLVER.KEY=VALUE"),
        ("toy", ["--shellbench-set=toy.faktor=2"], "settings of solver 'toy': field 'faktor' is not known here"),
    ],
)
def test_bad_options_are_one_sentence_and_exit_4(gate, solver: str, more: list[str], words: str) -> None:
    result = gate(solver, *more)
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    assert words in one_line(result)


def test_without_pytests_cache_a_folder_must_be_named(course: Path, pytester: pytest.Pytester) -> None:
    options = ("--shellbench=toys", "--shellbench-solver=toy", "-p", "no:cacheprovider", "--collect-only")
    result = pytester.runpytest_inprocess(*options)
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    assert "name a folder for finished runs: --shellbench-store=DIR" in one_line(result)
    assert pytester.runpytest_inprocess(*options, "--shellbench-store=runs").ret == 0


def test_a_cache_that_can_not_be_written_is_one_sentence(gate, course: Path, pytester: pytest.Pytester) -> None:
    (pytester.path / "file").touch()
    options = ("--shellbench=toys", "--shellbench-solver=toy", "-o", "cache_dir=file/cache", "--collect-only")
    result = pytester.runpytest_inprocess(*options)
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    assert "pytest's cache can't be written (File exists)" in one_line(result)
    gate("toy", "-k", "centre", store=Path("file") / "runs").stdout.fnmatch_lines(
        ["store *file/runs: can't be written (Not a directory)"]
    )


def test_items_are_listed_and_selected_like_tests(gate, pytester: pytest.Pytester) -> None:
    pytester.makepyfile("def test_ordinary(): pass")
    listed = gate("toy", "--collect-only", "-q", store=Path("runs"))
    assert listed.ret == 0
    listed.stdout.fnmatch_lines([HEADLINE.format("toy"), HEADLINE.format("toy").replace("centre", "membrane")])
    assert not (pytester.path / "runs").exists()
    gate("toy", "-k", "centre").assert_outcomes(passed=1, deselected=2)
    gate("toy", "-m", "shellbench", "--strict-markers").assert_outcomes(passed=2, deselected=1)
    unused = gate("toy", "-k", "ordinary")
    unused.assert_outcomes(passed=1, deselected=2)
    unused.stdout.fnmatch_lines(["shellbench: no item of the gate was run"])


def test_options_may_stand_in_the_configuration(course: Path, pytester: pytest.Pytester) -> None:
    pytester.makeini(
        "[pytest]\nshellbench = toys\nshellbench_solver = stranger\nshellbench_set = stranger.factor=1.02\n"
        "shellbench_tolerance = 0.1 strip.membrane=1e-12\n"
    )
    result = pytester.runpytest_inprocess()
    result.assert_outcomes(passed=2)
    assert len(Store(pytester.path / ".pytest_cache" / "d" / "shellbench").read().records) == 1
    narrower = pytester.runpytest_inprocess("--shellbench-tolerance=0.01")  # instead of all of the file's
    narrower.assert_outcomes(failed=1, skipped=1)


def test_without_the_option_nothing_happens(course: Path, pytester: pytest.Pytester) -> None:
    pytester.makepyfile("def test_ordinary(): pass")
    result = pytester.runpytest_inprocess()
    result.assert_outcomes(passed=1)
    assert not re.search(r"shellbench(?!-\d)", result.stdout.str())  # but for the list of plug-ins
    pytester.runpytest_inprocess("-p", "no:shellbench").assert_outcomes(passed=1)
    alone = pytester.runpytest_inprocess("--shellbench-solver=toy")
    assert alone.ret == pytest.ExitCode.USAGE_ERROR
    assert "says nothing without --shellbench=SUITE" in one_line(alone)


def test_without_the_option_the_plug_in_imports_nothing(tmp_path: Path) -> None:
    """Every run of pytest pays for it, so it must cost nothing."""
    program = (
        "import sys, pytest; before = set(sys.modules); pytest.main(['-q', '-p', 'shellbench.testing.pytest_plugin']);"
        "print(*sorted(m for m in sys.modules if m.partition('.')[0] in {'shellbench', 'numpy', 'pydantic', 'torch'}))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path,
        env={**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.splitlines()[-1] == "shellbench shellbench.testing shellbench.testing.pytest_plugin"


def test_the_page_describes_every_option() -> None:
    page = (ROOT / "docs" / "pytest.md").read_text()
    described = set(re.findall(r"^\| `(--[a-z-]+)=", page, re.MULTILINE))
    assert described == {"--" + name.replace("_", "-") for name in (*REPEATABLE, *SINGLE)}


@pytest.mark.long
@pytest.mark.parametrize(("setting", "outcome"), [("seconds=0.5", {"passed": 2}), ("behaviour=fail", {"failed": 2})])
def test_processes_of_xdist_solve_a_case_once(
    course: Path,
    plugin: Path,  # noqa: F811
    pytester: pytest.Pytester,
    setting: str,
    outcome: dict[str, int],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("xdist", reason="needs pytest-xdist")
    pytester.makeconftest(
        "import pathlib, sys\n"
        "from shellbench.bench.catalogue import catalog\n"
        f"sys.path.insert(0, {str(plugin)!r})\n"
        f"catalog.data_folder = lambda name: pathlib.Path({str(course)!r}) / name\n"
    )
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")  # the others' plug-ins take longer than the case
    plugins = ("-p", "xdist", "-p", "shellbench.testing.pytest_plugin")
    options = ("--shellbench=toys", "--shellbench-solver=toy", "--shellbench-store=runs", "-n2")
    result = pytester.runpytest_subprocess(*plugins, *options, f"--shellbench-set=toy.{setting}")
    result.assert_outcomes(**outcome)
    result.stdout.re_match_lines([r"strip +toy +(centre|membrane) .* (pass|FAIL)"] * 2)
    assert len(Store(pytester.path / "runs").read().records) == 1  # the other process takes even a failure as it is
