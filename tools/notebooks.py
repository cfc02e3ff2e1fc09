"""Runs the notebooks in examples/ from top to bottom and writes their outputs into them, without Jupyter.

``python tools/notebooks.py`` runs all of them, ``python tools/notebooks.py FILE.ipynb [NAME ...]`` one file in the folder
where it is called, and prints its variables of these names at the end.
"""

from __future__ import annotations

import ast
import base64
import contextlib
import io
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

EXAMPLES = Path(__file__).parents[1] / "examples"
LONGEST = 1000  # characters: a longer text says no more than the name of the type


def run(path: Path) -> dict[str, Any]:
    """Run the code cells of a notebook, write their outputs into its file, and return its variables."""
    notebook = json.loads(path.read_text(encoding="utf-8"))
    names: dict[str, Any] = {"__name__": "__main__"}
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    for count, cell in enumerate(cells, 1):
        tree = ast.parse("".join(cell["source"]))
        end = tree.body[-1]
        last = end.value if isinstance(end, ast.Expr) else None
        tree.body = tree.body[: -1 if last is not None else None]
        printed, shown = io.StringIO(), None
        with contextlib.redirect_stdout(printed):
            exec(compile(tree, f"cell {count}", "exec"), names)
            if last is not None:
                shown = eval(compile(ast.Expression(last), f"cell {count}", "eval"), names)
        outputs: list[dict[str, Any]] = []
        if printed.getvalue():
            outputs.append({"name": "stdout", "output_type": "stream", "text": _lines(printed.getvalue())})
        if shown is not None:
            result = {"data": _shown(shown), "execution_count": count, "metadata": {}}
            outputs.append(result | {"output_type": "execute_result"})
        cell |= {"execution_count": count, "outputs": outputs}
    text = json.dumps(notebook, indent=1, ensure_ascii=False, sort_keys=True)
    path.write_text(f"{text}\n", encoding="utf-8")
    return names


def _shown(value: Any) -> dict[str, Any]:
    """Return the representations of a value that a notebook shows, by MIME type."""
    text = repr(value)
    data: dict[str, Any] = {"text/plain": _lines(text if len(text) < LONGEST else type(value).__name__)}
    if hasattr(value, "_repr_html_"):
        data["text/html"] = _lines(value._repr_html_())
    if hasattr(value, "_repr_png_"):
        data = {"text/plain": [type(value).__name__], "image/png": base64.b64encode(value._repr_png_()).decode()}
    return data


def _lines(text: str) -> list[str]:
    return text.splitlines(keepends=True)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        found = run(Path(sys.argv[1]))
        print(*(f"{name}={found[name]!r}" for name in sys.argv[2:]), sep="\n")
    else:
        for path in sorted(EXAMPLES.glob("*.ipynb")):
            with tempfile.TemporaryDirectory() as folder:
                command = [sys.executable, str(Path(__file__)), str(path)]
                subprocess.run(command, cwd=folder, check=True, env=os.environ | {"MPLBACKEND": "Agg"})
