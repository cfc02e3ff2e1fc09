"""Known values of ropes: each figure has a judge and a second origin, both recomputed here."""

import pytest

from derivations import ropes
from shellbench.bench import catalog

CASES = sorted(ropes.JUDGES)


def test_every_rope_has_both_forms():
    assert ropes.JUDGES.keys() == ropes.SECOND_FORMS.keys()
    assert {name for name in catalog.case_names() if name.startswith("rope_")} == ropes.JUDGES.keys()


@pytest.mark.parametrize("name", CASES)
def test_the_second_form_is_what_the_file_says(name):
    known, computed = catalog.known_values(name), ropes.SECOND_FORMS[name]()
    assert computed.keys() == {quantity.name for quantity in catalog.named_case(name).quantities}
    for quantity, estimate in computed.items():
        (origin,) = known.of(quantity, "origin")
        assert abs(origin.value - estimate.value) <= max(0.1 * origin.uncertainty, 1e-14 * abs(origin.value))
        assert estimate.uncertainty <= 1.1 * origin.uncertainty


@pytest.mark.parametrize("name", CASES)
def test_both_forms_agree(name):
    judges, seconds = ropes.JUDGES[name](), ropes.SECOND_FORMS[name]()
    for quantity, judge in judges.items():
        second = seconds[quantity]
        assert abs(judge.value - second.value) <= judge.uncertainty + second.uncertainty, quantity


def test_mujoco_swings_nine_links_to_the_same_tip():
    """A third origin, an engine: hinges without damping, the classical Runge-Kutta rule, 0.1 ms."""
    mujoco = pytest.importorskip("mujoco")
    body = ""
    for _ in range(9):
        body = (
            '<body pos="0 0 -0.1"><joint type="hinge" axis="0 1 0" pos="0 0 0.1" armature="0" damping="0"/>'
            '<inertial pos="0 0 0" mass="1" diaginertia="1e-12 1e-12 1e-12"/>' + body + "</body>"
        )
    first = body.replace('pos="0 0 -0.1"', 'pos="0 0 -0.1"', 1)
    text = (
        '<mujoco><compiler boundmass="0" boundinertia="0"/><option integrator="RK4" timestep="1e-4" gravity="0 0 -9.81">'
        '<flag contact="disable"/></option><worldbody>' + first + "</worldbody></mujoco>"
    )
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[0] = -(30 * 3.141592653589793 / 180)  # turns about y from z to x
    for _ in range(10_000):
        mujoco.mj_step(model, data)
    judges = catalog.known_values("rope_nine_links")
    tip = data.xpos[-1]
    mujoco.mj_kinematics(model, data)
    for number, name in ((0, "tip_x"), (2, "tip_z")):
        assert tip[number] == pytest.approx(judges.judge(name, "rigid-links").value, rel=0, abs=1e-8)
