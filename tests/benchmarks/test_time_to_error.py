"""Time to an error: `fem` in degree 3, 4 and 5 and `kratos-iga`, on the four linear shells of the obstacle course.

Both solve a ladder of fixed meshes, in one run and in processor time. The time to an error is that of the coarsest mesh
from which on the error stays below it; an error that passes through zero does not count. Each mesh is solved twice, and
the faster solve counts. For `kratos-iga` the fastest degree counts, for `fem` each degree counts separately.
"""

import itertools
import time

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.solvers.fem.solver import FemSettings, FemSolver

SHELLS = ["square_plate", "scordelis_lo", "pinched_cylinder_diaphragm", "pinched_cylinder_free"]
ERRORS = (1e-3, 1e-4, 1e-5, 1e-6)
CELLS = (2, 3, 4, 6, 8, 11, 16, 22, 32, 45, 64)  # along each coordinate
ROUNDS = 2
LONGEST = 12.0  # seconds of processor time after which a ladder ends


def ladder(solver, settings, case, known):
    """Return seconds and errors of ever finer meshes, until the smallest error is reached twice."""
    rungs = []
    for n in CELLS:
        seconds = []
        for _ in range(ROUNDS if not rungs or rungs[-1][0] < 1 else 1):
            began = time.process_time()
            solution = solver.solve(case, settings(cells=(n, n)))
            seconds.append(time.process_time() - began)
        rungs.append((min(seconds), abs(measure_all(solution)[case.primary.name] / known - 1)))
        if (len(rungs) > 1 and max(error for _, error in rungs[-2:]) <= min(ERRORS)) or min(seconds) > LONGEST:
            break
    return rungs


def times_to_errors(rungs):
    """Return by error the seconds of the first mesh from which on errors stay below it, or None."""
    times = {}
    for bound in ERRORS:
        good = list(itertools.takewhile(lambda rung, bound=bound: rung[1] <= bound, reversed(rungs)))
        times[bound] = good[-1][0] if good else None
    return times


@pytest.mark.long
@pytest.mark.parametrize("name", SHELLS)
def test_time_to_error(benchmark, name):
    iga = pytest.importorskip(
        "shellbench_kratos.iga_solver", reason="needs Kratos: python -m pip install ./plugins/kratos"
    )
    case = catalog.named_case(name)
    known = catalog.known_values(name).judge(case.primary.name, case.theory).value
    found = {}

    def measure():
        for degree in (3, 4, 5):
            rungs = ladder(FemSolver(), lambda degree=degree, **k: FemSettings(degree=degree, **k), case, known)
            found[f"fem {degree}"] = times_to_errors(rungs)
        for degree in (3, 4) if benchmark.enabled else ():
            rungs = ladder(
                iga.KratosIgaSolver(), lambda degree=degree, **k: iga.KratosIgaSettings(degree=degree, **k), case, known
            )
            found[f"kratos-iga {degree}"] = times_to_errors(rungs)

    FemSolver().solve(case, FemSettings(cells=(2, 2)))  # what is imported or compiled once
    benchmark.pedantic(measure, rounds=1)
    assert all(times[min(ERRORS)] is not None for who, times in found.items() if who in ("fem 4", "fem 5"))
    benchmark.extra_info |= {who: {f"{e:.0e}": t for e, t in times.items()} for who, times in found.items()}
    for error in ERRORS:
        theirs = [times[error] for who, times in found.items() if who.startswith("kratos") and times[error]]
        for who, times in found.items():
            if theirs and who.startswith("fem") and times[error]:
                benchmark.extra_info[f"kratos-iga over {who} at {error:.0e}"] = round(min(theirs) / times[error], 2)
