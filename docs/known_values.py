"""Write known values from references/, as a page and as one table for programs: `python docs/known_values.py`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.reference import KnownValue
from shellbench.problem import Problem, Quantity
from shellbench.protocol.schema import read_toml

ROOT = Path(__file__).parents[1]
PAGE = Path(__file__).with_name("known_values.md")
TABLE = ROOT / "references" / "references.json"
PREFACE = """# Known values

<!-- Written by docs/known_values.py from references/. Change those, and run it. -->

What judges the headline of each case, and what else arrives at it. A value stands with the half width that surely covers the truth.
All other quantities of a case, and the figures usually quoted, are in `references/<case>.toml`; sources are keys of
`references/bibliography.bib`. For programs all of it is one table, `references/references.json`: a line for each quantity with its judge,
its other origins and what the literature says. To cite it, name the version of the exam, which is in the file and in every record.

A **judge** decides under the theory of its case. An **origin** is an independent second derivation. Where the source is
`shellbench` the locator names the file that computes it; `python -m derivations CASE` runs it. Tests recompute judges and origins
(`tests/bench/test_known_values.py`).

A case without a judge is not gated: its solvers are held against each other.

Kratos's figures come from whole shells, or from parts between planes of symmetry that are cases stated by hand
(`plugins/kratos/tests/test_known_values.py`). No code that looks for symmetry is shared with the solvers that are judged.

For the sleeves beyond buckling and the paper's napkins the second origin is the extrapolation of `fem` itself. For them only the judge is independent
of that solver.
"""


def cell(text: str) -> str:
    """Return text that can stand in a cell of a Markdown table."""
    return " ".join(text.replace("|", "\\|").split())


def row(case_file: Path) -> str:
    """Return the row of a case."""
    case = catalog.named_case(case_file.stem)
    quantity = case.primary
    file = ROOT / "references" / case_file.name
    values = read_toml(file)["values"] if file.is_file() else []
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


def figure(value: KnownValue) -> dict[str, Any]:
    """Return one known value as data."""
    keys = ("value", "uncertainty", "theory", "origin", "source", "locator", "note")
    return {key: getattr(value, key) for key in keys if getattr(value, key) not in ("", None)}


def entry(case: Problem, quantity: Quantity) -> dict[str, Any] | None:
    """Return the known values of a quantity; None if nothing judges it."""
    known = catalog.known_values(case.name)
    judge = known.judge(quantity.name, case.theory)
    if judge is None:
        return None
    origins = [v for v in known.of(quantity.name, "origin") if v.theory == case.theory]
    return {
        "case": case.name,
        "title": case.title,
        "kind": case.kind,
        "quantity": quantity.name,
        "description": quantity.description,
        "unit": quantity.unit,
        "at": quantity.mark,
        "headline": quantity.primary,
        "judge": figure(judge),
        "origins": [figure(value) for value in origins],
        "literature": [figure(value) for value in known.of(quantity.name, "literature")],
    }


def table() -> str:
    """Return all known values that judge, for programs."""
    cases = [catalog.named_case(name) for name in catalog.case_names()]
    entries = [found for case in cases for q in case.quantities if (found := entry(case, q)) is not None]
    head = {"exam": catalog.exam_version(), "source": "shellbench; see CITATION.cff", "values": len(entries)}
    lines = ",\n".join(f"  {json.dumps(one, ensure_ascii=False)}" for one in entries)
    return f'{json.dumps(head)[:-1]}, "known": [\n{lines}\n]}}\n'


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    TABLE.write_text(table(), encoding="utf-8")
