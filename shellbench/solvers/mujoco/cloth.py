"""A case as a model of MuJoCo: a flex of dimension 2 whose every vertex is a body on slide joints.

The engine's own gravity, air, contacts and constraints are off. A component of a vertex that a support holds has no
joint. Springs are those of the joints. Loads are applied forces.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError
from shellbench.solvers.mujoco.grid import Grid
from shellbench.solvers.mujoco.loading import Loading
from shellbench.solvers.mujoco.solver import Integrator

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

TURNING = 1.0  # kg m^2: moments of inertia that every body must have, and that nothing turns
BOTH = 3  # of a flex's `elastic2d`: stretching and bending


@dataclass(frozen=True)
class Cloth:
    """A compiled model and which of its degrees of freedom are which.

    Attributes
    ----------
    model, data
        The engine's own.
    free
        (v, 3) whether a vertex moves, by component; the degrees of freedom are these in their order.
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
        spec.option.disableflags = int(off.mjDSBL_CONTACT | off.mjDSBL_CONSTRAINT | off.mjDSBL_AUTORESET)
        free, springs = ~grid.held, loading.springs
        for vertex, (place, mass) in enumerate(zip(grid.rest, loading.masses, strict=True)):
            body = spec.worldbody.add_body(
                name=str(vertex), pos=place, mass=mass, inertia=[TURNING] * 3, explicitinertial=True
            )
            for axis in np.flatnonzero(free[vertex]):
                body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=np.eye(3)[axis], stiffness=springs[vertex, axis])
        _add_flex(spec, grid, damping)
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

    def push(self, forces: Array) -> None:
        """Set the forces (v, 3) that are applied until others are, N."""
        self.data.qfrc_applied[:] = forces[self.free]

    def set_velocity(self, velocity: Array) -> None:
        """Set the velocities (v, 3), m/s; what is held stays at rest."""
        self.data.qvel[:] = velocity[self.free]

    def step(self, count: int = 1) -> None:
        """Take steps in time."""
        mujoco.mj_step(self.model, self.data, nstep=count)

    @property
    def well(self) -> bool:
        """Whether the engine has warned of nothing, and all numbers are finite."""
        warned = any(int(warning.number) for warning in self.data.warning)
        return not warned and bool(np.isfinite(self.data.qpos).all() and np.isfinite(self.data.qvel).all())


def _add_flex(spec: Any, grid: Grid, damping: float) -> None:
    """Add the flex with the case's stiffnesses.

    It knows one Young's modulus and one thickness. Where a case scales its bending stiffness by a factor f, the
    thickness is h sqrt(f) and the modulus E / sqrt(f): E h stays, and E h^3 becomes f times as large.
    """
    material = grid.case.material
    root = math.sqrt(material.bending_factor)
    flex = spec.add_flex(
        name="cloth",
        dim=2,
        radius=material.thickness / 2,
        young=material.youngs_modulus / root,
        poisson=material.poissons_ratio,
        thickness=material.thickness * root,
        damping=damping,
        elastic2d=BOTH,
        contype=0,
        conaffinity=0,
        selfcollide=mujoco.mjtFlexSelf.mjFLEXSELF_NONE,
    )
    flex.vertbody = [str(vertex) for vertex in range(len(grid.points))]
    flex.vert = np.zeros(grid.rest.size).tolist()
    flex.elem = grid.triangles.ravel().tolist()
