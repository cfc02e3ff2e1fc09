"""Motions and paths through buckling as data: what a case may say of them, and what is refused in one sentence."""

import copy
from dataclasses import dataclass

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.problem import Step
from shellbench.problems.shell.quantities.measure import measure
from shellbench.protocol.schema import read_toml
from tests.families import altered, refusal

CASES = catalog.data_folder("cases")
FALL = read_toml(CASES / "free_fall.toml")
NAPKIN = read_toml(CASES / "napkin_plane.toml")
MOVED = read_toml(CASES / "napkin_moving_corners.toml")
SLEEVE = read_toml(CASES / "sleeve_twist.toml")


def ask(**quantity):
    """Ask for one more quantity."""
    return lambda d: d["quantities"].append({"name": "more", **quantity})


def corner(vector):
    """Move the first support so."""
    return lambda d: d["supports"][0].update(motion={"kind": "translation", "vector": vector})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d["material"].pop("areal_density"), ["material.areal_density", "positive"]),
        (lambda d: d["material"].update(areal_density=0), ["material.areal_density", "positive"]),
        (lambda d: d["material"].update(areal_density=-1), ["areal_density", "greater than or equal to 0"]),
        (lambda d: d.update(theory="kirchhoff-love-linear"), ["[dynamics]", "kirchhoff-love-nonlinear"]),
        (lambda d: d.update(path={"until": 2.0}), ["[path] or [dynamics]", "not both"]),
        (lambda d: d.update(path={"after_buckling": "follow"}), ["[path] or [dynamics]"]),
        (lambda d: d["dynamics"].pop("until"), ["dynamics.until", "missing"]),
        (lambda d: d["dynamics"].update(until=0), ["dynamics.until", "greater than"]),
        (lambda d: d["dynamics"].update(until=float("inf")), ["dynamics.until", "inf"]),
        (lambda d: d["dynamics"].update(until=0.7), ["asked for at 1 s", "ends at 0.7 s"]),
        (lambda d: d["dynamics"].update(states=[1.5]), ["asked for at 1.5 s", "ends at 1 s"]),
        (lambda d: d["dynamics"].update(states=[0]), ["dynamics.states", "greater than 0"]),
        (lambda d: d["dynamics"].update(damping=0.1), ["dynamics.damping", "not known"]),
        (lambda d: d["quantities"][0].update(at=0.0), ["asked for at 0 s", "ends at 1 s"]),
        (lambda d: d["quantities"][0].update(at=-0.5), ["asked for at -0.5 s"]),
        (lambda d: d.update(remove_rigid_motions=["translation_x"]), ["no rigid motion is removed"]),
        (ask(kind="load", at=0.5), ["'more'", "belongs to a [path]"]),
        (ask(kind="limit_point"), ["'more'", "belongs to a [path]"]),
        (ask(kind="critical_point"), ["'more'", "belongs to a [path]"]),
        (ask(kind="position", points=["xi1_min"], direction=[1, 0, 0]), ["'more'", "'xi1_min' is none"]),
        (ask(kind="position", points=["centre"], direction=[0, 0, 0]), ["direction", "zero"]),
        (ask(kind="centre_of_mass", direction=[0, 0, 0]), ["direction", "zero"]),
        (ask(kind="momentum"), ["momentum", "kinetic_energy"]),
        (ask(kind="reaction", support="hand", direction=[0, 0, 1]), ["'more'", "'hand'"]),
        (lambda d: d["supports"].append({"name": "a", "on": ["surface"]}) if "supports" in d else
            d.update(supports=[{"name": "a", "on": ["surface"]}]), ["'a'", "leaves a component free"]),
        (lambda d: d.update(supports=[{"name": "a", "on": ["surface"], "motion": {"kind": "value", "z": "t**2"}}]),
            ["everything is prescribed"]),
        (lambda d: d["loads"][0].update(acceleration=[0, 0, "1/(t-0.5)"]), ["kind 'gravity'", "not finite", "1 s"]),
        (lambda d: d["loads"][0].update(acceleration=[0, 0, "__import__('os')"]), ["kind 'gravity'"]),
        (lambda d: d["loads"][0].update(acceleration=[0, 0, "9**9**9**9"]), ["kind 'gravity'"]),
    ],
)  # fmt: skip
def test_an_impossible_motion_is_one_sentence(change, words):
    message = refusal(FALL, change)
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d["springs"][0].update(stiffness="-1e4*xi1"), ["'pin'", "not finite, or negative"]),
        (lambda d: d["springs"][0].update(stiffness=-1.0), ["'pin'", "not finite, or negative"]),
        (lambda d: d["springs"][0].update(stiffness="1/xi1"), ["'pin'", "not finite, or negative"]),
        (lambda d: d["springs"][0].update(stiffness=float("nan")), ["stiffness"]),
        (lambda d: d["springs"][0].update(stiffness="1e4*t"), ["'pin'", "'t'"]),
        (lambda d: d["springs"][0].update(stiffness="exec('1')"), ["'pin'", "exec"]),
        (lambda d: d["springs"][0].update(stiffness="(" * 200000), ["'pin'", "200000 characters"]),
        (lambda d: d["springs"][0].update(components=[]), ["springs", "at least one component"]),
        (lambda d: d["springs"][0].update(components=["x", "x"]), ["springs", "none twice"]),
        (lambda d: d["springs"][0].pop("name"), ["springs", "name", "missing"]),
        (lambda d: d["springs"].append(d["springs"][0]), ["'pin'", "spring names must differ"]),
    ],
)
def test_an_impossible_spring_is_one_sentence(change, words):
    message = refusal(NAPKIN, change)
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (corner(["t/10", 0, 0]), ["velocity at t = 0", "ramp it smoothly"]),
        (corner(["0.1 + t**2", 0, 0]), ["not zero at t = 0"]),
        (corner(["sqrt(t)", 0, 0]), ["support"]),
        (corner(["t**2/(t-0.35)", 0, 0]), ["not finite"]),
        (corner(["t**2*evil", 0, 0]), ["evil"]),
        (ask(kind="total_energy", at=0.7), ["'more'", "supports at rest", "constant"]),
    ],
)
def test_supports_start_at_rest(change, words):
    message = refusal(MOVED, change)
    for word in words:
        assert word in message


@pytest.mark.parametrize("ramp", ["t**2", "t**3*(10 - 15*t + 6*t**2)", "1 - cos(3*t)", "t*tanh(t)"])
def test_a_smooth_ramp_starts_at_rest(ramp):
    assert altered(MOVED, corner([ramp, 0, 0])).supports[0].motion.vector[0] == ramp


@pytest.mark.parametrize(
    ("load", "admissible"),
    [
        ({"kind": "area", "vector": [0, 0, 1]}, True),
        ({"kind": "area", "vector": [0, "xi1", 1]}, True),
        ({"kind": "pressure", "value": 0.5}, True),
        ({"kind": "area", "vector": [0, 0, "sin(2*t + 1)"]}, False),  # work of a load that changes in time
        ({"kind": "edge", "on": ["xi1_min"], "vector": [0, 0, 1]}, False),  # no load that is spread out
        ({"kind": "pressure", "value": 1, "follows": True}, False),  # no potential
    ],
)
def test_the_total_energy_is_asked_for_only_where_loads_are_constant_and_spread_out(load, admissible):
    def change(data):
        data["loads"].append(load)
        data["quantities"] = [q for q in data["quantities"] if q["kind"] != "total_energy"]

    assert altered(FALL, change).loads[1].kind == load["kind"]

    def asked(data):
        change(data)
        ask(kind="total_energy", at=0.5)(data)

    if admissible:
        assert altered(FALL, asked).quantity("more").unit == "J"
    else:
        assert "'more' needs supports at rest" in refusal(FALL, asked)


def test_loads_may_act_from_the_start_and_change_in_time():
    wind = {"kind": "area", "vector": ["0.3*sin(2*t + 1)", 0, 0]}
    data = copy.deepcopy(FALL)
    data["quantities"] = [q for q in data["quantities"] if q["kind"] != "total_energy"]
    assert len(altered(data | {"loads": [*FALL["loads"], wind]}).loads) == 2


def test_a_case_in_motion_is_kept_at_the_times_asked_for():
    case = altered(FALL, lambda d: d["dynamics"].update(until=1.5, states=[0.25, 0.5]))
    assert case.states == (0.25, 0.5, 1.0, 1.5)
    assert altered(FALL).dynamics.until == 1.0
    assert catalog.named_case("square_plate").dynamics is None


def test_what_moves_needs_no_support_and_what_rests_does():
    assert altered(FALL).supports == ()
    assert "singular" in refusal(FALL, lambda d: (d.pop("dynamics"), d.update(theory="kirchhoff-love-linear",
        loads=[{"kind": "area", "vector": [0, 0, 1]}], quantities=[q | {"at": 1.0} for q in d["quantities"][:1]])))  # fmt: skip


def test_plane_motion_holds_one_component_everywhere():
    case = altered(NAPKIN)
    assert case.held_everywhere == (2,)
    assert not case.prescribed
    assert altered(FALL).held_everywhere == ()
    edge = {"name": "edge", "on": ["xi1_min"], "components": ["y", "z"]}
    assert "z on 'xi1_min' is held on the whole surface already" in refusal(
        NAPKIN, lambda d: d["supports"].append(edge)
    )
    both = altered(NAPKIN, lambda d: d["supports"].append(edge | {"components": ["y"]}))
    assert both.held_everywhere == (2,)


def test_springs_add_up_by_component():
    case = altered(NAPKIN, lambda d: d["springs"].append({"name": "bed", "stiffness": "3*xi2", "components": ["z"]}))
    k = case.spring_stiffness([[0.0, 1.0], [0.1, 1.0], [1.0, 0.5]])
    soft = 2e4 * np.exp(-(0.1**2) / (2 * 0.05**2))
    assert k[0] == pytest.approx([2e4, 2e4, 2e4 + 3])
    assert k[1] == pytest.approx([soft, soft, soft + 3])
    assert k[2] == pytest.approx([0, 0, 1.5], abs=1e-30)
    assert np.all(altered(FALL).spring_stiffness(np.zeros((2, 3, 2))) == np.zeros((2, 3, 3)))


def test_springs_and_plane_motion_belong_to_what_moves():
    for key in ("springs", "supports"):

        def at_rest(data, key=key):
            data.pop("dynamics")
            data["quantities"] = [{"name": "u", "kind": "largest_displacement", "primary": True}]
            data["loads"] = []
            data.update({"supports": [{"name": "rim", "on": ["xi1_min"]}], "springs": []} | {key: NAPKIN[key]})

        words = "springs belong to the linear theory, or to a case" if key == "springs" else "belongs to a case"
        assert f"{words} with [dynamics]" in refusal(NAPKIN, at_rest)


@pytest.mark.parametrize("kind", ["kinetic_energy", "total_energy"])
def test_energies_of_motion_belong_to_what_moves(kind):
    assert "needs a case with [dynamics]" in refusal(SLEEVE, ask(kind=kind, at=0.5))


def test_the_physics_knows_motions_springs_and_buckling():
    for data, changes in (
        (FALL, [lambda d: d["dynamics"].update(until=1.1), lambda d: d["dynamics"].update(states=[0.2])]),
        (NAPKIN, [lambda d: d["springs"][0].update(stiffness=1.0), lambda d: d["springs"][0].update(components=["x"])]),
        (SLEEVE, [lambda d: d["path"].update(after_buckling="stop"), lambda d: d["quantities"][1].update(scale=2)]),
    ):
        base = altered(data).digest()
        for change in changes:
            assert altered(data, change).digest() != base


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d["path"].update(after_buckling="jump"), ["after_buckling", "'jump'", "'follow'"]),
        (lambda d: d["quantities"][1].update(gives="torsion"), ["'critical_torque'", "'torsion'", "torque_50mrad"]),
        (lambda d: d["quantities"][1].update(gives="critical_twist"), ["'critical_torque'", "'critical_twist'"]),
        (lambda d: d.update(theory="kirchhoff-love-linear"), ["'critical_twist'", "non-linear theory"]),
        (lambda d: d.update(path={"control": "displacement", "quantity": "w", "until": 1, "after_buckling": "follow"}),
            ["after_buckling", "control = 'load'"]),
        (lambda d: d["supports"][1].update(motion={"kind": "rotation", "axis": [0, 1, 0], "angle": 1.0}), ["'top_rim'", "acts at t = 0"]),
    ],
)  # fmt: skip
def test_an_impossible_buckling_is_one_sentence(change, words):
    message = refusal(SLEEVE, change)
    for word in words:
        assert word in message


def test_a_critical_point_needs_a_path_by_load():
    roof = read_toml(CASES / "hinged_roof_thick.toml")
    message = refusal(roof, ask(kind="critical_point"))
    assert "'more' needs the non-linear theory and a path with control = 'load'" in message


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("bent_plate", lambda d: d["quantities"][-2].update(at=0.5), "the last state"),
        ("contact_plate", ask(kind="potential_energy"), "without obstacles"),
        ("cantilever_pressure", ask(kind="potential_energy"), "do not follow the shell"),
        ("hinged_roof_thick", ask(kind="potential_energy", at=30), "control = 'load'"),
    ],
)
def test_a_potential_energy_needs_a_state_that_a_history_ends_in(name, change, words):
    assert words in refusal(read_toml(CASES / f"{name}.toml"), change)


@dataclass(frozen=True)
class Told:
    """A solution that tells its history alone."""

    case: object
    history: tuple


def test_the_potential_energy_of_a_linear_shell_is_that_of_the_last_step():
    case = altered(read_toml(CASES / "bent_plate.toml"))
    steps = [Step(k, 0.0, energy, 1, at) for k, (energy, at) in enumerate([(-3.0, 1.0), (-2.0, 1.0), (-9.0, 0.5)])]
    assert measure(Told(case, tuple(steps)), case.quantity("potential_energy")) == -2.0
    with pytest.raises(ValueError, match="no state at 1"):
        measure(Told(case, tuple(steps[2:])), case.quantity("potential_energy"))


def test_a_critical_point_marks_no_state():
    case = altered(SLEEVE)
    assert case.states == (0.05, 0.08, 0.1, 0.15, 0.2, 0.3, 0.5)
