"""Write drape.md and its figure from kept values, or compute them: the drape test beside measured fabrics.

    python docs/drape.py                  # writes tables and figure: seconds
    python docs/drape.py run [NAME ...]   # computes what is not kept, or these anew: half an hour on one core

Values are kept in docs/data/drape.json. What stands between `<!-- table NAME -->` and `<!-- end -->` is overwritten.
"""

from __future__ import annotations

import json
import re
import sys
import time
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.lines import Line2D

from shellbench.report.data.exhibit import DASHES, inks, style
from shellbench.report.figures.panel import add_legend, finish, open_figure

HERE = Path(__file__).parent
KEPT, PAGE, FIGURE = HERE / "data/drape.json", HERE / "drape.md", HERE / "figures/study_drape.png"
SOLVERS = "fem", "ndf-ritz"
LENGTHS = (90, 80, 60, 50, 40, 35, 30, 25, 22, 20, 18, 16, 15, 14, 13, 12)
"""Bending lengths, mm, from the first folds down."""
SHOWN = (40, 30, 25, 20, 15)
END = 15  # mm at the load factor 1 of the cases
UP = [0, 0, 1]
THICKNESSES = 1.6, 0.5, 0.16  # mm; D / B = 12 / h^2
FOLDS = 4, 5, 6, 7
GRAVITY, GRAM_FORCE = 9.80665, 9.80665e-3

# Name, B in gf cm^2/cm, 2HB in gf cm/cm, weight in mg/cm^2, drape coefficient in %, and nodes: means of warp and weft.
# Matsudaira, Masuda, Wada & Yokura (2015), J. Textile Eng. 61(6), 69-73, doi 10.4188/jte.61.69, tables 1 and 2.
FABRICS = (
    ("cotton broadcloth", 0.118, 0.124, 12.38, 82.9, 2),
    ("polyester tropical", 0.077, 0.029, 11.65, 50.7, 5),
    ("wool tropical", 0.067, 0.033, 16.29, 49.8, 5),
    ("polyester faille", 0.019, 0.007, 10.43, 28.3, 7),
)
Line = dict[str, Any]


# --- values -------------------------------------------------------------------------------------------


def by_splines(thickness: float, folds: int, spans: int = 14, waves: int = 60) -> Line:
    """Return drape coefficients and potentials, J, of a ring of so many folds, by splines times harmonics to `waves`."""
    from derivations.cusick import BENDING, weight
    from derivations.cusick_by_splines import Ring, folded_path

    ring = Ring(spans, folds, waves // folds, 12 * BENDING / (thickness * 1e-3) ** 2)
    points = []
    try:
        for length, c in folded_path(ring, [mm * 1e-3 for mm in LENGTHS]):
            points.append([round(length * 1e3, 3), ring.coefficient(c), ring.potential(c, weight(length))])
    except ArithmeticError as failure:
        return {"points": points, "failure": str(failure)}
    return {"points": points}


def buckling(thickness: float) -> Line:
    """Return the bending length, mm, at which each number of folds begins, by the judge's splines."""
    from derivations.cusick import BENDING
    from derivations.cusick_by_splines import FINE, buckling_length

    membrane = 12 * BENDING / (thickness * 1e-3) ** 2
    return {"lengths": {str(n): 1e3 * buckling_length(n, FINE, membrane) for n in range(3, 9)}}


def solved(solver: str, angle: float, periodic: bool, folds: int | None = None, **settings: Any) -> Line:
    """Return drape coefficients of the folded case on another part of the ring, degrees, by a solver."""
    from shellbench.bench.catalogue import catalog
    from shellbench.bench.plugins.registry import find_solver, load_solver
    from shellbench.problems.shell.case import build_case
    from shellbench.problems.shell.quantities.measure import measure_reached

    data = catalog.named_case("cusick_drape_folded").model_dump(mode="json", exclude_unset=True, exclude={"name"})
    data["surface"] |= {"xi1": [0, angle], "periodic": ["xi1"] if periodic else []}
    if periodic or folds is not None:
        data["supports"] = data["supports"][:1]
    if folds is not None:
        plane = {"on": ["xi1_min", "xi1_max"], "components": ["across"], "clamped": True}
        data["supports"].append({"name": "planes", **plane})
    every = [
        {"name": f"at_{mm}", "kind": "drape_coefficient", "direction": UP, "at": END / mm}
        for mm in LENGTHS
        if mm >= END
    ]
    data["quantities"] = [{**q, "primary": q["name"] == f"at_{END}"} for q in every]
    data["quantities"].append({"name": "buckling", "kind": "critical_point", "unit": ""})
    if periodic:
        data["quantities"].append({"name": "folds", "kind": "folds", "direction": UP})
    case, taken = build_case(data, "drape", "drape.toml"), load_solver(find_solver(solver))
    found = measure_reached(taken.answer_from(None, case, taken.settings_type(**settings), lambda _: None))
    points = [[mm, found[f"at_{mm}"]] for mm in LENGTHS if f"at_{mm}" in found]
    line: Line = {"settings": settings, "points": points}
    if "buckling" in found:
        line["buckling"] = END / found["buckling"]
    return line | ({"folds": found["folds"]} if "folds" in found else {})


def round_ring(solver: str, **settings: Any) -> Line:
    """Return the quantities of the round ring by a solver."""
    from shellbench.bench.catalogue import catalog
    from shellbench.bench.plugins.registry import find_solver, load_solver
    from shellbench.problems.shell.quantities.measure import measure_reached

    taken = load_solver(find_solver(solver))
    answer = taken.answer_from(
        None, catalog.named_case("cusick_drape"), taken.settings_type(**settings), lambda _: None
    )
    return {"settings": settings, "values": measure_reached(answer)}


JOBS: dict[str, Callable[[], Line]] = {
    **{f"buckling {h}": partial(buckling, h) for h in THICKNESSES},
    **{
        f"splines {h} {n}": partial(by_splines, h, n, waves=60 if h < 1 else 42) for h in THICKNESSES[:2] for n in FOLDS
    },
    **{f"splines {h} 5 coarse": partial(by_splines, h, 5, 12, 40 if h < 1 else 30) for h in THICKNESSES[:2]},
    "round fem": partial(round_ring, "fem"),
    "round ndf-ritz": partial(round_ring, "ndf-ritz"),
    "fem 4": partial(solved, "fem", 45.0, False, 4, cells=[10, 8]),
    "fem 5": partial(solved, "fem", 36.0, False, 5, cells=[8, 8]),
    "fem 6": partial(solved, "fem", 30.0, False, 6, cells=[7, 8]),
    "fem 5 coarse": partial(solved, "fem", 36.0, False, 5, cells=[4, 6]),
    "fem ring": partial(solved, "fem", 360.0, True, cells=[20, 4]),
    "ndf-ritz 4": partial(solved, "ndf-ritz", 90.0, False),
}


def run(names: list[str]) -> None:
    """Compute the named values, or what is missing, and keep each as soon as it is found."""
    for name in names or JOBS:
        kept = json.loads(KEPT.read_text()) if KEPT.exists() else {}
        if name in kept and not names:
            continue
        began = time.perf_counter()
        line = JOBS[name]()
        kept = json.loads(KEPT.read_text()) if KEPT.exists() else {}
        kept[name] = line | {"seconds": round(time.perf_counter() - began, 1)}
        KEPT.write_text(json.dumps(kept, indent=1, sort_keys=True) + "\n")
        print(name, kept[name]["seconds"], flush=True)


# --- the page -----------------------------------------------------------------------------------------


def fabrics() -> list[tuple[str, float, float, int, float]]:
    """Return name, bending length (B / w)^(1/3), mm, drape coefficient, nodes, and friction of each fabric.

    The friction is half of the moment's hysteresis, 2HB / 2, over the moment of the weight at the disc, w L^2 / 2.
    """
    rows = []
    for name, b, hysteresis, mass, coefficient, nodes in FABRICS:
        weight = mass * 1e-2 * GRAVITY
        length = (b * GRAM_FORCE * 1e-2 / weight) ** (1 / 3)
        friction = hysteresis * GRAM_FORCE / (weight * (0.15 - 0.09) ** 2)
        rows.append((name, 1e3 * length, coefficient / 100, nodes, friction))
    return rows


def curve(line: Line) -> dict[float, float]:
    """Return the drape coefficients of a kept line by bending length, mm."""
    return {point[0]: point[1] for point in line["points"]}


def at(line: Line, length: float) -> float:
    """Return the drape coefficient of a line at a bending length, mm, between its points; NaN beyond them."""
    points = sorted(curve(line).items())
    return float(np.interp(length, *zip(*points, strict=True), left=np.nan, right=np.nan))


def percent(value: float) -> str:
    """Write a share in percent; a dash for NaN."""
    return "–" if np.isnan(value) else f"{100 * value:.1f} %"


def table(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> list[str]:
    """Return a table in Markdown."""
    heads = list(heads)
    lines = [heads, ["---"] * len(heads), *rows]
    return ["|" + "|".join(line) + "|" for line in lines]


def rounds(kept: Line) -> list[str]:
    """Return the quantities of the round ring: known values, and the errors of both solvers."""
    from shellbench.bench.catalogue import catalog

    judges = {row.quantity: row for row in catalog.known_values("cusick_drape").values if row.role == "judge"}
    units = {q.name: q.unit for q in catalog.named_case("cusick_drape").quantities}
    rows = []
    for name, row in judges.items():
        errors = [kept[f"round {solver}"]["values"].get(name) for solver in SOLVERS]
        off = ["–" if value is None else f"{value / row.value - 1:+.0e}" for value in errors]
        rows.append((f"`{name}`", f"{row.value:.6g} {units[name]}".strip(), *off))
    return table(("quantity", "known value", *(f"error of `{solver}`" for solver in SOLVERS)), rows)


def buckled(kept: Line) -> list[str]:
    """Return the bending lengths at which folds begin, a thickness a row."""
    rows = []
    for h in THICKNESSES:
        if f"buckling {h}" not in kept:
            continue
        lengths = kept[f"buckling {h}"]["lengths"]
        first = max(lengths, key=lengths.get)
        rows.append((f"{h:g} mm", f"{12 * (150 / h) ** 2:.1e}", f"{lengths[first]:.1f} mm", first))
    return table(("thickness h", "D R^2 / B", "folds begin at c", "folds"), rows)


def folded(kept: Line) -> list[str]:
    """Return drape coefficients by bending length, a column a number of folds and method."""
    names = [name for name in HEADS if name in kept]
    heads = ("c, mm", *(HEADS[name] for name in names))
    return table(heads, [(f"{c}", *(percent(at(kept[name], c)) for name in names)) for c in SHOWN])


def measured(kept: Line) -> list[str]:
    """Return measured fabrics beside the computed range over numbers of folds."""
    rows = []
    for name, length, coefficient, nodes, friction in fabrics():
        spans = []
        for h in THICKNESSES[:2]:
            values = [at(kept[f"splines {h} {n}"], length) for n in FOLDS if f"splines {h} {n}" in kept]
            known = [value for value in values if not np.isnan(value)]
            spans.append(f"{100 * min(known):.0f} to {100 * max(known):.0f} %" if known else "–")
        rows.append((name, f"{length:.1f} mm", percent(coefficient), f"{nodes}", *spans, f"{100 * friction:.0f} %"))
    heads = ("fabric", "c", "measured", "folds", *(f"h = {h:g} mm" for h in THICKNESSES[:2]), "friction")
    return table(heads, rows)


HEADS = {
    "splines 0.5 4": "4 folds, splines",
    "fem 4": "`fem`",
    "ndf-ritz 4": "`ndf-ritz`",
    "splines 0.5 5": "5 folds, splines",
    "fem 5": "`fem`",
}
TABLES = {"rounds": rounds, "buckled": buckled, "folded": folded, "measured": measured}


def figure(kept: Line) -> Any:
    """Return the figure: drape coefficient against bending length, with measured fabrics."""
    drawn, ((axes,),) = open_figure((6.4, 4.2))
    colours = dict(zip(THICKNESSES[:2], ("#999999", "#332288"), strict=True))
    entries = {}
    for h, colour in colours.items():
        for n, dashes in zip(FOLDS, DASHES, strict=True):
            if f"splines {h} {n}" not in kept:
                continue
            x, y = zip(*sorted(curve(kept[f"splines {h} {n}"]).items()), strict=True)
            axes.plot(x, 100 * np.array(y), color=colour, linestyle=dashes, linewidth=0.9)
            entries[f"{n} folds, h = {h:g} mm"] = Line2D([], [], color=colour, linestyle=dashes)
    ink = inks(SOLVERS)
    for solver, names in (("fem", ("fem 4", "fem 5", "fem 6", "fem ring")), ("ndf-ritz", ("ndf-ritz 4",))):
        for name in filter(kept.__contains__, names):
            x, y = zip(*curve(kept[name]).items(), strict=True)
            look = {"color": ink[solver].colour, "marker": ink[solver].marker, "linestyle": "none"}
            axes.plot(x, 100 * np.array(y), markersize=3, **look)
        entries[f"{solver}, h = 0.5 mm"] = Line2D([], [], **look)
    for name, length, coefficient, nodes, _ in fabrics():
        axes.plot(length, 100 * coefficient, marker="*", markersize=9, color="#D55E00", linestyle="none")
        beside = {"xytext": (-7, -3), "ha": "right"} if "wool" in name else {"xytext": (7, -3)}
        axes.annotate(f"{name}, {nodes} folds", (length, 100 * coefficient), textcoords="offset points", **beside)
    entries["measured (Matsudaira et al. 2015)"] = Line2D([], [], marker="*", color="#D55E00", linestyle="none")
    finish([axes], "bending length c = (B/w)^(1/3) (mm)", "drape coefficient (%)", "Cusick drape test", log="x")
    axes.set_ylim(0, 102)
    axes.set_xticks([12, 15, 20, 30, 40, 60, 90], ["12", "15", "20", "30", "40", "60", "90"])
    add_legend(drawn, entries, 3)
    return drawn


def page(kept: Line, text: str) -> str:
    """Return the page with its tables written anew."""
    for name, made in TABLES.items():
        rows = "\n".join(made(kept))
        text = re.sub(
            rf"(?s)(<!-- table {name} -->\n).*?(<!-- end -->)", lambda m, rows=rows: f"{m[1]}\n{rows}\n\n{m[2]}", text
        )
    return text


def main(arguments: list[str]) -> None:
    """Compute values, or write page and figure."""
    if arguments[:1] == ["run"]:
        return run(arguments[1:])
    kept = json.loads(KEPT.read_text(encoding="utf-8"))
    PAGE.write_text(page(kept, PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    with style():
        figure(kept).savefig(FIGURE, dpi=150)
    return None


if __name__ == "__main__":
    main(sys.argv[1:])
