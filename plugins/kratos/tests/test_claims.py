"""The errors that `kratos-iga` promises: its converged values keep them."""

import pytest

pytest.importorskip("KratosMultiphysics", reason="needs Kratos: python -m pip install ./plugins/kratos")

from shellbench_kratos.iga_solver import KratosIgaSolver

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.brought import claimed
from shellbench.bench.plugins.registry import find_solver

CLAIMS = {
    "square_plate": 1e-4,
    "scordelis_lo": 1e-4,
    "pinched_cylinder_free": 1e-4,
    "pinched_cylinder_diaphragm": 1e-3,
}


def test_it_claims_what_was_asked_before_its_errors_were_seen():
    found = claimed(find_solver("kratos-iga"))
    asked = {name: {catalog.named_case(name).primary.name: claim} for name, claim in CLAIMS.items()}
    assert {name: {q: t.relative for q, t in held.items()} for name, held in found.items()} == asked


@pytest.mark.parametrize("name", CLAIMS)
def test_the_suite_asks_for_its_default_answer_once(name):
    runs = [r for r in catalog.find_suite("engines").runs if r.solver == "kratos-iga" and not r.settings]
    assert len([run for run in runs if name in run.cases]) == 1


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=() if n == "square_plate" else pytest.mark.long) for n in CLAIMS]
)
def test_it_holds_its_claim(name):
    case = catalog.named_case(name)
    known = catalog.known_values(name).judge(case.primary.name, case.theory)
    solver = KratosIgaSolver()
    found = case.primary.factor * case.primary.measure(solver.solve(case, solver.settings_type()))
    assert found == pytest.approx(known.value, rel=CLAIMS[name])
