"""Newton's law of cloth in its plane, for the output weights of scalar features and many materials at once.

Cloth does not bend in its plane. The membrane's energy has the stiffness D = E h / (1 - nu^2) (Kairanda et al. 2023,
eqs. (17), (18)), so that thickness and modulus enter only by their product. The general law (`motion_problem`) carries
three components and second derivatives through every evaluation; here both components share one table of slopes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.integrate import solve_ivp

from shellbench.errors import SolveFailure
from shellbench.problems.series.conditioned import ConditionedCase, Material
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.loads import GravityLoad
from shellbench.solvers.ndf.field.ansatz import Combined
from shellbench.solvers.ndf.field.build import build_features, build_inputs
from shellbench.solvers.ndf.field.jets import D1, D2, VALUE, Array, Placement
from shellbench.solvers.ndf.field.network import random_features
from shellbench.solvers.ndf.linear.ritz_field import field_spec
from shellbench.solvers.ndf.linear.ritz_settings import ConditionedSettings, RitzSettings
from shellbench.solvers.ndf.motion.integration import ATOL, RTOL
from shellbench.solvers.ndf.motion.motion import MotionLevel, degree_of, prepare_motion
from shellbench.solvers.ndf.motion.motion_problem import Motion
from shellbench.solvers.ndf.strains.sampled import Sampled
from shellbench.solvers.ndf.strains.smooth import POINTS_A_DEGREE, scales, width_for

PLANE = 2  # components of the motion


def refusal(case: ConditionedCase) -> str | None:
    """Return the reason that the motions of a shell can't be followed here, as one clause, or None if they can."""
    shell = case.shell_of(case.middle)
    if shell.dynamics is not None and shell.dynamics.damped:
        return "its motion is damped"
    if not shell.material.uniform:
        return "its modulus or thickness varies"
    if shell.surface.kind != "plane" or shell.held_everywhere != (PLANE,):
        return "it follows plane cloth that is held in its plane, and no other motions"
    if len(shell.supports) > 1 or shell.obstacles:
        return "it follows cloth that springs alone hold in its plane"
    pulls = [load.acceleration if isinstance(load, GravityLoad) else () for load in shell.loads]
    if not all(pull and all(isinstance(part, int | float) for part in pull) for pull in pulls):
        return "it follows motions under steady gravity alone"
    pulled = np.array([[float(part) for part in pull[:PLANE]] for pull in pulls]).reshape(-1, PLANE).sum(axis=0)
    asked = np.atleast_2d(np.array(case.asked.direction, dtype=float))[:, :PLANE]
    return None if pulled.any() and asked.any() else "nothing moves along what is asked"


def coordinates(material: Material) -> tuple[float, float]:
    """Return log(E h), E h in N/m, and Poisson's ratio: the parameters of plane motion."""
    return float(np.log(material.youngs_modulus * material.thickness)), material.poissons_ratio


def membrane_stiffness(place: Array) -> Array:
    """Return D = E h / (1 - nu^2), N/m, at coordinates (..., 2)."""
    return np.asarray(np.exp(place[..., 0]) / (1 - place[..., 1] ** 2))


@dataclass(frozen=True)
class PlaneMotion:
    """Newton's law of the output weights of scalar features, for many materials at once.

    Attributes
    ----------
    gradients
        (2 N, r): derivatives of the features along x at N points, then along y.
    share
        (N,): area of each point, m^2.
    springs
        (2, r, r): stiffness of the springs, N/m, by component.
    gravity
        (2, r): its force on the weights, N.
    density
        Mass per area, kg/m^2. The features are orthonormal in the area, so that this is the mass of each weight.
    """

    gradients: Array
    share: Array
    springs: Array
    gravity: Array
    density: float

    @classmethod
    def of_features(cls, motion: Motion, features: Combined, sampled: Sampled) -> PlaneMotion:
        """Tabulate features at the sample points."""
        case, jets = motion.case, sampled.jets
        share = motion.areas.numpy()
        values = jets[:, VALUE].numpy()
        stiffness = case.spring_stiffness(sampled.points) * share[:, None]
        force = np.zeros((PLANE, features.count))
        for load in case.loads:
            assert isinstance(load, GravityLoad)
            pull = np.array([float(part) for part in load.acceleration[:PLANE]])
            force += case.material.areal_density * np.outer(pull, share @ values)
        return cls(
            gradients=np.concatenate([jets[:, D1].numpy(), jets[:, D2].numpy()]),
            share=share,
            springs=np.stack([values.T @ (stiffness[:, c, None] * values) for c in range(PLANE)]),
            gravity=force,
            density=case.material.areal_density,
        )

    @property
    def count(self) -> int:
        """Number of features r."""
        return int(self.gradients.shape[1])

    def _stresses(self, weights: Array, places: Array) -> tuple[Array, Array, Array, Array]:
        """Return a_1, a_2 (2, k, N), and strains and stress resultants (3, k, N), as 11, 22, 12, times the area."""
        k = len(places)
        slopes = (weights.reshape(-1, self.count) @ self.gradients.T).reshape(k, PLANE, 2, -1)
        a = slopes.transpose(2, 1, 0, 3) + np.eye(2)[:, :, None, None]  # a_alpha = x,alpha
        strain = np.stack([
            (np.sum(a[0] ** 2, axis=0) - 1) / 2,
            (np.sum(a[1] ** 2, axis=0) - 1) / 2,
            np.sum(a[0] * a[1], axis=0) / 2,
        ])  # fmt: skip
        nu = places[:, 1, None]
        stiffness = membrane_stiffness(places)[:, None] * self.share
        stress = stiffness * np.stack([strain[0] + nu * strain[1], strain[1] + nu * strain[0], (1 - nu) * strain[2]])
        return a[0], a[1], strain, stress

    def accelerations(self, weights: Array, places: Array) -> Array:
        """Return the second time derivative (k, 2, r) of weights (k, 2, r), m/s^2 m, of materials (k, 2)."""
        a1, a2, _, stress = self._stresses(weights, places)
        # n^ab a_b is conjugate to u,a: the normal does not change, so that there is no bending.
        along_x = stress[0] * a1 + stress[2] * a2
        along_y = stress[2] * a1 + stress[1] * a2
        conjugate = np.concatenate([along_x, along_y], axis=-1).transpose(1, 0, 2)
        pull = np.stack([weights[:, c] @ self.springs[c] for c in range(PLANE)], axis=1)
        inner = (conjugate.reshape(-1, conjugate.shape[-1]) @ self.gradients).reshape(weights.shape)
        return np.asarray((self.gravity - inner - pull) / self.density)

    def energies(self, weights: Array, places: Array) -> Array:
        """Return the strain energy (k,), J, that of the springs included."""
        _, _, strain, stress = self._stresses(weights, places)
        stored = np.sum(strain * stress * np.array([1.0, 1.0, 2.0])[:, None, None], axis=(0, 2))
        pull = np.stack([weights[:, c] @ self.springs[c] for c in range(PLANE)], axis=1)
        return np.asarray((stored + np.sum(pull * weights, axis=(1, 2))) / 2)

    def follow(self, places: Array, times: Array) -> tuple[Array, int]:
        """Return weights (k, times, 2, r) of materials (k, 2) from rest, and evaluations of the forces.

        Raises
        ------
        SolveFailure
            If the step of time can't be cut any further.
        """
        shape = (2, len(places), PLANE, self.count)

        def law(_: float, state: Array) -> Array:
            weights, rates = state.reshape(shape)
            return np.concatenate([rates.ravel(), self.accelerations(weights, places).ravel()])

        with np.errstate(invalid="ignore", over="ignore"):  # in steps that are too long
            rest = np.zeros(int(np.prod(shape)))
            found = solve_ivp(law, (0.0, times[-1]), rest, "DOP853", t_eval=times, rtol=RTOL, atol=ATOL)
        if found.status != 0:
            raise SolveFailure(f"the motion can't be followed beyond {found.t[-1] if len(found.t) else 0:.3g} s")
        return np.moveaxis(found.y.reshape(*shape, -1)[0], -1, 1), int(found.nfev)


def features_of(shell: Case, degree: int, settings: ConditionedSettings) -> tuple[Motion, Combined]:
    """Return a rule, and features up to a degree that are orthonormal in the area."""
    spec = field_spec(shell, RitzSettings())
    spec = spec.model_copy(update={"stretched": False, "edge_stretched": False, "multipliers": 0})
    placement, inputs = Placement(), build_inputs(shell, spec)
    spread = placement.tensor(scales(shell, inputs, degree))
    width = settings.neurons if settings.neurons and degree == degree_of(shell, settings.neurons) else None
    network = random_features(spread, width or width_for(shell, degree), settings.seed, spec.activation)
    features = build_features(shell, spec, network, placement, inputs)
    motion = prepare_motion(shell, spec, MotionLevel(degree, features), POINTS_A_DEGREE)
    # The prepared features are orthonormal in all three components, of which one is held.
    values = motion.sampled.jets[:, VALUE]
    assert isinstance(motion.features, Combined)  # features of a network are combined
    root = torch.linalg.cholesky(values.T @ (motion.areas[:, None] * values))
    combine = torch.linalg.solve_triangular(root, motion.features.combine.T, upper=False).T
    return motion, Combined(motion.features.features, combine)


def plane_motion(motion: Motion, features: Combined) -> PlaneMotion:
    """Return Newton's law of features on a rule."""
    return PlaneMotion.of_features(
        motion, features, Sampled.at_points(motion.ansatz(0.0), features, motion.sampled.points)
    )
