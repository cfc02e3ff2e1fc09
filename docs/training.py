"""Comparisons of trained and drawn hidden layers, shown by docs/deep_fields.md.

python docs/training.py run     solve, on one core, and write reports/training.json: half an hour
python docs/training.py         write the tables of the page and docs/figures/study_training.png: seconds

Drawn and trained fields have the same start. Known values judge both; nothing is chosen by them.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import torch
from studies_page import table
from torch import Tensor

from derivations.drawn_shells import drawn, with_load
from shellbench.bench.catalogue import catalog
from shellbench.errors import SolveFailure
from shellbench.problems.shell.case import Case, build_case
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.report.data.exhibit import DASHES, inks, style
from shellbench.report.figures.panel import add_legend, entry, finish, open_figure
from shellbench.solvers.fem.solver import FemSettings, FemSolver
from shellbench.solvers.ndf.field.ansatz import Combined
from shellbench.solvers.ndf.field.build import build_ansatz, build_features, build_inputs
from shellbench.solvers.ndf.field.jets import VALUE, Placement
from shellbench.solvers.ndf.field.network import Network, deep_random_features
from shellbench.solvers.ndf.field.quadrature import NOWHERE, RuleSpec, area_rule
from shellbench.solvers.ndf.motion.motion_problem import Motion
from shellbench.solvers.ndf.ritz_solver import RitzSettings, RitzSolver
from shellbench.solvers.ndf.strains.smooth import orthonormal, scales, smooth, width_for
from shellbench.solvers.ndf.trainer_solver import NdfSolver, TrainerSettings
from shellbench.solvers.ndf.training.at_rest import field_spec
from shellbench.solvers.ndf.training.gauss_newton import flatten, forward, jacobian, unflatten

ROOT = Path(__file__).parents[1]
KEPT, PAGE, FIGURE = (
    ROOT / "reports/training.json",
    ROOT / "docs/deep_fields.md",
    ROOT / "docs/figures/study_training.png",
)
SEEDS = 0, 1, 2
STARTS = "fitted", "random"
Line = dict[str, Any]

# The width of the last hidden layer of each comparison, and settings beside it. Widths were chosen so that the drawn
# field lacks a part that is seen.
AT_REST = {
    "square_plate": (10, {}),
    "scordelis_lo": (40, {}),
    "pinched_cylinder_diaphragm": (40, {"mirrors": True}),
    "pinched_cylinder_free": (40, {"mirrors": True}),
}
PATHS = {"square_plate_nonlinear": 20, "scordelis_lo_nonlinear": 40, "cantilever_shear": 20, "cantilever_moment": 40}
WIDER = 2, 4, 8  # times the width: drawn fields among which the one of equal seconds is taken
STEPS, PATH_STEPS, LEAST = 30, 12, 1e-8

QUANTITIES = "".join(
    f'[[quantities]]\nname = "{name}"\nkind = "{name}"\nprimary = {str(not k).lower()}\n'
    for k, name in enumerate(("largest_displacement", "strain_energy", "bending_energy"))
)
RIM, STEEL = '["xi1_min", "xi1_max", "xi2_min", "xi2_max"]', "youngs_modulus = 2e11\npoissons_ratio = 0.3"


def unseen(surface: str, on: str, load: str, thickness: float, more: str = "", held: str = "clamped = true") -> str:
    """Return the text of a linear shell."""
    support = f'[[supports]]\nname = "rim"\non = {on}\n{held}\n' if on else ""
    return (
        f'title = "Unseen"\ntheory = "kirchhoff-love-linear"\n[surface]\nkind = "expression"\n{surface}\n'
        f"[material]\n{STEEL}\nthickness = {thickness}\n{support}{more}[[loads]]\n{load}\n{QUANTITIES}"
    )


def plane(x: str, y: str, sides: str) -> str:
    """Return a flat surface."""
    return f'x = "{x}"\ny = "{y}"\nz = "0"\n{sides}'


UNIT = "xi1 = [0, 1]\nxi2 = [0, 1]"
UNSEEN = {
    "dome on an elastic ring": unseen(
        'x = "cos(xi2)*cos(xi1)"\ny = "cos(xi2)*sin(xi1)"\nz = "sin(xi2)"\nxi1 = [0, 360]\nxi2 = [20, 75]\n'
        'angles = ["xi1", "xi2"]\nperiodic = ["xi1"]',
        "", 'kind = "pressure"\nvalue = "1e4*(1 + cos(2*xi1))"', 0.01,
        '[[springs]]\nname = "ring"\nstiffness = "1e10*exp(-((xi2 - 0.349)/0.05)**2)"\n',
    ),
    "strip, 1 : 20": unseen(
        plane("xi1", "xi2", "xi1 = [0, 20]\nxi2 = [0, 1]"), '["xi1_min"]',
        'kind = "area"\nvector = [0, 0, "-1 - xi2"]', 0.05,
    ),
    "patch of a torus": unseen(
        'x = "(3 + cos(xi2))*cos(xi1)"\ny = "(3 + cos(xi2))*sin(xi1)"\nz = "sin(xi2)"\nxi1 = [-40, 40]\n'
        'xi2 = [-60, 60]\nangles = ["xi1", "xi2"]',
        '["xi1_min", "xi1_max"]', 'kind = "pressure"\nvalue = 1e3', 0.005,
    ),
    "tapered cantilever": unseen(
        plane("xi1", "xi2*(1 - 0.4*xi1)", "xi1 = [0, 1]\nxi2 = [-0.5, 0.5]"), '["xi1_min"]',
        'kind = "area"\nvector = [0, 0, -1000]', 0.01,
    ),
    "skew plate": unseen(
        plane("xi1 + xi2*cos(1.2)", "xi2*sin(1.2)", UNIT), RIM, 'kind = "area"\nvector = [0, 0, -1000]', 0.01
    ),
    "arch on a bed": unseen(
        'x = "xi1"\ny = "xi2"\nz = "0.1*xi1*xi1"\nxi1 = [-1, 1]\nxi2 = [0, 1]', '["xi1_min", "xi1_max"]',
        'kind = "area"\nvector = [0, 0, "-1000*(1 + xi1*xi2)"]', 0.01,
        '[[springs]]\nname = "bed"\nstiffness = 1e5\ncomponents = ["z"]\n', 'components = ["x", "y", "z"]',
    ),
}  # fmt: skip
MOTION, DEGREES_FITTED, FITTED = "napkin_plane", (6, 8, 10, 13), 40
DRAWN = 2, 3, 4, 6, 12, 14  # seeds of `derivations.drawn_shells`, whose answers are prescribed


def field(case: Case, **settings: Any) -> Line:
    """Return seconds of the processor, parameters, and the error of the headline after each step."""
    known = catalog.known_values(case.name).judge(case.primary.name, case.theory).value
    began = time.process_time()
    try:
        answer = NdfSolver().solve(case, TrainerSettings(**settings))
    except SolveFailure as failure:
        return {"settings": settings, "failed": str(failure)}
    seconds = time.process_time() - began
    steps = [(one.iteration, one.seconds, one.quantities.get(case.primary.name)) for one in answer.history]
    return {
        "settings": settings,
        "seconds": round(seconds, 2),
        "parameters": answer.parameters,
        "error": measure_all(answer)[case.primary.name] / known - 1,
        "energy": answer.diagnostics["certified_energy"],
        "steps": [(k, round(at, 2), value / known - 1) for k, at, value in steps if value is not None],
    }


def comparisons() -> Iterator[Line]:
    """Yield the trained and the drawn fields of each case."""
    for name, (width, more) in AT_REST.items():
        for seed in SEEDS:
            for start in STARTS:
                trained = {"widths": (width,), "start": start, "iterations": STEPS, "tolerance": LEAST}
                yield {"case": name, **field(catalog.named_case(name), seed=seed, largest_gap=1.0, **trained, **more)}
            for wider in WIDER:
                drawn_one = {"widths": (wider * width,), "iterations": 0, **more}
                yield {"case": name, **field(catalog.named_case(name), seed=seed, largest_gap=1.0, **drawn_one)}
    for name, width in PATHS.items():
        for seed in SEEDS:
            for factor, steps in ((1, PATH_STEPS), (1, 0), *((wider, 0) for wider in WIDER)):
                settings = {"widths": (factor * width,), "iterations": steps, "seed": seed, "largest_gap": 1.0}
                yield {"case": name, **field(catalog.named_case(name), **settings)}


def unseen_shells() -> Iterator[Line]:
    """Yield the answers of elements and fields to shells on which nothing was tuned."""
    cases = {name: build_case(tomllib.loads(text), "unseen", name) for name, text in UNSEEN.items()}
    for seed in DRAWN:
        case = with_load(drawn(seed), f"drawn_{seed}")[0]
        cases[case.title] = case
    solvers = {
        "fem": (FemSolver, FemSettings),
        "ndf-ritz": (RitzSolver, RitzSettings),
        "ndf": (NdfSolver, TrainerSettings),
    }
    for name, case in cases.items():
        for solver, (kind, settings) in solvers.items():
            began = time.process_time()
            answer = kind().solve(case, settings())
            yield {
                "shell": name,
                "solver": solver,
                "seconds": round(time.process_time() - began, 1),
                "unsettled": answer.unsettled,
                "values": dict(measure_all(answer)),
            }


def fits() -> Iterator[Line]:
    """Yield the misfit of features to the last state of a motion, as drawn and trained on this state itself.

    The state is known here, so that no training on energies could do better. Polynomials are the bound of smooth
    combinations of features.
    """
    case, placement = catalog.named_case(MOTION), Placement()
    state = RitzSolver().solve(case, RitzSettings())
    spec = field_spec(TrainerSettings(), "exact").model_copy(update={"stretched": False, "multipliers": 0, "t": 0.0})
    ansatz, inputs, domain = build_ansatz(case, spec), build_inputs(case, spec), case.surface.domain
    values = inputs.jets(domain.grid(FITTED, FITTED).reshape(-1, 2), placement)[VALUE]
    rule_spec = RuleSpec((8, 8), 6)
    rule = area_rule(domain, NOWHERE, rule_spec)
    held = ansatz.factors.matrix(rule.points, placement)[VALUE, :, 0, 0]
    root = placement.tensor(rule.weights).sqrt() * held.abs()
    wanted = placement.tensor(state.displacement(rule.points, case.states[-1])) / held[:, None]
    inputs_at, sides = inputs.jets(rule.points, placement), (rule.points - domain.lower) / domain.size
    for degree in DEGREES_FITTED:
        width = width_for(case, degree)
        waves = np.einsum("ni,nj->nij", *(np.polynomial.legendre.legvander(2 * t - 1, degree) for t in sides.T))
        numbers = np.arange(degree + 1)
        low = np.add.outer(numbers * (numbers + 1), numbers * (numbers + 1)) <= degree * (degree + 1)
        network = deep_random_features(values, placement.tensor(scales(case, inputs, degree)), (8, 8, width), 0, "sine")
        trained = fitted_to(network, inputs_at, wanted, root)
        line: Line = {
            "degree": degree,
            "width": width,
            "polynomials": misfit(torch.tensor(waves[:, low]), wanted, root)[0],
        }
        for name, one in (("drawn", network), ("trained", trained)):
            features = build_features(case, spec, one, placement, inputs)
            some = smooth(ansatz, features, rule, degree)
            every = Combined(features, orthonormal(features.jets(rule.points), root**2))
            for kind, combined in (("smooth", some), ("all", every)):
                line[f"{name}, {kind}"] = misfit(combined.values(rule.points), wanted, root)[0]
                line[f"{name}, {kind}, frequency"] = Motion(case, spec, combined, rule_spec).highest_frequency()
        yield line


def misfit(features: Tensor, wanted: Tensor, root: Tensor) -> tuple[float, Tensor, Tensor]:
    """Return the relative misfit in the mean square of features (N, M), weights (M, 3), and what is left (N, 3)."""
    output = torch.linalg.lstsq(root[:, None] * features, root[:, None] * wanted, driver="gelsd").solution
    left = root[:, None] * (wanted - features @ output)
    return float(left.norm() / (root[:, None] * wanted).norm()), output, left


def fitted_to(network: Network, inputs: Tensor, wanted: Tensor, root: Tensor) -> Network:
    """Return a network trained on a known field by variable projection, 15 steps."""

    def features(one: Network) -> Tensor:
        return torch.cat([one.values(inputs[VALUE]), torch.ones_like(root)[:, None]], dim=1)

    damping, (now, output, left) = 1e-2, misfit(features(network), wanted, root)
    for _ in range(15):
        seed = wanted.new_zeros((len(wanted), 3, 6, network.width))
        seed[:, :, VALUE] = output[:-1].T
        rows = jacobian(network, forward(network, inputs)[1], seed).view(len(wanted), 3, -1) * root[:, None, None]
        basis, _ = torch.linalg.qr(root[:, None] * features(network))
        rows = rows.permute(1, 0, 2)
        rows = (rows - basis @ (basis.T @ rows)).reshape(3 * len(wanted), -1)
        matrix, slope = rows.T @ rows, rows.T @ left.T.reshape(-1)
        scale = matrix.diagonal().clamp_min(1e-30).sqrt()
        for _ in range(4):
            damped = matrix / scale[:, None] / scale + damping * torch.eye(len(scale), dtype=torch.float64)
            step = torch.linalg.solve(damped, slope / scale) / scale
            better = unflatten(flatten(network) + step, network)
            found = misfit(features(better), wanted, root)
            if found[0] < now:
                break
            damping *= 10
        else:
            return network
        network, damping, (now, output, left) = better, damping / 5, found
    return network


def run() -> None:
    """Solve, and keep what the page shows; with names of parts, these only."""
    torch.set_num_threads(1)
    kept: Line = {"commit": git_commit(), "fields": [], "unseen": [], "motion": []}
    parts = {"unseen": unseen_shells, "fields": comparisons, "motion": fits}
    if sys.argv[2:]:
        kept |= json.loads(KEPT.read_text()) | {part: [] for part in sys.argv[2:]}
        parts = {part: parts[part] for part in sys.argv[2:]}
    for part, lines in ((part, made()) for part, made in parts.items()):
        for line in lines:
            kept[part].append(line)
            print(part, *list(line.values())[:2], flush=True)
            KEPT.write_text(json.dumps(kept) + "\n")


def git_commit() -> str:
    """Return the commit that solves."""
    return subprocess.run(
        ["git", "rev-parse", "--short=8", "HEAD"], capture_output=True, text=True, cwd=ROOT
    ).stdout.strip()


def middle(errors: list[float]) -> str:
    """Return the median of the magnitudes, with the largest."""
    sizes = sorted(abs(e) for e in errors)
    return f"{median(sizes):.1e} ({sizes[-1]:.1e})"


def equal_width(lines: list[Line]) -> list[str]:
    """Return errors of drawn and trained fields, median and largest of the seeds, a case a row."""
    rows = []
    for name, width in {**{k: w for k, (w, _) in AT_REST.items()}, **PATHS}.items():
        own = [one for one in lines if one["case"] == name and "error" in one]
        trained = [one for one in own if one["settings"]["iterations"] and one["settings"].get("start") != "random"]
        seconds = max(one["seconds"] for one in trained)
        if name in AT_REST:
            same = [one["steps"][0][2] for one in trained]
        else:
            same = [o["error"] for o in own if not o["settings"]["iterations"] and o["settings"]["widths"] == [width]]
        wide = {}
        for one in own:
            if not one["settings"]["iterations"]:
                wide.setdefault(one["settings"]["widths"][0], []).append(one)
        affordable = [w for w, of_one in wide.items() if max(o["seconds"] for o in of_one) <= seconds]
        best = max(affordable, default=None)
        equal = f"{middle([o['error'] for o in wide[best]])}, {best} neurons" if best else "–"
        rows.append(
            (f"`{name}`", f"{width}", middle(same), middle([o["error"] for o in trained]), f"{seconds:.2g} s", equal)
        )
    heads = ("case", "neurons", "drawn", "trained", "seconds", "wider, drawn, in these seconds")
    return table(heads, rows)


def starts(lines: list[Line]) -> list[str]:
    """Return the errors before and after training, and the seconds to 1e-3, from both starts."""
    rows = []
    for name in AT_REST:
        for start in STARTS:
            own = [o for o in lines if o["case"] == name and o["settings"].get("start") == start and "error" in o]
            reached = [next((at for _, at, e in o["steps"] if abs(e) < 1e-3), None) for o in own]
            slowest = "not reached" if None in reached else f"{max(reached):.2g} s"
            first, last = (middle([o["steps"][k][2] for o in own]) for k in (0, -1))
            rows.append((f"`{name}`", start, first, last, slowest))
    return table(("shell", "start", "before training", "after", "within 1e-3 after"), rows)


def others(lines: list[Line]) -> list[str]:
    """Return the largest difference of each field to elements, by quantity relative, a shell a row."""
    rows = []
    for name in dict.fromkeys(one["shell"] for one in lines):
        own = {one["solver"]: one for one in lines if one["shell"] == name}
        cells = []
        for solver in ("ndf-ritz", "ndf"):
            values, reference = own[solver]["values"], own["fem"]["values"]
            size = reference["largest_displacement"]
            off = max(
                value if key == "field_error" else abs(value - reference[key]) / (size if "displacement" in key else reference[key])
                for key, value in values.items()
            )  # fmt: skip
            settled = "" if own[solver]["unsettled"] is None else ", not settled"
            cells.append(f"{off:.1e} in {own[solver]['seconds']:.2g} s{settled}")
        rows.append((name, *cells))
    return table(("shell", "`ndf-ritz`", "`ndf`"), rows)


def motion(lines: list[Line]) -> list[str]:
    """Return the misfits of drawn and trained features to a state of a motion, a degree a row."""
    kinds = "drawn, smooth", "trained, smooth", "drawn, all", "trained, all"
    rows = [
        (
            f"{one['degree']}, {one['width']}",
            f"{one['polynomials']:.1e}",
            *(f"{one[kind]:.1e} ({one[f'{kind}, frequency']:.0f})" for kind in kinds),
        )
        for one in lines
    ]
    return table(("degree, neurons", "polynomials", *kinds), rows)


def figure(lines: list[Line]) -> Any:
    """Return the errors against iterations from both starts, all seeds, a shell a panel."""
    drawing, panels = open_figure((7.6, 5.0), 2, 2)
    ink, entries = inks(("ndf",))["ndf"], {}
    for axes, name in zip(panels.flat, AT_REST, strict=True):
        for start, dashes in zip(STARTS, DASHES, strict=False):
            for one in lines:
                if one["case"] == name and one["settings"].get("start") == start and "error" in one:
                    at, errors = [s[0] for s in one["steps"]], [100 * abs(s[2]) for s in one["steps"]]
                    axes.plot(at, errors, color=ink.colour, linestyle=dashes, linewidth=0.9)
            entries[f"{start} start"] = entry(ink, linestyle=dashes)
        axes.axhline(0.1, color="black", linewidth=0.5)
        title = f"{catalog.named_case(name).title}, {AT_REST[name][0]} neurons"
        finish([axes], "iterations", "error of the displacement (%)", title, log="y")
    add_legend(drawing, entries, 2)
    return drawing


def main() -> None:
    """Write tables and figure, or run first."""
    if sys.argv[1:2] == ["run"]:
        run()
    kept = json.loads(KEPT.read_text())
    text = PAGE.read_text(encoding="utf-8")
    tables = {"width": equal_width(kept["fields"]), "starts": starts(kept["fields"]), "unseen": others(kept["unseen"])}
    tables["motion"] = motion(kept["motion"])
    for name, made in tables.items():
        before, rest = text.split(f"<!-- table {name} -->\n")
        text = (
            f"{before}<!-- table {name} -->\n\n"
            + "\n".join(made)
            + "\n\n<!-- end -->"
            + rest.split("<!-- end -->", 1)[1]
        )
    PAGE.write_text(text, encoding="utf-8")
    with style():
        figure(kept["fields"]).savefig(FIGURE, dpi=150)


if __name__ == "__main__":
    main()
