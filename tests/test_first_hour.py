"""A new user's first hour: the commands of the two tutorials, one after another, in an empty folder."""

import importlib.util
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.patience import GUARD

ROOT = Path(__file__).resolve().parent.parent
PROGRAMS = {"shellbench": [sys.executable, "-m", "shellbench"], "python": [sys.executable]}


def commands(page: str) -> list[list[str]]:
    """The lines of a page's blocks of commands, as arguments."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    lines = "\n".join(re.findall(r"^```bash\n(.*?)^```", text, re.MULTILINE | re.DOTALL)).splitlines()
    return [words for line in lines if (words := shlex.split(line, comments=True))]


def give(words: list[str], folder: Path, site: Path) -> None:
    """Run a command as its page shows it; packages are installed into a folder of the test."""
    if words[:4] == ["python", "-m", "pip", "install"]:
        here = ["--no-build-isolation"] if importlib.util.find_spec("hatchling") else []
        words = [*words[:4], "--no-deps", *here, "--target", str(site), f"./{words[-1].partition('[')[0]}"]
    done = subprocess.run(
        [*PROGRAMS[words[0]], *words[1:]],
        cwd=folder,
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join(filter(None, [str(site), str(ROOT), os.getenv("PYTHONPATH")])),
        },
        capture_output=True,
        text=True,
        timeout=10 * GUARD,
        check=False,
    )
    assert done.returncode == 0, f"{shlex.join(words)}\n{done.stdout}\n{done.stderr}"


@pytest.mark.long
def test_a_case_of_ones_own(tmp_path: Path) -> None:
    page = (ROOT / "docs/own_case.md").read_text(encoding="utf-8")
    give(["shellbench", "new-case", "paraboloid"], tmp_path, tmp_path / "site")
    shown = commands("own_case.md")
    assert len(shown) >= 3
    for words in shown:
        give(words, tmp_path, tmp_path / "site")
    known = re.search(r"^```toml\n(\[\[known\]\]\n.*?)^```", page, re.MULTILINE | re.DOTALL)
    assert known
    with (tmp_path / "paraboloid.toml").open("a", encoding="utf-8") as file:
        file.write(f"\n{known[1]}")
    give(["shellbench", "gate", "paraboloid.toml"], tmp_path, tmp_path / "site")


@pytest.mark.long
def test_a_solver_of_ones_own(tmp_path: Path) -> None:
    if importlib.util.find_spec("pip") is None:
        pytest.skip("needs pip")
    give(["shellbench", "run", "square_plate", "--solver", "fem"], tmp_path, tmp_path / "site")  # to compare with
    shown = commands("own_solver.md")
    assert len(shown) >= 11
    for words in shown:
        give(words, tmp_path, tmp_path / "site")
