"""Derivatives from energies, by differences, and the check of them: no solver's mechanics."""

from types import SimpleNamespace

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.registry import find_solver, load_solver
from shellbench.problem import answerable
from shellbench.problems.shell.solution import ShellSolution
from shellbench.problems.shell.variants import slopes
from shellbench.testing import derivatives


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    ("name", "solver", "settings", "limit"),
    [
        ("gradient_plate", "bspline-ritz", None, 1e-7),
        ("gradient_diaphragm", "bspline-ritz", None, 1e-4),
        ("gradient_plate", "cst-hinge", {"cells": [8, 8]}, None),
    ],
)
def test_derivatives_of_other_solvers(name, solver, settings, limit):
    """Ritz methods are as near as their energy; triangles have the scaling laws of their own answer."""
    program = load_solver(find_solver(solver))
    case, declined = answerable(program, catalog.named_case(name))
    answer, known = program.solve(case, settings), catalog.known_values(name)
    asked = [q for q in case.quantities if q.kind == "derivative"]
    assert asked
    assert all(words for words in declined.values())
    for q in asked:
        found = q.measure(answer)
        if limit is None:
            other = case.quantity(q.derivative_of).measure(answer)
            exact = known.judge(q.derivative_of, case.theory).value
            assert found / other == pytest.approx(known.judge(q.name, case.theory).value / exact, rel=1e-5)
        else:
            assert found == pytest.approx(known.judge(q.name, case.theory).value, rel=limit)


def test_energies_alone_give_no_other_derivative():
    case = catalog.named_case("gradient_roof")
    energy, edge = case.quantity("strain_energy"), case.primary
    assert slopes.why_not_from_energies(case, energy, "material.thickness") is None
    assert "by material.youngs_modulus" in slopes.why_not_from_energies(case, energy, "surface.radius")
    assert "displacements that the loads average" in slopes.why_not_from_energies(case, edge, "material.thickness")
    assert "from energies" in slopes.why_not_from_energies(
        catalog.named_case("gradient_sleeve"), energy, "material.thickness"
    )


class Answers:
    """An examination of plates whose deflection is exact; the derivative by the thickness may be wrong."""

    def __init__(self, factor):
        self.factor, self.exact = factor, catalog.named_case("gradient_plate")

    def solve(self, case):
        material, load = case.material, 1.0
        w = load / material.youngs_modulus / material.thickness**3
        size = {"material.youngs_modulus": -1, "material.thickness": -3 * self.factor, "loads.1": 1}
        size |= {"surface.xi1_max": 2, "surface.xi2_max": 2}
        values = {case.primary.name: w}
        for q in case.quantities:
            if q.kind == "derivative":
                p = q.parameter(case)
                values[q.name] = size.get(p.name, 0) * w / (p.value or 1)
        subject = SimpleNamespace(call=lambda *_: {name: v for name, v in values.items() if name != case.primary.name})
        return SimpleNamespace(subject=subject, key="", facts={"derivatives": True}, headline=lambda: w)


def test_the_check_passes_right_derivatives_and_fails_wrong_ones(monkeypatch):
    monkeypatch.setattr(derivatives, "own_uncertainty", lambda answer: 0.0)
    plate = catalog.named_case("square_plate")
    right, wrong = (derivatives.derivatives(Answers(factor), plate) for factor in (1.0, 1.1))
    assert right.status == "passed", right.words
    assert "sum rule" in right.words
    assert wrong.status == "failed"
    assert "material.thickness it is off by 3" in wrong.words
    assert "sum rule is missed" in wrong.words


def test_every_solution_says_why_it_has_no_derivative():
    bare = SimpleNamespace(diagnostics={}, case=catalog.named_case("cantilever_shear"))
    with pytest.raises(ValueError, match="from energies, in linear theory"):
        ShellSolution.derivative(bare, bare.case.primary, "material.thickness")
