"""Time and memory of `fem` against unknowns, on the roof and the cylinder: own dissection, SuperLU and PARDISO.

Each mesh is solved in a process of its own, which reports processor time and peak memory of the solve. The exponents are
slopes of the last three meshes in double logarithmic scale. Planes of symmetry are not used, so that unknowns are those
of the whole shell. A ladder ends after `LONGEST` seconds, or where memory ends.
"""

import json
import math
import subprocess
import sys

import pytest

SHELLS = ["scordelis_lo", "pinched_cylinder_diaphragm"]
METHODS = ("dissection", "superlu", "pardiso")
CELLS = (12, 16, 24, 32, 48, 64, 72)  # along each coordinate: up to a million unknowns
FEWEST = (4, 6)  # where nothing is measured
LONGEST = 120.0  # seconds of processor time after which a ladder ends
RUN = """
import json, resource, sys, time
from shellbench.bench.catalogue import catalog
from shellbench.solvers.fem.solver import FemSettings, FemSolver
name, method, n = sys.argv[1], sys.argv[2], int(sys.argv[3])
case, solver = catalog.named_case(name), FemSolver()
solver.solve(case, FemSettings(cells=(4, 4), direct_solver=method))  # what is imported or loaded once
idle, began = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
found = solver.solve(case, FemSettings(cells=(n, n), direct_solver=method, symmetry=False))
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - idle
print(json.dumps([found.parameters, time.process_time() - began, peak / 1e6]))
"""


def ladder(name, method, cells):
    """Return unknowns, seconds and gigabytes of ever finer meshes."""
    rungs = []
    for n in cells:
        done = subprocess.run([sys.executable, "-c", RUN, name, method, str(n)], capture_output=True, text=True)
        if done.returncode:
            break  # out of memory
        rungs.append(json.loads(done.stdout))
        if rungs[-1][1] > LONGEST:
            break
    return rungs


def exponent(rungs, column):
    """Return the slope of a column over the unknowns, between the first and the last of three meshes."""
    (first, last) = rungs[-3:][0], rungs[-1]
    return math.log(last[column] / first[column]) / math.log(last[0] / first[0])


@pytest.mark.long
@pytest.mark.parametrize("name", SHELLS)
def test_cost_of_unknowns(benchmark, name):
    found = {}

    def measure():
        for method in METHODS:
            found[method] = ladder(name, method, CELLS if benchmark.enabled else FEWEST)

    benchmark.pedantic(measure, rounds=1)
    for method, rungs in found.items():
        assert len(rungs) >= 2
        benchmark.extra_info[method] = [[n, round(seconds, 2), round(size, 3)] for n, seconds, size in rungs]
        if len(rungs) > 2:
            benchmark.extra_info[f"{method}: exponents"] = [round(exponent(rungs, column), 2) for column in (1, 2)]
