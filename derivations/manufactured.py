r"""Manufactured solutions: a displacement is prescribed, and the load is sought under which the shell takes it.

The energy of a Kirchhoff-Love shell is the integral of (N^ab eps_ab + M^ab kappa_ab) / 2, with N = D H eps and
M = B H kappa (Kairanda et al. 2023, eqs. (17)-(19)). In the linear theory, with

    eps_ab = (x,a . u,b + x,b . u,a) / 2,    kappa_ab = -(u,ab - Gamma^m_ab u,m) . a3

its variation, integrated by parts, gives the equation of Euler and Lagrange

    J f = -(J N^ab x,a),b - (J M^ab a3),ab - (J M^ab Gamma^m_ab a3),m,    J = sqrt(a).

In the exact theory eps and kappa are the changes of the metric and of the curvature, less the sign of the latter, and the
equation holds with x,a, Gamma and a3 of the deformed surface; J and H stay those of the reference.

1. Surface and displacement are Taylor series of order 4 at each point, read from the formulas of a case.
2. Strains and stresses follow as Taylor series of order 2, and the load as their derivatives: exact, up to rounding.
3. A case takes formulas: the load is interpolated at Chebyshev points, and what is left after the least coefficients are
   dropped is written as a nested polynomial.

`python -m derivations.manufactured CASE.toml` prints the load of a case that asks for a `field_error`. In the non-linear
theory it is the load at the end of the path.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import factorial
from pathlib import Path

import numpy as np
from numpy.polynomial import chebyshev
from scipy.optimize import minimize

from shellbench.problems.shell.case import Case, read_case
from shellbench.problems.shell.quantities.quantities import FieldError
from shellbench.problems.taylor import Taylor

from .estimate import Estimate
from .surface_strains import Array

CASES = Path(__file__).parents[1] / "cases"
PAIRS = ((0, 0), (1, 1), (0, 1))
SUMMED = (((0, 0), (0, 0)), ((1, 1), (1, 1)), ((0, 1), (0, 1)), ((1, 0), (0, 1)))
"""Indices a, b of a sum over both orders, each with the pair that stands for it."""
POINTS = 40
"""Chebyshev points a side at which a load is interpolated."""
KEPT = 1e-11
"""Part of the largest load below which a Chebyshev coefficient is dropped."""
MORE_DIGITS = 2
"""Of a coefficient, beyond what is dropped: rounding stays below that."""
TRUNCATED = 1e-11
"""Relative error of a known value, as the load of a case is a polynomial: `manufactured_splines` shows a quarter of it."""
GRID, STEP = 25, 0.02
"""Points a side from which the largest displacement is sought, and the first step."""
GAUSS = 30, 40
"""Points a side of the rules that energies are integrated by."""

Vector = list[Taylor]
Tensor = dict[tuple[int, int], Taylor]
"""By pairs of indices; symmetric ones have those of `PAIRS` alone."""


@dataclass(frozen=True)
class _State:
    """Surface and displacement at points, as series: what the load and the energies are made of."""

    tangents: tuple[Vector, Vector]
    normal: Vector
    area: Taylor
    christoffel: dict[tuple[int, tuple[int, int]], Taylor]
    strains: tuple[Tensor, Tensor]
    stresses: tuple[Tensor, Tensor]


def exact_formulas(case: Case) -> tuple[str | float, str | float, str | float]:
    """Return the formulas of the prescribed displacement."""
    return next(q.exact for q in case.quantities if isinstance(q, FieldError))


def manufactured_load(case: Case, points: Array) -> Array:
    """Return the load per reference area (n, 3) at points (n, 2), Pa."""
    state = _state(case, points)
    membrane, moment = ({pair: state.area * s for pair, s in stress.items()} for stress in state.stresses)
    total = [Taylor.constant(0.0, 0)] * 3
    for (a, b), pair in SUMMED:
        forces = [membrane[pair] * c for c in state.tangents[a]]
        couples = [moment[pair] * c for c in state.normal]
        terms = [_slope(forces, b), _slope(_slope(couples, a), b)]
        terms += [_slope([state.christoffel[m, pair] * c for c in couples], m) for m in (0, 1)]
        for term in terms:
            total = [sum_ - c for sum_, c in zip(total, term, strict=True)]
    return np.stack([np.broadcast_to(c.value / state.area.value, len(points)) for c in total], axis=-1)


def _state(case: Case, points: Array) -> _State:
    x = _series(case.surface.derivatives(points, 4))
    u = _series(case.evaluate(exact_formulas(case), points, order=4))
    reference, moved = (_slope(x, 0), _slope(x, 1)), (_slope(u, 0), _slope(u, 1))
    # 1. Geometry: J^2 is the determinant of the metric, and Gamma^m_ab = a^ml x,l . x,ab.
    metric = {(a, b): _dot(reference[a], reference[b]) for a, b in PAIRS}
    square, inverse = _inverse(metric)
    area = square.power(Taylor.constant(0.5, square.order))
    # The virtual work is done on the deformed surface in the exact theory, on the reference in the linear one.
    tangents = reference if case.linear else tuple(_add(r, m) for r, m in zip(reference, moved, strict=True))
    second = {(a, b): _slope(tangents[a], b) for a, b in PAIRS}
    current_square, current = _inverse({(a, b): _dot(tangents[a], tangents[b]) for a, b in PAIRS})
    normal = [c / current_square.power(Taylor.constant(0.5, square.order)) for c in _cross(*tangents)]
    christoffel = {
        (m, pair): current[m, 0] * _dot(tangents[0], second[pair]) + current[m, 1] * _dot(tangents[1], second[pair])
        for m in (0, 1)
        for pair in PAIRS
    }
    # 2. Strains: half of the change of the metric, and less the change of the curvature.
    strain, bending = {}, {}
    half = Taylor.constant(0.5, square.order)
    reference_normal = [c / area for c in _cross(*reference)]
    for a, b in PAIRS:
        strain[a, b] = half * (_dot(reference[a], moved[b]) + _dot(tangents[b], moved[a]))
        if case.linear:
            bent = _slope(moved[a], b)
            for m in (0, 1):
                bent = [p - christoffel[m, (a, b)] * q for p, q in zip(bent, moved[m], strict=True)]
            bending[a, b] = -_dot(bent, normal)
        else:
            bending[a, b] = _dot(_slope(reference[a], b), reference_normal) - _dot(second[a, b], normal)
    # 3. Stresses: nu a^ab (a^cd eps_cd) + (1 - nu) a^ac a^bd eps_cd, times D or B.
    material = case.material
    stretching = material.youngs_modulus * material.thickness / (1 - material.poissons_ratio**2)
    stresses = [
        _stress(kind, inverse, material.poissons_ratio, factor)
        for kind, factor in ((strain, stretching), (bending, stretching * material.thickness**2 / 12))
    ]
    return _State(tangents, normal, area, christoffel, (strain, bending), (stresses[0], stresses[1]))


def _inverse(metric: Tensor) -> tuple[Taylor, Tensor]:
    """Determinant and inverse of a metric."""
    square = metric[0, 0] * metric[1, 1] - metric[0, 1] * metric[0, 1]
    inverse = {(0, 0): metric[1, 1] / square, (1, 1): metric[0, 0] / square, (0, 1): -metric[0, 1] / square}
    return square, inverse | {(1, 0): inverse[0, 1]}


def _stress(strain: Tensor, inverse: Tensor, poisson: float, factor: float) -> Tensor:
    """Raise the indices of a strain and apply H."""
    found = {}
    for a, b in PAIRS:
        trace = _sum(inverse[c, d] * strain[pair] for (c, d), pair in SUMMED)
        raised = _sum(inverse[a, c] * inverse[b, d] * strain[pair] for (c, d), pair in SUMMED)
        weights = (Taylor.constant(factor * w, trace.order) for w in (poisson, 1 - poisson))
        found[a, b] = next(weights) * inverse[a, b] * trace + next(weights) * raised
    return found


def _series(derivatives: Mapping[tuple[int, int], Array]) -> Vector:
    """Series of the three components from their derivatives (n, 3)."""
    order = max(i + j for i, j in derivatives)
    terms = {(i, j): d / (factorial(i) * factorial(j)) for (i, j), d in derivatives.items()}
    return [Taylor({key: term[:, c] for key, term in terms.items()}, order) for c in range(3)]


def _slope(vector: Vector, axis: int) -> Vector:
    """Derivative along a coordinate: a series of one order less."""
    found = []
    for component in vector:
        terms = {}
        for key, term in component.terms.items():
            if key[axis] and sum(key) <= component.order:
                terms[(key[0] - 1, key[1]) if axis == 0 else (key[0], key[1] - 1)] = key[axis] * term
        found.append(Taylor(terms, component.order - 1))
    return found


def _sum(terms: object) -> Taylor:
    total: Taylor | None = None
    for term in terms:  # type: ignore[attr-defined]
        total = term if total is None else total + term
    assert total is not None
    return total


def _dot(one: Vector, two: Vector) -> Taylor:
    return one[0] * two[0] + one[1] * two[1] + one[2] * two[2]


def _add(one: Vector, two: Vector) -> Vector:
    return [a + b for a, b in zip(one, two, strict=True)]


def _cross(one: Vector, two: Vector) -> Vector:
    return [one[i] * two[j] - one[j] * two[i] for i, j in ((1, 2), (2, 0), (0, 1))]


# --- the load as formulas ----------------------------------------------------------------------------


def load_formulas(case: Case, dropped: float = KEPT) -> tuple[str, str, str]:
    """Return the load as three polynomials in xi1 and xi2, without Chebyshev coefficients below this part of it.

    Raises
    ------
    ValueError
        If the load is not resolved by `POINTS` points a side.
    """
    domain, nodes = case.surface.domain, chebyshev.chebpts1(POINTS)
    middle, half = np.add(domain.upper, domain.lower) / 2, np.subtract(domain.upper, domain.lower) / 2
    points = np.stack(np.meshgrid(nodes, nodes, indexing="ij"), axis=-1).reshape(-1, 2) * half + middle
    values = manufactured_load(case, points).reshape(POINTS, POINTS, 3)
    transform = np.linalg.inv(chebyshev.chebvander(nodes, POINTS - 1))
    coefficients = np.einsum("ip,jq,pqc->cij", transform, transform, values)
    scale = np.abs(values).max()
    if max(np.abs(coefficients[:, -2:]).max(), np.abs(coefficients[..., -2:]).max()) > dropped * scale:
        raise ValueError(f"the load varies too quickly to be a polynomial of degree {POINTS - 1} in each coordinate")
    kept = np.where(np.abs(coefficients) < dropped * scale, 0.0, coefficients)
    places = MORE_DIGITS - round(np.log10(dropped)) - int(np.ceil(np.log10(scale)))
    first, second = (_variable(f"xi{k + 1}", float(middle[k]), float(half[k])) for k in (0, 1))
    x, y, z = (_nested([_nested(row, second, places) for row in _monomials(c)], first, places) for c in kept)
    return x, y, z


def _variable(name: str, middle: float, half: float) -> str:
    """Formula of a coordinate that runs from -1 to 1."""
    shifted = name if middle == 0 else f"({name} - ({middle!r}))"
    return shifted if half == 1 else f"{shifted}/{half!r}"


def _monomials(coefficients: Array) -> Array:
    """Coefficients of powers from those of products of Chebyshev polynomials, trailing zeros cut."""
    size = len(coefficients)
    powers = np.zeros((size, size))
    for n, row in enumerate(np.eye(size)):
        of_one = chebyshev.cheb2poly(row)
        powers[n, : len(of_one)] = of_one
    found = powers.T @ coefficients @ powers
    rows, columns = np.nonzero(coefficients)
    return found[: rows.max(initial=0) + 1, : columns.max(initial=0) + 1]


def _nested(terms: Sequence[float | str], variable: str, places: int) -> str:
    """Return c0 + x*(c1 + x*(c2 + ...)); zeros at the end are left out."""
    words = [term if isinstance(term, str) else f"{round(float(term), places):.15g}" for term in terms]
    while len(words) > 1 and float_or_none(words[-1]) == 0:
        words.pop()
    text = words[-1]
    for word in reversed(words[:-1]):
        text = f"{variable}*({text})" if float_or_none(word) == 0 else f"{word}+{variable}*({text})"
    return text


def float_or_none(text: str) -> float | None:
    """Return the number that a text is; None if it is a formula."""
    try:
        return float(text)
    except ValueError:
        return None


# --- what is known -----------------------------------------------------------------------------------


def manufactured(name: str) -> dict[str, Estimate]:
    """Return the values of all quantities of a case of the project for the prescribed displacement."""
    return values_of(read_case(CASES / f"{name}.toml"))


def values_of(case: Case, truncated: float = TRUNCATED) -> dict[str, Estimate]:
    """Return the values of all quantities for the prescribed displacement; its load is known so well, relative."""
    coarse, fine = (_energies(case, count) for count in GAUSS)
    found = {}
    for quantity in case.quantities:
        if quantity.kind in fine:
            value = fine[quantity.kind]
            found[quantity.name] = Estimate.between(value, coarse[quantity.kind], "J", truncated * value)
        elif quantity.kind == "displacement":
            points = np.array([case.places[name].xi for name in quantity.points])
            directions = np.array(quantity.directions)
            directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
            moved = case.evaluate(exact_formulas(case), points)[0, 0]
            value = float(np.mean(np.sum(moved * directions, axis=-1)))
            found[quantity.name] = Estimate(value, truncated * abs(value), "m")
        elif quantity.kind == "largest_displacement":
            value = largest(case, lambda points: case.evaluate(exact_formulas(case), points)[0, 0])
            found[quantity.name] = Estimate(value, truncated * value, "m")
        else:
            found[quantity.name] = Estimate(0.0, truncated, "")
    return found


def largest(case: Case, displacement: Callable[[Array], Array]) -> float:
    """Return the largest magnitude of a displacement (n, 3) by points (n, 2): the best of a grid, climbed from.

    Its error is the square of the distance to the summit, so that a simplex need not be small.
    """
    candidates = case.surface.domain.grid(GRID, GRID).reshape(-1, 2)
    best = candidates[np.argmax(np.linalg.norm(displacement(candidates), axis=-1))]
    found = minimize(
        lambda xi: -float(np.linalg.norm(displacement(xi[None])[0])),
        best,
        method="Nelder-Mead",
        options={"xatol": 1e-8, "fatol": 0.0, "initial_simplex": best + STEP * np.array([[0, 0], [1, 0], [0, 1]])},
    )
    return -float(found.fun)


def parametric_rule(case: Case, count: int) -> tuple[Array, Array]:
    """Return points (n, 2) and weights (n,) of Gauss's rule on the parametric rectangle, so many points a side."""
    domain, (x, w) = case.surface.domain, np.polynomial.legendre.leggauss(count)
    size = np.subtract(domain.upper, domain.lower)
    points = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
    return (points + 1) / 2 * size + domain.lower, np.outer(w, w).ravel() * np.prod(size) / 4


def _energies(case: Case, count: int) -> dict[str, float]:
    points, weights = parametric_rule(case, count)
    state = _state(case, points)
    membrane, bending = (
        float(weights @ (state.area * _sum(stress[pair] * strain[pair] for _, pair in SUMMED)).value) / 2
        for strain, stress in zip(state.strains, state.stresses, strict=True)
    )
    return {"membrane_energy": membrane, "bending_energy": bending, "strain_energy": membrane + bending}


NAMES = ("manufactured_hypar", "manufactured_oblique_cylinder", "manufactured_paraboloid")
FINITE = "manufactured_finite_strain"
MANUFACTURED = {name: partial(manufactured, name) for name in (*NAMES, FINITE)}
"""Functions that compute the known values, by case."""


if __name__ == "__main__":
    for component, formula in zip("xyz", load_formulas(read_case(Path(sys.argv[1]))), strict=True):
        print(f"{component}: {formula}")
