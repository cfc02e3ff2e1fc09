"""The isogeometric answer: a continuous field through its own rational B-splines.

Strains, energies and forces of a displacement field on a patch, from the theory and not from Kratos.

They express Kratos' answer in the terms of the case, and measure its balance with the loads: an error in the use of
the engine would appear as a residual.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.conditions import Material
from shellbench.problems.shell.solution import Arrays, ShellSolution, Words, state_number
from shellbench.problems.shell.symmetry.symmetry import Part, part_of, whole_of
from shellbench_kratos.iga_conditions import control_forces, held_by
from shellbench_kratos.nurbs import Midsurface, NurbsPatch, midsurface_of

Array = NDArray[np.float64]
Derivatives = Mapping[tuple[int, int], Array]

SECOND = ((2, 0), (0, 2), (1, 1))
SPANS_AT_ONCE = 32  # rows of spans that are integrated at once, which bounds the memory


@dataclass(frozen=True)
class Frame:
    """A surface's base vectors, normal and second derivatives at points.

    Attributes
    ----------
    a1, a2, normal
        (..., 3); the normal is a1 x a2 divided by its length.
    area
        (...,) that length.
    second
        Second derivatives 11, 22, 12, (..., 3) each.
    """

    a1: Array
    a2: Array
    normal: Array
    area: Array
    second: tuple[Array, Array, Array]

    @classmethod
    def from_derivatives(cls, x: Derivatives) -> Frame:
        """Return the frame of positions given with their derivatives."""
        cross = np.cross(x[1, 0], x[0, 1])
        area = np.linalg.norm(cross, axis=-1)
        return cls(x[1, 0], x[0, 1], cross / area[..., None], area, (x[2, 0], x[0, 2], x[1, 1]))

    @property
    def metric(self) -> Array:
        """Covariant metric 11, 22, 12, (..., 3)."""
        return np.stack([_dot(self.a1, self.a1), _dot(self.a2, self.a2), _dot(self.a1, self.a2)], axis=-1)

    @property
    def curvature(self) -> Array:
        """Covariant curvature 11, 22, 12, (..., 3)."""
        return np.stack([_dot(x, self.normal) for x in self.second], axis=-1)

    def tilt(self, first: Array, second: Array) -> Array:
        """Return the change (..., 3) of the normal under small changes of the base vectors."""
        change = np.cross(first, self.a2) + np.cross(self.a1, second)
        return np.asarray((change - _dot(change, self.normal)[..., None] * self.normal) / self.area[..., None])


def _dot(first: Array, second: Array) -> Array:
    return np.asarray(np.einsum("...i,...i->...", first, second))


def strains(x: Derivatives, u: Derivatives, linear: bool) -> Array:
    """Return membrane and bending strains (..., 2, 3) of a displacement, given with its derivatives.

    eps = (a - abar)/2 and kappa = bbar - b, components 11, 22, 12; linearised if asked for.
    """
    rest = Frame.from_derivatives(x)
    if not linear:
        moved = Frame.from_derivatives({key: x[key] + u[key] for key in x})
        return np.stack([(moved.metric - rest.metric) / 2, rest.curvature - moved.curvature], axis=-2)
    shear = (_dot(rest.a1, u[0, 1]) + _dot(rest.a2, u[1, 0])) / 2
    membrane = np.stack([_dot(rest.a1, u[1, 0]), _dot(rest.a2, u[0, 1]), shear], axis=-1)
    tilt = rest.tilt(u[1, 0], u[0, 1])
    bending = [-_dot(u[k], rest.normal) - _dot(s, tilt) for k, s in zip(SECOND, rest.second, strict=True)]
    return np.stack([membrane, np.stack(bending, axis=-1)], axis=-2)


def stresses(x: Derivatives, strain: Array, material: Material) -> Array:
    """Return n^ab and m^ab (..., 2, 3), contravariant components 11, 22, 12, of strains (..., 2, 3).

    n^ab = D (nu a^ab a^cd + (1 - nu) a^ac a^bd) eps_cd, and m with B (Kairanda et al. 2023, eqs. (17)-(19)).
    """
    a11, a22, a12 = np.moveaxis(Frame.from_derivatives(x).metric, -1, 0)
    inverse = (
        np.stack([np.stack([a22, -a12], -1), np.stack([-a12, a11], -1)], -2) / (a11 * a22 - a12**2)[..., None, None]
    )
    tensor = strain[..., [[0, 2], [2, 1]]]
    raised = np.einsum("...ac,...kcd,...db->...kab", inverse, tensor, inverse)
    trace = np.einsum("...cd,...kcd->...k", inverse, tensor)
    nu = material.poissons_ratio
    full = nu * trace[..., None, None] * inverse[..., None, :, :] + (1 - nu) * raised
    stiffness = np.array([material.membrane_stiffness, material.bending_stiffness])
    return np.asarray(np.stack([full[..., 0, 0], full[..., 1, 1], full[..., 0, 1]], axis=-1) * stiffness[:, None])


def densities(x: Derivatives, strain: Array, material: Material) -> Array:
    """Return the membrane and the bending energy per area (..., 2), J/m^2."""
    work = stresses(x, strain, material) * strain * np.array([1.0, 1.0, 2.0])
    return np.asarray(work.sum(axis=-1) / 2)


@dataclass(frozen=True)
class Integrals:
    """Integrals of a displacement field over a patch.

    Attributes
    ----------
    energies
        (2,) membrane and bending energy, J.
    forces
        (3, n1, n2) internal forces: the derivatives of the energy with respect to the control points' displacements, N.
    """

    energies: Array
    forces: Array


def integrals(case: Case, patch: NurbsPatch, control_points: Array, displacements: Array) -> Integrals:
    """Integrate energy and internal forces of displacements (n1, n2, 3), by Gauss's rule on each span."""
    energies, forces = np.zeros(2), np.zeros((3, *patch.shape))
    nodes, weights = zip(*(basis.gauss(basis.degree + 1) for basis in patch.bases), strict=True)
    step = SPANS_AT_ONCE * (patch.bases[0].degree + 1)
    starts = [*range(0, len(nodes[0]), step), len(nodes[0])]
    right = patch.bases[1].matrices(nodes[1])
    for low, high in pairwise(starts):
        left = patch.bases[0].matrices(nodes[0][low:high])
        x, u = (patch.on_grid(field, nodes[0][low:high], nodes[1]) for field in (control_points, displacements))
        strain = strains(x, u, case.linear)
        weight = np.outer(weights[0][low:high], weights[1]) * Frame.from_derivatives(x).area
        energies += np.einsum("gh,ghk->k", weight, densities(x, strain, case.isotropic))
        stress = stresses(x, strain, case.isotropic) * weight[..., None, None]
        frame = Frame.from_derivatives(x if case.linear else {key: x[key] + u[key] for key in x})
        for (i, j), density in _work(frame, stress).items():
            forces += patch.gather(left[i], density, right[j])
    return Integrals(energies, forces)


def _work(frame: Frame, stress: Array) -> dict[tuple[int, int], Array]:
    """Return the conjugates of the derivatives of a displacement (..., 3), for stresses (..., 2, 3)."""
    n, m = stress[..., 0, :, None], stress[..., 1, :, None]
    # delta kappa_ab = -(delta u,ab . a3 + x,ab . delta a3), and delta a3 is linear in delta u,1 and delta u,2
    pull = -(m[..., 0, :] * frame.second[0] + m[..., 1, :] * frame.second[1] + 2 * m[..., 2, :] * frame.second[2])
    pull -= _dot(pull, frame.normal)[..., None] * frame.normal
    pull /= frame.area[..., None]
    return {
        (1, 0): n[..., 0, :] * frame.a1 + n[..., 2, :] * frame.a2 + np.cross(frame.a2, pull),
        (0, 1): n[..., 1, :] * frame.a2 + n[..., 2, :] * frame.a1 + np.cross(pull, frame.a1),
        (2, 0): -m[..., 0, :] * frame.normal,
        (0, 2): -m[..., 1, :] * frame.normal,
        (1, 1): -2 * m[..., 2, :] * frame.normal,
    }


Lines = tuple[tuple[float, ...], tuple[float, ...]]


@dataclass(frozen=True)
class IgaSolution(ShellSolution):
    """A displacement field on a NURBS patch, at one or several load factors.

    Attributes
    ----------
    part, midsurface
        The part of the case's shell that was solved, and its NURBS surface.
    coefficients
        (n1, n2, 3, states) displacements of the control points, m.
    states, factors
        Marks of the path (see `path.Path`), and load factors there: the same where the load is prescribed.
    parameters
        Components of control points that were solved for.
    """

    formats: ClassVar[tuple[str | int, ...]] = ("kratos-iga, format 1",)
    numbers: ClassVar[tuple[str, ...]] = ("coefficients",)

    part: Part
    midsurface: Midsurface
    coefficients: Array
    states: tuple[float, ...]
    factors: tuple[float, ...]
    parameters: int

    @property
    def case(self) -> Case:
        """The solved case."""
        return self.part.whole

    @property
    def degree(self) -> int:
        """Degree of the splines."""
        return self.midsurface.patch.bases[0].degree

    @property
    def lines(self) -> Lines:
        """Knot lines of the part, as values of the coordinates."""
        first, second = self.midsurface.patch.bases
        return first.lines, second.lines

    @property
    def storage_bytes(self) -> int:
        """Bytes of the coefficients and the knot lines; weights and control points follow from the case."""
        return super().storage_bytes + sum(8 * len(lines) for lines in self.lines)

    def state(self, at: float | None) -> int:
        """Return the number of a mark of the path; InputError if the case was not solved at it."""
        return state_number(self.case, self.states, at)

    def displacement_at(self, xi: Array, at: float | None) -> Array:
        """Return the displacement (N, 3) at points (N, 2)."""
        folded = self.part.fold(xi)
        coefficients = self.coefficients[..., self.state(at)]
        return self.midsurface.patch.derivatives(coefficients, folded.points, order=0)[0, 0] * folded.signs

    def field_at(self, name: str, xi: Array, at: float | None) -> Array:
        """Return strains (N, 3) or energy densities (N,) at points (N, 2)."""
        folded = self.part.fold(xi)
        patch = self.midsurface.patch
        x = self.case.surface.derivatives(self.case.surface.domain.wrap(folded.points), order=2)
        u = patch.derivatives(self.coefficients[..., self.state(at)], folded.points)
        strain = strains(x, u, self.case.linear)
        number = 0 if name.startswith("membrane") else 1
        if name.endswith("density"):
            return densities(x, strain, self.case.isotropic)[:, number]
        # where one coordinate runs the other way, components 12 have the other sign
        strain[..., 2] *= folded.turned.prod(axis=-1)[:, None]
        return strain[:, number]

    @cached_property
    def _integrals(self) -> list[Integrals]:
        surface = self.midsurface
        return [
            integrals(self.case, surface.patch, surface.control_points, self.coefficients[..., number])
            for number in range(len(self.states))
        ]

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Return the membrane and the bending part of the strain energy of the whole shell, J."""
        membrane, bending = self._integrals[self.state(at)].energies * self.part.copies
        return float(membrane), float(bending)

    def reaction_at(self, number: int, centre: Array, at: float | None) -> tuple[Array, Array]:
        """Return force (3,) in N and moment (3,) about `centre` in N m that a support exerts on the shell.

        They are the forces that its control points lack for equilibrium: internal forces less loads. Rigid motions of
        the field are those of its control points. The forces' moment about the centre is therefore the support's.
        """
        state, patch = self.state(at), self.midsurface.patch
        lacking = self._integrals[state].forces - control_forces(self.part.case, patch, self.factors[state])
        places = self.midsurface.control_points
        if not self.case.linear:
            places = places + self.coefficients[..., state]
        force, moment = np.zeros(3), np.zeros(3)
        for mirrors in self.part.images():
            acting = held_by(self.part, number, mirrors, patch.shape)
            forces, arms = np.moveaxis(np.where(acting, lacking, 0.0), 0, -1), places
            for mirror in mirrors:
                forces, arms = forces * mirror.signs, mirror.reflected_positions(arms)
            force += forces.sum(axis=(0, 1))
            moment += np.cross(arms - centre, forces).sum(axis=(0, 1))
        return force, moment

    def kept(self) -> tuple[Words, Arrays]:
        """Return the data of a file beside the case and the history."""
        return {"degree": self.degree, "symmetry": bool(self.part.mirrors)}, {
            "lines1": np.asarray(self.lines[0]),
            "lines2": np.asarray(self.lines[1]),
            "coefficients": self.coefficients,
            "states": np.asarray(self.states),
            "factors": np.asarray(self.factors),
        }

    @classmethod
    def restored(cls, case: Case, words: Words, arrays: Arrays) -> IgaSolution:
        """Make a solution from the content of a file; ValueError or KeyError if it is inconsistent."""
        degree, lines1, lines2 = int(words["degree"]), arrays["lines1"].tolist(), arrays["lines2"].tolist()
        coefficients, states = arrays["coefficients"], tuple(arrays["states"].tolist())
        factors = tuple(arrays["factors"].tolist())
        if len(factors) != len(states) or coefficients.shape != (
            len(lines1) - 1 + degree,
            len(lines2) - 1 + degree,
            3,
            len(states),
        ):
            raise ValueError("coefficients do not fit the knot lines")
        lines = (tuple(lines1), tuple(lines2))
        return cls(
            part_of(case) if words["symmetry"] else whole_of(case),
            midsurface_of(case.surface, lines, degree, case.surface.domain.angle),
            coefficients,
            states,
            factors,
            int(words["parameters"]),
        )
