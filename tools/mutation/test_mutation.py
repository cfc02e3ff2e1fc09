"""Tests of the exam's test: rules make the described changes only, draws repeat, and the exam detects a fault."""

from __future__ import annotations

import ast
import json
import math
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from shellbench.bench.catalogue.reference import Tolerance
from shellbench.bench.judge.row import Finding
from tests.bench.test_classes import figure
from tools.mutation.draw import Mutant, all_mutants, draw, mutants_of, mutated
from tools.mutation.exam import CONFIDENT, VALUE, finds_a_mistake, first_mistake
from tools.mutation.operators import RULES
from tools.mutation.report import add, interval, score, words
from tools.mutation.schedule import Question, Reach, _answers, _in_order, _within
from tools.mutation.targets import CHECK, FEM, KINDS, LEFT_OUT, MECHANICS, STATEMENT, TARGETS, file_of, kind_of, parts


def made(rule: str, expression: str) -> set[str]:
    """Return the mutations that a rule makes of an expression, or of a statement, in any of its nodes."""
    source = f"def f():\n    {expression}"
    return {mutant.becomes for mutant in mutants_of("toy", source) if mutant.rule == rule}


@pytest.mark.parametrize(
    ("rule", "before", "after"),
    [
        ("sign", "return -a", {"return a"}),
        ("sign", "return a + b - c", {"return a - b - c", "return a + b + c"}),
        ("sign", "x += a", {"x -= a"}),
        ("factor", "return 3 * a", {"return 6 * a", "return 1.5 * a"}),
        ("factor", "return a * b", set()),
        (
            "factor",
            "return a - b",
            {"return 2 * a - b", "return 0.5 * a - b", "return a - 2 * b", "return a - 0.5 * b"},
        ),
        ("quotient", "return a * b / c", {"return a / b / c", "return a * b * c"}),
        ("transposed", "return a[i, j]", {"return a[j, i]"}),
        ("transposed", "return a[:, i]", set()),
        ("transposed", "return a[..., None, i]", set()),
        ("transposed", "return a.T @ b", {"return a @ b"}),
        ("transposed", "return np.swapaxes(a, 1, 2)", {"return a"}),
        ("transposed", "return a.transpose(0, 2, 1)", {"return a.transpose(2, 0, 1)", "return a.transpose(0, 1, 2)"}),
        (
            "transposed",
            "return np.einsum('nab,nb->na', a, b)",
            {"return np.einsum('nba,nb->na', a, b)", "return np.einsum('nab,bn->na', a, b)"},
        ),
        ("dropped term", "return a + b", {"return a", "return b"}),
        ("dropped term", "return a - b", {"return a", "return -b"}),
        ("dropped term", "x -= a", {"pass"}),
        ("arguments", "return cross(a, b)", {"return cross(b, a)"}),
        ("arguments", "return f(a, b[0], c.d)", set()),
        ("arguments", "return np.maximum(a, b)", set()),
        ("off by one", "return range(n)", {"return range(n - 1)", "return range(1, n)"}),
        ("off by one", "return a[1:n]", {"return a[2:n]", "return a[1:n - 1]"}),
        ("off by one", "return a[0]", {"return a[1]"}),
        ("off by one", "return a[:, 2]", {"return a[:, 1]"}),
        ("off by one", "return f(x, order=2)", {"return f(x, order=1)"}),
        ("boundary", "return a < b", {"return a <= b"}),
        ("boundary", "return not a", {"return a"}),
        ("boundary", "return x.max(0)", {"return x.min(0)"}),
        ("boundary", "return min(a, b)", {"return max(a, b)"}),
    ],
)
def test_a_rule_makes_what_it_says(rule: str, before: str, after: set[str]) -> None:
    assert made(rule, before) == after


NO_MECHANICS = '''
"""A docstring of 2 + 3 words."""
MOST = 2 * 400
Load = A | B
def said(x) -> str:
    return x + 1
def check_it(x):
    return x + 1
class Settings(Model):
    cells: int = Field(8 + 1, ge=1 - 0)
    @field_validator("cells")
    def _even(cls, cells):
        return cells - 1
def solve(x, order=2 + 1, progress=None):
    """Solve 2 + 2."""
    if x < 0:
        raise ValueError(f"{x + 1} is wrong")
    assert x < 3
    progress(x - 1)
    y: Annotated[float, 1 + 2] = isinstance(x, float)
    return f"{x - 2}"
'''


def test_what_is_no_mechanics_is_left_out() -> None:
    assert not mutants_of("toy", NO_MECHANICS)


def test_tables_and_heads_of_statements_count() -> None:
    source = "PAIRS = {(0, 0): a[0, 1]}\ndef f(x):\n    if x < 0:\n        return x + 1\n    for i in range(n):\n        x -= 1\n    return x"
    changed = {mutant.becomes for mutant in mutants_of("toy", source)}
    assert {"PAIRS = {(0, 0): a[1, 0]}", "if x <= 0:", "for i in range(n - 1):", "pass", "return x"} <= changed


FIRST, *FEW, OTHER = FEM.modules()[:4]  # the first has the most mutants
ALONE = [*FEW, *(pytest.param(name, marks=pytest.mark.long) for name in (FIRST, OTHER, *FEM.modules()[4:6]))]


@pytest.mark.parametrize("module", ALONE)
def test_a_mutant_differs_in_its_statement_alone(module: str) -> None:
    source = file_of(module).read_text()
    before = [ast.dump(statement) for statement in ast.parse(source).body]
    for mutant in draw(mutants_of(module, source), 0, 20):
        changed = mutated(source, mutant)
        after = [ast.dump(statement) for statement in changed.body]
        assert sum(old != new for old, new in zip(before, after, strict=True)) == 1
        compile(changed, module, "exec")


def test_a_draw_repeats_and_survives_a_shift_of_lines() -> None:
    source = file_of(FEM.modules()[0]).read_text()
    one, other = (draw(mutants_of("toy", text), 3, 30) for text in (source, "\n\n# moved\n" + source))
    assert [m.name for m in one] == [m.name for m in other]
    assert [m.name for m in one] != [m.name for m in draw(mutants_of("toy", source), 4, 30)]


def test_a_draw_spreads_over_modules_and_rules() -> None:
    modules = [name for name in FEM.modules() if name.rpartition(".")[2] in {"kinematics", "loads", "assembly"}]
    drawn = draw(all_mutants(modules), 1, 30)
    assert {mutant.module for mutant in drawn} == set(modules)
    assert {mutant.rule for mutant in drawn} == set(RULES)


def test_every_target_has_mechanics() -> None:
    for target in TARGETS.values():
        for module in target.modules():
            assert list(parts(ast.parse(file_of(module).read_text()))), module


def test_a_function_is_what_the_first_entry_says_of_it_and_mechanics_otherwise() -> None:
    assert kind_of("shellbench.solvers.ndf.linear.signs", "rounding_energy") == STATEMENT
    assert kind_of("shellbench.solvers.ndf.linear.signs", "jitter_share") == CHECK
    assert kind_of("shellbench.solvers.fem.mesh.mesh", "TensorMesh.locate") == MECHANICS
    source = "class A:\n    def f(self, x):\n        def inner():\n            return x + 1\n        return inner()\n"
    assert {part.function for part in parts(ast.parse(source))} == {"A.f"}


def test_kinds_name_functions_that_are_there_and_say_why() -> None:
    functions = {
        module: {part.function for part in parts(ast.parse(file_of(module).read_text()))}
        for target in TARGETS.values()
        for module in target.modules()
    }
    for modules, pattern, kind, why in KINDS:
        assert kind in {*LEFT_OUT, STATEMENT}
        assert why
        for name in modules.split("|"):
            own = {function for module, there in functions.items() if module.endswith(f".{name}") for function in there}
            assert any(re.fullmatch(pattern, function) for function in own), (name, pattern)


def reach(case: str, seconds: float) -> Reach:
    return Reach(Question("fem", case), seconds, {})


def test_cheap_questions_come_first_and_further_ways_to_ask_later() -> None:
    exam = _in_order([reach("b", 1.0), reach("a@axes", 0.3), reach("a@units", 0.3), reach("a", 0.3), reach("c", 0.8)])
    assert [r.question.case for r in exam] == ["a", "a@axes", "c", "a@units", "b"]
    assert len(_within(exam, 1.0)) == 2
    assert len(_within(exam, 0.0)) == 1
    assert len(_within(exam, math.inf)) == 5


def planted(module: str, statement: str, becomes: str) -> Mutant:
    source = file_of(module).read_text()
    return next(m for m in mutants_of(module, source) if (m.statement, m.becomes) == (statement, becomes))


PLATE = Question("fem", "square_plate")
NONE_OF_A_PLATE = (  # the coordinate lines of a plate are straight: what is dropped is zero, and the other terms stay
    "shellbench.solvers.fem.mechanics.kinematics",
    "tangential = (surface.second - curvature * surface.normal[:, None]) / surface.area[:, None, None]",
    "tangential = surface.second / surface.area[:, None, None]",
)
HALF_THE_BENDING = (
    "shellbench.problems.shell.question.conditions",
    "return self.bending_factor * self.membrane_stiffness * self.thickness ** 2 / 12",
    "return self.bending_factor * self.membrane_stiffness * self.thickness ** 2 / 24",
)


@pytest.mark.parametrize("change", [HALF_THE_BENDING, NONE_OF_A_PLATE])
def test_what_the_next_test_plants_is_still_made(change: tuple[str, str, str]) -> None:
    assert planted(*change).becomes == change[2]


@pytest.mark.long
@pytest.mark.parametrize(("change", "red"), [(HALF_THE_BENDING, True), (NONE_OF_A_PLATE, False)])
def test_the_exam_tells_a_fault_from_none(change: tuple[str, str, str], red: bool) -> None:
    (answer,), why = _answers(planted(*change), [PLATE], (), lambda _: 300.0)
    assert not why
    assert answer.red.startswith(VALUE) if red else not answer.red


@pytest.mark.parametrize(("error", "found"), [(5e-2, False), (5e-4, False), (-2.0, True)])
def test_an_answer_that_passes_against_expectation_is_no_mistake(error: float, found: bool) -> None:
    opened = Tolerance(relative=1e-3, open_finding="known to be off")
    assert finds_a_mistake(figure(error).judged(opened).finding()) is found


def test_a_figure_within_its_tolerance_that_is_wrong_with_confidence_is_a_mistake() -> None:
    row = figure(5e-4).judged(Tolerance(relative=1e-3))
    sure = Finding(row, "red", "its error is 6 times the uncertainty that it states")
    silent = SimpleNamespace(accuracy=(row.finding(),), calibration=())
    assert first_mistake(silent, row.case) == ""
    assert first_mistake(SimpleNamespace(accuracy=(row.finding(),), calibration=(sure,)), row.case).startswith(
        CONFIDENT
    )
    opened = Finding(row, "expected failure", sure.sentence)
    assert first_mistake(SimpleNamespace(accuracy=(row.finding(),), calibration=(opened,)), row.case) == ""


def entry(name: str, red: str) -> dict[str, Any]:
    texts = {"rule": "sign", "old": "a", "new": "-a", "statement": f"{name} = a", "becomes": f"{name} = -a"}
    return {"name": name, "module": "toy", "line": 1, "red": red, "by": "fem a", "asked": 1, "kind": MECHANICS, **texts}


RUN = {
    "target": "fem",
    "seed": 1,
    "results": [entry("x", "value: w: its error is 1"), entry("y", ""), {**entry("v", ""), "kind": STATEMENT}],
}


def test_a_score_counts_survivors_as_holes_and_mechanics_alone() -> None:
    assert score(RUN["results"]) == (3, 1, 0, 2)
    assert score(RUN["results"], (MECHANICS,)) == (2, 1, 0, 1)
    said = words(RUN)
    assert said.startswith("fem, seed 1: 1 of 3 red; of mechanics 1 of 2, 1 to 99 %")
    assert said.count("toy:1, sign") == 2


def test_the_bounds_of_a_share_are_those_of_the_binomial_distribution() -> None:
    """At either bound so many red mutants, or so few, have a probability of one fortieth."""
    low, high = interval(18, 20)
    chances = [[math.comb(20, k) * p**k * (1 - p) ** (20 - k) for k in range(21)] for p in (low, high)]
    assert sum(chances[0][18:]) == pytest.approx(0.025, rel=1e-9)
    assert sum(chances[1][:19]) == pytest.approx(0.025, rel=1e-9)
    assert interval(5, 5)[1] == 1.0
    assert interval(0, 5)[0] == 0.0


def test_an_unseen_score_is_written_once(tmp_path: Path) -> None:
    path = tmp_path / "score.json"
    add(RUN, path)
    add({**RUN, "results": []}, path)
    (draw,) = json.loads(path.read_text())["draws"]
    assert (draw["drawn"], draw["holes"], draw["mechanics"]["red"]) == (3, 2, 1)
