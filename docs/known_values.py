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

A known value is a reference value with a stated uncertainty: the value plus or minus it should cover the truth. This
page lists one value of each case, its headline (main quantity). To find a case, search the page for its name, such as
`scordelis_lo`. The name links to a page with all its values and their sources. `python -m nox -s docs` builds these
pages; `shellbench list scordelis_lo` prints the same.
[Benchmarks by name](benchmarks_by_name.md) has the names and values of other sets: NAFEMS, MacNeal-Harder and others.

- The **judge** decides on answers of the case's theory. An **origin** is an independent second derivation.
- In the tables, brackets after a method have its source: a file of this repository, or a key of
  `references/bibliography.bib`. The key `shellbench` means: computed here.
- `python -m derivations scordelis_lo` computes a judge anew. Tests recompute judges and origins
  (`tests/bench/test_known_values.py`).
- A case without a judge is not gated (no tolerance applies). Its solvers are compared with each other.
- Values of Kratos, a finite element program, are of whole shells, or of parts that were stated by hand
  (`plugins/kratos/tests/test_known_values.py`). No search for symmetry, which the judged solvers have, affects them.
- Sleeves that buckle, garments, the napkins of NeuralClothSim and the drape on a ball have `fem` as second origin of most
  values. There `fem` ran on finer meshes, and only the judge is independent of it.

`references/<case>.toml` has all quantities of a case, and the values usually quoted. `references/references.json` has
everything in one table, for programs. To cite a value, name the version of the exam (cases, known values and tolerances).
It is in `references/references.json` and in every record.
"""
CLOTH = {"cloth", "cloth_published", "garments", "garments_scatter", "obstacle_course"}  # suites, at finite strain
SMALL = "Plates and shells, small displacements"
GROUPS = (
    SMALL, "Large displacements", "Cloth and motion", "Contact", "Modes and buckling", "Ranges of materials",
    "Edits", "Fields", "Ropes", "Skinning",
)  # fmt: skip
KINDS = {"conditioned": "Ranges of materials", "editing": "Edits", "rope": "Ropes", "skinning": "Skinning"}


def cell(text: str) -> str:
    """Return text that can stand in a cell of a Markdown table."""
    return " ".join(text.replace("|", "\\|").split())


def group(case: Problem) -> str:
    """Return the group of a case: its kind, and for shells the suite and the theory."""
    suites = set(case.suites)
    if case.kind != "shell":
        return KINDS.get(case.kind, "Fields")
    if suites & {"modes", "buckling"}:
        return "Modes and buckling"
    if "contact" in suites:
        return "Contact"
    if case.theory == "kirchhoff-love-nonlinear":
        return "Cloth and motion" if suites & CLOTH or getattr(case, "dynamics", None) else "Large displacements"
    return SMALL


def where(value: dict[str, Any]) -> str:
    """Return the source of a value and the place in it; the file alone if it was computed here."""
    source = "" if value["source"] == "shellbench" and value.get("locator") else value["source"]
    return ", ".join(filter(None, (source, value.get("locator", ""))))


def row(case: Problem) -> str:
    """Return the row of a case."""
    quantity = case.primary
    file = ROOT / "references" / f"{case.name}.toml"
    values = read_toml(file)["values"] if file.is_file() else []
    link = f"[`{case.name}`](cases/{case.name}.md)" if case.name == case.base else f"`{case.name}`"
    found = [v for v in values if v["quantity"] == quantity.name and v["theory"] == case.theory]
    judges = [v for v in found if v["role"] == "judge"]
    value = " ".join(f"{v['value']:.13g} ± {v['uncertainty']:.2g} {quantity.unit}" for v in judges) or "no known value"
    how = "; ".join(f"{v['origin']} ({where(v)})" for v in judges)
    others = "; ".join(f"{v['origin']} [{v['source']}]" for v in found if v["role"] == "origin")
    headline = quantity.description or quantity.kind.replace("_", " ")
    return f"|{link}|{cell(headline)}|{value}|{cell(how)}|{cell(others)}|"


def headlines() -> list[str]:
    """Return the lines of the tables of headlines, a group each."""
    head = "|case|headline|known value|method of the judge (source)|methods of the origins [source]|\n|---|---|---|---|---|"
    names = sorted([*catalog.own_case_names(), *catalog.own_twins()])
    cases = [catalog.named_case(name) for name in names]
    lines = []
    for title in GROUPS:
        lines += ["", f"### {title}", "", head, *(row(case) for case in cases if group(case) == title)]
    return lines


def page() -> str:
    """Return the whole page."""
    return "\n".join([PREFACE, "## Headlines", *headlines(), ""])


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
    cases = [catalog.named_case(name) for name in [*catalog.case_names(), *catalog.own_twins()]]
    entries = [found for case in cases for q in case.quantities if (found := entry(case, q)) is not None]
    head = {"exam": catalog.exam_version(), "source": "shellbench; see CITATION.cff", "values": len(entries)}
    lines = ",\n".join(f"  {json.dumps(one, ensure_ascii=False)}" for one in entries)
    return f'{json.dumps(head)[:-1]}, "known": [\n{lines}\n]}}\n'


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    TABLE.write_text(table(), encoding="utf-8")
