"""One step in time: exact where it must be, of second order, damped as said, and a minimum that is found."""

import numpy as np
import pytest

from shellbench.solvers.fem.algebra.factor import factorise
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.mesh.quadrature import Quadrature
from shellbench.solvers.fem.motion.generalised_alpha import Instant, Scheme
from shellbench.solvers.fem.motion.time_step import MovingShell, _StepPotential
from shellbench.solvers.fem.path.problem import FiniteProblem
from shellbench.solvers.stepping.control import NotConvergedError
from tests.solvers.fem.shells import LARGEST, MATERIAL, shell

G, DENSITY = 9.8, MATERIAL["areal_density"]
FALLING = {"kind": "gravity", "acceleration": [0, 0, -G]}
WEIGHT = {"kind": "gravity", "acceleration": [0.3, 0.0, -G]}
TURNED = {
    "name": "turned", "on": ["xi2_max"], "clamped": True,
    "motion": {"kind": "rotation", "axis": [1, 0, 0], "centre": [0, 1, 0], "angle": "50*t**2"},
}  # fmt: skip
RADII = (0.0, 0.3, 0.5, 0.9)


def moving(cells=(3, 2), radius=0.5, surface="plane", **fields):
    """Return a shell that is ready to step."""
    fields = {"theory": "kirchhoff-love-nonlinear", "supports": [], "dynamics": {"until": 1.0}, **fields}
    case = shell(surface, quantities=[LARGEST | {"at": 1.0}], **fields)
    domain = case.surface.domain
    lines = [np.linspace(low, high, n + 1) for low, high, n in zip(domain.lower, domain.upper, cells, strict=True)]
    mesh = TensorMesh(domain, (lines[0], lines[1]))
    return MovingShell(FiniteProblem.on_mesh(case, mesh, Quadrature.of_order(mesh, 7)), Scheme(radius))


def sprung(k, **fields):
    return moving(springs=[{"name": "s", "stiffness": k}], **fields)


def translation(shell, vector):
    """Return the degrees of freedom (nodes, 12) of a uniform displacement."""
    q = np.zeros((shell.problem.mesh.node_count, 3, 4))
    q[:, :, 0] = vector
    return q.reshape(-1, 12)


def advanced(shell, h, count):
    now = shell.initial_instant(h)
    for _ in range(count):
        now = shell.step(now, h)
    return now


def minimum(shell, h, seed=0, size=0.02):
    """Return the potential of a step from a random state, and a random place in it."""
    rng = np.random.default_rng(seed)
    target, x = (rng.uniform(-size, size, (shell.problem.mesh.node_count, 12)) for _ in range(2))
    s = shell.scheme
    weight = (1 - s.alpha_m) / ((1 - s.alpha_f) * s.beta * h**2)
    return _StepPotential(shell, shell.problem.ties(0.0), 0.4, shell.problem.loads(0.0), target, weight), x


# the incremental potential


@pytest.mark.parametrize("surface", ["plane", "cylinder"])
def test_the_residual_is_the_potentials_gradient(surface):
    shell = sprung("3 + xi2", surface=surface, cells=(4, 2), loads=[WEIGHT], supports=[TURNED])
    of, x = minimum(shell, 0.05)
    energy = shell.problem.energy
    step = np.random.default_rng(1).normal(size=x.shape)

    def value(share):
        return of._potential(x + share * step, energy.deform(x + share * step))[0]

    d = 1e-4
    expected = (8 * (value(d) - value(-d)) - (value(2 * d) - value(-2 * d))) / (12 * d)
    assert -np.sum(of._residual(x, energy.deform(x)) * step) == pytest.approx(expected, rel=1e-8)


def test_the_factorised_tangent_is_the_residuals_derivative():
    shell = sprung("3 + xi2", surface="cylinder", cells=(4, 2), loads=[WEIGHT], supports=[TURNED])
    of, x = minimum(shell, 0.02, size=0.005)
    energy, ties = shell.problem.energy, of.ties
    right = ties.to_free(np.random.default_rng(1).normal(size=x.shape)[..., None])
    step = ties.to_nodal(of._factorised(x, energy.deform(x)).solve(right) * ties.free[..., None])[..., 0]
    d = 1e-3 / np.abs(step).max()
    ahead, back = (of._residual(x + s * d * step, energy.deform(x + s * d * step)) for s in (1, -1))
    change = ties.to_free(((back - ahead) / (2 * d))[..., None])
    assert np.allclose(change, right, rtol=0, atol=1e-4 * np.abs(right).max())


def test_a_step_satisfies_the_balance_of_the_generalised_alpha_method():
    """M a at 1 - alpha_m, forces at 1 - alpha_f, and Newmark's two rules, written out for a step of a swinging sheet."""
    for radius in RADII:
        shell = moving(radius=radius, loads=[WEIGHT], supports=[{"name": "corner", "on": ["xi1_min,xi2_max"]}])
        s, h = shell.scheme, 0.01
        start = advanced(shell, h, 4)
        end = shell.step(start, h)
        af, am = radius / (radius + 1), (2 * radius - 1) / (radius + 1)
        gamma, beta = 0.5 - am + af, (1 - am + af) ** 2 / 4
        assert (s.alpha_f, s.alpha_m, s.gamma, s.beta) == pytest.approx((af, am, gamma, beta))
        x = (1 - af) * end.q + af * start.q
        acceleration = (1 - am) * end.a + am * start.a
        inner = shell.problem.energy.deform(x).forces
        loads = shell.problem.loads(0.0)
        inertia = (shell.mass @ acceleration[..., None])[..., 0]
        unbalanced = loads + end.reaction - inner - inertia
        assert np.abs(unbalanced).max() <= 1e-6 * np.abs(inertia).max()
        assert np.abs(end.reaction).max() > 1e-2 * np.abs(inertia).max()
        assert np.allclose(
            end.q, start.q + h * start.v + h**2 * ((0.5 - beta) * start.a + beta * end.a), rtol=0, atol=1e-12
        )
        assert np.allclose(end.v, start.v + h * ((1 - gamma) * start.a + gamma * end.a), rtol=0, atol=1e-10)


# closed forms


def test_free_fall_is_exact_whatever_the_steps():
    shell = moving(loads=[FALLING])
    now = shell.initial_instant(0.1)
    for h in (0.1, 0.003, 0.4, 0.4, 0.05):
        now = shell.step(now, h)
        assert np.allclose(now.q, translation(shell, [0, 0, -G * now.t**2 / 2]), rtol=0, atol=1e-9)
        assert np.allclose(now.v, translation(shell, [0, 0, -G * now.t]), rtol=0, atol=1e-7)
        kinetic, stored = shell.energies(now)
        mass = DENSITY * 2.0
        assert kinetic == pytest.approx(mass / 2 * (G * now.t) ** 2, rel=1e-8)
        assert stored < 1e-10 * kinetic
        assert now.supplied == pytest.approx(kinetic, rel=1e-8)


@pytest.mark.parametrize("h", [0.1, 1e-3])
def test_free_flight_converges(h):
    """Nothing loads or strains the sheet, so that no energy but the kinetic one gives a scale."""
    shell = moving()
    rest = shell.initial_instant(h)
    place, velocity = [0.1, 0.2, 0.3], [0.3, 0.2, 5.0]
    now = Instant(0.0, translation(shell, place), translation(shell, velocity), rest.a, rest.reaction)
    for _ in range(5):
        now = shell.step(now, h)
    assert np.allclose(now.q, translation(shell, place + 5 * h * np.array(velocity)), rtol=0, atol=1e-9)
    assert np.allclose(now.v, translation(shell, velocity), rtol=0, atol=1e-6)


@pytest.mark.parametrize("radius", RADII)
def test_an_oscillator_converges_with_the_square_of_the_step(radius):
    """A rigid sheet on springs: rho u'' = -rho g - k u, u = -(rho g / k) (1 - cos(w t)), w^2 = k / rho."""
    k, until = 20.0, 0.7
    w = np.sqrt(k / DENSITY)
    expected = -DENSITY * G / k * (1 - np.cos(w * until))
    speed = -DENSITY * G / k * w * np.sin(w * until)
    shell = sprung(k, radius=radius, loads=[FALLING], cells=(1, 1))
    counts = np.array([20, 40, 80])
    errors = []
    for count in counts:
        end = advanced(shell, until / count, count)
        errors.append(np.hypot(w * (end.q[0, 8] - expected), end.v[0, 8] - speed))
        assert np.allclose(end.q, translation(shell, [0, 0, end.q[0, 8]]), rtol=0, atol=1e-8)
    assert errors[-1] < 1e-2 * np.hypot(w * expected, speed)
    assert -2.2 < np.polyfit(np.log(counts), np.log(errors), 1)[0] < -1.8


def amplification(radius, frequency):
    """Return the eigenvalues of a step for (u, h v, h^2 a) of a rigid sheet on springs, w h = `frequency`."""
    h = 0.1
    shell = sprung(DENSITY * (frequency / h) ** 2, radius=radius, cells=(1, 1))
    unit, none = translation(shell, [1e-3, 0, 0]), translation(shell, [0, 0, 0])
    columns = []
    for q, v, a in ((unit, none, none), (none, unit / h, none), (none, none, unit / h**2)):
        end = shell.step(Instant(0.0, q, v, a, none), h)
        columns.append([end.q[0, 0], h * end.v[0, 0], h**2 * end.a[0, 0]])
    return np.linalg.eigvals(np.array(columns).T / 1e-3)


@pytest.mark.parametrize("radius", RADII)
def test_an_unresolved_frequency_is_damped_by_the_spectral_radius(radius):
    assert np.abs(amplification(radius, 1e5)).max() == pytest.approx(radius, abs=2e-2)
    # the more a frequency is resolved, the less it is damped, and the better its phase is right
    slow = amplification(radius, 0.1)
    principal = slow[np.argsort(-np.abs(slow))[:2]]
    assert np.allclose(np.abs(principal), 1.0, rtol=0, atol=1e-3)
    assert np.allclose(np.abs(np.angle(principal)), 0.1, rtol=1e-2)


@pytest.mark.parametrize("radius", [*RADII, 1.0])
def test_no_step_is_too_long_for_a_linear_oscillator(radius):
    assert all(np.abs(amplification(radius, w)).max() <= 1 + 1e-5 for w in (0.01, 0.5, 1.0, 2.0, 5.0, 30.0, 1e3))


# energy


def imbalance(vector, counts):
    """Return the energy lost or gained after .2 s in each number of steps, relative to the final energy."""
    supports = [{"name": "edge", "on": ["xi1_min"], "motion": {"kind": "translation", "vector": vector}}]
    relative = []
    for count in counts:
        shell = sprung(20, loads=[FALLING], supports=supports, cells=(2, 2))
        end = advanced(shell, 0.2 / count, count)
        energy = sum(shell.energies(end))
        relative.append(abs(energy - end.supplied) / energy)
        moved = end.q.reshape(-1, 3, 4)[shell.problem.ties(0.2).nodes[0], :, 0]
        assert np.allclose(moved, [shell.problem.case.scalar(text, 0.2) for text in vector])
    return relative


def test_energy_is_lost_or_gained_with_the_square_of_the_step():
    counts = np.array([20, 40, 80])
    lost = imbalance([0, 0, 0], counts)
    assert lost[-1] < 2e-5
    assert np.polyfit(np.log(counts), np.log(lost), 1)[0] < -1.8


def test_work_of_moved_supports_is_of_second_order():
    counts = np.array([20, 40, 80])
    lost = imbalance(["20*t**4", 0, "30*t**4"], counts)
    assert lost[-1] < 2e-3
    assert np.polyfit(np.log(counts), np.log(lost), 1)[0] < -1.7


def test_at_rest_the_acceleration_is_that_of_the_loads_and_supports():
    held = {"name": "edge", "on": ["xi1_min"]}
    shell = moving(loads=[WEIGHT], supports=[held])
    rest = shell.initial_instant(0.01)
    residual = shell.problem.loads(0.0) - (shell.mass @ rest.a[..., None])[..., 0]
    assert np.abs(shell.problem.ties(0.0).to_free(residual[..., None])).max() < 1e-10
    assert np.allclose(rest.reaction, -residual, atol=1e-10)
    assert not np.any(rest.q)
    assert not np.any(rest.v)
    nodes = shell.problem.ties(0.0).nodes
    assert np.abs(rest.a.reshape(-1, 3, 4)[nodes][:, :, [0, 2]]).max() < 1e-9
    pushed = moving(supports=[held | {"motion": {"kind": "translation", "vector": ["3*t**2", 0, 0]}}])
    rest = pushed.initial_instant(0.01)
    assert np.allclose(rest.a.reshape(-1, 3, 4)[nodes][:, :, 0], [6, 0, 0])


# where the potential is not convex


def compressed(shell, share=0.1):
    """Return a sheet at rest that is far shorter than it would be, and hardly bent."""
    mesh = shell.problem.mesh
    q = np.zeros((mesh.node_count, 3, 4))
    q[:, 0, 0] = -share * mesh.node_points[:, 0]
    q[:, 0, 1] = -share * mesh.node_scales[:, 1]
    q[:, 2, 0] = 1e-3 * np.sin(7 * mesh.node_points[:, 0] + mesh.node_points[:, 1])
    none = np.zeros((mesh.node_count, 12))
    return Instant(0.0, q.reshape(-1, 12), none, none, none)


def test_an_indefinite_tangent_is_made_positive():
    shell = moving(cells=(6, 3))
    start = compressed(shell)
    of, _ = minimum(shell, 0.05)
    strained = shell.problem.energy.deform(start.q)
    reduced = of.ties.reduce(tangent(of, strained))
    assert factorise(reduced, shell.problem.dissection, "reported").negative_count > 0
    values, vectors = np.linalg.eigh(reduced.to_csr().toarray())
    assert values[0] < 0
    factor = of._factorised(start.q, strained)
    for vector in (*vectors.T[:3], vectors.T[-1]):  # a force is answered by a step along it, in whatever direction
        right = vector.reshape(*start.q.shape, 1)
        assert np.sum(right * factor.solve(right)) > 0


@pytest.mark.parametrize("h", [0.02, 0.05, 0.1])
def test_from_where_the_potential_is_not_convex_the_line_search_finds_a_minimum(h, monkeypatch):
    """Full Newton steps, of either sign of the tangent, do not get there."""
    shell = moving(cells=(6, 3))
    start = compressed(shell)
    seen = []
    original = _StepPotential._potential

    def watched(self, x, strained, pressed=None):
        found = original(self, x, strained)
        seen.append((self, found[0]))
        return found

    monkeypatch.setattr(_StepPotential, "_potential", watched)
    end = shell.step(start, h)
    monkeypatch.undo()
    x = (1 - shell.scheme.alpha_f) * end.q + shell.scheme.alpha_f * start.q
    of, first = seen[0]
    strained = shell.problem.energy.deform(x)
    found = of._potential(x, strained)[0]
    assert found < first - 1e-3 * abs(first)
    assert found == pytest.approx(min(value for _, value in seen), rel=1e-9)
    scale = np.abs(shell.problem.energy.deform(start.q).forces).max()
    assert np.abs(of._residual(x, strained)).max() < 1e-4 * scale
    assert factorise(of.ties.reduce(tangent(of, strained)), shell.problem.dissection, "reported").negative_count == 0


def tangent(of, strained):
    """Return the second derivative of a step's potential."""
    matrix = of.shell.problem.energy.tangent(strained)
    matrix.blocks[...] += of.weight * of.shell.mass.blocks
    return matrix


@pytest.mark.parametrize("speed", [np.nan, np.inf, 1e200])
def test_a_step_from_nowhere_does_not_converge(speed):
    shell = moving()
    rest = shell.initial_instant(0.1)
    rng = np.random.default_rng(0)
    wild = Instant(0.0, rest.q, speed * rng.normal(size=rest.q.shape), rest.a, rest.reaction)
    with np.errstate(all="ignore"), pytest.raises(NotConvergedError):
        shell.step(wild, 0.1)


def test_a_step_that_is_far_too_long_does_not_converge():
    shell = moving(cells=(6, 3))
    start = shell.initial_instant(1.0)
    wild = Instant(0.0, start.q, 30 * np.random.default_rng(0).normal(size=start.q.shape), start.a, start.reaction)
    with pytest.raises(NotConvergedError):
        shell.step(wild, 1.0)


def test_a_shell_can_go_on_after_a_step_that_did_not_converge():
    shell = moving(loads=[FALLING])
    start = shell.initial_instant(0.1)
    wild = Instant(0.0, start.q, np.full_like(start.q, np.nan), start.a, start.reaction)
    with pytest.raises(NotConvergedError):
        shell.step(wild, 0.1)
    assert np.allclose(shell.step(start, 0.1).q, translation(shell, [0, 0, -G * 0.005]), rtol=0, atol=1e-10)
