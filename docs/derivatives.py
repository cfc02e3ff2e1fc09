"""The figure and the tables of docs/derivatives.md.

python docs/derivatives.py --figure     docs/derivative_steps.png
python docs/derivatives.py --seconds    seconds of ten derivatives beside those of the solve
python docs/derivatives.py --identify   adjoint and differences side by side
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.registry import find_solver, load_solver
from shellbench.problems.shell.question.parameters import changed, parameters_of
from shellbench.solvers.fem.derivatives.answer import FemAnswer
from shellbench.solvers.fem.linear.equilibrium import solve
from shellbench.solvers.fem.mesh.mesh import TensorMesh

FIGURE = Path(__file__).parent / "derivative_steps.png"
STEPS = 10.0 ** -np.arange(0.5, 12.1, 0.5)  # relative
KNOWN = {"thickness": "edge_deflection_by_thickness", "radius": "edge_deflection_by_radius"}
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
            print(
                f"| `{name}` | `{solver}` | {d['iterations']} | {d['solves']} | {d['adjoint_solves']} | {took:.1f} | {error:.0e} |"
            )


if __name__ == "__main__":
    for option, work in (("--figure", figure), ("--seconds", seconds), ("--identify", identify)):
        if option in sys.argv:
            work()
