"""Derivatives of a linear answer by the adjoint: one further solve for all parameters.

The answer on a mesh satisfies R(u; p) . v = 0 for all v that the supports leave free, and C(p) u = g(p). With

    K lambda = Q_u on free degrees of freedom,    C lambda = 0,
    f - K u = C^T mu,    K lambda - Q_u = C^T s,

the derivative of a quantity Q(u; p) is

    dQ/dp = Q_p - lambda . R_p - mu . (C_p lambda) - s . (g_p - C_p u).

It is the derivative of the value on this mesh, whose lines move with the bounds of the surface; it converges as the
value does. C and g change only where directions of supports turn, or prescribed motions change, with the parameter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.measure import unit
from shellbench.problems.shell.quantities.quantities import (
    DisplacementQuantity,
    EnergyQuantity,
    PositionQuantity,
    PotentialEnergy,
    QuantityModel,
    ReactionQuantity,
    TorqueQuantity,
)
from shellbench.problems.shell.quantities.resultant_quantities import COLUMNS, MembraneForce, Moment, TensorResultant
from shellbench.problems.shell.question.parameters import Parameter, changed
from shellbench.solvers.fem.algebra.choices import Method
from shellbench.solvers.fem.algebra.direct_solve import Solve
from shellbench.solvers.fem.derivatives.deviation import Deviation
from shellbench.solvers.fem.derivatives.forms import FIRST, SECOND, Numbers, Works, cross, dot, functions_at, length
from shellbench.solvers.fem.derivatives.variations import Strained, strained
from shellbench.solvers.fem.linear.equilibrium import LinearShell
from shellbench.solvers.fem.mechanics.assembly import InternalForces
from shellbench.solvers.fem.mechanics.constraints import support_conditions
from shellbench.solvers.fem.mechanics.kinematics import (
    DERIVATIVES,
    STRAINS,
    Midsurface,
    elasticities,
    stiffness_moduli,
    strain_operator,
)
from shellbench.solvers.fem.mechanics.loads import Loading
from shellbench.solvers.fem.mechanics.resultants import patch_fits
from shellbench.solvers.fem.mechanics.rigid_motions import nodal_rigid_motions
from shellbench.solvers.fem.mechanics.sharing import Conditions
from shellbench.solvers.fem.mechanics.solution import FemSolution
from shellbench.solvers.fem.mesh.basis import COMPONENTS, Derivative
from shellbench.solvers.fem.mesh.mesh import TensorMesh

Array = NDArray[np.float64]

LOOSE = 1e-8  # work of a quantity on a free rigid motion, over its own size, that is rounding
TURNING = 1e-3  # relative step of the differences of supports' conditions: their error is the fourth power
FIXED = 1e-11  # change of conditions over such a step that is rounding
MEMBRANE_ROWS = 9  # of the root operators, by root strain and component


@dataclass(frozen=True)
class Target:
    """A quantity as a function of the displacement at one state.

    Attributes
    ----------
    slope
        (nodes, dofs) Q_u on the scaled degrees of freedom.
    explicit
        From deviations to Q_p (deviations,) at a fixed displacement.
    """

    slope: Array
    explicit: Callable[[Sequence[Deviation]], Array]


@dataclass(frozen=True)
class Adjoint:
    """The linear shell of a solution, for derivatives of its quantities.

    Attributes
    ----------
    solution
        The answer on one mesh.
    method
        The direct solver.
    """

    solution: FemSolution
    method: Method = "auto"

    @cached_property
    def works(self) -> Works:
        """Virtual works on the mesh."""
        return Works(self.solution.case, self.solution.mesh, self.solution.quadrature_order)

    @cached_property
    def shell(self) -> LinearShell:
        """The assembled shell."""
        found, quadrature = self.solution, self.works.quadrature
        return LinearShell.on_mesh(found.case, found.mesh, found.states, quadrature, self.method)

    @cached_property
    def _factor(self) -> list[Solve]:
        return []  # of K, from the first solve on

    def field(self, nodal: Array) -> Array:
        """Return scaled degrees of freedom (nodes, dofs) as coefficients (nodes, 3, kinds)."""
        mesh = self.solution.mesh
        return np.asarray(nodal.reshape(mesh.node_count, COMPONENTS, -1) / mesh.node_scales[:, None])

    def gradient(self, quantity: QuantityModel, parameters: Sequence[Parameter]) -> Array:
        """Return dQ/dp (parameters,).

        Raises
        ------
        InputError
            If this quantity has no derivative here.
        """
        u = self.solution.coefficients[..., self.solution.state(quantity.at)]
        deviations = [Deviation(self.solution.case, p) for p in parameters]
        return self.total(self.target(quantity, u), u, deviations, quantity.at)

    def total(self, target: Target, u: Array, deviations: Sequence[Deviation], t: float) -> Array:
        """Return the derivatives (deviations,) of a function of the displacement at the load factor t."""
        turned, adjoint = self.opposed(target.slope)
        found = target.explicit(deviations) - self.works.virtual_work(np.stack([u, adjoint], axis=-1), deviations, t)
        return np.asarray(found - np.array([self._turning(off, u, adjoint, turned, t) for off in deviations]))

    def opposed(self, slope: Array) -> tuple[Array, Array]:
        """Return K lambda - Q_u (nodes, dofs), and lambda as coefficients (nodes, 3, kinds)."""
        shell, case, mesh = self.shell, self.solution.case, self.solution.mesh
        if shell.loose.size:
            motions = nodal_rigid_motions(case, mesh) @ shell.loose
            works = np.einsum("ndm,nd->m", motions, slope)
            if np.abs(works).max() > LOOSE * np.abs(motions).max() * np.abs(slope).sum():
                raise InputError("its quantity moves with a rigid motion that nothing holds: it has no derivative here")
        found, answer = shell.solve(
            slope[..., None], np.zeros((*slope.shape, 1)), factor=next(iter(self._factor), None)
        )
        self._factor[:] = [answer.factor]
        return (shell.system @ found)[..., 0] - slope, self.field(found[..., 0])

    def target(self, quantity: QuantityModel, u: Array) -> Target:
        """Return a quantity as a function of the displacement; `u` (nodes, 3, kinds) is the answer."""
        works, case = self.works, self.solution.case
        both, t, nodal = np.stack([u, u], axis=-1), quantity.at, works.scaled(u)[..., None]
        match quantity:
            case DisplacementQuantity():
                return self._at_points(quantity, np.array([unit(d) for d in quantity.directions]), u)
            case PositionQuantity():
                directions = np.tile(unit(quantity.direction), (len(quantity.points), 1))
                return self._at_points(quantity, directions, u)
            case EnergyQuantity():
                parts = {"membrane_energy": (0,), "bending_energy": (1,)}.get(quantity.kind, (0, 1))
                roots = [np.array(root) for root in self.shell.roots]
                for root in roots:
                    by_strain = root.reshape(*root.shape[:2], 6, -1)
                    by_strain[:, :, 3 * (1 - parts[0]) :][:, :, : 3 * (2 - len(parts))] = 0
                slope = InternalForces(works.mesh, works.quadrature, roots)(nodal)[..., 0]
                return Target(slope, lambda offs: works.stress_work(both, offs, parts) / 2)
            case PotentialEnergy():
                loads = Loading.on_mesh(case, works.mesh, works.quadrature, (t,)).nodal
                slope = (self.shell.internal_forces(nodal) - loads)[..., 0]

                def energy(offs: Sequence[Deviation]) -> Array:
                    rest = [works.spring_work(both, off) / 2 - works.load_work(u, off, t) for off in offs]
                    return np.asarray(works.stress_work(both, offs) / 2 + np.array(rest))

                return Target(slope, energy)
            case ReactionQuantity() | TorqueQuantity():
                return self._reaction(quantity, u)
            case MembraneForce() | Moment():
                return self._resultant(quantity, u)
        raise InputError(f"fem gives no derivative of a quantity of kind '{quantity.kind}'")

    def _at_points(self, quantity: DisplacementQuantity | PositionQuantity, directions: Array, u: Array) -> Target:
        works, points = self.works, quantity.coordinates(self.solution)
        vectors = directions / len(points)
        slopes = works.values(u, points, ((1, 0), (0, 1)))
        moved = isinstance(quantity, PositionQuantity)

        def explicit(offs: Sequence[Deviation]) -> Array:
            found = []
            for off in offs:
                slides = np.array([off.slide(name) for name in quantity.points])
                x = off.position(points, 1)
                speeds = slopes + moved * np.real(np.stack([x[1, 0], x[0, 1]], axis=1))
                rise = moved * np.imag(x[0, 0]) / off.step
                found.append(np.sum(vectors * (np.einsum("na,nac->nc", slides, speeds) + rise)))
            return np.array(found)

        return Target(self._spread(points, ((0, 0),), vectors[:, None]), explicit)

    def _spread(self, points: Array, orders: Sequence[Derivative], factors: Array) -> Array:
        """Return the slope (nodes, dofs) of the sum of derivatives of u at points times factors (n, orders, 3)."""
        mesh = self.solution.mesh
        nodes, inside, sizes = mesh.locate(points)
        table = functions_at(mesh, inside, sizes, orders) / mesh.node_scales[nodes][:, None]
        slope = np.zeros((mesh.node_count, COMPONENTS, len(mesh.kinds)))
        np.add.at(slope, nodes.ravel(), np.einsum("noak,noc->nack", table, factors).reshape(-1, *slope.shape[1:]))
        return slope.reshape(mesh.node_count, -1)

    def _resultant(self, quantity: TensorResultant, u: Array) -> Target:
        # Q = sum of w t^ab f_ab over samples of the fits (see `mechanics.resultants`), f_ab = (a_a . e_i)(a_b . e_j)
        # at the point itself; t^ab f_ab is the work of the stresses on strains f.
        works, case, part = self.works, self.solution.case, int(isinstance(quantity, Moment))
        points, shares = quantity.rule(case)
        fits = patch_fits(case, self.solution.mesh, points)
        counts, grid = [len(samples) for samples, _ in fits], np.concatenate([samples for samples, _ in fits])
        at, weights = case.surface.domain.wrap(grid), np.concatenate([fit for _, fit in fits], axis=1)
        i, j = STRAINS[COLUMNS[quantity.component]]

        def projected(x: Mapping[Derivative, Numbers]) -> Numbers:
            """Return f_ab (3, samples) from derivatives (points, 3) of the position."""
            first, second = x[1, 0], x[0, 1]
            axis = first / length(first)
            normal = cross(first, second)
            frame = axis, cross(normal / length(normal), axis)
            (one, two), (other, last) = ([dot(a, frame[k]) for a in (first, second)] for k in (i, j))
            return np.repeat(np.stack([one * other, two * last, (one * last + two * other) / 2]), counts, axis=1)

        x = case.surface.derivatives(at, 2)
        surface = Midsurface.from_position(x)
        moduli = stiffness_moduli(case.surface, case.material, at)[:, part] * np.repeat(shares, counts)
        strains = projected(case.surface.derivatives(case.surface.domain.wrap(points), 1)) * (moduli * weights[0])
        stresses = np.einsum("nst,tn->ns", elasticities(surface, case.material)[:, part], strains)
        rows = strain_operator(surface)[:, 3 * part : 3 * part + 3]
        gradients = works.values(u, grid, DERIVATIVES)

        def explicit(offs: Sequence[Deviation]) -> Array:
            found = []
            for off in offs:
                y, here = off.position(at), off.position(case.surface.domain.wrap(points))
                slides = 1j * off.step * np.array([off.slide(name) for name in quantity.on])
                turned = {
                    (a, b): here[a, b] + slides[:, :1] * here[a + 1, b] + slides[:, 1:] * here[a, b + 1]
                    for a, b in ((1, 0), (0, 1))
                }
                known = strained(y, {FIRST: gradients}, 1)
                tensor = np.zeros((6, len(at)), dtype=complex)
                tensor[3 * part : 3 * part + 3] = projected(turned)
                both = Strained(known.area, known.metric, {**known.strains, SECOND: tensor})
                fit = weights[0] + np.sum(np.repeat(slides, counts, axis=0).T * weights[1:], axis=0)
                sites: Any = off.sites(at)[0]
                stiffness = stiffness_moduli(off.moved.surface, off.moved.material, sites)[:, part]
                ratio = off.moved.material.poissons_ratios[part]
                work = both.work(ratio, part, FIRST, SECOND) * stiffness * fit * np.repeat(shares, counts)
                found.append(off.rate(np.sum(work)))
            return np.array(found)

        return Target(self._spread(grid, DERIVATIVES, np.einsum("ns,nscd->ndc", stresses, rows)), explicit)

    def _reaction(self, quantity: ReactionQuantity | TorqueQuantity, u: Array) -> Target:
        # Q = psi . (K u - f), psi a motion of the nodes with this support alone; the terms m(v) gap are no force of it.
        solution, shell, works = self.solution, self.shell, self.works
        number = [s.name for s in solution.case.supports].index(quantity.support)
        sharing, nodes = shell.ties.sharing, shell.ties.nodes
        if np.any(sharing.holders[sharing.meeting, number]):
            raise InputError(f"support '{quantity.support}' meets another one: fem gives no derivative of its force")
        psi = np.zeros_like(u)
        if isinstance(quantity, TorqueQuantity):
            arms = solution._support_positions.copy()
            arms[:, 0] -= quantity.centre
            psi[nodes] = np.swapaxes(np.cross(unit(quantity.axis), arms), 1, 2)
        else:
            psi[nodes, :, 0] = unit(quantity.direction)
        moved = works.scaled(psi)
        moved[nodes] *= sharing.holders[:, number]
        slope = shell.internal_forces(moved[..., None])[..., 0]
        for clamp in shell.clamps:
            slope += clamp.transposed_gap(moved)
        both = np.stack([u, self.field(moved)], axis=-1)

        def explicit(offs: Sequence[Deviation]) -> Array:
            if isinstance(quantity, TorqueQuantity) and any(off.moves_surface for off in offs):
                raise InputError("fem gives no derivative of a torque by a number of the surface")
            whole = works.virtual_work(both, offs, quantity.at)
            rest = [
                works.clamp_work(both, off, quantity.at, symmetric=False) - works.clamp_work(both, off, quantity.at)
                for off in offs
            ]
            return np.asarray(whole + np.array(rest))

        return Target(slope, explicit)

    def _turning(self, off: Deviation, u: Array, adjoint: Array, turned: Array, t: float) -> float:
        """Return mu . (C_p lambda) + s . (g_p - C_p u): zero unless conditions of supports change."""
        turned_by = self.turns(off, t)
        if turned_by is None:
            return 0.0
        shell, works, mesh = self.shell, self.works, self.solution.mesh
        at_rest, rates = turned_by
        nodal, opposite = works.scaled(u), works.scaled(adjoint)
        loads = Loading.on_mesh(self.solution.case, mesh, works.quadrature, (t,)).nodal
        for clamp in shell.clamps:
            loads = loads + clamp.right_hand_side(mesh.node_count)[..., :1]
        forces = (loads - shell.system @ nodal[..., None])[..., 0]
        found = 0.0
        for node in shell.ties.nodes:
            own = [(k, np.flatnonzero(c.nodes == node)) for k, c in enumerate(at_rest)]
            rows, row_rates, value_rates = (
                np.concatenate([part[k][at].reshape(-1, *part[k].shape[2:]) for k, at in own])
                for part in ([c.rows for c in at_rest], *rates)
            )
            held = np.linalg.pinv(rows.T)
            found += float(held @ forces[node] @ (row_rates @ opposite[node]))
            found += float(held @ turned[node] @ (value_rates - row_rates @ nodal[node]))
        return found

    def turns(self, off: Deviation, t: float) -> tuple[list[Conditions], list[list[Array]]] | None:
        """Return `turning` of the solution's case on its mesh."""
        return turning(self.solution.case, self.solution.mesh, off, t)


def turning(
    case: Case, mesh: TensorMesh, off: Deviation, t: float
) -> tuple[list[Conditions], list[list[Array]]] | None:
    """Return the conditions of supports, and the derivatives of rows and of values; None if they do not change."""
    if not off.moves_surface:
        return None
    step = TURNING * (abs(off.parameter.value) or 1.0)
    stated = [_conditions(case, mesh, off, k * step, t) for k in (-2, -1, 0, 1, 2)]
    rates, changes = [], 0.0
    for name in ("rows", "values"):
        every = [[getattr(c, name) for c in some] for some in zip(*stated, strict=True)]
        size = max((float(np.abs(one[2]).max(initial=0.0)) for one in every), default=0.0)
        change = max((float(np.ptp(one, axis=0).max(initial=0.0)) for one in every), default=0.0)
        changes = max(changes, change / size if size else 0.0)
        rates.append([(one[0] - 8 * one[1] + 8 * one[3] - one[4]) / (12 * step) for one in every])
    return (stated[2], [rates[0], [values[..., 0] for values in rates[1]]]) if changes > FIXED else None


def _conditions(case: Case, mesh: TensorMesh, off: Deviation, step: float, t: float) -> list[Conditions]:
    """Return the conditions of supports with the parameter off by a real step, on the mesh that follows it."""
    if step:
        moved = changed(case, off.parameter, off.parameter.value + step)
        old, new = mesh.domain, moved.surface.domain

        def follow(xi: Array, axis: int) -> Array:
            return np.asarray(new.lower[axis] + (xi - old.lower[axis]) / old.size[axis] * new.size[axis])

        units = [180 / np.pi if angle else 1.0 for angle in new.angle]
        points = {
            name: tuple(float(follow(np.asarray(x), k)) * units[k] for k, x in enumerate(old.internal(xi)))
            for name, xi in case.points.items()
        }
        case = moved.model_copy(update={"points": points})
        first, second = (follow(line, axis) for axis, line in enumerate(mesh.lines))
        mesh = TensorMesh(new, (first, second), mesh.degree, mesh.folds)
    return list(support_conditions(case, mesh, (t,)))
