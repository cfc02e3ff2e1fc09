"""Write findings/passports.md from kept figures, or measure figures and keep them.

    python docs/passports.py                        # writes the page
    python docs/passports.py measure newton-vbd     # measures one solver again; needs its plug-in

A measurement is a case of the suite passport with one setting changed. Values that take long are measured once and kept
in docs/data/passports.json with the versions that gave them.
"""

from __future__ import annotations

import json
import sys
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
KEPT = HERE / "data" / "passports.json"
PAGE = HERE / "findings" / "passports.md"
ENGINES = {"newton": ("newton", "warp-lang"), "mujoco": ("mujoco",), "cst": ("shellbench",)}

BASE = {"cells": [20, 2]}
STEPS = (4e-3, 1e-3, 2.5e-4)
NEWTON: list[tuple[str, dict[str, Any]]] = [
    *(("free_fall", {"cells": [4, 4], "time_step": step}) for step in (1e-2, 1e-3)),
    *(("vibrating_strip", {**BASE, "time_step": step}) for step in STEPS),
    *(("vibrating_strip", {**BASE, "time_step": 1e-3, "iterations": n}) for n in (1, 100)),
    *(("vibrating_strip", {"cells": cells, "time_step": 1e-3}) for cells in ([10, 1], [40, 4])),
    *(("vibrating_strip", {**BASE, "time_step": 1e-3, "cut": cut}) for cut in ("left", "alternating")),
]
EXPLICIT: list[tuple[str, dict[str, Any]]] = [
    (case, {**settings, "time_step": 2.5e-4} if case == "vibrating_strip" else settings)
    for case, settings in NEWTON
    if "iterations" not in settings and not (case == "vibrating_strip" and settings.get("time_step", 0) == STEPS[0])
]
HANGING = [("heavy_cantilever", {"cells": [20, 1]}), ("heavy_cantilever", {"cells": [32, 1]})]
CST: list[tuple[str, dict[str, Any]]] = [
    ("vibrating_strip", {**BASE, "time_step": 1e-3, "diagonal": cut}) for cut in ("right", "left", "alternating")
]
RUNS = {
    "newton-semi-implicit": [*EXPLICIT, *HANGING],
    "newton-vbd": NEWTON,
    "newton-style3d": NEWTON,
    "newton-xpbd": NEWTON,
    "cst-hinge": [("free_fall", {"cells": [4, 4], "time_step": 1e-2}), *CST],
    "mujoco-flex": [("free_fall", {"cells": [4, 4]}), *(("vibrating_strip", {"cells": c}) for c in ([10, 1], [20, 2]))],
}


def ratios(case: str, solution: Any) -> dict[str, float]:
    """Return what a solution simulates, as multiples of what it was given, by name of the passport's property."""
    from shellbench.bench.catalogue import catalog
    from shellbench.bench.judge.passport import PROPERTIES
    from shellbench.problems.shell.quantities.measure import measure
    from shellbench.report.studies.stiffnesses import ratio_of

    known = {row.quantity: row.value for row in catalog.known_values(case).values if row.role == "judge"}
    mine = [one for one in PROPERTIES if one.case == case]
    wanted = {name for one in mine for name in one.quantities}
    found = {q.name: measure(solution, q) for q in solution.case.quantities if q.name in wanted}
    return {one.name: ratio for one in mine if (ratio := ratio_of(one, found, known)) is not None}


def versions(solver: str) -> dict[str, str]:
    """Return the versions of the packages that a solver needs."""
    names = next(names for start, names in ENGINES.items() if solver.startswith(start))
    found = {}
    for name in names:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "missing"
    return found


def measure(solver: str, only: str | None = None) -> None:
    """Measure a solver and keep what it gives, run after run."""
    from shellbench.bench.catalogue import catalog
    from shellbench.bench.plugins.registry import find_solver, load_solver
    from shellbench.errors import InputError, SolveFailure

    taken = load_solver(find_solver(solver))
    for case, settings in RUNS[solver]:
        if only and case != only:
            continue
        began, line = time.perf_counter(), {"case": case, "settings": settings}
        try:
            problem = catalog.named_case(case)
            if reason := taken.declines(problem):
                raise InputError(reason)
            # `answer_from` and not `solve`: quantities that the solver declines are not measured
            solution = taken.answer_from(None, problem, taken.settings_type(**settings), lambda _: None)
            line["ratios"] = ratios(case, solution)
            if solution.unsettled:
                line["unsettled"] = solution.unsettled
        except (SolveFailure, InputError) as failure:
            line["failure"] = str(failure)
        line["seconds"] = round(time.perf_counter() - began, 1)
        kept = json.loads(KEPT.read_text()) if KEPT.exists() else {}
        mine = kept.setdefault(solver, {"runs": []})
        mine["versions"] = versions(solver)
        mine["runs"] = [run for run in mine["runs"] if (run["case"], run["settings"]) != (case, settings)] + [line]
        KEPT.write_text(json.dumps(kept, indent=1, sort_keys=True) + "\n")
        print(solver, line, flush=True)


if __name__ == "__main__":
    if sys.argv[1:2] == ["measure"]:
        measure(*sys.argv[2:])
