"""The notebooks in examples/ run from top to bottom, and what their cells end with can be shown."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.patience import GUARD

EXAMPLES = Path(__file__).parents[1] / "examples"
NOTEBOOKS = sorted(EXAMPLES.glob("*.ipynb"))
SMALL = 20_000  # bytes
RUN = """
import ast, json, sys
names = {"__name__": "__main__"}
for place, cell in enumerate(json.load(open(sys.argv[1], encoding="utf-8"))["cells"]):
    if cell["cell_type"] != "code":
        continue
    tree = ast.parse("".join(cell["source"]))
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, f"cell {place}", "exec"), names)
    if last is not None:
        shown = eval(compile(ast.Expression(last.value), f"cell {place}", "eval"), names)
        for way in ("_repr_html_", "_repr_png_"):
            if hasattr(shown, way):
                assert getattr(shown, way)(), f"cell {place} shows nothing"
print(*(f"{name}={names[name]!r}" for name in sys.argv[2:]), sep="\\n")
"""


def test_there_are_three_small_ones_without_outputs() -> None:
    assert [path.stem for path in NOTEBOOKS] == ["course", "own_shell", "own_solver"]
    for path in NOTEBOOKS:
        text = path.read_text(encoding="utf-8")
        assert len(text) < SMALL
        cells = json.loads(text)["cells"]
        assert not any(cell.get("outputs") or cell.get("execution_count") for cell in cells)
        assert cells[0]["source"][0].startswith("# ")


def executed(path: Path, folder: Path, *names: str) -> dict[str, str]:
    """Run a notebook's cells in order, by Python alone; return what some of its names are in the end."""
    command = [sys.executable, "-c", RUN, str(path), *names]
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=4 * GUARD, env=os.environ | {"MPLBACKEND": "Agg"}
    )
    assert done.returncode == 0, done.stderr
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
