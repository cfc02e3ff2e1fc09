"""The exam examined: rules make what they say and nothing else, draws repeat, and the exam tells a fault from none."""

from __future__ import annotations

import ast
import math
import re
from types import SimpleNamespace
from typing import Any

import pytest

from shellbench.bench.reference import Tolerance
from shellbench.bench.row import Finding
from tests.bench.test_classes import figure
from tests.mutation.draw import Mutant, all_mutants, draw, mutants_of, mutated
from tests.mutation.exam import CONFIDENT, VALUE, finds_a_mistake, first_mistake
from tests.mutation.operators import RULES
from tests.mutation.report import (
    PAGE,
    SCORE,
    UNJUDGED,
    Excuse,
    add,
    excuses,
    hole_groups,
    interval,
    of_kinds,
    page,
    read_runs,
    score,
    scores,
    stale_excuses,
    still_made,
    summary,
    unseen,
)
from tests.mutation.schedule import Question, Reach, _answers, _in_order, _within
from tests.mutation.targets import CHECK, FEM, KINDS, LEFT_OUT, MECHANICS, STATEMENT, TARGETS, file_of, kind_of, parts


def made(rule: str, expression: str) -> set[str]:
    """Return what a rule makes of an expression, or of a statement, in any of its nodes."""
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
    assert kind_of("shellbench.solvers.ndf.signs", "rounding_energy") == STATEMENT
    assert kind_of("shellbench.solvers.ndf.signs", "jitter_share") == CHECK
    assert kind_of("shellbench.solvers.fem.mesh", "TensorMesh.locate") == MECHANICS
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
    "shellbench.solvers.fem.kinematics",
    "tangential = (surface.second - curvature * surface.normal[:, None]) / surface.area[:, None, None]",
    "tangential = surface.second / surface.area[:, None, None]",
)
HALF_THE_BENDING = (
    "shellbench.problems.shell.conditions",
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
    "patience": 60.0,
    "cases": ["fem a"],
    "mutants": 9,
    "reached": 5,
    "not_reached": {"toy": ["3-4"]},
    "results": [entry("x", "value: w: its error is 1"), entry("y", ""), entry("z", ""), entry("w", "crash: KeyError")],
}
GROUPS = {"what no case asks": "none has it", UNJUDGED: "nobody has said", STATEMENT: "how sure"}
SAID = {("toy", "sign", "y = a", "y = -a"): Excuse("equivalent", "its sign does not count")}


def test_a_score_leaves_equivalent_mutants_out() -> None:
    ((name, found),) = summary([RUN], SAID)
    assert name == "fem, seed 1"
    assert found == (4, 2, 1, 1, 0)
    assert found.share == 2 / 3


def test_a_score_by_kind_counts_these_alone() -> None:
    stated = {**entry("v", ""), "kind": STATEMENT}
    mixed = {**RUN, "results": [*RUN["results"], stated]}
    assert score(of_kinds(mixed, (MECHANICS,))["results"], SAID) == (4, 2, 1, 1, 0)
    assert score(of_kinds(mixed, (STATEMENT,))["results"], SAID) == (1, 0, 0, 1, 0)
    assert "| fem, seed 1 | 1 | 0 | 60 | 5 |  |  | 50 % of 4 | 67 % of 3 |" in page([mixed], SAID, GROUPS)


def test_what_was_closed_after_it_was_seen_counts_as_a_hole_of_an_unseen_draw() -> None:
    closed = {**RUN, "unseen": True, "results": [{**RUN["results"][0], "closed": True}, *RUN["results"][1:]]}
    assert unseen(closed, SAID) == (4, 1, 1, 2, 0)
    assert "| **seed 1, mechanics** | 4 | 1 | 1 | 2 | 0 | 33 % |" in page([closed], SAID, GROUPS)
    assert '"red": 1' in scores([closed], SAID)


def test_the_bounds_of_a_share_are_those_of_the_binomial_distribution() -> None:
    """At either bound so many red ones, or so few, come up in a fortieth of all draws."""
    low, high = interval(18, 20)
    chances = [[math.comb(20, k) * p**k * (1 - p) ** (20 - k) for k in range(21)] for p in (low, high)]
    assert sum(chances[0][18:]) == pytest.approx(0.025, rel=1e-9)
    assert sum(chances[1][:19]) == pytest.approx(0.025, rel=1e-9)
    assert interval(5, 5)[1] == 1.0
    assert interval(0, 5)[0] == 0.0


def test_what_is_gone_counts_in_an_unseen_score_alone() -> None:
    gone = {key: Excuse("gone", "deleted") for key in SAID}
    now = score(RUN["results"], gone)
    assert now == (4, 2, 0, 1, 1)
    assert now.share == 2 / 3
    assert unseen(RUN, gone) == (4, 2, 0, 2, 0)


def test_the_page_names_holes_and_excuses() -> None:
    text = page([RUN], SAID, GROUPS)
    holes, equivalent = text.partition("## Holes")[2].split("## Equivalent mutants")
    assert "no verdict yet" in holes
    assert "its sign does not count" in equivalent
    assert "toy 3-4" in text


def test_a_draw_takes_the_place_of_the_same_draw(tmp_path) -> None:
    path = tmp_path / "mutation.json"
    add([RUN], path)
    runs = add([{**RUN, "results": RUN["results"][:1]}, {**RUN, "seed": 2}], path)
    assert [(run["seed"], len(run["results"])) for run in runs] == [(1, 1), (2, 4)]
    assert read_runs(path) == runs


def test_excuses_are_about_mutants_that_are_made() -> None:
    assert not stale_excuses(excuses(), read_runs())


def test_what_is_gone_is_made_no_more() -> None:
    assert not still_made(excuses())
    module = FEM.modules()[0]
    made_still = mutants_of(module, file_of(module).read_text())[0].key
    assert still_made({made_still: Excuse("gone", "it is not")}) == {made_still}


def test_the_page_is_that_of_the_result() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(read_runs(), excuses(), hole_groups())


def test_holes_in_mechanics_have_a_group_and_others_that_of_their_kind() -> None:
    said = {**SAID, ("toy", "sign", "z = a", "z = -a"): Excuse("hole", "rare", "what no case asks")}
    stated = {**RUN, "results": [*RUN["results"], {**entry("v", ""), "kind": STATEMENT}]}
    text = page([stated], said, GROUPS)
    assert "| [what no case asks](#what-no-case-asks) | 1 | none has it |" in text
    assert f"| [{STATEMENT}](#{STATEMENT}) | 1 | how sure |" in text
    assert UNJUDGED not in text


def test_every_group_is_one_that_the_page_explains() -> None:
    groups = hole_groups()
    assert {*LEFT_OUT, STATEMENT, UNJUDGED} <= groups.keys()
    for excuse in excuses().values():
        assert not excuse.group or (excuse.verdict == "hole" and excuse.group in groups)


def test_the_score_of_the_report_is_that_of_the_result() -> None:
    assert SCORE.read_text(encoding="utf-8") == scores(read_runs(), excuses())
