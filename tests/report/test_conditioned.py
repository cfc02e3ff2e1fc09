"""Section "Conditioned fields": errors over materials, and from how many answers on a field has paid."""

from types import SimpleNamespace

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.row import Row
from shellbench.report.studies import conditioned
from shellbench.report.studies.conditioned import Conditioned, breakeven, rival

CASE = "conditioned_plate"


def solution(name, worst, before, each, uncertainty=1e-9):
    row = Row(
        case=CASE, case_title=CASE, suite="conditioned", solver=name, seed=0, settings={}, quantity="value_00", primary=True,
        at=1.0, status="ok", value=1.0, uncertainty=uncertainty, run_id=name,
    )  # fmt: skip
    return Conditioned(name, [row], {"value_00": worst, "value_01": worst / 3}, {"by": 0.1}, before, each)


FIELD = solution("field", 1e-5, 10.0, 0.0)
RIVALS = [FIELD, solution("coarse", 1e-3, 0, 0.1), solution("good", 1e-6, 0, 0.5, None), solution("sure", 1e-8, 0, 2.0)]


def test_a_field_has_paid_when_its_building_is_saved():
    assert breakeven(10.0, 0.0, 0.3) == 34
    assert breakeven(10.0, 0.5, 0.5) is None
    assert rival(FIELD, RIVALS).name == "good"  # what is worse is no rival, nor what was built beforehand
    assert rival(FIELD, RIVALS, sure=True).name == "sure"
    assert rival(solution("better", 1e-9, 10.0, 0.0), RIVALS) is None


def test_the_table_tells_both_breakevens():
    lines = {line["solution"]: line for line in conditioned.table({CASE: RIVALS}).data.to_dict("records")}
    field = lines["field"]
    assert (field["breakeven"], field["sure"], field["against"]) == (20, 5, "good")
    assert field["proven"] == 28  # two solves of two seconds more
    assert field["mean"] == pytest.approx(2e-5 / 3)


def test_only_problems_of_many_materials_are_shown():
    assert conditioned.section(SimpleNamespace(rows=[], records={})) is None
    assert catalog.find_suite("conditioned").remarks
