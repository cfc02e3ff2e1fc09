"""Derivatives without the mechanics of a solver: from the energies of its answer, or by differences of its answers.

A Ritz method makes the potential energy P(u; p) = U - W stationary. In linear theory with supports at rest U = -P, and

    dU/dp = -P_p:    -U/E,    -(U_m + 3 U_b)/h,    -U_b/f of the factor of bending,    2 U of that of the only load,

with U_m and U_b the membrane and the bending part. This is exact for the answer in its own functions (of a neural
field: the output layer moves with p, hidden layers stay), and the error of U is of second order. A displacement that
the loads average, such as that under a single force, is 2 U / F. Nothing follows so for other displacements, or at
finite strain.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.quantities import (
    DerivativeQuantity,
    DisplacementQuantity,
    EnergyQuantity,
    QuantityModel,
)
from shellbench.problems.shell.question.loads import PointLoad
from shellbench.problems.shell.question.parameters import changed

DERIVATIVES = "derivatives"  # in diagnostics: by quantity and parameter
CHANGE = 0.01  # of a parameter: differences of fourth order with steps of this size and twice that
SAME = 1e-9  # relative difference of forces, and of directions, that is rounding


def averaged_force(case: Case, quantity: QuantityModel) -> float | None:
    """Return F in Q = 2 U / F, N, if the loads average a displacement; None if they do not."""
    if not isinstance(quantity, DisplacementQuantity) or not all(isinstance(x, PointLoad) for x in case.loads):
        return None
    pulls = [(n, x) for x in case.loads if isinstance(x, PointLoad) for n in x.on]
    acting = {n: np.array(case.evaluate(x.force, np.zeros(2))[0, 0]) for n, x in pulls}
    if set(acting) != set(quantity.points) or len(acting) != len(pulls):
        return None
    sizes = [float(np.linalg.norm(acting[name])) for name in quantity.points]
    units = [np.array(d) / np.linalg.norm(d) for d in quantity.directions]
    pairs = zip(quantity.points, units, strict=True)
    same = all(np.linalg.norm(acting[name] - sizes[0] * d) <= SAME * sizes[0] for name, d in pairs)
    return len(sizes) * sizes[0] if same else None


def why_not_from_energies(case: Case, quantity: QuantityModel, name: str) -> str | None:
    """Return the reason that energies alone give no such derivative, as one clause, or None if they do."""
    at_rest = case.linear and not case.modal and not case.springs and all(s.motion is None for s in case.supports)
    if not at_rest:
        return "it gives derivatives from energies, in linear theory with supports at rest and without springs"
    if quantity.kind != "strain_energy" and averaged_force(case, quantity) is None:
        return "it gives derivatives of the strain energy, and of displacements that the loads average"
    known = ["material.youngs_modulus", "material.thickness", "material.bending_factor"]
    if len(case.loads) == 1:
        known.append("loads.1")
    return None if name in known else f"it gives derivatives by {', '.join(known)}"


def from_energies(solution: Any, quantity: QuantityModel, name: str) -> float:
    """Return dQ/dp of a quantity for which `why_not_from_energies` finds no reason."""
    case = solution.case
    if reason := why_not_from_energies(case, quantity, name):
        raise ValueError(reason)
    membrane, bending = solution.energies(quantity.at)
    material = case.material
    change = {
        "material.youngs_modulus": -(membrane + bending) / material.youngs_modulus,
        "material.thickness": -(membrane + 3 * bending) / material.thickness,
        "material.bending_factor": -bending / material.bending_factor,
        "loads.1": membrane + bending,
    }[name]
    force = averaged_force(case, quantity)
    if name == "loads.1" and force is None:
        change *= 2
    return float(change if force is None or isinstance(quantity, EnergyQuantity) else 2 * change / force)


def by_differences(case: Case, solve: Callable[[Case], Any]) -> Any:
    """Return a solver's answer with the derivatives that the case asks for, by differences of its answers.

    A derivative of a quantity without a stated uncertainty has none. Another one has the same relative uncertainty,
    and that of its difference: how far the orders two and four are apart.
    """
    asked = [q for q in case.quantities if isinstance(q, DerivativeQuantity)]
    plain = case.without([q.name for q in asked]) if asked else case
    solution, found, unsure = solve(plain), dict[str, float](), dict[str, float]()
    for name in dict.fromkeys(q.with_respect_to for q in asked):
        p = next(q for q in asked if q.with_respect_to == name).parameter(case)
        size = abs(p.value) or 1.0
        others = [
            solve(Case.model_validate(changed(plain, p, p.value + k * CHANGE * size).data() | {"name": case.name}))
            for k in (-2, -1, 1, 2)
        ]
        for q in (q for q in asked if q.with_respect_to == name):
            values = [case.quantity(q.derivative_of).measure(other) for other in others]
            second = (values[2] - values[1]) / (2 * CHANGE * size)
            fourth = (4 * second - (values[3] - values[0]) / (4 * CHANGE * size)) / 3
            found[key(q.derivative_of, name)] = fourth
            if (own := solution.uncertainty.get(q.derivative_of)) is not None:
                value = abs(case.quantity(q.derivative_of).measure(solution))
                unsure[q.name] = abs(fourth - second) + (own / value * abs(fourth) if value else 0.0)
    if not asked:
        return solution
    more = {**solution.diagnostics, DERIVATIVES: found}
    return replace(solution, case=case, diagnostics=more, uncertainty={**solution.uncertainty, **unsure})


def key(quantity: str, parameter: str) -> str:
    """Return the key of a derivative in diagnostics."""
    return f"{quantity} by {parameter}"
