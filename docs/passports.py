"""Write findings/passports.md from kept figures, or measure figures and keep them.

    python docs/passports.py                        # writes the page
    python docs/passports.py measure newton-vbd     # measures what a solver lacks; needs its plug-in
    python docs/passports.py deck hinge plugins/newton/decks/hinge.py    # keeps what a deck prints

A measurement is a case of the suite passport with one setting changed. Values that take long are measured once and kept
in docs/data/passports.json with the versions that gave them.
"""

from __future__ import annotations

import json
import math
import re
import sys
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
KEPT = HERE / "data" / "passports.json"
PAGE = HERE / "findings" / "passports.md"
DECK_LINE = re.compile("(VBD|semi|XPBD|step|rolled|stretch)")  # of decks, apart from messages of the program
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
    if "iterations" not in settings and settings["time_step"] not in STEPS[::2]
]
SLOW: list[tuple[str, dict[str, Any]]] = [  # of projective dynamics a step takes twenty times as long as of the others
    *NEWTON[:4],
    ("vibrating_strip", {**BASE, "time_step": STEPS[0], "iterations": 1}),
    ("vibrating_strip", {"cells": [10, 1], "time_step": STEPS[0]}),
    ("vibrating_strip", {**BASE, "time_step": STEPS[0], "cut": "alternating"}),
]
HANGING = [("heavy_cantilever", {"cells": [20, 1]})]
CST: list[tuple[str, dict[str, Any]]] = [
    ("vibrating_strip", {**BASE, "time_step": 1e-3, "diagonal": cut}) for cut in ("right", "left", "alternating")
]
WOVEN: list[tuple[str, dict[str, Any]]] = [
    ("woven_swatch", {"cells": [16, 16]}),
    *((f"woven_cantilever_{thread}", {"cells": [64, 4]}) for thread in ("warp", "weft")),
    *(("woven_bias_strip", {"cells": [64, 16], "diagonal": cut}) for cut in ("right", "left", "alternating")),
]
RUNS: dict[str, list[tuple[str, dict[str, Any]]]] = {
    "newton-semi-implicit": [*EXPLICIT, *HANGING],
    "newton-vbd": NEWTON,
    "newton-style3d": SLOW,
    "newton-xpbd": NEWTON,
    "cst-hinge": [("free_fall", {"cells": [4, 4], "time_step": 1e-2}), *CST, *WOVEN],
    "mujoco-flex": [("free_fall", {"cells": [4, 4]}), *(("vibrating_strip", {"cells": c}) for c in ([10, 1], [20, 2]))],
}


def ratios(case: str, solution: Any) -> dict[str, float]:
    """Return the stiffnesses of a solution as multiples of those it was given, by name of the passport's property."""
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
    from shellbench.problem import declined_quantities

    taken = load_solver(find_solver(solver))
    for case, settings in RUNS[solver]:
        kept = json.loads(KEPT.read_text()) if KEPT.exists() else {}
        done = [(run["case"], run["settings"]) for run in kept.get(solver, {"runs": []})["runs"]]
        if (only and case != only) or (only is None and (case, settings) in done):
            continue
        began, line = time.perf_counter(), {"case": case, "settings": settings}
        try:
            problem = catalog.named_case(case)
            if reason := taken.declines(problem):
                raise InputError(reason)
            problem = problem.without(declined_quantities(taken, problem))
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


def keep_deck(name: str, command: list[str]) -> None:
    """Run a deck of a program alone, and keep the lines that it prints."""
    import subprocess

    out = subprocess.run([sys.executable, *command], capture_output=True, text=True, check=True).stdout
    kept = json.loads(KEPT.read_text())
    kept.setdefault("decks", {})[name] = [line for line in out.splitlines() if DECK_LINE.match(line)]
    KEPT.write_text(json.dumps(kept, indent=1, sort_keys=True) + "\n")


FRAME = 1 / 120  # s: newton's plug-in takes whole parts of it as steps


def step_of(solver: str, step: float) -> float:
    """Return the step, s, that a setting makes."""
    return FRAME / math.ceil(FRAME / step - 1e-9) if solver.startswith("newton") else step


def words(solver: str, settings: dict[str, Any]) -> str:
    """Return settings in words."""
    said = []
    for name, value in settings.items():
        if name == "cells":
            said.append(f"{value[0]} x {value[1]} cells")
        elif name == "time_step":
            said.append(f"step {step_of(solver, value):.2g} s")
        elif name in ("cut", "diagonal"):
            said.append(f"diagonals {value}")
        else:
            said.append(f"{name} {value}")
    return ", ".join(said)


def rows(kept: dict[str, Any], case: str) -> list[str]:
    """Return the lines of a table of one case: solver, settings, ratios."""
    lines = []
    for solver in RUNS:
        for run in kept.get(solver, {"runs": []})["runs"]:
            if run["case"] != case:
                continue
            values = ", ".join(f"{value:.3f}" for value in run.get("ratios", {}).values())
            if "unsettled" in run:
                values = "none: it had not come to rest"
            values = values or run.get("failure", "none: no strip moves so")
            lines.append(f"| `{solver}` | {words(solver, run['settings'])} | {values} |")
    return lines


def at_rest(kept: dict[str, Any]) -> list[str]:
    """Return the section on cloth at rest; nothing if none was measured."""
    found = rows(kept, "heavy_cantilever")
    if not found:
        return []
    return [
        "## Bending at rest",
        "",
        "`heavy_cantilever`: a clamped strip hangs under its own weight, at Gamma 1, 10, 100 and 1000 (weight over bending).",
        "",
        "| solver | settings | bending, ratios |",
        "|---|---|---|",
        *found,
        "",
        "Stretch is ten million times as stiff as bending here. With 40,000 steps for each load, kinetic damping does not bring the strip to rest.",
        "The other solvers of newton were not asked.",
        "",
    ]


def off_axes(kept: dict[str, Any]) -> list[str]:
    """Return the section on woven cloth."""
    tables = {
        "woven_swatch": "stretch and shear at 30 degrees to the warp, by their work",
        "woven_cantilever_warp": "bending along the warp, Gamma 40",
        "woven_cantilever_weft": "bending along the weft, Gamma 100",
        "woven_bias_strip": "bending at 30 degrees to the warp",
    }
    lines = [line.replace("| `", f"| {words} | `", 1) for case, words in tables.items() for line in rows(kept, case)]
    return [
        "## Warp, weft and bias",
        "",
        "Cloth has other stiffnesses along its warp than along its weft. Of the simulators here only `cst-hinge` takes them: its triangles have",
        "the membrane's, and each hinge that of a cylinder along its edge, as cloth simulators do it.",
        "",
        "| what | solver | settings | ratio |",
        "|---|---|---|---|",
        *lines,
        "",
        "Stretch is right in every direction, and bending along warp and weft within 2 %. Off both, bending is 8 to 26 % too stiff by the cut of the cells:",
        "cloth along its bias twists as it bends, and the [twist of hinges](hinges.md) is that of another plate.",
        "",
    ]


def fence(lines: list[str]) -> list[str]:
    """Return lines as a block of text."""
    return ["```text", *lines, "```"]


def value_of(kept: dict[str, Any], solver: str, case: str, **settings: Any) -> float:
    """Return the ratio of one kept run."""
    (run,) = (r for r in kept[solver]["runs"] if r["case"] == case and r["settings"] == settings)
    return float(next(iter(run["ratios"].values())))


def ratio(kept: dict[str, Any], solver: str, case: str, **settings: Any) -> str:
    """Return the ratio of one kept run, rounded."""
    return f"{value_of(kept, solver, case, **settings):.2f}"


def page(kept: dict[str, Any]) -> str:
    """Return the page."""
    used = {
        f"{name} {number}" for solver in RUNS for name, number in kept.get(solver, {"versions": {}})["versions"].items()
    }
    strip = "vibrating_strip"
    fell = ratio(kept, "newton-style3d", "free_fall", cells=[4, 4], time_step=1e-3)
    fell_coarse = ratio(kept, "newton-style3d", "free_fall", cells=[4, 4], time_step=1e-2)
    fine = ratio(kept, "newton-vbd", strip, cells=[40, 4], time_step=1e-3)
    many = ratio(kept, "newton-vbd", strip, **BASE, time_step=1e-3, iterations=100)
    ten = ratio(kept, "newton-vbd", strip, **BASE, time_step=1e-3)
    one = ratio(kept, "newton-vbd", strip, **BASE, time_step=1e-3, iterations=1)
    long = ratio(kept, "newton-vbd", strip, **BASE, time_step=STEPS[0])
    cut = ratio(kept, "newton-semi-implicit", strip, **BASE, time_step=2.5e-4, cut="alternating")
    right = ratio(kept, "newton-semi-implicit", strip, **BASE, time_step=2.5e-4)
    agreed = [
        ("newton-semi-implicit", {"time_step": 2.5e-4}),
        ("newton-vbd", {"time_step": 1e-3, "iterations": 100}),
        ("newton-xpbd", {"time_step": 1e-3}),
        ("mujoco-flex", {}),
        ("cst-hinge", {"time_step": 1e-3, "diagonal": "right"}),
    ]
    found = [value_of(kept, solver, strip, **BASE, **settings) for solver, settings in agreed]
    spread = max(found) - min(found)
    lines = [
        "# Passports of cloth simulators",
        "",
        "A cloth simulator asks for numbers of its own: triangle and edge stiffnesses instead of E, nu and h. A passport measures the",
        "stiffness that comes out, as a multiple of the one that was asked for. One means: as asked.",
        "No example of newton's own was run here, beside decks of newton alone and closed forms of one cell.",
        "",
        "<!-- table passports -->",
        f"Versions: {', '.join(sorted(used))}. `docs/passports.py` measures and writes this page.",
        "",
        "## Bending in motion",
        "",
        "A strip that is held at both ends swings once under a small pressure (`vibrating_strip`). Its deflection after half a period gives",
        "the bending stiffness. Unless stated, iterations are 10 and diagonals are right.",
        "",
        "| solver | settings | bending, ratio |",
        "|---|---|---|",
        *rows(kept, strip),
        "",
        f"- **Cut of the cells.** Hinges simulate {right} with diagonals to the right, and {cut} with alternating ones. That is the hinges' own",
        "  limit on such grids, whatever the program: see [Hinges](hinges.md). Where iterations suffice, three solvers of newton, `mujoco-flex` and",
        f"  `cst-hinge` agree on 20 x 2 cells to {spread:.4f}.",
        f"- **Iterations.** Vertex block descent is nearly converged with 10 iterations on 20 x 2 cells (ratio {ten}; {many} with 100). With 1 iteration",
        f"  the strip bends as if it had {one} of its stiffness; with 10 on 40 x 4 cells, {fine}; with 10 and steps of {step_of('newton', STEPS[0]):.2g} s, {long}. Finer meshes need more",
        '  iterations. newton\'s guide to tuning VBD says so ("a fine mesh converging slowly").',
        "- **Loss of velocity.** A solver that loses velocity deflects less, and this test reads that as stiffness. The values of `newton-style3d` mix",
        "  stiffness, loss and unfinished iterations; they are no verdict on its bending, whose moment on one fold is right (`plugins/newton/tests`).",
        "",
        "## Free fall",
        "",
        "| solver | settings | fall, ratio |",
        "|---|---|---|",
        *rows(kept, "free_fall"),
        "",
        "`newton-style3d` multiplies velocities by 0.998 in every step (`style3d/kernels.py`, `update_velocity`). Shorter steps therefore damp more:",
        f"after 1 s the cloth has fallen {fell_coarse} of the right distance with steps of {step_of('newton', 1e-2):.2g} s, and {fell} with {step_of('newton', 1e-3):.2g} s. The factor is not an option.",
        "Such damping keeps cloth calm at a fixed step. But refining the step leads to no limit. One search of the tracker found no report. A deck of newton alone, with",
        "its own grid and default options (`plugins/newton/decks/free_fall.py`), shows the same:",
        "",
        *fence(kept.get("decks", {}).get("free_fall", [])),
        "",
        *at_rest(kept),
        *off_axes(kept),
        "## What newton's numbers mean",
        "",
        "| number | `SolverVBD` | `SolverSemiImplicit` | `SolverXPBD` | `SolverStyle3D` |",
        "|---|---|---|---|---|",
        "| `tri_ke` | mu | mu | not used | E h, E h, G h (`tri_aniso_ke`) |",
        "| `tri_ka` | lambda | lambda + mu | not used | not used: no Poisson's effect |",
        "| `edge_ke`, moment of a hinge | `edge_ke` l theta | `edge_ke` l (2 A) theta | `edge_ke` (2 A) theta | 3 `edge_ke` l^2/(A1 + A2) theta |",
        "",
        "mu and lambda are Lame's constants of plane stress times h, theta is the angle of a hinge, l its length, A, A1 and A2 areas of its triangles.",
        "`plugins/newton` sets these numbers from E, nu and h; its tests hold each against a closed form.",
        "",
        "- The same `tri_ka` is another Poisson's ratio in `SolverVBD` than in `SolverSemiImplicit`.",
        "- In `SolverSemiImplicit` and `SolverXPBD` the gradient of the angle lacks the division by the length of the triangle's normal (2 A).",
        "  So the same `edge_ke` bends less on smaller triangles. If A1 and A2 differ, the two moments of a hinge do not balance.",
        "  newton's issue 277 asks to verify the bending forces of `SolverSemiImplicit`, and is open; a deck of newton alone",
        "  (`plugins/newton/decks/hinge.py`) prints both moments over `edge_ke` l theta:",
        "",
        *fence(kept.get("decks", {}).get("hinge", [])),
        "",
        "- Issue 2933 of newton says that `SolverXPBD` resets its multipliers in each iteration, so that iterations stiffen the cloth. Version 1.8.0",
        "  keeps them within a step, and bending does not depend on iterations here. Longer steps, finer cells and",
        "  alternating diagonals made the strip unstable (none in the table).",
        "- Hinges whose triangles are below 5e-7 m^2 have no force (`eps` in the kernels): in metres, cells of less than about a millimetre do not bend.",
        "- Until June 2026 the bending force of `SolverStyle3D` was too large at large bending (pull request 3229). The version here has the repair.",
        "",
        "## The released NeuralClothSim",
        "",
        "The code of the NeurIPS version is public (MIT). Its strain and energy modules run alone on given deformations:",
        "`python plugins/neuralclothsim/decks/energy_checks.py PATH_OF_CLONE`, twenty lines, at commit 804177b of its repository.",
        "",
        *fence(kept.get("decks", {}).get("neuralclothsim", [])),
        "",
        "- **Bending of a rolled plate.** The released code computes the bending strain that the paper prints. It is accurate for small rotations only",
        "  ([NeuralClothSim replicated](neuralclothsim.md)).",
        "- **Thickness.** With a non-linear material, `energy.py` integrates over the thickness by Simpson's rule and *subtracts* the strain energy of the",
        "  bottom, where the rule adds it ([silk, cotton and canvas](../board/findings.md#neuralclothsim-silk-cotton-and-canvas)). Bending with stretch can be negative.",
        "  The branch of the linear material has no such sum. One search of the tracker found no report.",
        "<!-- end -->",
    ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    if sys.argv[1:2] == ["measure"]:
        measure(*sys.argv[2:])
    elif sys.argv[1:2] == ["deck"]:
        keep_deck(sys.argv[2], sys.argv[3:])
    else:
        PAGE.write_text(page(json.loads(KEPT.read_text())), encoding="utf-8")
