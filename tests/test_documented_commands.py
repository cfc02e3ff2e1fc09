"""The examples of README and docs work: commands with their options and arguments, sessions, Python."""

import ast
import re
import shlex
from importlib import import_module
from pathlib import Path

import pytest
import typer

from shellbench.bench.plugins import registry
from shellbench.cli import app

ROOT = Path(__file__).parents[1]
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "examples/solver_template/README.md")),
    *sorted(page for page in (ROOT / "docs").rglob("*.md") if page.parent.name != "cases"),  # those are built
]
FENCED = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
IN_A_LINE = re.compile(r"`(shellbench [a-z][^`]*)`")
SESSION = re.compile(r"nox -s\s+((?:[a-z_]+ ?)+)")
DOCUMENTED = re.compile(r"^::: ([\w.]+)$", re.MULTILINE)
OF_COMMANDS = ("", "bash", "text", "console")  # languages of blocks that show commands
OPTIONAL = re.compile(r"\[(?![\d\[])[^\]]*\]")  # what a line may leave out; no list of numbers
CHOICE = re.compile(r"(\.\w+)(\|\.\w+)+")  # FILE.npz|.obj|.vtu
BESIDE = re.compile(
    r"\s{2,}(?!-)\S.*|(?<=[^\"])\s*[#;&|](?=[^\"]*(?:\"[^\"]*\"[^\"]*)*$).*"
)  # words beside a command, or another command


@pytest.fixture(autouse=True)
def _files_of_solvers_are_names(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "name_of", str)


def shown(page: str) -> list[str]:
    """Command lines of a page: those that begin a line of a block of code."""
    blocks = [block for language, block in FENCED.findall(page) if language in OF_COMMANDS]
    lines = "\n".join(blocks).replace("\\\n", " ").splitlines()
    whole = [line.strip().removeprefix("$ ") for line in lines]
    return [
        BESIDE.sub("", CHOICE.sub(r"\1", OPTIONAL.sub("", line))).strip()
        for line in whole
        if re.match(r"shellbench [a-z-]", line)  # pytest's output begins with the word, too
    ]


GROUP = typer.main.get_command(app)


def parse(line: str) -> None:
    """Raise what the program would raise before it does anything."""
    words = shlex.split(line)[1:]
    with GROUP.make_context("shellbench", [*words], resilient_parsing=False) as context:
        name, command, rest = GROUP.resolve_command(context, words)
        command.make_context(name, rest, parent=context)


def named(page: str) -> list[str]:
    """Commands that stand in typewriter within a text: they may lack what a command is about."""
    return [" ".join(line.split()) for line in IN_A_LINE.findall(FENCED.sub("", page))]


NAMED = sorted({line for path in PAGES for line in named(path.read_text(encoding="utf-8"))})
COMMANDS = sorted(
    {line for path in PAGES for line in shown(path.read_text(encoding="utf-8"))} - {"shellbench COMMAND --help"}
)


@pytest.mark.parametrize("line", COMMANDS)
def test_a_command_that_is_shown_can_be_given(line: str) -> None:
    parse(line)


@pytest.mark.parametrize("line", [line for line in NAMED if line not in COMMANDS])
def test_a_command_that_is_named_is_one(line: str) -> None:
    try:
        parse(line)
    except Exception as error:  # Click's own, of a module that Typer hides
        if "Missing parameter" not in str(error):
            raise


@pytest.mark.parametrize(
    "line", ["shellbench tabel", "shellbench table --formatt json", "shellbench compare A", "shellbench list a b"]
)
def test_one_that_can_not_be_given_is_seen(line: str) -> None:
    with pytest.raises(Exception, match=r"No such|Missing|unexpected"):
        parse(line)


def test_the_page_on_using_it_shows_every_command() -> None:
    page = (ROOT / "docs/using.md").read_text(encoding="utf-8")
    assert [name for name in GROUP.commands if f"shellbench {name}" not in page and f"`{name}" not in page] == []


def test_sessions_that_are_shown_are_there() -> None:
    known = set(re.findall(r"^@nox\.session.*\ndef (\w+)", (ROOT / "noxfile.py").read_text("utf-8"), re.MULTILINE))
    named = {name for path in PAGES for names in SESSION.findall(path.read_text("utf-8")) for name in names.split()}
    assert len(named) > 20
    assert named - known == set()


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_python_that_is_shown_can_be_read_and_finds_what_it_imports(path: Path) -> None:
    for block in (
        block for language, block in FENCED.findall(path.read_text(encoding="utf-8")) if language == "python"
    ):
        for statement in ast.walk(ast.parse(block)):
            if isinstance(statement, ast.ImportFrom) and str(statement.module).startswith("shellbench"):
                module = import_module(str(statement.module))
                assert [alias.name for alias in statement.names if not hasattr(module, alias.name)] == []


def test_the_python_interface_documents_what_is_there() -> None:
    names = DOCUMENTED.findall((ROOT / "docs/api.md").read_text(encoding="utf-8"))
    assert {"shellbench.interface.run", "shellbench.interface.table", "shellbench.problem.Solver"} <= set(names)
    for name in names:
        module, _, attribute = name.rpartition(".")
        found = import_module(name) if name == "shellbench.errors" else getattr(import_module(module), attribute)
        assert found.__doc__, name
