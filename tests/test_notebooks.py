"""The notebooks in examples/ run from top to bottom, and what their cells end with can be shown."""

import ast
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.patience import GUARD

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
NOTEBOOKS = sorted(EXAMPLES.glob("*.ipynb"))
LARGEST = 250_000  # bytes, outputs included


def test_there_are_three_with_outputs() -> None:
    assert [path.stem for path in NOTEBOOKS] == ["course", "own_shell", "own_solver"]
    for path in NOTEBOOKS:
        text = path.read_text(encoding="utf-8")
        assert len(text) < LARGEST
        cells = json.loads(text)["cells"]
        assert cells[0]["source"][0].startswith("# ")
        code = [cell for cell in cells if cell["cell_type"] == "code"]
        assert [cell["execution_count"] for cell in code] == [*range(1, len(code) + 1)]
        ends = [ast.parse("".join(cell["source"])).body[-1] for cell in code]
        assert [
            c["id"] for c, end in zip(code, ends, strict=True) if isinstance(end, ast.Expr) and not c["outputs"]
        ] == []
        for output in (output for cell in code for output in cell["outputs"]):
            assert "image/png" in output.get("data", {}) or "text/plain" in output.get("data", {}) or output["text"]


def executed(path: Path, folder: Path, *names: str) -> dict[str, str]:
    """Run a copy of a notebook by tools/notebooks.py; return the text of some of its variables at the end."""
    copy = shutil.copyfile(path, folder / path.name)
    command = [sys.executable, str(ROOT / "tools/notebooks.py"), str(copy), *names]
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=4 * GUARD, env=os.environ | {"MPLBACKEND": "Agg"}
    )
    assert done.returncode == 0, done.stderr
    kept, made = (
        [
            [output["output_type"] for output in cell.get("outputs", ())]
            for cell in json.loads(file.read_text())["cells"]
        ]
        for file in (path, copy)
    )
    assert kept == made, "write the outputs anew by `python tools/notebooks.py`"
    return dict(line.split("=", 1) for line in done.stdout.splitlines()[-len(names) :])


@pytest.mark.long
def test_the_course(tmp_path: Path) -> None:
    errors = json.loads(
        executed(EXAMPLES / "course.ipynb", tmp_path, "errors")["errors"]
        .replace("np.float64", "")
        .replace("(", "")
        .replace(")", "")
    )
    assert errors[0] > 10 * errors[-1]


@pytest.mark.long
def test_a_shell_of_ones_own(tmp_path: Path) -> None:
    found = executed(EXAMPLES / "own_shell.ipynb", tmp_path, "weight", "reaction")
    weight, reaction = (
        float(found[name].removeprefix("np.float64(").removesuffix(")")) for name in ("weight", "reaction")
    )
    assert reaction == pytest.approx(weight, rel=1e-4)  # the mesh of flat facets has less area than the saddle


@pytest.mark.long
def test_a_solver_of_ones_own(tmp_path: Path) -> None:
    found = executed(EXAMPLES / "own_solver.ipynb", tmp_path, "apart")
    assert float(found["apart"].removeprefix("np.float64(").removesuffix(")")) < 1e-6
