"""Cases that the Kratos solvers decline, with the same reasons as other solvers."""

from pathlib import Path

import pytest

pytest.importorskip("KratosMultiphysics", reason="needs Kratos: python -m pip install ./plugins/kratos")

from shellbench_kratos.iga_solver import KratosIgaSolver
from shellbench_kratos.thin_solver import KratosThinSolver

from shellbench.errors import InputError
from tests.problems.shell.test_solution import CASE
from tests.solvers import test_edge_parts as edge_parts
from tests.solvers import test_foundations as foundations
from tests.solvers import test_local_directions as local
from tests.solvers import test_piecewise as piecewise
from tests.solvers import test_varying_stiffness as stiffness

IGA, THIN = KratosIgaSolver(), KratosThinSolver()
WALL = {"name": "wall", "on": ["xi1_min", "xi1_max"]}
TAPERED = stiffness.strip(
    {"kind": "edge", "vector": [0, 0, -1]}, [stiffness.energy("strain_energy")], thickness_factor=stiffness.TAPERED
)
OWN_AXES = local.tube(supports=[{"name": "s", "on": local.RIMS, "components": list(local.LOCAL)}])
OWN_LOADS = local.twisted(supports=[{"name": "wall", "on": ["xi2_min"]}])


@pytest.mark.parametrize(
    ("solvers", "case", "words"),
    [
        ((IGA, THIN), edge_parts.partly_clamped(), "a support holds a part of an edge, and this solver takes whole"),
        ((IGA, THIN), foundations.plate(supports=[WALL]), "it rests on springs, which this solver does not take"),
        ((IGA,), OWN_AXES, "a support holds directions local to the shell, and this solver takes x, y and z only"),
        ((IGA,), OWN_LOADS, "a load is local to the shell, and this solver takes loads along x, y and z only"),
        (
            (IGA,),
            piecewise.pressed("max(xi1, 0.5)"),
            "a formula of it has kinks or jumps, and this solver takes smooth",
        ),
        ((IGA, THIN), TAPERED, "its modulus or thickness varies, and this solver takes the same everywhere"),
    ],
)
def test_what_it_does_not_take_is_declined(solvers, case, words):
    for solver in solvers:
        assert solver.declines(case).startswith(words)


@pytest.mark.parametrize("solver", [IGA, THIN], ids=lambda solver: solver.name)
def test_a_start_is_never_ignored(solver):
    with pytest.raises(InputError, match=f"^{solver.name} can't go on from an earlier solution"):
        solver.solve(CASE, solver.settings_type(), start=Path("earlier.npz"))
