"""Contact at rest and finite strain by a Ritz field: faults of its mechanics turn the gate red."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from shellbench.bench.catalogue import catalog
from shellbench.errors import SolveFailure
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.problems.shell.question.contact import gaps
from shellbench.solvers.ndf.field.build import usual_resolution
from shellbench.solvers.ndf.field.quadrature import RuleSpec
from shellbench.solvers.ndf.linear.contact import ALONG_SLENDER, draw_field
from shellbench.solvers.ndf.linear.contact_forces import SMOOTH, contact_points, least_forces, smoothest_forces
from shellbench.solvers.ndf.linear.ritz_field import field_spec
from shellbench.solvers.ndf.path import contact_at_finite_strain as touching
from shellbench.solvers.ndf.path.continuation import load_steps
from shellbench.solvers.ndf.path.equilibrium import PathProblem
from shellbench.solvers.ndf.ritz_solver import RitzSettings, RitzSolver
from shellbench.solvers.stepping.control import PathEndsError
from tests.injecting import shares_of_tolerances
from tests.test_contact_ndf_faults import glued as pulling_obstacles

STRIP, DRAPE = "contact_heavy_strip", "contact_drape"
TURN = {"kind": "rotation", "axis": [0, 1, 0], "angle": "10*t"}
TURNED = {"name": "wall", "on": ["xi1_min"], "clamped": True, "motion": TURN}


def one_answer(name):
    """Solve a case on one resolution alone; of the strip, with features that jump where contact begins."""
    case, settings = catalog.named_case(name), RitzSettings()
    level, spec = usual_resolution(case), field_spec(case, settings)
    if name == STRIP:
        rules = RuleSpec((12, 3), 6), RuleSpec((16, 4), 7)
        level = replace(level, neurons=150, along=ALONG_SLENDER, rule=rules[0], fine=rules[1])
        spec = spec.model_copy(update={"creases": ((0, 0.797, -1),)})
    with torch.no_grad():
        return touching.answer(case, spec, settings, level, 0, 1.0).solution


def pulled(patch):
    """Multipliers of the wrong sign."""
    forces = touching.least_forces
    patch.setattr(touching, "least_forces", lambda *a: -forces(*a))


def turned_normal(patch):
    """Normals of the wrong side."""
    patch.setattr(touching, "gaps", lambda *a: (gaps(*a)[0], -gaps(*a)[1]))


def at_rest(patch):
    """Gaps of the shell at rest instead of the displaced one."""
    patch.setattr(touching, "gaps", lambda case, points, u, t: gaps(case, points, 0 * u, t))


def glued(patch):
    """Obstacles that pull as well."""
    pulling_obstacles(patch, touching)


def halved(patch):
    """Report half of the forces."""
    smooth = touching.smoothest_forces
    patch.setattr(touching, "smoothest_forces", lambda *a: smooth(*a) / 2)


@pytest.mark.long
@pytest.mark.parametrize("name", [STRIP, DRAPE])
def test_one_answer_is_green_and_kept_in_its_file(name, tmp_path):
    answer = one_answer(name)
    assert max(shares_of_tolerances(answer, "ndf-ritz").values()) < 1
    again = RitzSolver().load(answer.save(tmp_path / "answer"))
    assert measure_all(again) == pytest.approx(measure_all(answer), rel=1e-9, abs=1e-12)


@pytest.mark.long
@pytest.mark.parametrize(
    ("fault", "name", "red"),
    [
        (pulled, STRIP, "no equilibrium was found"),
        (turned_normal, STRIP, "no equilibrium was found"),
        (at_rest, STRIP, "nothing touches an obstacle"),
        (glued, STRIP, {"contact_force", "tip_shortening"}),
        (halved, STRIP, {"contact_force", "wall_force"}),
        (at_rest, DRAPE, {"penetration", "corner_drop"}),
    ],
)
def test_a_fault_is_red_for_its_own_reason(fault, name, red, monkeypatch):
    fault(monkeypatch)
    if isinstance(red, str):
        with pytest.raises((SolveFailure, ValueError), match=red):
            shares_of_tolerances(one_answer(name), "ndf-ritz")
        return
    found = shares_of_tolerances(one_answer(name), "ndf-ritz")
    assert red <= {quantity for quantity, share in found.items() if not share < 1}


def rows_of(case, neurons, panels, finer):
    """Return points at which a case asks for gaps, on few features."""
    settings = RitzSettings()
    rules = RuleSpec(panels, 4)
    level = replace(usual_resolution(case), neurons=neurons, rule=rules, fine=rules)
    spec = field_spec(case, settings)
    ansatz, features, (rule, _), focal = draw_field(case, spec, settings, level, 0)
    problem = PathProblem(spec, ansatz, features, rule, focal).independent()
    touch = contact_points(case, (), finer, ends=True)
    return touching.ContactRows(problem, touch, np.zeros(len(touch.points), dtype=bool))


def strip(**parts):
    """Return the heavy strip of which parts are others."""
    data = catalog.named_case(STRIP).model_dump(exclude={"name"}, exclude_unset=True)
    return build_case({**data, **parts}, STRIP, STRIP)


def rows_on_the_ball():
    """Return points of the draped cloth on few features, and a random state of theirs."""
    points = rows_of(catalog.named_case(DRAPE), 12, (3, 3), 0.2)
    y = torch.as_tensor(np.random.default_rng(0).normal(size=points.problem.basis.size))
    return points, 1e-3 * y


def test_the_curvature_of_an_obstacle_is_the_derivative_of_what_it_exerts():
    points, y = rows_on_the_ball()
    case, combine = points.problem.ansatz.case, points.problem.basis.combine
    forces = np.random.default_rng(1).uniform(size=len(points.touch.points))

    def exerted(y):
        _, normal = gaps(case, points.touch.points, points.displacement(combine @ y, 1.0), 1.0)
        return (torch.as_tensor(forces[:, None] * normal)[:, None] @ points.reduced).sum(dim=(0, 1))

    step = 1e-4 * y.flip(0)
    added = points.curvature(forces, points.displacement(combine @ y, 1.0), 1.0) @ (2 * step)
    change = (exerted(y - step) - exerted(y + step)).numpy()
    assert added.numpy() == pytest.approx(change, rel=1e-4, abs=1e-5 * np.abs(change).max())


def test_points_with_ends_stand_for_the_whole_shell():
    case = catalog.named_case(DRAPE)
    for creases in ((), ((0, 0.3, -1),)):
        touch = contact_points(case, creases, 1.0, ends=True)
        assert touch.lengths.prod(axis=1).sum() == pytest.approx(0.5 * 0.3)
        assert touch.points.min(axis=0) == pytest.approx(case.surface.domain.lower)
        assert touch.points.max(axis=0) == pytest.approx(case.surface.domain.upper)


def test_smooth_forces_are_the_least_that_move_the_shell_as_spikes_do():
    x = np.linspace(0, 1, 40)
    compliance = np.exp(-((x[:, None] - x) ** 2) / 0.1)  # smooth: it tells few of these forces apart
    unit, line, gap = np.ones(40), np.zeros(40, dtype=bool), -np.minimum(x, 0.6)
    spikes = least_forces(compliance, gap, 1e-9 * unit)
    before = np.zeros(40)
    for passes in (1, 2):
        # A pass minimises the miss's energy and the squares of its change among forces that push (proximal point).
        smooth = smoothest_forces(compliance, gap, spikes, unit, line, 1e6, passes)
        missed = compliance @ (smooth - spikes)
        rate = missed + SMOOTH * (smooth - before)
        assert smooth.min() >= 0
        assert rate.min() >= -1e-12
        assert rate @ smooth == pytest.approx(0, abs=1e-12)
        assert missed @ (smooth - spikes) <= SMOOTH * spikes @ spikes / passes
        assert np.count_nonzero(smooth) > 2 * np.count_nonzero(spikes)
        before = smooth


@pytest.mark.long
def test_a_strip_that_only_the_floor_keeps_from_buckling_is_followed(monkeypatch):
    floor = {"kind": "plane", "centre": (0, 0, -0.002), "normal": (0, 0, 1)}
    push = {"kind": "edge", "on": ("xi1_max",), "vector": ("-0.1*t", 0, 0)}  # forty times Euler's load
    weight = {"kind": "area", "vector": (0, 0, "-0.1*t")}
    pressed = strip(obstacles=[floor], loads=[weight, push])
    with torch.no_grad():
        points = rows_of(pressed, 20, (6, 1), 0.3)

        def last():
            return list(load_steps(points.problem, (1.0,), lambda _, s, t: touching.contact_state(points, s, t)[0]))[-1]

        state, combine = last(), points.problem.basis.combine
        tangent = combine.T @ points.problem.tangent(state.deformed, state.t, state.weights) @ combine
        assert float(torch.linalg.eigvalsh(tangent)[0]) < 0  # under forces that stay, it would buckle
        monkeypatch.setattr(touching, "STIFF", 0.0)
        with pytest.raises(PathEndsError, match="no equilibrium was found"):
            last()


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"path": {"control": "arc_length", "quantity": "tip_shortening", "until": 1.0}}, "by load steps before"),
        ({"path": {"after_buckling": "follow"}}, "by load steps before buckling only"),
        ({"loads": [{"kind": "pressure", "value": "-0.1*t", "follows": True}]}, "under dead forces alone"),
        ({"loads": [{"kind": "moment", "on": ["xi1_max"], "axis": [0, 1, 0], "value": "1e-3*t"}]}, "without moments"),
        ({"supports": [TURNED]}, "or edges that turn"),
        ({"quantities": [{"name": "c", "kind": "critical_point", "primary": True}]}, "no critical points"),
    ],
)
def test_what_is_not_touched_at_finite_strain_is_declined(parts, words):
    found = RitzSolver().declines(strip(**parts))
    assert words in (found or "")
