"""The first minute: templates, doctor, a quick look, names that were nearly right, completion, Ctrl-C, 80 columns."""

import contextlib
import fcntl
import importlib
import io
import os
import pty
import re
import shutil
import struct
import subprocess
import sys
import termios
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest
from rich.console import Console

from shellbench import __main__ as program
from shellbench import cli
from shellbench.bench.catalogue import catalog, listing, templates
from shellbench.bench.judge import doctor
from shellbench.bench.run.display import Lines, display
from shellbench.bench.store.store import Store
from shellbench.errors import InputError, Interrupted
from shellbench.problem import Progress
from shellbench.protocol.spelling import did_you_mean
from shellbench.solvers.fem.solver import FemSolver
from tests.bench.conftest import plugin, toys  # noqa: F401 - fixtures
from tests.bench.running import InThisProcess
from tests.patience import GUARD
from tests.test_cli import shellbench  # noqa: F401 - fixture

ROOT = Path(__file__).parents[1]


class Here(InThisProcess):
    """Makes runs right here, whatever was asked for."""

    def __init__(self, *asked: object) -> None: ...

    def expect(self, task: object) -> None: ...

    def close(self) -> None: ...


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Start no processes."""
    monkeypatch.setattr("shellbench.bench.run.local.LocalProcesses", Here)
    monkeypatch.setattr(doctor, "LocalProcesses", Here)


@pytest.mark.parametrize("like", [None, "scordelis_lo", "free_fall"])
def test_a_new_case_asks_what_its_template_does(tmp_path: Path, like: str | None) -> None:
    case = catalog.find_case(str(templates.write_case("mine", like, tmp_path)))
    source = ROOT / "examples" / templates.CASE if like is None else ROOT / "cases" / f"{like}.toml"
    assert (case.name, case.suites) == ("mine", ())
    given = catalog.find_case(str(source))
    assert {**case.physics(), "name": ""} == {**given.physics(), "name": ""}


def test_fem_converges_on_a_new_case_with_few_unknowns(tmp_path: Path) -> None:
    case = catalog.find_case(str(templates.write_case("my-shell", None, tmp_path)))
    solution = FemSolver().solve(case, FemSolver.settings_type())
    assert (case.name, solution.diagnostics["converged"]) == ("my_shell", True)
    assert solution.parameters < 5_000
    # B-splines of degree 6 on 24 x 24 spans, by the program of derivations/linear_splines.py.
    assert case.primary.measure(solution) == pytest.approx(1.47348454e-6, rel=1e-7)


@pytest.mark.parametrize(
    ("name", "like", "said"),
    [
        ("no name", None, "can't be the name of a case"),
        ("../mine", None, "can't be the name of a case"),
        ("scordelis_lo", None, "is a case of the suite"),
        ("taken", None, "is there already"),
        ("mine", "scordelis", "did you mean scordelis_lo"),
        ("mine", "scordelis_lo@oblique", "there is no such case"),
    ],
)
def test_a_case_that_can_not_be_written_is_refused(tmp_path: Path, name: str, like: str | None, said: str) -> None:
    (tmp_path / "taken.toml").write_text("", encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(said)):
        templates.write_case(name, like, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["taken.toml"]


def test_a_new_solver_is_whole_and_solves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = templates.write_solver("my_plate", tmp_path)
    assert folder.name == "my-plate"
    files = [path for path in folder.rglob("*") if path.is_file()]
    assert {path.relative_to(folder).parts[0] for path in files} >= {
        ".github",
        ".gitignore",
        "pyproject.toml",
        "src",
        "tests",
    }
    text = "".join(path.read_text(encoding="utf-8") for path in files)
    assert [name for name in (templates.NAME, templates.PACKAGE, templates.CLASS, "../../") if name in text] == []
    package = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert package["entry-points"]["shellbench.solvers"] == {"my-plate": "my_plate.solver:MyPlateSolver"}
    monkeypatch.syspath_prepend(folder / "src")
    solver = importlib.import_module("my_plate.solver").MyPlateSolver()
    case = catalog.named_case("square_plate")
    assert solver.name == "my-plate"
    judge = catalog.known_values("square_plate").judge(case.primary.name, case.theory)
    solution = solver.solve(case, solver.settings_type())
    assert case.primary.measure(solution) == pytest.approx(judge.value, rel=1e-6)
    assert "<td>centre_deflection</td><td>0.48748232</td>" in solution._repr_html_()


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("My", "can't be the name of a solver"),
        ("../mine", "can't be the name of a solver"),
        ("class", "can't be the name of a solver"),
        ("fem", "is installed already"),
        ("numpy", "a Python package 'numpy' is installed already"),
        ("taken", "is there already"),
    ],
)
def test_a_solver_that_can_not_be_written_is_refused(tmp_path: Path, name: str, said: str) -> None:
    (tmp_path / "taken").mkdir()
    with pytest.raises(InputError, match=re.escape(said)):
        templates.write_solver(name, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]


@pytest.mark.usefixtures("here")
def test_the_doctor_finds_this_machine_fit_and_a_wrong_answer_bad(tmp_path: Path, toys: Path, monkeypatch) -> None:  # noqa: F811
    monkeypatch.setattr(doctor, "list_solver", lambda entry: {"available": True})  # to import them all takes a second
    lines = list(doctor.examine(Store(tmp_path / "runs"), "strip", "toy"))
    assert [line.about for line in lines if line.state == "BAD"] == []
    assert "off the known value by" in lines[-1].words
    assert doctor._solve("strip", "nobody").state == "BAD"
    known = toys / "references" / "strip.toml"
    known.write_text(known.read_text().replace("value = ", "value = 1", 1))  # whatever it was, it is another now
    catalog.known_values.cache_clear()
    assert doctor._solve("strip", "toy").state == "BAD"


def test_a_disk_that_is_full_is_bad(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = shutil.disk_usage(tmp_path)
    for free, state in ((10**10, "ok"), (10**9, "note"), (10**6, "BAD")):
        monkeypatch.setattr(shutil, "disk_usage", lambda place, free=free: usage._replace(free=free))
        assert doctor._disk(tmp_path / "not" / "yet").state == state


@pytest.mark.usefixtures("here")
def test_a_quick_look_solves_prints_and_judges(shellbench, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    monkeypatch.setattr("shellbench.bench.run.plan.QUICK_SUITE", "toys")
    monkeypatch.setenv("COLUMNS", "80")
    code, out, err = shellbench("quick")
    assert (code, err) == (0, "")
    assert "5 solved" in out
    assert "every gate holds" in out
    assert "What next:" in out
    assert [line for line in out.splitlines() if len(line) > 80] == []
    assert "5 kept from before" in shellbench("quick")[1]


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("scordelis", "scordelis_lo"),
        ("sqare_plate", "square_plate"),
        ("pinched-cylinder-free", "pinched_cylinder_free"),
    ],
)
def test_names_that_are_nearly_right_are_recognised(name: str, meant: str) -> None:
    assert meant in did_you_mean(name, catalog.case_names())
    assert did_you_mean("xyzzy", catalog.case_names()) == ""


def test_the_list_fits_a_screen_and_names_all_suites(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listing, "list_solver", lambda entry: {"available": False, "reason": ""})
    lines = listing.overview(100).splitlines()
    assert len(lines) - len(listing.solver_entries()) <= 48  # and three that name many solvers
    assert max(map(len, lines)) <= 100
    assert [name for name in catalog.suite_names() if f" {name} " not in " ".join([*lines, ""])] == []


@pytest.mark.parametrize(
    ("arguments", "meant"),
    [
        (("run", "strop"), "strip"),
        (("run", "--suite", "toy"), "toys"),
        (("run", "strip", "--solver", "toy-nosy"), "toy-noisy"),
        (("run", "strip", "--solver", "toy", "--set", "toy.factr=1"), "factor"),
        (("tabel",), "table"),
        (("table", "--fromat", "json"), "--format"),
    ],
    ids=" ".join,
)
def test_the_command_line_says_what_was_meant(shellbench, arguments: tuple[str, ...], meant: str) -> None:  # noqa: F811
    code, out, err = shellbench(*arguments)
    assert (code, out) == (2, "")
    assert re.search(rf"([Dd]id you mean|Possible options):? '?{meant}", err)


def test_any_command_that_is_interrupted_says_so_and_exits_130(shellbench, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    def interrupt(*arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Store, "names", interrupt)
    for command in (("table",), ("gate",), ("report",), ("compare", "a", "b")):
        assert shellbench(*command) == (Interrupted.exit_code, "", "shellbench: interrupted\n")


def test_an_interrupt_outside_of_any_command_says_so_too(capfd, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "main", interrupt)
    with pytest.raises(SystemExit, match="130"):
        program.main()
    assert capfd.readouterr() == ("", "shellbench: interrupted\n")


def test_verbose_shows_where_an_error_came_from(shellbench, capfd, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    monkeypatch.setattr(sys, "argv", ["shellbench", "--verbose", "table", "nowhere"])
    with pytest.raises(SystemExit, match="2"):
        cli.main()
    err = capfd.readouterr().err
    assert err.startswith("Traceback")
    assert err.splitlines()[-1].startswith("shellbench: store")


def test_a_verbose_run_tells_its_steps_in_a_pipe() -> None:
    task = SimpleNamespace(case_name="strip", identity=SimpleNamespace(solver="toy", seed=1))
    for verbose, told in ((True, ["begins strip toy seed 1", "step 2/9 strip toy seed 1 half way"]), (False, [])):
        file = io.StringIO()
        shown = Lines(file, verbose)
        shown.started(task)
        shown.progressed(task, Progress(2, 9, "half\nway"))
        assert file.getvalue().splitlines() == told


class Terminal(io.StringIO):
    """Says that it is one."""

    def isatty(self) -> bool:
        return True


def test_progress_takes_one_line_a_run_on_80_columns() -> None:
    task = SimpleNamespace(
        run_id="1", case_name="pinched_cylinder_diaphragm@oblique", identity=SimpleNamespace(solver="ndf-ritz", seed=0)
    )
    console = Console(file=Terminal(), width=80, force_terminal=True)
    with display(console, 3) as shown:
        shown.started(task)
        shown.progressed(task, Progress(12, 250, "energy -1.234567e-05 J, features of other kinds join, 2121 unknowns"))
        lines = ["".join(part.text for part in line) for line in console.render_lines(shown.bars.get_renderable())]
    assert len(lines) == 2
    assert "pinched_cylinder_diaphragm@oblique" in lines[1]
    assert "12/250" in lines[1]


def test_shells_complete_names(shellbench, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    for words, meant in (
        ("run st", "strip"),
        ("gate --suite t", "toys"),
        ("export strip --solver toy-n", "toy-noisy"),
        ("new-s", "new-solver"),
    ):
        monkeypatch.setenv("_SHELLBENCH_COMPLETE", "complete_bash")
        monkeypatch.setenv("COMP_WORDS", f"shellbench {words}")
        monkeypatch.setenv("COMP_CWORD", str(len(words.split())))
        assert shellbench()[1].split() == [meant]


def in_terminal(command: list[str], columns: int) -> list[str]:
    """Lines that a program writes to a terminal of its own, so many columns wide."""
    ours, its = pty.openpty()
    fcntl.ioctl(its, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    with subprocess.Popen(command, stdout=its, stderr=its, stdin=its) as process:
        os.close(its)
        written = b""
        with contextlib.suppress(OSError):  # the end of a terminal is an error
            while chunk := os.read(ours, 4096):
                written += chunk
        assert process.wait(GUARD) == 0, written
    os.close(ours)
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", written.decode()).replace("\r", "").splitlines()


@pytest.mark.long
@pytest.mark.parametrize("command", [["list"], ["list", "scordelis_lo"], ["doctor"], ["gate", "--help"]], ids=" ".join)
def test_what_a_terminal_of_80_columns_is_shown_fits(command: list[str], tmp_path: Path) -> None:
    program = "import os, sys; os.environ.pop('COLUMNS', None); from shellbench.cli import main; main()"
    lines = in_terminal([sys.executable, "-c", program, *command], 80)
    assert lines
    assert max(map(len, lines)) <= 80
