"""Edge moments at finite rotation: the angle is followed beyond whole turns, and its moment is conservative."""

from itertools import pairwise

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from shellbench.errors import InputError
from shellbench.problem import answerable, declined_quantities
from shellbench.solvers.ndf.field.build import build_ansatz, build_features, build_inputs
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.jets import Placement, from_derivatives
from shellbench.solvers.ndf.field.network import random_features
from shellbench.solvers.ndf.field.quadrature import RuleSpec
from shellbench.solvers.ndf.ritz_solver import RitzSettings, RitzSolver
from shellbench.solvers.ndf.strains.energy import symmetric
from shellbench.solvers.ndf.strains.reaction import edge_moments
from tests.solvers.ndf.shells import shell, support

PLACEMENT = Placement()
NO_FOCI = np.zeros((0, 2))
SPEC = RuleSpec((3, 3), 5)
AXIS = np.array([0.3, -1.0, 0.4]) / np.sqrt(1.25)


def edge_moment(surface="helicoid", edge="xi1_max", value="3*t*(1 + xi2)", axis=AXIS, finite=True):
    load = {"kind": "moment", "on": [edge], "axis": [float(a) for a in axis], "value": value}
    case = shell(surface, theory="kirchhoff-love-nonlinear", supports=[support("w", "xi1_min", clamped=True)],
                 loads=[load])  # fmt: skip
    spec = FieldSpec()
    inputs = build_inputs(case, spec)
    network = random_features(PLACEMENT.tensor(np.full(inputs.count, 2.0)), 5, 0)
    features = build_features(case, spec, network, PLACEMENT, inputs)
    (moment,) = edge_moments(build_ansatz(case, spec), features, SPEC, NO_FOCI, finite)
    return moment


def turned_gradients(moment, rotation):
    """Displacement gradients (N, 5, 3) of the shell turned as a whole."""
    x = from_derivatives(moment.case.surface.derivatives(moment.sampled.points, 2), PLACEMENT).numpy()
    jet = PLACEMENT.tensor(x @ (rotation.as_matrix() - np.eye(3)).T)
    return moment.sampled.undeformed.gradients(jet)


def drawn(moment, size=0.3, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return size * torch.randn(len(moment.lengths), 5, 3, generator=generator, dtype=torch.float64)


@pytest.mark.parametrize("surface", ["plane", "helicoid", "hypar"])
def test_the_angle_of_a_rotation_about_the_axis_is_followed_beyond_whole_turns(surface):
    moment = edge_moment(surface)
    angles = torch.zeros(len(moment.lengths), dtype=torch.float64)
    for angle in np.arange(0.5, 16.0, 0.5):
        angles = moment.angles(turned_gradients(moment, Rotation.from_rotvec(angle * AXIS)), angles)
        torch.testing.assert_close(angles, torch.full_like(angles, angle), rtol=1e-11, atol=1e-11)
    for angle in np.arange(15.0, -8.0, -0.5):
        angles = moment.angles(turned_gradients(moment, Rotation.from_rotvec(angle * AXIS)), angles)
    torch.testing.assert_close(angles, torch.full_like(angles, -7.5), rtol=1e-11, atol=1e-11)


def test_the_angle_is_that_of_the_normal_about_the_axis():
    """theta = atan2(e . (p x q), p . q) with the parts p, q across e of the normals, here by numpy."""
    moment = edge_moment()
    gradients = drawn(moment)
    x = moment.case.surface.derivatives(moment.sampled.points, 1)
    u = gradients.numpy()

    def across(a1, a2):
        normal = np.cross(a1, a2)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        return normal - (normal @ AXIS)[:, None] * AXIS

    p, q = across(x[1, 0], x[0, 1]), across(x[1, 0] + u[:, 0], x[0, 1] + u[:, 1])
    expected = np.arctan2(np.cross(p, q) @ AXIS, (p * q).sum(-1))
    found = moment.angles(gradients, torch.zeros(len(p), dtype=torch.float64))
    np.testing.assert_allclose(found.numpy(), expected, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("surface", ["plane", "helicoid", "roof"])
def test_the_variation_of_the_angle_and_its_own(surface):
    moment = edge_moment(surface, "xi1_max")
    gradients, near = drawn(moment), torch.zeros(len(moment.lengths), dtype=torch.float64)
    rows, form = moment.rows(gradients), moment._form(gradients)
    torch.testing.assert_close(form, form.mT, rtol=1e-12, atol=1e-12 * float(form.abs().max()))
    for seed in (1, 2):
        change, step = drawn(moment, seed=seed), 1e-5
        flat = change[:, :2].flatten(1)
        slope = (moment.angles(gradients + step * change, near) - moment.angles(gradients - step * change, near)) / (
            2 * step
        )
        torch.testing.assert_close((rows * flat).sum(-1), slope, rtol=1e-7, atol=1e-8)
        bend = (moment.rows(gradients + step * change) - moment.rows(gradients - step * change)) / (2 * step)
        torch.testing.assert_close((form @ flat[..., None])[..., 0], bend, rtol=1e-6, atol=1e-7)


def test_forces_and_tangent_are_the_slopes_of_the_work():
    """With the moment's work as the potential of forces on the output weights: what acts is conservative."""
    moment, t = edge_moment(), 0.6
    generator = torch.Generator().manual_seed(0)
    weights, direction = (
        0.2 * torch.randn(2, moment.sampled.jets.shape[-1] * 3, generator=generator).double()
    ).unbind()
    near = torch.zeros(len(moment.lengths), dtype=torch.float64)

    def gradients(s):
        return moment.sampled.gradients((weights + s * direction).view(3, -1))

    def work(s):
        return float(moment.moments(t) @ moment.angles(gradients(s), near))

    step = 1e-5
    force = moment.forces(gradients(0), t)
    assert float(force @ direction) == pytest.approx((work(step) - work(-step)) / (2 * step), rel=1e-7)
    tangent = torch.zeros(len(weights), len(weights), dtype=torch.float64)
    moment.add_tangent(tangent, gradients(0), t)
    slope = (moment.forces(gradients(step), t) - moment.forces(gradients(-step), t)) / (2 * step)
    torch.testing.assert_close(symmetric(tangent) @ direction, -slope, rtol=1e-6, atol=1e-7 * float(slope.abs().max()))


def test_the_work_round_a_closed_loop_is_nothing():
    """Out by rotations about one axis, back by another way: the sum of the forces' work is zero."""
    moment = edge_moment()
    legs = 400
    turns = [Rotation.from_euler("xyz", [0.5 * np.sin(s), 0.4 * (1 - np.cos(s)), 0.3 * np.sin(2 * s)])
             for s in np.linspace(0, 2 * np.pi, legs + 1)]  # fmt: skip
    states = [turned_gradients(moment, turn) for turn in turns]
    work, way = 0.0, 0.0
    for before, after in pairwise(states):
        middle = (moment.rows(before) + moment.rows(after)) / 2
        part = float((middle * (after - before)[:, :2].flatten(1)).sum(-1) @ moment.moments(1.0))
        work, way = work + part, way + abs(part)
    assert abs(work) < 1e-4 * way


def test_moments_are_those_of_the_formula_on_the_edge():
    """Integral of 3 t (1 + xi2) along the edge xi1 = 90 degrees of the helicoid, a line of length 1 from xi2 = 1."""
    moment = edge_moment()
    assert float(moment.moments(0.5).sum()) == pytest.approx(3 * 0.5 * (1 + 1.5), rel=1e-12)
    curved = edge_moment("roof", "xi2_max", "2*t")
    assert float(curved.moments(1.0).sum()) == pytest.approx(2 * 3 * np.radians(80), rel=1e-12)


def test_in_linear_theory_the_angle_is_its_first_variation_at_rest():
    finite, linear = edge_moment(), edge_moment(finite=False)
    gradients, near = drawn(finite, 1e-7), torch.zeros(len(finite.lengths), dtype=torch.float64)
    exact, first = finite.angles(gradients, near), linear.angles(gradients, near)
    torch.testing.assert_close(first, exact, rtol=1e-4, atol=1e-12)
    torch.testing.assert_close(linear.angles(1e7 * gradients, near), 1e7 * first, rtol=1e-12, atol=0)
    torch.testing.assert_close(linear.rows(1e7 * gradients), linear.rows(0 * gradients), rtol=0, atol=0)
    count = 3 * linear.sampled.jets.shape[-1]
    tangent = torch.zeros(count, count, dtype=torch.float64)
    linear.add_tangent(tangent, gradients, 1.0)
    assert tangent.abs().max() == 0


def test_angles_are_carried_over_to_a_finer_rule():
    """Beyond a whole turn the finer rule follows the other one: nothing is lost by whole turns."""
    moment = edge_moment("plane")
    case, spec = moment.case, FieldSpec()
    inputs = build_inputs(case, spec)
    network = random_features(PLACEMENT.tensor(np.full(inputs.count, 2.0)), 5, 0)
    features = build_features(case, spec, network, PLACEMENT, inputs)
    (fine,) = edge_moments(build_ansatz(case, spec), features, RuleSpec((5, 5), 6), NO_FOCI, True)
    angles = PLACEMENT.tensor(7.0 + 0.8 * moment.sampled.points[:, 1])
    near = moment.interpolate(angles, fine)
    expected = PLACEMENT.tensor(7.0 + 0.8 * fine.sampled.points[:, 1])
    assert len(near) == len(fine.lengths)
    assert (near - expected).abs().max() < 0.05  # beyond the outermost points it is constant
    turn = Rotation.from_rotvec(7.0 * AXIS)
    found = fine.angles(turned_gradients(fine, turn), near)
    torch.testing.assert_close(found, torch.full_like(found, 7.0), rtol=1e-11, atol=0)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("along", "across", "normal"), [("xi1", "xi2", "y"), ("xi2", "xi1", "x")])
def test_mirrors_that_meet_a_support_leave_its_force_determinate(along, across, normal):
    # a strip on two supports, mirrors on its sides: each support bears half of the load, whatever the plate does
    tangent = {"x": "y", "y": "x"}[normal]
    case = shell(
        supports=[
            support("near", f"{along}_min", components=[tangent, "z"]),
            support("far", f"{along}_max", components=["z"]),
            support("mirrors", f"{across}_min", f"{across}_max", symmetry=normal),
        ],
        loads=[{"kind": "area", "vector": [0, 0, -3.0]}],
        quantities=[
            {"name": "largest", "kind": "largest_displacement", "primary": True},
            {"name": "force", "kind": "reaction", "support": "near", "direction": [0, 0, 1]},
        ],
    )
    assert declined_quantities(RitzSolver(), case) == {}
    answer = RitzSolver().solve(case, RitzSettings(neurons=60))
    assert case.quantity("force").measure(answer) == pytest.approx(3.0 * 4 / 2, rel=1e-5)


def test_a_force_that_two_supports_share_at_a_corner_is_declined_and_costs_no_other_quantity():
    case = shell(
        supports=[support("left", "xi1_min"), support("rest", "xi1_max", "xi2_min", "xi2_max", components=["z"])],
        loads=[{"kind": "area", "vector": [0, 0, -3.0]}],
        quantities=[
            {"name": "largest", "kind": "largest_displacement", "primary": True},
            {"name": "force", "kind": "reaction", "support": "left", "direction": [0, 0, 1]},
        ],
    )
    solver = RitzSolver()
    assert solver.declines(case) is None
    taken, declined = answerable(solver, case)
    assert [quantity.name for quantity in taken.quantities] == ["largest"]
    assert "meets at a corner" in declined["force"]
    with pytest.raises(InputError, match="force of test: the reaction of support 'left'"):
        solver.solve(case, RitzSettings(neurons=20))
    headline, other = (q.model_copy(update={"primary": not q.primary}) for q in case.quantities)
    whole = case.model_copy(update={"quantities": (headline, other)})
    assert answerable(solver, whole)[0] is whole  # without its headline it would be no case
    with pytest.raises(InputError, match="force of test: the reaction of support 'left'"):
        solver.solve(whole, RitzSettings(neurons=20))
