"""The figure and the tables of docs/derivatives.md.

python docs/derivatives.py --figure     docs/derivative_steps.png
python docs/derivatives.py --seconds    seconds of ten derivatives beside those of the solve
python docs/derivatives.py --identify   adjoint and differences side by side, and a conditioned field
python docs/derivatives.py --draws      scatter over 200 noisy data, each identified by the solver
python docs/derivatives.py --published  derivatives through the weights of a trained field
"""

from __future__ import annotations

import sys
import time
import tomllib
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.registry import find_solver, load_solver
from shellbench.problems.series.identification import IdentificationCase
from shellbench.problems.shell.question.parameters import changed, parameters_of
from shellbench.solvers.fem.derivatives.answer import FemAnswer
from shellbench.solvers.fem.identifying_solver import FemIdentifySolver
from shellbench.solvers.fem.linear.equilibrium import solve
from shellbench.solvers.fem.mesh.mesh import TensorMesh

FIGURE = Path(__file__).parent / "derivative_steps.png"
STEPS = 10.0 ** -np.arange(0.5, 12.1, 0.5)  # relative
KNOWN = {"thickness": "edge_deflection_by_thickness", "radius": "edge_deflection_by_radius"}
DRAWS = 200
TRAINED = {"iterations": 500, "width": 128, "layers": 3}
EXPONENTS = {"youngs_modulus": -1.0, "thickness": -3.0, "poissons_ratio": -2 * 0.3**2 / (1 - 0.3**2)}
COLOURS = {"thickness": "#0072B2", "radius": "#D55E00"}


def on_mesh(case, cells: int, degree: int = 5):
    """Solve a linear case on an even mesh."""
    domain = case.surface.domain
    first, second = (
        low + size * np.linspace(0, 1, cells + 1) for low, size in zip(domain.lower, domain.size, strict=True)
    )
    mesh = TensorMesh(domain, (first, second), degree)
    found = solve(case, mesh, case.states, 2 * degree + 1, "auto")
    return FemAnswer.of(found.solution, found.assembled)


def figure() -> None:
    """Draw the error of central differences against their step, and that of the adjoint below."""
    import matplotlib.pyplot as plt

    case, cells = catalog.named_case("gradient_roof"), 12
    answer, known = on_mesh(case, cells), catalog.known_values(case.name)
    drawing, axes = plt.subplots(figsize=(7, 4.2), layout="constrained")
    for name, group in (("thickness", "material"), ("radius", "surface")):
        p = parameters_of(case)[f"{group}.{name}"]
        exact = known.judge(KNOWN[name], case.theory).value
        errors = []
        for step in STEPS * p.value:
            ahead, behind = (case.primary.measure(on_mesh(changed(case, p, p.value + s), cells)) for s in (step, -step))
            errors.append(abs((ahead - behind) / (2 * step) / exact - 1))
        adjoint = abs(answer.derivative(case.primary, p.name) / exact - 1)
        axes.loglog(STEPS, errors, "o-", ms=3, color=COLOURS[name], label=f"by the {name}, central differences")
        axes.axhline(adjoint, ls="--", color=COLOURS[name], label=f"by the {name}, adjoint")
        print(
            f"{name}: best difference {min(errors):.1e} at {STEPS[int(np.argmin(errors))]:.0e}, adjoint {adjoint:.1e}"
        )
    axes.loglog(STEPS[:6], 3 * STEPS[:6] ** 2, "k:", lw=1, label="slope 2")
    axes.set(
        xlabel="step, relative to the parameter", ylabel="relative error of the derivative of the edge's deflection"
    )
    axes.invert_xaxis()
    axes.legend(fontsize=8)
    drawing.savefig(FIGURE, dpi=130)


def seconds() -> None:
    """Print the seconds of a gradient beside those of the solve, on one mesh."""
    with threadpool_limits(1):
        for name, cells in (("gradient_roof", 32), ("gradient_plate", 32), ("gradient_roof", 48)):
            case = catalog.named_case(name)
            before = time.process_time()
            answer = on_mesh(case, cells)
            between = time.process_time()
            names = list(parameters_of(case))[:10]
            answer.gradient(case.primary, names)
            spent, took = between - before, time.process_time() - between
            print(f"| `{name}` | {answer.parameters} | {spent:.2f} | {took:.2f} | {took / spent:.2f} |")


def identify() -> None:
    """Print what both ways of identification take."""
    for name in ("identified_strip", "identified_roof"):
        for solver in ("fem-identify", "fem-identify-differences"):
            case, before = catalog.named_case(name), time.process_time()
            found = load_solver(find_solver(solver)).solve(case)
            known, primary = catalog.known_values(name), case.primary
            error = abs(primary.measure(found) / known.judge(primary.name, case.theory).value - 1)
            d = found.diagnostics
            took = time.process_time() - before
            print(f"| `{name}` | `{solver}` | {d['solves']} | {d['adjoint_solves']} | {took:.1f} | {error:.0e} |")
    one_thickness()


def one_thickness() -> None:
    """Print what three ways take to find the roof's thickness from the deflection of its edge alone."""
    data, truth = stated("identified_roof"), 0.27
    case = IdentificationCase.build(data | {"measured": data["measured"][:1]}, "identified_roof", "the roof")
    for solver in ("fem-identify", "fem-identify-differences"):
        before = time.process_time()
        found = load_solver(find_solver(solver)).solve(case)
        took, d = time.process_time() - before, found.diagnostics
        error = abs(found.found("material.thickness")[0] / truth - 1)
        print(f"| its edge alone | `{solver}` | {d['solves']} | {d['adjoint_solves']} | {took:.1f} | {error:.0e} |")
    before = time.process_time()
    field = load_solver(find_solver("ndf-conditioned")).solve(catalog.named_case("conditioned_roof"))
    prepared, material = time.process_time() - before, {"youngs_modulus": 4.32e8, "poissons_ratio": 0.0}
    thickness, count, step, before = 0.2, 0, 1.0, time.process_time()
    while abs(step) > 1e-9:
        now, count = {**material, "thickness": thickness}, count + 1
        step = -np.log(field.asked(now) / case.measured[0].value) / field.derivative(now, "thickness")
        thickness *= np.exp(step)
    took = time.process_time() - before
    print(
        f"| its edge alone | `ndf-conditioned` | {count} answers | | {prepared:.1f} + {took:.3f} | {abs(thickness / truth - 1):.0e} |"
    )


def stated(name: str) -> dict:
    """Return the data of a case's file."""
    return tomllib.loads((Path(__file__).parents[1] / f"cases/{name}.toml").read_text())


def draws() -> None:
    """Print predicted scatter, that of noisy data which the solver identifies, and the Jacobian's on the same noise."""
    for name, cells in (("identified_strip", [6, 1]), ("identified_roof", [8, 8])):
        case, data, rng = catalog.named_case(name), stated(name), np.random.default_rng(7)
        solver, settings = FemIdentifySolver(), {"cells": cells}
        values, predicted = solver.solve(case, settings).values
        slopes = solver.values(case, np.log(values), solver.settings_type(**settings))[1]
        jacobian = slopes / [[d.value] for d in case.measured]
        noise, found, solves = case.noise * rng.normal(size=(DRAWS, len(jacobian))), [], 0
        before = time.process_time()
        for errors in noise:
            noisy = [d | {"value": d["value"] * (1 + e)} for d, e in zip(data["measured"], errors, strict=True)]
            answer = solver.solve(IdentificationCase.build(data | {"measured": noisy}, name, "a draw"), settings)
            found.append(answer.values[0])
            solves += answer.diagnostics["solves"]
        print(f"{name}: {DRAWS} draws, {solves} solves, {time.process_time() - before:.0f} s")
        columns = predicted / values, np.std(found, axis=0, ddof=1) / values
        columns += (np.std(noise @ np.linalg.pinv(jacobian).T, axis=0, ddof=1),)
        for parameter, *row in zip(case.unknowns, *columns, strict=True):
            print(f"| {parameter} | " + " | ".join(f"{100 * share:.3f} %" for share in row) + " |")


def published() -> None:
    """Print relative derivatives through the fixed weights of a trained field, by autograd."""
    import torch

    case = catalog.named_case("gradient_plate")
    case = case.model_copy(update={"quantities": case.quantities[:2]})
    answer, known = load_solver(find_solver("ndf-published")).solve(case, TRAINED), catalog.known_values(case.name)
    x, weights = np.polynomial.legendre.leggauss(40)
    grid = np.stack(np.meshgrid(50 * (x + 1), 50 * (x + 1), indexing="ij"), axis=-1).reshape(-1, 2)
    area = torch.from_numpy(2500 * np.outer(weights, weights).ravel())
    values = [getattr(case.material, name) for name in EXPONENTS]
    parameters = torch.tensor(values, dtype=torch.float64, requires_grad=True)
    young, thickness, nu = parameters
    energy = torch.zeros((), dtype=torch.float64)
    for part, power in (("membrane", thickness), ("bending", thickness**3 / 12)):
        one, two, shear = torch.from_numpy(answer.evaluate(f"{part}_strain", grid)).T  # of fixed weights: no parameter
        density = (one + two) ** 2 - 2 * (1 - nu) * (one * two - shear**2)
        energy = energy + young * power / (1 - nu**2) / 2 * (area @ density)
    (slopes,) = torch.autograd.grad(energy, parameters)
    for q in case.quantities:
        exact = known.judge(q.name, case.theory).value
        print(f"{q.name}: {q.measure(answer):.5g}, {q.measure(answer) / exact - 1:+.1%}")
    for (name, exact), value, slope in zip(EXPONENTS.items(), values, slopes.tolist(), strict=True):
        through = value * slope / energy.item()
        print(f"| `{name}` | {exact:+.3f} | {through:+.3f} | {-through:+.3f} | 0 |")


if __name__ == "__main__":
    for work in (figure, seconds, identify, draws, published):
        if f"--{work.__name__}" in sys.argv:
            work()
