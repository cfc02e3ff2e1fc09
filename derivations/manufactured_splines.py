r"""Manufactured solutions once more: the shell is solved under the load that its case declares.

The trial functions are splines along the vectors x,1, x,2 and x,1 cross x,2, which meet the clamped edges exactly
(`linear_splines`). What supports move is added to them as the formula of the motion itself, which must tilt no edge. In the
exact theory the trial functions are splines of Cartesian components, from positions (`spline_shell`). They have no slope
across a clamped edge at all: more than a clamp asks, and no more than the prescribed displacement has.

Nothing here knows the prescribed displacement but the error that is asked for, and the strong form is not used: strains are
products of vectors, or of positions, and loads and stresses are tested by the splines.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from shellbench.problems.shell.case import Case, read_case
from shellbench.problems.shell.question.conditions import Value
from shellbench.problems.shell.question.loads import AreaLoad

from .estimate import Estimate
from .linear_splines import Answer, Field, LinearShell, elasticity
from .manufactured import CASES, exact_formulas, largest, manufactured_load, parametric_rule
from .spline_path import load_control
from .spline_shell import Ends, Shell, Splines
from .surface_strains import DERIVATIVES, Array, first_variation

DEGREE = 7
SPANS = 6, 9
"""Knot spans a side, coarser and finer."""
SAMPLES = 12
"""Gauss points a side at which the error of the field is integrated."""
ROUNDING = 1e-11
"""Relative: the condition of the stiffness."""
QUADRATURE = 40
"""Gauss points a side of the weak form."""
CLAMPED: Sequence[tuple[Ends, Ends]] = [
    (("zero", "zero"), ("zero", "zero")),
    (("zero", "zero"), ("zero", "zero")),
    (("clamped", "clamped"), ("clamped", "clamped")),
]


def _points(one: Array, two: Array) -> Array:
    return np.stack([one, two], axis=-1)


def surface_of(case: Case) -> Field:
    """Return the derivatives of a case's midsurface."""
    return lambda one, two, i, j: case.surface.derivatives(_points(one, two), i + j)[i, j]


def frame_of(case: Case) -> Field:
    """Return the derivatives of x,1, x,2 and their cross product."""

    def frame(one: Array, two: Array, i: int, j: int) -> Array:
        x = case.surface.derivatives(_points(one, two), i + j + 1)
        # (x,1 cross x,2) differentiated i and j times, by Leibniz's rule; i + j <= 2.
        normal = np.zeros_like(x[0, 0])
        for m in range(i + 1):
            for n in range(j + 1):
                times = (2 if (i, m) == (2, 1) else 1) * (2 if (j, n) == (2, 1) else 1)
                normal += times * np.cross(x[m + 1, n], x[i - m, j - n + 1])
        return np.stack([x[i + 1, j], x[i, j + 1], normal], axis=1)

    return frame


def spline_shell(case: Case, spans: int) -> LinearShell:
    """Return the shell of a case that is clamped all around, of the load and the motion that it declares."""
    (support,), (load,) = case.supports, case.loads
    assert isinstance(load, AreaLoad)
    vector, motion, domain = load.vector, support.motion, case.surface.domain
    first, second = (
        Splines(np.linspace(low, high, spans + 1), DEGREE) for low, high in zip(domain.lower, domain.upper, strict=True)
    )

    def moved(one: Array, two: Array, i: int, j: int) -> Array:
        assert isinstance(motion, Value)
        return case.evaluate(motion.vector, _points(one, two), order=i + j)[i, j]

    return LinearShell(
        surface_of(case),
        frame_of(case),
        (first, second),
        CLAMPED,
        case.material.youngs_modulus,
        case.material.poissons_ratio,
        case.material.thickness,
        load=lambda one, two: case.evaluate(vector, _points(one, two))[0, 0],
        moved=None if motion is None else moved,
    )


def manufactured_by_splines(name: str) -> dict[str, Estimate]:
    """Return the values of all quantities of a case of the project, uncertain by the change from fewer spans."""
    case = read_case(CASES / f"{name}.toml")
    coarse, fine = (_measured(case, spline_shell(case, spans).solve()) for spans in SPANS)
    found = {}
    for quantity in case.quantities:
        value, unit = fine[quantity.name], quantity.unit
        found[quantity.name] = Estimate.between(
            value, coarse[quantity.name], unit, ROUNDING * max(abs(value), not unit)
        )
    return found


# --- the exact theory --------------------------------------------------------------------------------

FACTORS = 0.25, 0.5, 0.75, 1.0
EXACT_SPANS = 6, 8
"""Knot spans a side, coarser and finer."""


@dataclass(frozen=True)
class LargeAnswer:
    """A shell from positions at the end of its path: free coefficients, and energies in J."""

    shell: Shell
    free: Array
    membrane: float
    bending: float

    def displacement(self, one: float, two: float) -> Array:
        """Displacement (3,) at a point."""
        return np.array([self.shell.row(one, two, tuple(unit)) @ self.free for unit in np.eye(3)])


def pressed_shell(case: Case, spans: int) -> LargeAnswer:
    """Return the answer to a case of the exact theory that is clamped all around, under the load that it declares."""
    (load,), domain, material = case.loads, case.surface.domain, case.material
    assert isinstance(load, AreaLoad)
    vector = load.vector
    first, second = (
        Splines(np.linspace(low, high, spans + 1), DEGREE) for low, high in zip(domain.lower, domain.upper, strict=True)
    )
    clamped: tuple[Ends, Ends] = (("clamped", "clamped"), ("clamped", "clamped"))
    shell = Shell(
        surface_of(case),
        (first, second),
        [clamped] * 3,
        material.youngs_modulus,
        material.poissons_ratio,
        material.thickness,
        load=lambda one, two: case.evaluate(vector, _points(one, two))[0, 0],
    )
    *_, state = load_control(shell, FACTORS)
    return LargeAnswer(shell, state.free, *shell.energies(state.free))


def finite_strain_by_splines(name: str) -> dict[str, Estimate]:
    """Return the values of all quantities of a case of the exact theory, uncertain by the change from fewer spans."""
    case = read_case(CASES / f"{name}.toml")
    coarse, fine = (_measured(case, pressed_shell(case, spans)) for spans in EXACT_SPANS)
    return {
        q.name: Estimate.between(fine[q.name], coarse[q.name], q.unit, ROUNDING * max(abs(fine[q.name]), not q.unit))
        for q in case.quantities
    }


# --- what both are asked -----------------------------------------------------------------------------


def _measured(case: Case, answer: Answer | LargeAnswer) -> Mapping[str, float]:
    found = {}
    energies = {"membrane_energy": answer.membrane, "bending_energy": answer.bending}
    energies["strain_energy"] = sum(energies.values())
    for quantity in case.quantities:
        if quantity.kind in energies:
            found[quantity.name] = energies[quantity.kind]
        elif quantity.kind == "displacement":
            along = [np.array(d) / np.linalg.norm(d) for d in quantity.directions]
            places = [case.places[place].xi for place in quantity.points]
            found[quantity.name] = float(
                np.mean([d @ answer.displacement(*xi) for d, xi in zip(along, places, strict=True)])
            )
        elif quantity.kind == "largest_displacement":
            found[quantity.name] = largest(case, lambda points: np.array([answer.displacement(*xi) for xi in points]))
        else:
            points, weights = parametric_rule(case, SAMPLES)
            exact = case.evaluate(exact_formulas(case), points)[0, 0]
            error = np.array([answer.displacement(*xi) for xi in points]) - exact
            square = (weights @ np.sum(e**2, axis=-1) for e in (error, exact))
            found[quantity.name] = float(np.sqrt(next(square) / next(square)))
    return found


# --- the weak form -----------------------------------------------------------------------------------


def residuals(case: Case, virtual: Sequence[tuple[str, str, str]], by_strong_form: bool = False) -> Array:
    """Return the virtual work of stresses less that of the load, over the sum of their magnitudes.

    The displacement is the prescribed one, the load that of the case. Virtual strains are the first variation of the exact
    ones, at rest in the linear theory. Virtual displacements are formulas that vanish with their slopes at all edges.
    `by_strong_form` takes the load of `manufactured_load` instead of the declared one.
    """
    points, weights = parametric_rule(case, QUADRATURE)
    (load,) = case.loads
    assert isinstance(load, AreaLoad)
    x = case.surface.derivatives(points, 2)
    vectors = np.stack([x[order] for order in DERIVATIVES], axis=-2)
    tangents = vectors[:, :2]
    metric = tangents @ np.swapaxes(tangents, 1, 2)
    weights = weights * np.sqrt(np.linalg.det(metric))
    elastic = elasticity(np.linalg.inv(metric), case.material.poissons_ratio)
    fields = [case.evaluate(formulas, points, order=2) for formulas in (exact_formulas(case), *virtual)]
    moved, *tests = (np.stack([u[o] for o in DERIVATIVES], axis=-2) for u in fields)
    at_rest, gradient = first_variation(vectors)
    if case.linear:
        strain = np.einsum("nskc,nkc->ns", gradient, moved)
    else:
        deformed, gradient = first_variation(vectors + moved)
        strain = deformed - at_rest
    density = manufactured_load(case, points) if by_strong_form else case.evaluate(load.vector, points)[0, 0]
    found = []
    for test, field in zip(tests, fields[1:], strict=True):
        varied = np.einsum("nskc,nkc->ns", gradient, test)
        stretched, bent = (
            stiffness * np.einsum("ns,nst,nt->n", strain[:, part], elastic, varied[:, part])
            for stiffness, part in (
                (case.material.membrane_stiffness, slice(0, 3)),
                (case.material.bending_stiffness, slice(3, 6)),
            )
        )
        work = np.sum(density * field[0, 0], axis=-1)
        size = weights @ (np.abs(stretched) + np.abs(bent) + np.abs(work))
        found.append(weights @ (stretched + bent - work) / size)
    return np.array(found)
