"""Derivatives of frequencies and buckling loads.

With K x = omega^2 M x, or (K + G(u)) x = omega^2 M x about a loaded state, and K x = -mu G(u) x,

    d(omega^2)/dp = (x . (K_p + G') x - omega^2 x . M_p x) / (x . M x),
    dmu/dp = -(x . K_p x + mu x . G' x) / (x . G x),

x . G x = g(u, x) is linear in the linear answer u to the loads. Its derivative is that of a quantity of this answer,

    x . G' x = g_p - lambda . R_p,    K lambda = g_u    (see `adjoint`).

A mode whose value occurs twice has no derivative.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError
from shellbench.problems.shell.quantities.quantities import ModeQuantity
from shellbench.problems.shell.question.parameters import Parameter, parameters_of
from shellbench.solvers.fem.derivatives.adjoint import Adjoint, Target
from shellbench.solvers.fem.derivatives.deviation import Deviation
from shellbench.solvers.fem.derivatives.forms import FIRST, SECOND, Works, rates, work_of
from shellbench.solvers.fem.derivatives.variations import strained
from shellbench.solvers.fem.linear.equilibrium import solve
from shellbench.solvers.fem.linear.modes import FULL_LOAD
from shellbench.solvers.fem.mechanics.assembly import derivatives_on_cells
from shellbench.solvers.fem.mechanics.kinematics import (
    DERIVATIVES,
    Midsurface,
    elasticities,
    stiffness_moduli,
    strain_operator,
)
from shellbench.solvers.fem.mechanics.solution import FemSolution
from shellbench.solvers.fem.mesh.basis import COMPONENTS
from shellbench.solvers.fem.mesh.quadrature import basis_scales, cell_portions

Array = NDArray[np.float64]

TWICE = 1e-5  # relative distance of two values of modes that are one
BENT = (0, 2)  # the second variation of the strains by v
PRESTRESS = work_of(FIRST, BENT)  # half of the density of g(u, x)


def mode_gradient(solution: FemSolution, quantity: ModeQuantity, parameters: Sequence[Parameter]) -> Array:
    """Return the derivatives (parameters,) of a mode's value.

    Raises
    ------
    InputError
        If the value occurs twice, or supports turn with a parameter.
    """
    case, found = solution.case, solution.mode_values
    value = found[quantity.number]
    if any(abs(other - value) <= TWICE * value for number, other in found.items() if number != quantity.number):
        raise InputError(f"mode {quantity.number} has the value of another one, so that it has no derivative")
    adjoint, deviations = Adjoint(solution), [Deviation(case, p) for p in parameters]
    if any(adjoint.turns(off, FULL_LOAD) for off in deviations):
        raise InputError("its supports turn with a parameter: fem gives no derivative of its modes")
    works, mode = adjoint.works, solution.coefficients[..., solution.state(quantity.mark)]
    twice = np.stack([mode, mode], axis=-1)
    stiff = works.stress_work(twice, deviations)
    stiff += [works.spring_work(twice, off) + works.clamp_work(twice, off, None) for off in deviations]
    held = bool(case.loads) or any(support.motion is not None for support in case.supports)
    geometric, prestress = _prestress(adjoint, mode, deviations) if held else (0.0, np.zeros(len(deviations)))
    if quantity.kind == "buckling_load":
        return -(stiff + value * prestress) / geometric
    plain = Deviation(case, parameters_of(case)["material.youngs_modulus"])
    squared, mass = (2 * math.pi * value) ** 2, works.products(twice, plain, works.mass_density).real
    inertia = np.array([off.rate(works.products(twice, off, works.mass_density)) for off in deviations])
    return (stiff + prestress - squared * inertia) / (mass * 8 * math.pi**2 * value)


def _prestress(adjoint: Adjoint, mode: Array, deviations: Sequence[Deviation]) -> tuple[float, Array]:
    """Return g(u, x) and its derivatives."""
    solution = adjoint.solution
    order = 2 * solution.mesh.degree + 1
    loaded = Adjoint(solve(solution.case, solution.mesh, (FULL_LOAD,), order, adjoint.method).solution)
    works, u = adjoint.works, loaded.solution.coefficients[..., 0]
    both = np.stack([u, mode], axis=-1)
    slope = second_variation_slope(works, mode)

    def explicit(offs: Sequence[Deviation]) -> Array:
        return 2 * rates(offs, works.on_cells(both, offs, PRESTRESS, order=2))

    return float(np.sum(slope * works.scaled(u))), loaded.total(Target(slope, explicit), u, deviations, FULL_LOAD)


def second_variation_slope(works: Works, mode: Array) -> Array:
    """Return g_u (nodes, dofs): the work of any displacement's stresses on twice the second variation by a mode."""
    mesh, case, quadrature = works.mesh, works.case, works.quadrature
    table, kinds = quadrature.table(DERIVATIVES, mesh.basis), len(mesh.kinds)
    slope = np.zeros((mesh.node_count, COMPONENTS, kinds))
    for cells in cell_portions(mesh):
        points, weights = quadrature.on_cells(mesh, cells)
        flat, nodes, sizes = points.reshape(-1, 2), mesh.nodes[cells], mesh.sizes[cells]
        x = case.surface.derivatives(flat, order=2)
        surface = Midsurface.from_position(x)
        gradients = derivatives_on_cells(mesh, cells, quadrature, mode[..., None])[..., 0]
        bent = 2 * strained(x, {SECOND: gradients}, 2).strains[BENT].T.reshape(-1, 2, 3, 1)
        stresses = (elasticities(surface, case.material) @ bent)[..., 0]
        stresses *= stiffness_moduli(case.surface, case.material, flat)[..., None]
        stresses *= (weights.ravel() * surface.area)[:, None, None]
        rows = np.einsum("ns,nscd->ndc", stresses.reshape(-1, 6), strain_operator(surface))
        steps = np.stack([sizes[:, 0] ** i * sizes[:, 1] ** j for i, j in DERIVATIVES], axis=-1)
        spread = rows.reshape(len(nodes), -1, len(DERIVATIVES), COMPONENTS) / steps[:, None, :, None]
        local = np.einsum("kf,ekc->efc", table, spread.reshape(len(nodes), -1, COMPONENTS))
        local = local.reshape(len(nodes), -1, kinds, COMPONENTS) * basis_scales(mesh, cells)[..., None]
        np.add.at(slope, nodes, np.swapaxes(local, 2, 3))
    return slope.reshape(mesh.node_count, -1)
