"""Following a chain of MuJoCo: a body for each mass, on a hinge about -y at the far end of the link before it.

Bodies hang straight down where all angles are zero. A hinge's angle is that of its link less that of the link before.
Masses are points: the engine requires moments of inertia, and gets negligible ones. The tension of a link is the
engine's own force between a body and the one before it.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError, SolveFailure
from shellbench.problems.rope.case import RopeCase
from shellbench.problems.rope.planar import pulling, start_angles
from shellbench.problems.rope.solution import RopeState
from shellbench.problems.rope.solving import Watch, spans

Array = NDArray[np.float64]

POINT = 1e-12  # kg m^2: moments of inertia; of 1 kg at 0.1 m it is 0.01
PLACES = slice(3, 6)  # of a velocity of MuJoCo, which begins with the turning


def built(case: RopeCase, integrator: str) -> Any:
    """Build and compile the model; InputError if the engine refuses it."""
    assert case.rope is not None
    spec = mujoco.MjSpec()
    spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    spec.option.gravity = [0.0, 0.0, -case.gravity]
    off = mujoco.mjtDisableBit
    spec.option.disableflags = int(off.mjDSBL_CONTACT | off.mjDSBL_CONSTRAINT | off.mjDSBL_AUTORESET)
    body, place = spec.worldbody, np.array(case.rope.root, dtype=float)
    for number, (length, mass) in enumerate(zip(case.rope.link_lengths, case.masses, strict=True)):
        body = body.add_body(
            name=str(number),
            pos=place - [0.0, 0.0, length],
            mass=mass,
            ipos=np.zeros(3),
            inertia=[POINT] * 3,
            explicitinertial=True,
        )
        above = [0.0, 0.0, length]
        body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, -1.0, 0.0], pos=above)
        body.add_site(name=str(number), pos=above)
        spec.add_sensor(type=mujoco.mjtSensor.mjSENS_FORCE, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=str(number))
        place = np.zeros(3)
    try:
        return spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise InputError(f"{case.name}: MuJoCo refuses the chain: {' '.join(str(error).split())}") from None


def followed(case: RopeCase, integrator: str, rate: float, watch: Watch) -> list[RopeState]:
    """Return the states at the case's times; SolveFailure, with those before, if it diverges or a link must push."""
    model = built(case, integrator)
    data = mujoco.MjData(model)
    angles, rates = start_angles(case)
    data.qpos[:], data.qvel[:] = np.diff(angles, prepend=0.0), np.diff(rates, prepend=0.0)
    root = np.array(case.rope.root, dtype=float) if case.rope else np.zeros(3)
    states: list[RopeState] = []
    for until, count, step in spans(case, rate):
        model.opt.timestep = step
        for _ in range(count):
            if watch.due(data.time, step):
                mujoco.mj_kinematics(model, data)
                watch.keep(data.time, nodes_of(data, root))
            mujoco.mj_step(model, data)
            watch.stepped()
            if any(int(warning.number) for warning in data.warning) or not np.isfinite(data.qpos).all():
                raise SolveFailure(f"the motion diverges at t = {data.time:g} s", states)
        mujoco.mj_forward(model, data)
        tensions = pulling(case, until, data.sensordata.reshape(-1, 3)[:, 2].copy(), states)
        states.append(RopeState(nodes_of(data, root), velocities_of(model, data), tensions))
    return states


def nodes_of(data: Any, root: Array) -> Array:
    """Return places of all nodes, (n + 1, 3), m."""
    return np.vstack([root, data.xpos[1:]])


def velocities_of(model: Any, data: Any) -> Array:
    """Return velocities of all nodes, (n + 1, 3), m/s."""
    found = np.zeros((model.nbody, 6))
    for body in range(1, model.nbody):
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, found[body], 0)
    return found[:, PLACES].copy()
