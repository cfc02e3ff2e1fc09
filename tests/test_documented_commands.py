"""Each command line that README and docs show can be given: its command, options and number of names are known."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
import typer

from shellbench.cli import app

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "examples/solver_template/README.md", *sorted((ROOT / "docs").rglob("*.md"))]
FENCED = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
OF_COMMANDS = ("", "bash", "text", "console")  # languages of blocks that show commands
OPTIONAL = re.compile(r"\[(?![\d\[])[^\]]*\]")  # what a line may leave out; no list of numbers
CHOICE = re.compile(r"(\.\w+)(\|\.\w+)+")  # FILE.npz|.obj|.vtu
BESIDE = re.compile(
    r"\s{2,}(?!-)\S.*|(?<=[^\"])\s*[#;&|](?=[^\"]*(?:\"[^\"]*\"[^\"]*)*$).*"
)  # words beside a command, or another command


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


def parse(line: str) -> None:
    """Raise what the program would raise before it does anything."""
    group = typer.main.get_command(app)
    words = shlex.split(line)[1:]
    with group.make_context("shellbench", [*words], resilient_parsing=False) as context:
        name, command, rest = group.resolve_command(context, words)
        command.make_context(name, rest, parent=context)


COMMANDS = sorted(
    {line for path in PAGES for line in shown(path.read_text(encoding="utf-8"))} - {"shellbench COMMAND --help"}
)


@pytest.mark.parametrize("line", COMMANDS)
def test_a_command_that_is_shown_can_be_given(line: str) -> None:
    parse(line)


@pytest.mark.parametrize(
    "line", ["shellbench tabel", "shellbench table --formatt json", "shellbench compare A", "shellbench list a b"]
)
def test_one_that_can_not_be_given_is_seen(line: str) -> None:
    with pytest.raises(Exception, match=r"No such|Missing|unexpected"):
        parse(line)


def test_the_page_on_using_it_shows_every_command() -> None:
    page = (ROOT / "docs/using.md").read_text(encoding="utf-8")
    names = typer.main.get_command(app).commands
    assert [name for name in names if f"shellbench {name}" not in page and f"`{name}" not in page] == []
