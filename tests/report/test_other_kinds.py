"""A chain of point masses on the page: no surface, no theory of shells, quantities with units of their own."""

import json
from dataclasses import dataclass

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.reference import KnownValue, KnownValues
from shellbench.bench.plugins import kinds
from shellbench.bench.plugins.kinds import find_kind, problem_of
from shellbench.bench.store.record import Measured
from shellbench.bench.store.store import Store as Records
from shellbench.problem import Kind, Problem
from shellbench.report.page.page import write_report
from shellbench.report.page.paper import write_paper
from shellbench.report.sections.tables import render
from tests.report.conftest import record, refinement, row
from tests.report.test_page import Page, pages_of

NAME, KIND, THEORY, SUITE = "nailed_chain", "chain", "unstated", "ropes"
TITLE = "Chain between two nails"
SAG, PULL = 0.75, 12.5  # of the closed form: links, and N


@dataclass(frozen=True)
class Asked:
    name: str
    unit: str
    description: str = ""
    at: float = 1.0


@dataclass(frozen=True)
class Chain:
    """A problem of another kind, as far as a report can see."""

    name: str = NAME
    kind: str = KIND
    title: str = TITLE
    theory: str = THEORY
    suites: tuple[str, ...] = (SUITE,)
    states: tuple[float, ...] = (1.0,)
    quantities: tuple[Asked, ...] = (Asked("sag", "link"), Asked("pull", "N"))


def known(case):
    assert case == NAME
    facts = {"role": "judge", "theory": THEORY, "origin": "closed form", "source": "bernoulli1691"}
    return KnownValues(
        values=(
            KnownValue(quantity="sag", value=SAG, uncertainty=1e-12, **facts),
            KnownValue(quantity="pull", value=PULL, uncertainty=1e-11, **facts),
        )
    )


@pytest.fixture
def chain(tmp_path, monkeypatch):
    """Records and rows of two solvers of a chain; one kept the places of its masses."""
    names = [*catalog.case_names(), NAME]
    monkeypatch.setattr(catalog, "case_names", lambda: names)
    frozen = dict(catalog.tolerances()) | {"direct": {}, "relaxed": {}}
    monkeypatch.setattr(catalog, "tolerances", lambda: frozen)
    kind = Kind(problem=Problem, keep=lambda solution, case: None)
    monkeypatch.setattr(kinds, "problem_of", lambda data: Chain() if data["kind"] == KIND else problem_of(data))
    monkeypatch.setattr(kinds, "find_kind", lambda name: kind if name == KIND else find_kind(name))
    folder = tmp_path / "runs"
    folder.mkdir()
    records, rows = [], []
    for solver, error in (("direct", 1e-9), ("relaxed", 2e-3)):
        history = tuple(
            step.model_copy(update={"quantities": {"sag": SAG * (1 + error * 2.0**-i)}})
            for i, step in enumerate(refinement("square_plate"))
        )
        plate = record(folder, catalog.named_case("square_plate"), solver, None, history=history)
        (folder / f"{plate.run_id}.json").unlink()
        np.savez(folder / plate.fields_file, masses=np.zeros((9, 3)), links=np.arange(8))
        made = plate.model_copy(
            update={
                "case_name": NAME,
                "case": {"kind": KIND, "name": NAME, "title": TITLE},
                "own_case": False,
                "run_id": f"{NAME}-{solver}",
                "values": {"sag": Measured(value=SAG * (1 + error)), "pull": Measured(value=PULL * (1 + error))},
                "resolution": (),
            }
        )
        (folder / f"{made.run_id}.json").write_text(json.dumps(made.model_dump(mode="json")), encoding="utf-8")
        records.append(made)
        for quantity, unit, truth in (("sag", "link", SAG), ("pull", "N", PULL)):
            change = {
                "case": NAME, "case_title": TITLE, "suite": SUITE, "suites": (SUITE,), "run_id": made.run_id,
                "quantity": quantity, "unit": unit, "primary": quantity == "sag", "description": "",
                "value": truth * (1 + error), "reference": truth, "reference_uncertainty": 1e-12,
                "reference_theory": THEORY, "reference_source": "bernoulli1691", "relative_error": error,
                "absolute_error": truth * error, "tolerance": 1e-6, "passed": error < 1e-6,
            }  # fmt: skip
            rows.append(row(plate).model_copy(update=change))
    return folder, records, rows


@pytest.mark.parametrize("format", ["text", "markdown", "latex", "csv", "json", "html"])
def test_its_table_has_its_values_and_units(chain, format):
    _, _, rows = chain
    text = render(rows, format, known)
    assert "0.75" in text
    assert "link" in text


def test_its_page_has_all_that_it_can_show_and_nothing_else(chain, tmp_path):
    folder, records, rows = chain
    start = write_report(Records(folder), rows, tmp_path / "out", known, for_print=False)
    page = pages_of(start)[f"{SUITE}.html"]
    assert not Page(page).open
    words = "".join(Page(page).words)
    assert "2 of 4 gated values pass" in words
    assert "fail" in words
    for section in ("displacements", "convergence", "quantities"):
        assert f'<section id="{section}">' in page
    for section in ("shells", "paths", "cloth", "newton", "strains", "fields", "thinness"):
        assert f'<section id="{section}">' not in page
    assert {record.run_id for record in records} <= set(start.read_text(encoding="utf-8").replace("<", ">").split(">"))
    assert not (start.parent / "plotly.js").exists()


def test_it_can_be_put_into_a_paper(chain, tmp_path):
    folder, _, rows = chain
    write_paper(Records(folder), rows, tmp_path / "paper", known)
    assert "0.75" in (tmp_path / "paper" / "tables" / f"displacements_{SUITE}.tex").read_text(encoding="utf-8")
