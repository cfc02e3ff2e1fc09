"""Following a motion of MuJoCo's cloth on one grid, frame by frame.

The case becomes a model of MuJoCo: a flex of dimension 2 whose every vertex is a body on slide joints. The engine's own
gravity and air are off. A component of a vertex that a support holds has no joint. Springs are
those of the joints. Loads are applied forces. Obstacles are geoms, met by the engine's own contact of triangles,
without friction and as hard as it can be: `solref` is twice a step, the shortest that the engine calls stable.

MuJoCo's semi-implicit Euler rule is v(n+1) = v(n) + h a(x(n)), x(n+1) = x(n) + h v(n+1), of first order if both v and x
begin at rest: a free fall then runs ahead by g h t/2. The same rule is the leapfrog of Verlet (1967), of second order,
if its velocities are taken for those half a step earlier than its positions. A staggered motion begins with the
velocity -h a(0)/2 and reads velocities so: at a frame they are the mean of the engine's before and after.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, eigsh
from threadpoolctl import ThreadpoolController

from shellbench.errors import InputError, SolveFailure
from shellbench.problem import Progress, ProgressCallback, Step
from shellbench.problems.obstacle import Body, Box, Capsule, HalfSpace, Sphere
from shellbench.problems.shell.case import Case
from shellbench_mujoco.elasticity import Elasticity
from shellbench_mujoco.engine import quiet
from shellbench_mujoco.grid import Grid, Loading
from shellbench_mujoco.solution import FlexSolution
from shellbench_mujoco.solver import FlexSettings, Integrator

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

TURNING = 1.0  # kg m^2: moments of inertia that every body must have, and that nothing turns
NO_RADIUS = 1e-9  # of the cloth's size: the radius of a flex whose midsurface touches
BOTH = 3  # of a flex's `elastic2d`: stretching and bending


@dataclass(frozen=True)
class Cloth:
    """A compiled model with the meaning of its degrees of freedom.

    Attributes
    ----------
    model, data
        The engine's own.
    free
        (v, 3) True if a vertex moves, by component; the degrees of freedom are these in their order.
    masses
        (v,) kg.
    """

    model: Any
    data: Any
    free: NDArray[np.bool_]
    masses: Array

    @classmethod
    def from_grid(cls, grid: Grid, loading: Loading, integrator: Integrator, time_step: float, damping: float) -> Cloth:
        """Build and compile the model.

        Raises
        ------
        InputError
            If the engine refuses it.
        """
        spec = mujoco.MjSpec()
        spec.option.timestep = time_step
        spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
        spec.option.gravity = [0, 0, 0]
        off = mujoco.mjtDisableBit
        alone = 0 if grid.case.obstacles else int(off.mjDSBL_CONTACT | off.mjDSBL_CONSTRAINT)
        spec.option.disableflags = alone | int(off.mjDSBL_AUTORESET)
        free, springs = ~grid.held, loading.springs
        for vertex, (place, mass) in enumerate(zip(grid.rest, loading.masses, strict=True)):
            body = spec.worldbody.add_body(
                name=str(vertex), pos=place, mass=mass, inertia=[TURNING] * 3, explicitinertial=True
            )
            for axis in np.flatnonzero(free[vertex]):
                body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=np.eye(3)[axis], stiffness=springs[vertex, axis])
        _add_flex(spec, grid, damping)
        for obstacle in grid.case.obstacles:
            _add_obstacle(spec, obstacle, 2 * time_step)
        try:
            model = spec.compile()
        except (ValueError, mujoco.FatalError) as error:
            raise InputError(f"{grid.case.name}: MuJoCo refuses the cloth: {' '.join(str(error).split())}") from None
        return cls(model, mujoco.MjData(model), free, loading.masses)

    def displacement(self) -> Array:
        """Return the displacements (v, 3) of the vertices, m."""
        return self._spread(self.data.qpos)

    def velocity(self) -> Array:
        """Return the engine's velocities (v, 3) of the vertices, m/s."""
        return self._spread(self.data.qvel)

    def _spread(self, values: Array) -> Array:
        field = np.zeros(self.free.shape)
        field[self.free] = values
        return field

    def pressing(self) -> Array:
        """Return the forces of obstacles on the vertices (v, 3) in this state, N."""
        mujoco.mj_forward(self.model, self.data)
        return self._spread(self.data.qfrc_constraint)

    def push(self, forces: Array) -> None:
        """Set the applied forces (v, 3), N."""
        self.data.qfrc_applied[:] = forces[self.free]

    def set_velocity(self, velocity: Array) -> None:
        """Set the velocities (v, 3), m/s; held components stay at rest."""
        self.data.qvel[:] = velocity[self.free]

    def step(self, count: int = 1) -> None:
        """Take steps in time."""
        mujoco.mj_step(self.model, self.data, nstep=count)

    @property
    def well(self) -> bool:
        """True if the engine has given no warning and all numbers are finite."""
        warned = any(int(warning.number) for warning in self.data.warning)
        return not warned and bool(np.isfinite(self.data.qpos).all() and np.isfinite(self.data.qvel).all())


def _add_flex(spec: Any, grid: Grid, damping: float) -> None:
    """Add the flex with the case's stiffnesses.

    The flex has one Young's modulus and one thickness. If a case scales its bending stiffness by a factor f, the
    thickness is h sqrt(f) and the modulus E / sqrt(f): E h stays, and E h^3 becomes f times as large.
    """
    material, size = grid.case.isotropic, float(np.ptp(grid.rest, axis=0).max())
    root = math.sqrt(material.bending_factor)
    flex = spec.add_flex(
        name="cloth",
        dim=2,
        radius=material.thickness / 2 if grid.case.contact.thickness else NO_RADIUS * size,
        young=material.youngs_modulus / root,
        poisson=material.poissons_ratio,
        thickness=material.thickness * root,
        damping=damping,
        elastic2d=BOTH,
        contype=int(bool(grid.case.obstacles)),
        conaffinity=int(bool(grid.case.obstacles)),
        condim=1,
        selfcollide=mujoco.mjtFlexSelf.mjFLEXSELF_NONE,
    )
    flex.vertbody = [str(vertex) for vertex in range(len(grid.points))]
    flex.vert = np.zeros(grid.rest.size).tolist()
    flex.elem = grid.triangles.ravel().tolist()


def _add_obstacle(spec: Any, obstacle: Body, softness: float) -> None:
    """Add a geom that the flex meets without friction; `softness` is the time, s, in which contact comes to rest."""
    shapes, along, size = mujoco.mjtGeom, np.array([0.0, 0.0, 1.0]), [0.0, 0.0, 1.0]
    match obstacle:
        case Sphere(radius=radius):
            shape, size[0] = shapes.mjGEOM_SPHERE, radius
        case HalfSpace():
            shape, along = shapes.mjGEOM_PLANE, obstacle.unit
        case Capsule(radius=radius):
            shape, along = shapes.mjGEOM_CAPSULE, np.array(obstacle.half_axis)
            size[:2] = radius, float(np.linalg.norm(along))
        case Box(half_sides=sides):
            shape, size = shapes.mjGEOM_BOX, list(sides)
        case _:
            raise AssertionError(obstacle)  # declined
    geom = spec.worldbody.add_geom(type=shape, size=size, pos=obstacle.at(0.0)[0], condim=1, solref=[softness, 1.0])
    geom.alt.type, geom.alt.zaxis = mujoco.mjtOrientation.mjORIENTATION_ZAXIS, along
    geom.contype = geom.conaffinity = geom.priority = 1  # without priority `solref` is averaged with the flex's default


SHARE = 0.25  # of 2/omega, the longest step at which leapfrog is stable at rest; stretched cloth is stiffer
MOST_STEPS = 10_000_000
NUDGE = 1e-6  # of a cell's diagonal, by which forces are differentiated
ENOUGH = 1e-2  # relative accuracy of the square of the highest frequency
FEW = 12  # unknowns whose matrix is written out instead
ROUNDING = 1e-9  # of a step or a frame


@dataclass(frozen=True)
class Pace:
    """Division of a motion into equal frames, and of frames into equal steps."""

    until: float
    frames: int
    steps: int

    @classmethod
    def from_rates(cls, until: float, frame_rate: float, time_step: float) -> Pace:
        """Return the pace whose frames and steps are as long as asked for, or a little shorter.

        Raises
        ------
        InputError
            If that makes too many steps.
        """
        if not until / time_step <= MOST_STEPS:
            raise InputError(f"field 'time_step': {time_step:g} s makes more than {MOST_STEPS} steps in {until:g} s")
        frames = max(1, math.ceil(until * frame_rate - ROUNDING))
        return cls(until, frames, max(1, math.ceil(until / frames / time_step - ROUNDING)))

    @property
    def time_step(self) -> float:
        """Length of a step, s."""
        return self.until / (self.frames * self.steps)

    def time(self, step: int) -> float:
        """Return the time after a number of steps, s."""
        return self.until * step / (self.frames * self.steps)


@dataclass(frozen=True)
class Frame:
    """The state at one time, s: displacements, velocities, forces of obstacles (v, 3), and the work of loads, J."""

    at: float
    displacement: Array
    velocity: Array
    pressing: Array
    work: float


def usual_step(elasticity: Elasticity, loading: Loading, damping: float = 0.0) -> float:
    """Return a quarter of the longest step, s, at which the leapfrog rule is stable around rest.

    That is 2/w (sqrt(1 + z^2) - z), with z = beta w/2 the damping ratio at the highest frequency w and beta Rayleigh's
    `damping`, s (Belytschko, Liu & Moran 2000, section 6.2).
    """
    highest = highest_frequency(elasticity, loading)
    ratio = damping * highest / 2
    return SHARE * 2 / highest / (math.sqrt(1 + ratio**2) + ratio)


def highest_frequency(elasticity: Elasticity, loading: Loading) -> float:
    """Return the highest natural frequency at rest, rad/s, by Lanczos' method.

    Raises
    ------
    InputError
        If supports hold all vertices.
    """
    grid = elasticity.grid
    free = ~grid.held
    if not free.any():
        raise InputError("field 'cells': supports hold all vertices; choose more cells")
    root = np.sqrt(np.broadcast_to(loading.masses[:, None], free.shape)[free])
    size = NUDGE * math.sqrt(2 * float(grid.areas.max()))

    def stiffness(scaled: Array) -> Array:
        direction = np.zeros(free.shape)
        direction[free] = scaled.ravel() / root
        part = size / max(float(np.abs(direction).max()), np.finfo(float).tiny)
        change = elasticity.forces(grid.rest + part * direction) - elasticity.forces(grid.rest - part * direction)
        return np.asarray((change / (2 * part) + loading.springs * direction)[free] / root)

    if len(root) <= FEW:
        return math.sqrt(float(np.linalg.eigvals(np.array([stiffness(row) for row in np.eye(len(root))])).real.max()))
    operator = LinearOperator((len(root), len(root)), matvec=stiffness, dtype=float)
    start = np.random.default_rng(0).standard_normal(len(root))
    (square,) = eigsh(operator, k=1, which="LA", tol=ENOUGH, v0=start, return_eigenvectors=False)
    return math.sqrt(float(square))


def march(cloth: Cloth, loading: Loading, integrator: Integrator, staggered: bool, pace: Pace) -> Iterator[Frame]:
    """Follow the motion from rest and yield its frames, rest first; it ends early where the engine gives up."""
    h, case = pace.time_step, loading.case
    force, work, done = loading.forces(0.0), 0.0, 0
    cloth.push(force)
    if staggered:
        cloth.set_velocity(-h / 2 * force / cloth.masses[:, None])

    def advance(count: int) -> float:
        """Take steps from the step that is done; return the work of loads that change, J."""
        nonlocal force
        if case.steady:
            cloth.step(count)
            return 0.0
        gained = 0.0
        for step in range(done, done + count):
            if integrator == "RK4":  # it holds applied forces through a step: take their mean
                cloth.push(loading.forces(pace.time(step) + h / 2))
            before = cloth.displacement()
            cloth.step()
            after = loading.forces(pace.time(step + 1))
            gained += float(np.sum((force + after) / 2 * (cloth.displacement() - before)))
            force = after
            cloth.push(force)
        return gained

    with quiet():
        for number in range(pace.frames + 1):
            displacement, velocity = cloth.displacement(), cloth.velocity()
            pressing = cloth.pressing() if case.obstacles else np.zeros_like(displacement)
            at = float(np.sum(force * displacement)) if case.steady else work
            if staggered:
                work += advance(1)
                done += 1
                velocity = (velocity + cloth.velocity()) / 2
            if not cloth.well:
                return
            yield Frame(pace.time(number * pace.steps), displacement, velocity, pressing, at)
            if number < pace.frames:
                ahead = (number + 1) * pace.steps - done
                work += advance(ahead)
                done += ahead


MOST_BYTES = 2**31  # of frames that are kept in memory
GAIN = 2.0  # times the most work that loads have done: energy that only a diverging motion has
NEGLIGIBLE = 1e-12  # strain whose energy may be rounding: relative to D times the area


@dataclass
class _Course:
    """State of a running motion."""

    grid: Grid
    pace: Pace
    tell: ProgressCallback
    figures: Mapping[str, Any]
    began: float = field(default_factory=time.perf_counter)
    frames: list[Frame] = field(default_factory=list)
    history: list[Step] = field(default_factory=list)
    most_work: float = 0.0

    def __post_init__(self) -> None:
        self.elasticity, self.loading = Elasticity(self.grid), Loading(self.grid)
        self.unknowns = int((~self.grid.held).sum())
        material = self.grid.case.isotropic
        self.negligible = NEGLIGIBLE * material.membrane_stiffness * float(self.grid.areas.sum())

    def keep(self, frame: Frame) -> bool:
        """Keep a frame; return False if its energy exceeds the work done on it."""
        u, v = frame.displacement, frame.velocity
        kinetic = float(np.sum(self.loading.masses[:, None] * v**2)) / 2
        stored = kinetic + sum(self.elasticity.energies(self.grid.rest + u))
        stored += float(np.sum(self.loading.springs * u**2)) / 2
        self.most_work = max(self.most_work, abs(frame.work))
        if not stored <= GAIN * self.most_work + self.negligible:
            return False
        seconds = time.perf_counter() - self.began
        self.frames.append(frame)
        step = Step(len(self.frames) - 1, seconds, stored - frame.work, self.unknowns, at=frame.at, phase="time")
        if frame.at > 0:
            self.history.append(step)
            self.tell(Progress(len(self.frames) - 1, self.pace.frames, f"{frame.at:.4g} s"))
        return True

    def solution(self) -> FlexSolution:
        """Return the motion up to the last frame."""
        energies = [step.energy for step in self.history]
        figures = {
            **self.figures,
            "time_step": self.pace.time_step,
            "steps": (len(self.frames) - 1) * self.pace.steps,
            "energy_drift": max(energies, key=abs, default=0.0),
        }
        return FlexSolution(
            self.grid,
            self.frames[-1].at,
            np.stack([frame.displacement for frame in self.frames]),
            np.stack([frame.velocity for frame in self.frames]),
            self.unknowns,
            np.stack([frame.pressing for frame in self.frames]) if self.grid.case.obstacles else None,
            history=tuple(self.history),
            diagnostics=figures,
        )

    @property
    def partial(self) -> FlexSolution | None:
        """Solution up to the failure of a motion; None before the first frame."""
        return self.solution() if len(self.frames) > 1 else None


def solve(case: Case, settings: FlexSettings, progress: ProgressCallback) -> FlexSolution:
    """Follow a motion; see `shellbench_mujoco.solver.MujocoFlexSolver`."""
    with ThreadpoolController().select(internal_api="openblas").limit(limits=1):  # the matrices are small
        return _follow(case, settings, progress)


def _follow(case: Case, settings: FlexSettings, tell: ProgressCallback) -> FlexSolution:
    assert case.dynamics is not None
    began = time.perf_counter()
    grid = Grid(case, settings.cells)
    loading = Loading(grid)
    wanted = settings.time_step or usual_step(Elasticity(grid), loading, settings.damping)
    pace = Pace.from_rates(case.dynamics.until, settings.frame_rate, wanted)
    size = 2 * (pace.frames + 1) * grid.rest.nbytes
    if size > MOST_BYTES:
        raise InputError(
            f"field 'frame_rate': {pace.frames} frames on this grid take {size / 1e9:.1f} GB, choose fewer"
        )
    staggered = settings.staggered and settings.integrator == "Euler"
    figures = {"cells": list(settings.cells), "integrator": settings.integrator, "staggered": staggered}
    course = _Course(grid, pace, tell, figures, began)
    cloth = Cloth.from_grid(grid, loading, settings.integrator, pace.time_step, settings.damping)
    for frame in march(cloth, loading, settings.integrator, staggered, pace):
        if not course.keep(frame):
            break
    if len(course.frames) <= pace.frames:
        reached = course.frames[-1].at if course.frames else 0.0
        raise SolveFailure(
            f"the motion diverges after {reached:.4g} s: steps of {pace.time_step:.3g} s are too long for the"
            f" integrator {settings.integrator}",
            partial=course.partial,
        )
    return course.solution()
