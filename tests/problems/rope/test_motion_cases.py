"""Files of ropes in motion: faults are reported in one sentence; obstacles and prescribed motions."""

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins import registry
from shellbench.errors import InputError
from shellbench.problems.moving import moved
from shellbench.problems.obstacle import Capsule, FormulaBody, HalfSpace, Plate, Sphere, deepest
from shellbench.problems.rope.case import RopeCase
from shellbench.problems.rope.solution import RopeMotion, RopeState

DROP = {key: value for key, value in catalog.named_case("rope_drop").data().items() if key != "name"}
BALL = {key: value for key, value in catalog.named_case("rope_ball").data().items() if key != "name"}
NET = {key: value for key, value in catalog.named_case("rope_of_springs").data().items() if key != "name"}
AROUND = {"kind": "sphere", "centre": [0.0, 0.0, 0.3], "radius": 0.35}
ORIGIN = (0.0, 0.0, 0.0)
OBSTACLES = (
    Sphere(kind="sphere", centre=ORIGIN, radius=0.7),
    HalfSpace(kind="plane", centre=ORIGIN, normal=(1.0, -2.0, 0.5)),
    Plate(kind="plate", centre=ORIGIN, normal=(0.0, 1.0, 1.0), half_thickness=0.2),
    Capsule(kind="capsule", centre=ORIGIN, half_axis=(0.5, 0.0, 0.4), radius=0.3),
)
FORMULAS = ("7*(sqrt(x**2 + y**2 + z**2) - 0.7)", "x - 2*y + z/2", "abs(y + z) - 0.2*sqrt(2)")  # no lengths, but levels
FORMULA = {"kind": "formula", "centre": [0.0, 0.0, -0.5]}


def rope(**changes):
    return DROP | {"rope": DROP["rope"] | changes}


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (rope(masses=[-1.0]), "field 'rope.masses.0': found -1.0, but it must be greater than 0"),
        (rope(link_lengths=[0.0]), "field 'rope.link_lengths.0': found 0.0, but it must be greater than 0"),
        (rope(masses=[1.0, 1.0]), "there are 2 masses, but 1 link_lengths"),
        (rope(angle=3.0), "exactly one of 'angle' and 'start'"),
        (rope(start=[[0.0, 0.0, -1.2]]), "link 1 is 1.2 m long at the start, but it must be above 0 and at most 1"),
        (rope(start=[[0.0, 0.0, 0.0]]), "link 1 is 0 m long at the start"),
        (rope(velocities=[[0.0, 0.0, 0.0]] * 2), "'velocities' has 2 entries"),
        (rope(root=["atan(1e6*(t - 0.4995)) + pi/2", 0.0, 0.0]), "the root jumps by 3.1"),
        (rope(root=["log(t)", 0.0, 0.0]), "is not finite at t = 0"),
        (rope(root=["x", 0.0, 0.0]), "uses the unknown name 'x'"),
        (DROP | {"obstacles": [AROUND]}, "an obstacle is around the root at t = 0"),
        (DROP | {"obstacles": [AROUND | {"centre": [0.0, 0.0, "2 - 2*t"]}]}, "an obstacle is around the root at t = 0.8"),
        (DROP | {"obstacles": [AROUND | {"centre": [0.0, 0.0, -0.2]}]}, "a mass is 0.25 m deep in an obstacle at the start"),
        (DROP | {"obstacles": [AROUND | {"kind": "cube"}]}, "found 'cube'"),
        (DROP | {"obstacles": [FORMULA | {"phi": "z - t"}]}, "uses the unknown name 't'; known are x, y, z, pi"),
        (DROP | {"obstacles": [FORMULA | {"phi": "z.real"}]}, "is not a formula"),
        (DROP | {"obstacles": [FORMULA | {"phi": "1"}]}, "phi = '1' has no gradient, or no value, at x, y, z = 0, 0, 0.4"),
        (DROP | {"obstacles": [FORMULA | {"phi": "log(x - 1)"}]}, "has no gradient, or no value, at x, y, z = 0, 0, 0.4"),
        (DROP | {"obstacles": [FORMULA | {"phi": "0.45 - z"}]}, "an obstacle is around the root at t = 0"),
        (DROP | {"obstacles": [FORMULA | {"phi": "3*z - 1.5"}]}, "a mass is 0.1 m deep in an obstacle at the start"),
        (rope(count=0), "field 'rope.count': found 0, but it must be"),
        (
            rope(count=4, root=[1.0, 0.0, 0.0], start=[[1.0, 0.0, -0.1]])
            | {"obstacles": [{"kind": "sphere", "centre": [0.0, 1.0, -0.15], "radius": 0.1}]},
            "a mass is 0.05 m deep in an obstacle",
        ),
        (
            rope(count=2) | {"quantities": [{"name": "t", "kind": "tension", "link": 3, "primary": True}]},
            "number 3, but 2 is the last",
        ),
        (BALL | {"rope": DROP["rope"]}, "exactly one of the tables 'chain', 'rope', 'particles' and 'net'"),
        (NET | {"theory": "rigid-links"}, "the theory of a net is 'springs', that of all else 'rigid-links'"),
        (NET | {"wind": {"drag": 1.0}}, "has no wind and no obstacles"),
        (NET | {"quantities": [{"name": "t", "kind": "tension", "link": 10, "primary": True}]}, "number 10, but 9 is the last"),
        (rope(lateral={"stiffness": 1.0}), "springs of 'lateral' are between chains, but the count is 1"),
        (BALL | {"quantities": [{"name": "t", "kind": "tension", "link": 1, "primary": True}]}, "loose masses have none"),
        (BALL | {"quantities": [{"name": "t", "kind": "speed", "node": 6, "primary": True}]}, "number 6, but 5 is the last"),
        (BALL | {"quantities": [{"name": "t", "kind": "speed", "node": 5, "primary": True, "at": -1.0}]}, "before the start"),
        (BALL | {"particles": {"start": [[0.0, 0.0, 0.0]], "count": 4}}, "a count needs two places"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_one_sentence(data, words):
    with pytest.raises(InputError) as caught:
        RopeCase.build(data, "wrong", "wrong.toml")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("obstacle", OBSTACLES, ids=lambda o: o.kind)
def test_gradients_are_those_of_the_distances(obstacle):
    places = np.random.default_rng(1).normal(size=(200, 3))
    gradient, step = obstacle.gradient(places), 1e-6
    assert np.linalg.norm(gradient, axis=1) == pytest.approx(np.ones(200), abs=1e-12)
    for axis in np.eye(3):
        difference = (obstacle.distance(places + step * axis) - obstacle.distance(places - step * axis)) / (2 * step)
        assert difference == pytest.approx(gradient @ axis, abs=1e-8)


@pytest.mark.parametrize("obstacle", OBSTACLES, ids=lambda o: o.kind)
def test_the_distance_leads_to_the_surface(obstacle):
    """From outside a step of phi against the gradient ends where phi is zero."""
    places = 3 * np.random.default_rng(2).normal(size=(200, 3))
    outside = places[obstacle.distance(places) > 0]
    assert len(outside) > 20
    landed = outside - obstacle.distance(outside)[:, None] * obstacle.gradient(outside)
    assert np.abs(obstacle.distance(landed)).max() < 1e-12


@pytest.mark.parametrize(("formula", "body"), [*zip(FORMULAS, OBSTACLES[:3], strict=True)])
def test_formulas_are_the_bodies_that_they_describe(formula, body):
    places = np.random.default_rng(4).normal(size=(100, 3))
    described = FormulaBody(kind="formula", phi=formula)
    assert described.distance(places) == pytest.approx(body.distance(places), abs=1e-14)
    assert described.gradient(places) == pytest.approx(body.gradient(places), abs=1e-14)


def test_what_is_no_distance_is_one_to_first_order():
    """(r^2 - R^2) over its slope 2 r is d - d^2/(2 r), with d = r - R."""
    places = np.random.default_rng(5).normal(size=(100, 3))
    radii = np.linalg.norm(places, axis=1)
    found = FormulaBody(kind="formula", phi="x**2 + y**2 + z**2 - 0.49").distance(places)
    assert found == pytest.approx(radii - 0.7 - (radii - 0.7) ** 2 / (2 * radii), abs=1e-14)


def test_what_moves_has_the_velocity_of_its_formula():
    place, velocity, acceleration = moved(("sin(2*t)", 1.0, "t**3"), 0.4)
    assert place == pytest.approx([np.sin(0.8), 1.0, 0.064])
    assert velocity == pytest.approx([2 * np.cos(0.8), 0.0, 0.48])
    assert acceleration == pytest.approx([-4 * np.sin(0.8), 0.0, 2.4])


def test_depth_is_the_deepest_of_all():
    ball = Sphere(kind="sphere", centre=("t", 0.0, 0.0), radius=1.0)
    places = np.array([[1.5, 0.0, 0.0], [1.9, 0.0, 0.0], [4.0, 0.0, 0.0]])
    assert deepest((ball,), places, 1.0) == pytest.approx(0.5)
    assert deepest((ball,), places, 10.0) == 0


def test_quantities_measure_what_they_say():
    case = catalog.named_case("rope_jerk")
    random = np.random.default_rng(4)
    nodes, velocities = random.normal(size=(6, 3)), random.normal(size=(6, 3))
    motion = RopeMotion(case, (RopeState(nodes, velocities, np.zeros(5)),))
    masses = np.array(case.rope.masses)
    values = {q.name: q.measure(motion) for q in case.quantities}
    assert values["kinetic_energy"] == pytest.approx(
        sum(m * v @ v / 2 for m, v in zip(masses, velocities[1:], strict=True))
    )
    assert values["momentum_z"] == pytest.approx(masses @ velocities[1:, 2])
    assert values["tip_speed"] == pytest.approx(np.linalg.norm(velocities[-1]))


@pytest.mark.parametrize("solver", ["rope-exact", "rope-printed", "rope-xpbd"])
def test_each_chain_is_the_first_one_turned(solver):
    data = {key: value for key, value in catalog.named_case("rope_unequal_links").data().items() if key != "name"}
    data["quantities"] = [
        {"name": "x", "kind": "position", "node": 14, "axis": "x", "at": 0.1, "primary": True},
        {"name": "energy", "kind": "energy", "at": 0.1},
        {"name": "push", "kind": "momentum", "axis": "x", "at": 0.1},
    ]
    many = RopeCase.build(data | {"rope": data["rope"] | {"count": 3}}, "many", "test")
    one = RopeCase.build(data | {"quantities": [{**q, "node": 4} if "node" in q else q for q in data["quantities"]]},
                         "one", "test")  # fmt: skip
    solve = registry.load_solver(registry.find_solver(solver)).solve
    several, alone = (solve(case, {"steps_per_second": 60.0}).state(0.1) for case in (many, one))
    for number, angle in enumerate((0.0, 2 * np.pi / 3, 4 * np.pi / 3)):
        x, y, z = alone.nodes.T
        turned = np.stack([x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle), z], axis=1)
        assert several.nodes[5 * number : 5 * number + 5] == pytest.approx(turned, abs=1e-11)
        assert several.tensions[4 * number : 4 * number + 4] == pytest.approx(alone.tensions, rel=1e-8)
    found = {q.name: q.measure(RopeMotion(many, (several,))) for q in many.quantities}
    single = {q.name: q.measure(RopeMotion(one, (alone,))) for q in one.quantities}
    assert found["energy"] == pytest.approx(3 * single["energy"], rel=1e-10)
    assert found["push"] == pytest.approx(0.0, abs=1e-9)
    assert abs(single["push"]) > 0.1
    assert found["x"] == pytest.approx(several.nodes[14, 0])


def test_a_motion_survives_its_file(tmp_path):
    case = catalog.named_case("rope_drop")
    state = RopeState(np.eye(2, 3), np.ones((2, 3)), np.array([3.0]), 0.1, 0.2)
    motion = RopeMotion(case, (state, state))
    again = RopeMotion.load(motion.save(tmp_path / "motion"))
    assert again.case.digest() == case.digest()
    for name, array in motion.stacked().items():
        assert np.array_equal(again.stacked()[name], array)
    (tmp_path / "none.npz").write_bytes(b"nothing")
    with pytest.raises(InputError, match="holds no motion of a rope"):
        RopeMotion.load(tmp_path / "none.npz")


def test_a_state_that_was_not_reached_is_refused():
    motion = RopeMotion(catalog.named_case("rope_drop"), ())
    with pytest.raises(ValueError, match="ended before t = 1"):
        motion.state(1.0)
