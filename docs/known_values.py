"""Write the table of known values from references/: `python docs/known_values.py`."""

from __future__ import annotations

import tomllib
from pathlib import Path

from shellbench.bench.kinds import read_problem

ROOT = Path(__file__).parents[1]
PAGE = Path(__file__).with_name("known_values.md")
PREFACE = """# Known values

<!-- Written by docs/known_values.py from references/. Change those, and run it. -->

What judges the headline of each case, and what else arrives at it. A value stands with the half width that surely covers the truth.
All other quantities of a case, and the figures usually quoted, are in `references/<case>.toml`; sources are keys of
`references/bibliography.bib`.

A **judge** decides under the theory of its case. An **origin** is an independent second derivation. Where the source is
`shellbench` the locator names the file that computes it; `python -m derivations CASE` runs it. Tests recompute judges and origins
(`tests/bench/test_known_values.py`).

A case without a judge is not gated: its solvers are held against each other.

Kratos's figures come from whole shells, or from parts between planes of symmetry that are cases stated by hand
(`tests/solvers/kratos/test_known_values.py`). No code that looks for symmetry is shared with the solvers that are judged.

For the sleeves and the paper's napkins the second origin is the extrapolation of `fem` itself. For them only the judge is independent
of that solver.
"""


def cell(text: str) -> str:
    """Return text that can stand in a cell of a Markdown table."""
    return " ".join(text.replace("|", "\\|").split())


def row(case_file: Path) -> str:
    """Return the row of a case."""
    case = read_problem(case_file)
    quantity = case.primary
    file = ROOT / "references" / case_file.name
    values = tomllib.loads(file.read_text(encoding="utf-8"))["values"] if file.is_file() else []
    found = [v for v in values if v["quantity"] == quantity.name and v["theory"] == case.theory]
    judges = [v for v in found if v["role"] == "judge"]
    value = " ".join(f"{v['value']:.13g} ± {v['uncertainty']:.2g} {quantity.unit}" for v in judges) or "no known value"
    how = "; ".join(f"{v['origin']} ({v['locator'] or v['source']})" for v in judges)
    others = "; ".join(f"{v['origin']} [{v['source']}]" for v in found if v["role"] == "origin")
    return f"| `{case.name}` | {cell(quantity.description)} | {value} | {cell(how)} | {cell(others)} |"


def page() -> str:
    """Return the whole page."""
    head = "| case | headline | known value | judge | origins |\n|---|---|---|---|---|"
    rows = [row(path) for path in sorted((ROOT / "cases").glob("*.toml"))]
    return PREFACE + "\n" + "\n".join([head, *rows]) + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
