"""Studies of motion after Kairanda et al. 2023, sections G, H, F and I.1: runs, records and figures of docs/studies.md.

python docs/studies.py run [NAME]     make the missing runs, one at a time; an interrupted study resumes
python docs/studies.py keep [NAME]    write the runs' figures to reports/studies/NAME.csv
python docs/studies.py fit            fit fields of constant size to the napkins of `long`: reports/studies/constant.csv
python docs/studies_page.py           draw docs/figures/study_NAME.png, and write the tables of docs/studies.md

A study is a list of runs: a case of the catalogue with some entries changed, a solver, its settings and a seed. Runs
are `shellbench run` on case files in reports/study_runs, where their records lie, too.
"""

from __future__ import annotations

import contextlib
import csv
import json
import math
import re
import resource
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.registry import find_solver, load_solver
from shellbench.cli import app

ROOT = Path(__file__).parents[1]
KEPT, FIGURES = ROOT / "reports/studies", ROOT / "docs/figures"
STORE = Path("reports/study_runs")  # of records, which are large and not committed
SHARES = STORE / "shares.jsonl"  # of a processor, by run: the machine may have had other work
SMALL = {"layers": 2, "width": 64, "learning_rate": 1e-3}  # of a training that a CPU can afford
CLOSE = 0.01  # m: two motions are together until they are that far apart, in the mean


@dataclass(frozen=True)
class Run:
    """One run of a study.

    Attributes
    ----------
    base, edits
        The case of the catalogue, and new values by key.
    name
        Name of the edited case; the base itself if it is empty. Without edits it is a file in reports/studies.
    yardstick
        Whether this run is the reference of the other runs of the case.
    """

    base: str
    solver: str
    settings: dict[str, Any] = field(default_factory=dict)
    name: str = ""
    edits: dict[str, float] = field(default_factory=dict)
    seed: int = 0
    yardstick: bool = False

    @property
    def case(self) -> str:
        return self.name or self.base


def words(value: float) -> str:
    """Return a number as a part of a case's name."""
    return f"{value:g}".replace(".", "_").replace("-", "_")


def thin() -> Iterator[Run]:
    """A napkin that droops between two held edges, from thick to thin, at the same areal density (section H.1)."""
    for h in (1e-2, 1e-3, 1e-4):
        edited: dict[str, Any] = {"name": f"napkin_thin_{words(h)}", "edits": {"thickness": h, "until": 0.3}}
        yield Run("napkin_fixed_edges", "fem", {"cells": [4, 4], "time_step": 1 / 60}, **edited)
        yield Run("napkin_fixed_edges", "fem", {"cells": [6, 6], "time_step": 1 / 120}, **edited)
        yield Run("napkin_fixed_edges", "fem", {"cells": [8, 8], "time_step": 1 / 240}, yardstick=True, **edited)
        for neurons in (120, 240):
            yield Run("napkin_fixed_edges", "ndf-ritz", {"neurons": neurons}, **edited)


def times() -> Iterator[Run]:
    """Samples in time, and in space beside them (section H.2); and steps, where time is stepped through."""
    fall = {**SMALL, "omega0": 3.0, "iterations": 1000}
    for count in (5, 10, 25):
        for seed in (0, 1):
            yield Run("free_fall", "ndf-published", {**fall, "cells": [5, 5], "times": count}, seed=seed)
    napkin = {**SMALL, "omega0": 5.0, "iterations": 500}
    for count in (5, 10, 25):
        yield Run("napkin_plane", "ndf-published", {**napkin, "cells": [8, 8], "times": count})
    yield Run("napkin_plane", "ndf-published", {**napkin, "cells": [5, 5], "times": 10})
    for rate in (30, 60, 120):
        yield Run("napkin_plane", "fem", {"cells": [6, 6], "time_step": 1 / rate})
    yield Run("napkin_plane", "fem", {"cells": [6, 6], "time_step": 1 / 240}, yardstick=True)


def runtime() -> Iterator[Run]:
    """Motions by seconds of computing (sections G.1 and I.1)."""
    for side, rate in ((2, 60), (3, 60), (4, 120), (6, 120)):
        yield Run("napkin_plane", "fem", {"cells": [side, side], "time_step": 1 / rate})
    yield Run("napkin_plane", "fem", {"cells": [8, 8], "time_step": 1 / 240}, yardstick=True)
    for neurons in (30, 60, 120, 240):
        yield Run("napkin_plane", "ndf-ritz", {"neurons": neurons})
    stopped = {**SMALL, "omega0": 5.0, "cells": [8, 8], "times": 10}
    for iterations in (100, 500):
        yield Run("napkin_plane", "ndf-published", {**stopped, "iterations": iterations})


def long() -> Iterator[Run]:
    """A napkin that swings in its plane for ever longer (section G.2): time, memory, and how long two meshes agree."""
    for until in (0.5, 2.0, 8.0):
        edited: dict[str, Any] = {"name": f"napkin_long_{words(until)}", "edits": {"until": until}}
        yield Run("napkin_plane", "fem", {"cells": [2, 2], "time_step": 1 / 60}, yardstick=until == 8.0, **edited)
        if until < 8.0:
            yield Run("napkin_plane", "fem", {"cells": [3, 3], "time_step": 1 / 60}, yardstick=True, **edited)


def droop() -> Iterator[Run]:
    """Figure 11 on the drooping napkin: linear, published and exact strains, solved for and trained."""
    edited: dict[str, Any] = {"name": "napkin_droop", "edits": {"until": 0.4}}
    yield Run("napkin_fixed_edges", "fem", {"cells": [8, 8], "time_step": 1 / 240}, yardstick=True, **edited)
    for strain in ("linear", "published", "exact"):
        yield Run("napkin_fixed_edges", "ndf-ritz", {"neurons": 120, "strain": strain}, **edited)
        trained = {**SMALL, "omega0": 5.0, "cells": [8, 8], "times": 10, "iterations": 500, "strain": strain}
        yield Run("napkin_fixed_edges", "ndf-published", trained, **edited)


def trained() -> Iterator[Run]:
    """Activations on the repaired training of the plate (Table 3)."""
    repaired = {"width": 128, "schedule": "cosine", "averaging": 0.99, "keep": "best"}
    for activation in ("sine", "tanh", "gelu"):
        yield Run("square_plate", "ndf-published", {**repaired, "learning_rate": 2e-4, "activation": activation})


def components() -> Iterator[Run]:
    """Figure 10: Cartesian or covariant components from the output layer, on trained roofs and cylinders.

    Angles make covariant components large: by arc lengths they are those of an orthonormal local basis. The choices of
    the repaired training were made with Cartesian ones. One seed of the cylinder, which takes twice as long.
    """
    repaired = {"width": 128, "schedule": "cosine", "averaging": 0.99, "keep": "best"}
    roof, cylinder = {"learning_rate": 2e-3, "omega0": 5.0}, {"learning_rate": 5e-4, "omega0": 8.0}
    for seed in (0, 1):
        for bases in ("cartesian", "covariant"):
            yield Run("scordelis_lo", "ndf-published", {**repaired, **roof, "components": bases}, seed=seed)
        covariant = {**repaired, **roof, "components": "covariant"}
        yield Run("scordelis_lo", "ndf-published", covariant, name="roof_by_arc_length", seed=seed)
    for bases in ("cartesian", "covariant"):
        yield Run("pinched_cylinder_diaphragm", "ndf-published", {**repaired, **cylinder, "components": bases})


def natural() -> Iterator[Run]:
    """The four shells of Table 3 by natural gradient; the settings were chosen by certified energy of seed 0.

    Layers, frequency and precision are as printed. Cells, width and iterations are as many as ten minutes of a core
    allow.
    """
    settings = {
        "optimiser": "natural",
        "width": 24,
        "cells": [80, 80],
        "learning_rate": 1.0,
        "schedule": "cosine",
        "averaging": 0.95,
        "keep": "best",
        "certify_every": 25,
        "pins": "none",
    }
    cylinders = {"pinched_cylinder_diaphragm": 500, "pinched_cylinder_free": 350}
    lengths = {**cylinders, "scordelis_lo": 100, "square_plate": 60}
    for case, iterations in lengths.items():
        singular = {"singular": 4} if case in cylinders else {}
        for seed in range(3):
            yield Run(case, "ndf-published", {**settings, "iterations": iterations, **singular}, seed=seed)


STUDIES = {one.__name__: one for one in (thin, times, runtime, long, droop, trained, components, natural)}


def case_file(run: Run) -> str:
    """Return the argument of `shellbench run`: the name of the case, or the file of an edited one, which is written."""
    if not run.name:
        return run.base
    if not run.edits:
        return str(KEPT / f"{run.name}.toml")
    text = (ROOT / f"cases/{run.base}.toml").read_text().partition("[[quantities]]")[0]
    text = re.sub(r"(?m)^suites = .*\n", "", text)
    for key, value in run.edits.items():
        text, found = re.subn(rf"(?m)^{key} = .*$", f"{key} = {value!r}", text)
        assert found == 1, f"{run.base} has no single {key}"
    down = np.argmin([float(a) for a in re.search(r"acceleration = \[(.*)\]", text)[1].split(",")])  # type: ignore[index]
    until = run.edits["until"]
    for name, at, primary in (("half", until / 2, "false"), ("end", until, "true")):
        text += (
            f'[[quantities]]\nname = "centre_{name}"\nkind = "centre_of_mass"\ndirection = {np.eye(3)[down].tolist()}\n'
        )
        text += f"at = {at!r}\nprimary = {primary}\nabsolute = true\n\n"
        for energy in ("membrane_energy", "bending_energy", "total_energy"):
            absolute = "absolute = true\n" if energy == "total_energy" else ""
            text += f'[[quantities]]\nname = "{energy}_{name}"\nkind = "{energy}"\nat = {at!r}\n{absolute}\n'
    path = STORE / "cases" / f"{run.name}.toml"
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.is_file() or path.read_text() != text:
        path.write_text(text)
    return str(path)


def make(runs: list[Run]) -> None:
    """Make the runs that have no record, and note the processor time of each; a failed run is tried again."""
    for run in runs:
        command = ["run", case_file(run), "--solver", run.solver, "--store", str(STORE)]
        command += ["--threads", "1", "--jobs", "1", "--timeout", "900"]
        if run.solver != "fem":
            command += ["--seed", str(run.seed)]
        for key, value in run.settings.items():
            command += ["--set", f"{run.solver}.{key}={value if isinstance(value, list) else json.dumps(value)}"]
        before, began = processor_seconds(), time.perf_counter()
        with contextlib.suppress(SystemExit):
            app(command, standalone_mode=False)
        share = (processor_seconds() - before) / (time.perf_counter() - began)
        if (record := record_of(run)) is not None:
            with SHARES.open("a") as file:
                file.write(json.dumps({"run_id": record["run_id"], "share": share}) + "\n")


def processor_seconds() -> float:
    """Return the processor time of all ended runs, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def share_of(run_id: str) -> float:
    """Return the share of a processor that a run had; later lines belong to commands that found its record."""
    lines = map(json.loads, SHARES.read_text().splitlines())
    return next((line["share"] for line in lines if line["run_id"] == run_id), math.nan)


def record_of(run: Run) -> dict[str, Any] | None:
    """Return the newest record of a run."""
    found = []
    for path in STORE.glob(f"{run.case}-{run.solver}-*.json"):
        one = json.loads(path.read_text())
        identity = one["identity"]
        same = identity["settings"] == one["defaults"] | run.settings
        if one["case_name"] == run.case and same and identity["seed"] in (None, run.seed):
            found.append(one)
    return max(found, key=lambda one: one["sequence"], default=None)


def probes(record: dict[str, Any] | None) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the times and the displacements (T, N, 3) at the case's own probes."""
    if record is None or not record.get("fields_file"):
        return None
    with np.load(STORE / record["fields_file"]) as fields:
        return fields["probe_marks"], fields["probe_displacements"]


def line_of(run: Run, yardstick: dict[str, Any] | None) -> dict[str, Any]:
    """Return the figures of a run that are kept."""
    kept = {"case": run.case, **run.edits, "solver": run.solver, "settings": json.dumps(run.settings), "seed": run.seed}
    record = record_of(run)
    if record is None:
        return kept | {"status": "not run"}
    known, resolved = record["diagnostics"], record["history"]
    kept |= {
        "status": record["status"],
        "seconds": record["seconds"] * share_of(record["run_id"]),
        "parameters": record["parameters"],
    }
    kept |= {"storage_bytes": record["storage_bytes"], "time_steps": known.get("time_steps")}
    if record["peak_memory_bytes"] and record["idle_memory_bytes"]:
        kept["solve_bytes"] = record["peak_memory_bytes"] - record["idle_memory_bytes"]
    kept |= {name: known.get(name) for name in ("energy_gap", "energy_drift", "fine_functional", "training_functional")}
    if known.get("fine_functional") is not None and len(resolved) > 10:
        last = np.array([step["energy"] for step in resolved[-10:]])
        kept["scatter"] = float(np.std(last - np.polyval(np.polyfit(np.arange(10), last, 1), np.arange(10))))
    kept |= {name: one["value"] for name, one in record["values"].items() if run.name or name in ASKED}
    if "certified_energy" in known:
        values, primary = catalog.known_values(run.base), catalog.named_case(run.base).primary.name
        least, judge = (values.judge(name, "kirchhoff-love-linear").value for name in ("strain_energy", primary))
        kept |= {
            "above": 1 + known["certified_energy"] / least,
            "error": record["values"][primary]["value"] / judge - 1,
        }
        course = [(step["iteration"], step["quantities"]) for step in resolved]
        kept["course"] = json.dumps(  # iteration: energy above the least, error of the displacement
            {
                at: [round(1 + of["certified_energy"] / least, 6), round(of[primary] / judge - 1, 6)]
                for at, of in course
                if "certified_energy" in of
            }
        )
    mine, best = probes(record), probes(yardstick)
    if mine and best and not run.yardstick:
        off = np.sqrt(((mine[1] - best[1]) ** 2).sum(-1).mean(-1))
        kept |= {"off_half": float(np.interp(mine[0][-1] / 2, mine[0], off)), "off_end": float(off[-1])}
        apart = np.flatnonzero(off > CLOSE)
        kept["together"] = float(mine[0][max(apart[0] - 1, 0)] if len(apart) else mine[0][-1])
    kept |= {"run_id": record["run_id"], "commit": record["environment"]["git_sha"][:9]}
    return kept


ASKED = ("fall_500ms", "fall_1000ms", "corner_y_500ms", "centre_y_400ms")


def keep(name: str) -> None:
    """Write the figures of a study's runs, a line each."""
    runs = list(STUDIES[name]())
    if not any(record_of(run) for run in runs):
        raise SystemExit(f"no run of {name} has a record: make them by `python docs/studies.py run {name}`")
    best = {run.case: record_of(run) for run in runs if run.yardstick}
    lines = [line_of(run, best.get(run.case)) for run in runs]
    columns = list(dict.fromkeys(key for line in lines for key in line))
    write(name, columns, lines)


def write(name: str, columns: list[str], lines: list[dict[str, Any]]) -> None:
    """Write a study's lines."""
    KEPT.mkdir(parents=True, exist_ok=True)
    with (KEPT / f"{name}.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows({key: brief(value) for key, value in line.items()} for line in lines)


def brief(value: Any) -> Any:
    """Return a number with seven digits; None if it is not finite."""
    return (f"{value:.7g}" if math.isfinite(value) else None) if isinstance(value, float) else value


def fit() -> None:
    """Fit fields of random sines of (xi, t), of the same size for each duration, to the napkins of `long` by `fem`.

    The output layer is fitted by least squares at random places and times. The error is measured at other random ones,
    and the frequency in time with the least error is kept.
    """
    lines = []
    for run in (one for one in long() if one.yardstick):
        record = record_of(run)
        if record is None:
            raise SystemExit(f"{run.name} has no record: make it by `python docs/studies.py run long`")
        solution, until = load_solver(find_solver("fem")).load(STORE / record["solution_file"]), run.edits["until"]
        rng = np.random.default_rng(0)
        at, xi = np.sort(rng.uniform(0, until, 400)), rng.uniform(0, 1, (400, 40, 2))
        u = np.concatenate([solution.displacement_at(points, t) for points, t in zip(xi, at, strict=True)])
        inputs = np.column_stack([xi.reshape(-1, 2), np.repeat(at, 40)])
        held = np.arange(len(u)) // 40 % 5 == 0  # each fifth instant is not fitted
        for features in (125, 500):
            weights, phases = rng.standard_normal((3, features)), rng.uniform(0, 2 * np.pi, features)
            best = math.inf
            for rate in (2, 4, 8, 16):  # rad/s
                seen = np.sin(inputs @ (weights * np.array([[4], [4], [rate]])) + phases)
                matrix = seen[~held].T @ seen[~held]
                output = np.linalg.solve(
                    matrix + 1e-8 * np.trace(matrix) / features * np.eye(features), seen[~held].T @ u[~held]
                )
                best = min(best, float(np.sqrt(((seen @ output - u)[held] ** 2).sum(-1).mean())))
            numbers = 8 * 7 * features  # three weights, a phase and three outputs each
            size = {"until": until, "features": features, "bytes": numbers, "history_bytes": record["storage_bytes"]}
            lines.append(size | {"off": best, "run_id": record["run_id"]})
    write("constant", list(lines[0]), lines)


def main() -> None:
    """Run, keep or fit the studies that are named, or all."""
    what, *names = sys.argv[1:] or [""]
    if what not in ("run", "keep", "fit") or not set(names) <= STUDIES.keys():
        raise SystemExit(f"{__doc__}\nStudies: {', '.join(STUDIES)}")
    if what == "fit":
        fit()
    for name in names or STUDIES:
        if what == "run":
            make(list(STUDIES[name]()))
        elif what == "keep":
            keep(name)


if __name__ == "__main__":
    main()
