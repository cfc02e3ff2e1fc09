"""Both recipes at finite strain, end to end: known elastic curves, limit points, and what fails how."""

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from shellbench.bench.catalogue.catalog import known_values, named_case, tolerance
from shellbench.errors import InputError, SolveFailure
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.problems.shell.question.path import Path
from shellbench.solvers.ndf.linear.declines import why_not_followed
from shellbench.solvers.ndf.ritz_solver import RitzSettings, RitzSolver
from shellbench.solvers.ndf.trainer_solver import NdfSolver, TrainerSettings
from tests.alike import REPEATED, alike
from tests.solvers.ndf.shells import FREE, inner_points, shell, support

SOLVER = RitzSolver()
NONLINEAR = "kirchhoff-love-nonlinear"
WALL = support("wall", "xi1_min", clamped=True)
STRIP = {"neurons": 80, "scale": 2.0, "panels": (8, 2)}
THICKNESS = 0.02
UP = {"name": "up", "kind": "displacement", "points": ["tip"], "direction": [0, 0, 1], "primary": True}
SHEAR = {"kind": "edge", "on": ["xi1_max"], "vector": [0, 0, "4*t"]}


def solve(case, **choices):
    return SOLVER.solve(case, RitzSettings(**choices))


def strip(load, width=0.5, thickness=THICKNESS, **data):
    """A strip of length and bending stiffness 1, clamped at xi1 = 0, that bends in one plane."""
    return shell(
        {"kind": "plane", "xi1": [0, 1], "xi2": [0, width]},
        {"youngs_modulus": 12 / thickness**3, "poissons_ratio": 0.0, "thickness": thickness},
        **{"theory": NONLINEAR, "points": {"tip": [1, width / 2]}, "supports": [WALL], "loads": [load],
           "quantities": [UP], **data},
    )  # fmt: skip


def elastica(force, stretching):
    """Tip displacement (along, up) of a clamped strip of length and bending stiffness 1 under a dead shear force.

    With the stretch l and the angle theta, eps = (l^2 - 1) / 2 and kappa = l theta' (the change of the curvature form,
    not of the angle per length), so that M = l^2 theta', M' = -F l cos theta, and l follows from
    D l (l^2 - 1) / 2 + M^2 / l^3 = F sin theta.
    """

    def stretch(theta, moment):
        length = np.ones_like(theta)
        for _ in range(20):
            rest = stretching * length * (length**2 - 1) / 2 + moment**2 / length**3 - force * np.sin(theta)
            length = length - rest / (stretching * (3 * length**2 - 1) / 2 - 3 * moment**2 / length**4)
        return length

    def rates(_, y):
        theta, moment = y[:2]
        length = stretch(theta, moment)
        return np.stack([
            moment / length**2, -force * length * np.cos(theta), length * np.cos(theta) - 1, length * np.sin(theta)
        ])  # fmt: skip

    s = np.linspace(0, 1, 41)
    start = np.stack([s, force * (1 - s) / 2, 0 * s, s**2 / 2])
    solved = solve_bvp(rates, lambda a, b: np.array([a[0], b[1], a[2], a[3]]), s, start, tol=1e-9, max_nodes=20000)
    assert solved.success
    return solved.y[2, -1], solved.y[3, -1]


@pytest.fixture(scope="module")
def sheared():
    return solve(strip(SHEAR, path={"states": [0.25, 0.5]}), **STRIP)


@pytest.mark.parametrize("t", [0.25, 0.5, 1.0])
def test_a_cantilever_under_shear_is_an_elastica(sheared, t):
    stretching = sheared.case.material.membrane_stiffness
    tip = sheared.displacement(np.array([1.0, 0.25]), at=t)
    np.testing.assert_allclose(tip[[0, 2]], elastica(4 * t, stretching), rtol=3e-6)
    assert abs(tip[1]) < 1e-7
    inextensible = elastica(4 * t, 1e9)
    np.testing.assert_allclose(tip[[0, 2]], inextensible, rtol=6e-4)


def test_the_elastica_is_the_published_one():
    """u = 0.32894 L and w = 0.66996 L at F L^2 / B = 4 (Mattiasson 1981, table I), inextensible."""
    np.testing.assert_allclose(elastica(4.0, 1e9), (-0.32894, 0.66996), atol=6e-6)


@pytest.fixture(scope="module")
def coiled():
    middle = support("middle", "xi2_min", symmetry="y")
    load = {"kind": "moment", "on": ["xi1_max"], "axis": [0, -1, 0], "value": "2*pi*t"}
    case = strip(load, supports=[WALL, middle], points={"tip": [1, 0]}, path={"states": [0.25, 0.5]})
    return solve(case, **STRIP)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("t", [0.25, 0.5, 1.0])
def test_a_cantilever_under_a_moment_is_a_circle(coiled, t):
    """M = l^2 k with l^2 = 1 - 2 k^2 / D: a full circle, a little more than full because bending shortens it."""
    stretching = coiled.case.material.membrane_stiffness
    k = min(np.roots([-2 / stretching, 0, 1, -2 * np.pi * t]), key=lambda root: abs(root - 2 * np.pi * t)).real
    length = np.sqrt(1 - 2 * k**2 / stretching)
    s = np.linspace(0, 1, 9)
    u = coiled.displacement(np.stack([s, np.full(9, 0.2)], axis=-1), at=t)
    expected = np.stack([length / k * np.sin(k * s) - s, 0 * s, length / k * (1 - np.cos(k * s))], axis=-1)
    np.testing.assert_allclose(u, expected, atol=2e-5)
    membrane, bending = coiled.energies(at=t)
    assert bending == pytest.approx(0.5 * (length * k) ** 2 / 2, rel=2e-5)  # on a width of a half
    assert membrane == pytest.approx(0.5 * stretching / 2 * (k**2 / stretching) ** 2, rel=2e-3)


def test_a_moment_works_on_the_angle_that_it_turns_by(coiled):
    """Potential energy = strain energy less M theta, theta = k at the tip, by the recorded energy of the last state."""
    stretching = coiled.case.material.membrane_stiffness
    k = min(np.roots([-2 / stretching, 0, 1, -2 * np.pi]), key=lambda root: abs(root - 2 * np.pi)).real
    assert coiled.history[-1].energy == pytest.approx(sum(coiled.energies()) - 0.5 * 2 * np.pi * k, rel=1e-5)


def test_rolled_plate_has_the_energy_of_a_circle():
    """B/2 k^2 per area, k the angle per length; by the published strain that times the mean of (cos + sin^2)^2."""
    case = named_case("rolled_plate")
    exact, published = solve(case), solve(case, strain="published")
    b = case.material.bending_stiffness
    for t in case.states:
        theta = np.pi * t
        membrane, bending = exact.energies(at=t)
        assert bending == pytest.approx(0.5 * b * theta**2 / 2, rel=1e-12)
        assert membrane < 1e-12 * bending
        s, squared = np.sin(theta), theta / 2 + np.sin(2 * theta) / 4
        fourth = 3 * theta / 8 + np.sin(2 * theta) / 4 + np.sin(4 * theta) / 32
        share = (theta + 2 * s - squared - 2 * (s - s**3 / 3) + fourth) / theta
        assert published.energies(at=t)[1] == pytest.approx(share * bending, rel=1e-9)
    assert exact.parameters == 0


def test_a_rigid_rotation_costs_nothing():
    case = named_case("rigid_rotation")
    scale = case.material.membrane_stiffness
    exact = solve(case)
    for t in case.states:
        assert sum(exact.energies(at=t)) < 1e-20 * scale
    assert sum(solve(case, strain="published").energies()) > 1e-8 * scale
    assert sum(solve(case, strain="linear").energies()) > 1e-3 * scale


def test_a_prescribed_surface_carries_its_loads():
    """The mould balances them on the deformed shell: force and moment of the weight of a plate moved by 90 degrees."""
    turn = {"kind": "rotation", "axis": [0, 1, 0], "centre": [0, 0, 0], "angle": "-90*t"}
    case = shell(
        "plane", theory=NONLINEAR, supports=[support("mould", "surface", motion=turn)],
        loads=[{"kind": "gravity", "acceleration": ["-10*t", 0, 0]}],
    )  # fmt: skip
    solution = solve(case)
    weight = 10 * 2.0 * 4  # acceleration, mass per area, area
    force, moment = solution.reaction("mould")
    np.testing.assert_allclose(force, [weight, 0, 0], atol=1e-9)
    np.testing.assert_allclose(moment, np.cross([0, 0, 1], [weight, 0, 0]), atol=1e-9)  # its middle is at z = 1
    displacement = np.array([[-1.0, 0, 1]])  # of the middle, 1 m from the axis
    np.testing.assert_allclose(solution.displacement(np.array([[1.0, 0.0]])), displacement, atol=1e-12)
    assert solution.history[-1].energy == pytest.approx(-weight * 1.0, rel=1e-9)  # the middle fell by 1 m


def test_a_prescribed_surface_in_linear_theory_is_strained_linearly():
    """u_x = 0.3 xi1 and nu = 0: E h / 2 times 0.3^2 per area, without the square that finite strain adds."""
    mould = support("mould", "surface", motion={"kind": "value", "x": "0.3*xi1"})
    material = {"poissons_ratio": 0.0}
    stretching = 1e7 * 0.05
    linear = solve(shell("plane", material, supports=[mould]))
    assert linear.energies()[0] == pytest.approx(stretching / 2 * 0.3**2 * 4, rel=1e-12)
    moved = support("mould", "surface", motion={"kind": "value", "x": "0.3*t*xi1"})
    exact = solve(shell("plane", material, theory=NONLINEAR, supports=[moved]))
    assert exact.energies()[0] == pytest.approx(stretching / 2 * ((1.3**2 - 1) / 2) ** 2 * 4, rel=1e-12)


def test_a_moment_in_linear_theory_bends_in_proportion():
    """w = M L^2 / (2 B), at any size: the angle is its first variation."""
    load = {"kind": "moment", "on": ["xi1_max"], "axis": [0, -1, 0], "value": 3.0}
    solution = solve(strip(load, theory="kirchhoff-love-linear"), **{**STRIP, "panels": (5, 2)})
    tip = solution.displacement(np.array([1.0, 0.25]))
    np.testing.assert_allclose(tip, [0, 0, 1.5], atol=1e-6)
    np.testing.assert_allclose(solution.reaction("wall")[1], [0, 1.5, 0], atol=1e-5)


def test_small_loads_give_the_linear_answer():
    """The linear answer has features toward edges that a path has not: both are wide enough for the same plate."""
    base = named_case("square_plate_nonlinear")
    small = base.model_copy(update={"path": Path(until=1e-6), "quantities": ()})
    linear = base.model_copy(update={"theory": "kirchhoff-love-linear", "path": Path(), "quantities": ()})
    points = inner_points(base)
    first, second = (solve(c, neurons=160).displacement(points) for c in (small, linear))
    np.testing.assert_allclose(1e6 * first, second, rtol=0, atol=1e-5 * np.abs(second).max())


def test_the_linear_strain_at_large_loads_is_linear():
    """The ablation strain = "linear" keeps the path's states in proportion."""
    solution = solve(named_case("square_plate_nonlinear"), neurons=30, strain="linear")
    points = inner_points(solution.case)
    np.testing.assert_allclose(
        solution.displacement(points, at=0.25) * 4, solution.displacement(points), rtol=1e-9, atol=1e-12
    )


@pytest.mark.long
def test_displacement_control_passes_the_limit_points_of_a_thick_roof():
    """Against this suite's own splines (references/hinged_roof_thick.toml), by fifty neurons."""
    solution = solve(named_case("hinged_roof_thick"), neurons=50)
    values = measure_all(solution)
    assert values["limit_load"] == pytest.approx(2225.4, rel=0.02)
    assert values["valley_load"] == pytest.approx(510.8, rel=0.02)
    assert values["limit_deflection"] == pytest.approx(10.72, rel=0.05)
    path = [s for s in solution.history if s.phase == "path"]
    assert [s.quantities["deflection"] for s in path] == sorted(s.quantities["deflection"] for s in path)
    for mark in solution.case.states:
        at = solution.displacement(np.array([np.pi / 2, 0.0]), at=mark)
        assert -at[2] == pytest.approx(mark, rel=1e-9)


@pytest.mark.long
def test_a_roof_under_load_control_fails_at_its_limit_load_and_says_where():
    base = named_case("hinged_roof_thick")
    ridge = next(q for q in base.quantities if q.name == "deflection")
    asked = ridge.model_copy(update={"at": 4.0, "primary": True})  # beyond the limit load
    case = base.model_copy(update={"path": Path(until=4.0, states=(1.0,)), "quantities": (asked,)})
    with pytest.raises(SolveFailure, match="last converged load factor is") as caught:
        solve(case, neurons=30, panels=(3, 3), largest_gap=1.0)
    text, partial = str(caught.value), caught.value.partial
    assert "\n" not in text
    reached = float(text.rsplit(" ", 1)[1])
    assert 2.15 < reached < 2.4  # the whole roof's limit load is 2225 N, a factor of 2.225
    deflections = [-partial.displacement(np.array([np.pi / 2, 0.0]), at=t)[2] for t in (1.0, partial.marks[-1])]
    assert 0 < deflections[0] < deflections[1] < 12
    assert partial.marks[-1] == pytest.approx(reached, rel=1e-5)
    assert partial.history[-1].at == pytest.approx(reached, rel=1e-5)
    assert sum(partial.energies()) > sum(partial.energies(at=1.0)) > 0
    with pytest.raises(InputError, match="not at 4"):
        partial.displacement(np.array([np.pi / 2, 0.0]), at=4.0)


def test_a_field_that_exploits_its_quadrature_is_a_failure_that_names_the_gap():
    with pytest.raises(SolveFailure, match="exploits its quadrature") as caught:
        solve(named_case("square_plate_nonlinear"), neurons=40, panels=(2, 2), order=4)
    text, partial = str(caught.value), caught.value.partial
    gap = partial.diagnostics["energy_gap"]
    assert gap > 5e-4
    assert f"differs by {gap:.2g}, more than the 0.0005 allowed" in text
    assert "\n" not in text
    assert partial.displacement(np.array([10.0, 20.0]), at=0.25).shape == (3,)


@pytest.mark.parametrize(("solver", "settings"), [(SOLVER, RitzSettings), (NdfSolver(), TrainerSettings)])
def test_a_finite_strain_does_not_fit_the_linear_theory(solver, settings):
    with pytest.raises(InputError, match='linear theory: setting strain = "exact" does not fit') as caught:
        solver.solve(named_case("square_plate"), settings(strain="exact"))
    assert "\n" not in str(caught.value)


def test_what_a_field_cannot_follow_is_declined():
    bent = {"kind": "value", "z": "0.1*t*xi2"}
    moved = strip(SHEAR, supports=[support("jaw", "xi1_min", clamped=True, motion=bent)])
    with pytest.raises(InputError, match="can't take test: it can't tell how far the clamped support 'jaw'"):
        solve(moved)
    turn = {"kind": "rotation", "axis": [0, 1, 0], "angle": "90*t"}
    jaw = support("jaw", "xi1_min", clamped=True, motion=turn)
    assert why_not_followed(strip(SHEAR, supports=[jaw])) is None
    assert "where supported edges meet" in why_not_followed(strip(SHEAR, supports=[jaw, support("side", "xi2_min")]))
    free = strip({"kind": "area", "vector": [0, 0, "t*(xi1 - 0.5)"]}, supports=[], remove_rigid_motions=FREE)
    assert "needs supports against rotation" in why_not_followed(free)
    shifted = support("jaw", "xi1_min", clamped=True, motion={"kind": "translation", "vector": [0, 0, "t"]})
    assert why_not_followed(strip(SHEAR, supports=[shifted])) is None
    controlled = {"control": "displacement", "quantity": "up", "until": 0.1}
    led = strip(SHEAR, supports=[shifted], path=controlled, quantities=[{**UP, "at": 0.1}])
    with pytest.raises(InputError, match="can't move support 'jaw' on a path with control"):
        solve(led)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("control", ["displacement", "arc_length"])
@pytest.mark.parametrize("loads", [[SHEAR], []])
def test_a_displacement_that_the_loads_do_not_cause_is_a_failure(control, loads):
    """A point of the wall never moves, and nothing moves that nothing loads."""
    foot = {"points": {"tip": [0 if loads else 1, 0.25]}}
    path = {"control": control, "quantity": "up", "until": 0.1}
    case = strip(SHEAR, **{"loads": loads, "path": path, "quantities": [{**UP, "at": 0.1}], **foot})
    with pytest.raises(SolveFailure, match="no state beyond rest converged") as caught:
        solve(case, neurons=16)
    assert "\n" not in str(caught.value)


def test_a_moved_clamp_carries_an_unloaded_strip_along():
    shifted = support("jaw", "xi1_min", clamped=True, motion={"kind": "translation", "vector": ["t", 0, "2*t"]})
    solution = solve(strip({"kind": "gravity", "acceleration": [0, 0, 0]}, supports=[shifted]), neurons=20)
    points = inner_points(solution.case)
    np.testing.assert_allclose(solution.displacement(points), np.broadcast_to([1, 0, 2], (20, 3)), atol=1e-9)
    assert sum(solution.energies()) < 1e-15


@pytest.mark.long
def test_rungs_are_climbed_until_the_energy_stands_still():
    solution = solve(named_case("square_plate_nonlinear"))
    rungs = [s for s in solution.history if s.phase == "solve"]
    assert solution.diagnostics["settled"]
    assert solution.diagnostics["energy_change"] <= 2e-4
    assert len(rungs) >= 2
    assert [s.unknowns for s in rungs] == sorted(s.unknowns for s in rungs)
    assert rungs[-1].energy <= rungs[0].energy * (1 - 1e-9 * np.sign(rungs[0].energy))
    factors = [s.at for s in solution.history if s.phase == "path"]
    assert factors == sorted(factors)
    assert set(solution.case.states) <= set(factors)
    assert [s.iteration for s in solution.history] == list(range(len(solution.history)))


@pytest.mark.long
def test_a_deep_network_agrees_with_random_features():
    case = named_case("square_plate_nonlinear")
    reference = solve(case, neurons=120)
    deep = NdfSolver().solve(case, TrainerSettings(widths=(40,), iterations=1))
    for name in ("centre_deflection", "strain_energy", "membrane_energy"):
        assert measure_all(deep)[name] == pytest.approx(measure_all(reference)[name], rel=1e-3)
    assert deep.diagnostics["hidden_layers"] == "trained"
    assert deep.parameters == 3 * deep.diagnostics["features"] + deep.states[-1].field.features.network.parameters


def test_what_is_not_trained_is_not_counted_as_trained():
    case = named_case("square_plate_nonlinear")
    drawn = NdfSolver().solve(case, TrainerSettings(widths=(40,), iterations=0))
    assert drawn.diagnostics["hidden_layers"] == "as drawn"
    assert drawn.parameters == 3 * drawn.diagnostics["features"]


LONG_CONTROLS = [pytest.param(control, marks=pytest.mark.long) for control in ("displacement", "arc_length")]


@pytest.mark.parametrize("control", ["load", *LONG_CONTROLS])
def test_consistent_units_give_the_same_path(control):
    """Metres to millimetres and newtons to kilonewtons: the same states, by every control."""

    def roof(length, force):
        load = 60.0 * force / length**2
        path = {"control": control, "quantity": "down", "until": 0.1 * length}
        down = {"name": "down", "kind": "displacement", "points": ["top"], "direction": [0, -1, 0], "primary": True}
        return shell(
            {"kind": "cylinder", "axis": "z", "radius": 3 * length, "xi1": [50, 130], "xi2": [0, 5 * length]},
            {"youngs_modulus": 1e7 * force / length**2, "thickness": 0.05 * length}, theory=NONLINEAR,
            points={"top": [90, 2.5 * length]}, loads=[{"kind": "area", "vector": [0, f"-{load}*t", 0]}],
            supports=[support("ends", "xi2_min", "xi2_max", components=["x", "y"])],
            remove_rigid_motions=FREE[2:3], **({} if control == "load" else {"path": path}),
            quantities=[down if control == "load" else {**down, "at": 0.1 * length}],
        )  # fmt: skip

    first, second = (solve(roof(*units), neurons=24, panels=(5, 5), largest_gap=1.0) for units in ((1, 1), (1e3, 1e-3)))
    points = inner_points(first.case)
    u, v = first.displacement(points), second.displacement(points * [1, 1000])
    np.testing.assert_allclose(v, 1000 * u, rtol=0, atol=1e-4 * np.abs(v).max())
    assert first.history[-1].at == pytest.approx(second.history[-1].at, rel=1e-5)
    np.testing.assert_allclose(second.energies(), np.array(first.energies()), rtol=1e-4)


@pytest.mark.long
def test_seeds_are_reproducible_and_differ():
    case = named_case("square_plate_nonlinear")
    first, again, other = (solve(case, neurons=20, seed=seed) for seed in (0, 0, 1))
    points = inner_points(case)
    one, same, new = (solution.displacement(points, at=0.5) for solution in (first, again, other))
    alike(same, one, REPEATED)
    assert np.abs(new - one).max() > 10 * REPEATED * np.abs(one).max()


@pytest.mark.long
@pytest.mark.parametrize("name", ["cantilever_shear", "cantilever_moment", "hinged_roof_thick"])
def test_gated_quantities_are_within_their_tolerance(name):
    case = named_case(name)
    solution = solve(case, seed=1)
    for quantity in case.quantities:
        if allowed := tolerance(name, quantity.name, SOLVER.name):
            known = known_values(name).judge(quantity.name, case.theory).value
            assert measure_all(solution)[quantity.name] == pytest.approx(known, rel=allowed.relative)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("at", [pytest.param(1.0, marks=pytest.mark.long), 0.0, -1.0])
def test_a_point_support_is_moved_from_the_start_in_linear_theory(at):
    """In linear theory a prescribed displacement need not vanish at t = 0, and any t may be asked for."""
    moment = {"kind": "moment", "on": ["xi1_max"], "axis": [0, 1, 0], "value": "0.1*t"}
    pin = support("pin", "xi1_max,xi2_max", components=["z"], motion={"kind": "translation", "vector": [0, 0, 0.1]})
    case = strip(moment, theory="kirchhoff-love-linear", supports=[WALL, pin], quantities=[UP | {"at": at}])
    solution = solve(case, neurons=40)
    assert solution.displacement(np.array([1.0, 0.5]), at=at)[2] == pytest.approx(0.1, rel=1e-8)
    force, _ = solution.reaction("pin", at=at)
    assert abs(force[2]) > 0.01


def test_the_history_tells_what_the_solution_measures_where_supports_move():
    moved = WALL | {"motion": {"kind": "translation", "vector": [0, 0, "0.5*t"]}}
    solution = solve(strip(SHEAR, supports=[moved]), **STRIP)
    assert solution.history[-1].quantities["up"] == pytest.approx(measure_all(solution)["up"], rel=1e-9)
    assert measure_all(solution)["up"] > 0.5
