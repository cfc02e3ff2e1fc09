"""Tables and figures of docs/studies.md from reports/studies: `python docs/studies_page.py` writes both, in seconds.

What stands between `<!-- table NAME -->` and `<!-- end -->` is overwritten.
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes

from shellbench.report.data.exhibit import DASHES, inks, style
from shellbench.report.figures.panel import add_legend, entry, finish, open_figure

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/studies.md"
SOLVERS = ("fem", "ndf-ritz", "ndf-published")
INKS = inks(SOLVERS)
AREA_DENSITY, GRAVITY = 0.144, 9.8  # of the napkin that falls freely for 1 s, kg/m2 and m/s2
LEAST = -AREA_DENSITY * GRAVITY**2 / 6  # J: ∫ (½ρu̇² - ρgu) dt at u = g(t - t²/2), the stationary point for T = 1 s
Line = dict[str, Any]


def lines_of(name: str) -> list[Line]:
    """Return the kept lines of a study: numbers as numbers, settings by name."""
    with (ROOT / f"reports/studies/{name}.csv").open(newline="") as file:
        return [{key: number(value) for key, value in line.items()} for line in csv.DictReader(file)]


def number(text: str) -> Any:
    """Return a cell as a number or text; None if it is empty."""
    if text.startswith("{"):
        return json.loads(text)
    try:
        return float(text) if text else None
    except ValueError:
        return text


def short(value: Any, digits: int = 2) -> str:
    """Write a number with limited digits; a dash for None, and text unchanged."""
    return "–" if value is None else value if isinstance(value, str) else f"{value:.{digits}g}"


def table(heads: Iterable[str], rows: Iterable[Iterable[Any]]) -> list[str]:
    """Return a table in Markdown."""
    heads = list(heads)
    cells = ["| " + " | ".join(row if isinstance(row, str) else short(row) for row in one) + " |" for one in rows]
    return ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads), *cells]


def percent(value: float | None) -> str:
    """Write a relative difference; a dash for none."""
    return "–" if value is None else f"{100 * value:+.2g} %"


def ended(line: Line) -> str:
    """Return the status of a run that is not ok, in brackets."""
    return "" if line["status"] == "ok" else f" ({line['status']})"


def millimetres(length: float) -> str:
    """Write a length in m with two digits, in mm."""
    return f"{float(f'{1000 * length:.2g}'):g} mm"


def motions() -> list[str]:
    """Return the distance from the finest mesh and the seconds of the finest run of each solver, a motion a row."""
    groups = [("in its plane, 0.5 s", lines_of("runtime"))]
    groups += [(f"h = {h:g} m, 0.3 s", of_one) for h, of_one in by("thickness", lines_of("thin"))]
    for strain in ("linear", "published", "exact"):
        drooping = [line for line in lines_of("droop") if line["settings"].get("strain") == strain]
        groups.append((f"h = 0.0012 m, 0.4 s, {strain} strain", drooping))
    rows = [(name, *(finest(lines, solver) for solver in SOLVERS)) for name, lines in groups]
    return table(("napkin", *(f"`{solver}`" for solver in SOLVERS)), rows)


def finest(lines: list[Line], solver: str) -> str:
    """Return distance and seconds of the last, and finest, run of a solver that is not the yardstick."""
    found = [line for line in lines if line["solver"] == solver and line["off_end"] is not None]
    return f"{millimetres(found[-1]['off_end'])}, {found[-1]['seconds']:.2g} s" if found else "–"


def times() -> list[str]:
    """Return the surplus of the functional of a free fall over the least, and the scatter of its loss, by samples in time."""
    rows = []
    falls = [line for line in lines_of("times") if line["case"] == "free_fall"]
    for count, of_one in by("count", [{**line, "count": line["settings"]["times"]} for line in falls]):
        above = (percent((line["fine_functional"] - LEAST) / -LEAST) for line in of_one)
        rows.append((f"{count}", "; ".join(above), "; ".join(short(line["scatter"]) for line in of_one)))
    return table(("samples in time", "functional above the least", "scatter of the loss, J"), rows)


def constant() -> list[str]:
    """Return the error of fields of constant size, fitted to motions of `fem`, and the bytes of both."""
    rows = []
    for until, of_one in by("until", lines_of("constant")):
        off = (millimetres(line["off"]) for line in of_one)
        sizes = f"{of_one[0]['history_bytes'] / 1e6:.2g} MB"
        rows.append((f"{until:g} s", sizes, *off))
    counts = [
        f"{count:.0f} features, {8 * 7 * count / 1000:.0f} kB" for count, _ in by("features", lines_of("constant"))
    ]
    return table(("until", "`fem`'s history", *counts), rows)


def trained() -> list[str]:
    """Return energy and displacement of repaired trainings, by activation and by components of the output."""
    rows = [
        (line["case"], f"{line['settings']['activation']}, Cartesian" + ended(line), "0", *errors_of(line))
        for line in lines_of("trained")
    ]
    for line in lines_of("components"):
        shell = "scordelis_lo" if line["case"] == ARC else line["case"]
        rows.append((shell, f"sine, {basis_of(line)}" + ended(line), f"{line['seed']:.0f}", *errors_of(line)))
    return table(("shell", "activation, output", "seed", "certified energy above the least", "displacement"), rows)


def errors_of(line: Line) -> tuple[str, str]:
    """Return the energy above the least and the error of the displacement of a training."""
    return percent(line["above"]), percent(line["error"])


BASES = {"cartesian": "Cartesian", "covariant": "covariant"}
ARC = "roof_by_arc_length"


def basis_of(line: Line) -> str:
    """Return the name of the output layer's components."""
    return BASES[line["settings"]["components"]] + (", by arc length" if line["case"] == ARC else "")


def by(key: str, lines: list[Line]) -> Iterator[tuple[Any, list[Line]]]:
    """Yield the lines of each value, in their order."""
    for value in dict.fromkeys(line[key] for line in lines):
        yield value, [line for line in lines if line[key] == value]


def curves(
    axes: Axes, groups: dict[str, list[Line]], x: str | Callable[[Line], Any], y: str | Callable[[Line], Any]
) -> dict[str, Any]:
    """Draw a curve for each group; return their entries of the legend."""
    entries = {}
    seen: dict[str, int] = {}
    for label, lines in groups.items():
        ink = INKS[lines[0]["solver"]]
        line = DASHES[seen.get(ink.colour, 0) % len(DASHES)]
        seen[ink.colour] = seen.get(ink.colour, 0) + 1
        points = [[one[k] if isinstance(k, str) else k(one) for k in (x, y)] for one in lines]
        points = [pair for pair in points if None not in pair and pair[1] > 0]
        if points:
            axes.plot(*zip(*points, strict=True), color=ink.colour, marker=ink.marker, linestyle=line, markersize=4.5)
            entries[label] = entry(ink, linestyle=line)
    return entries


def solvers(lines: Iterable[Line]) -> dict[str, list[Line]]:
    groups: dict[str, list[Line]] = {}
    for line in lines:
        groups.setdefault(line["solver"], []).append(line)
    return groups


def figures() -> Iterator[tuple[str, Any]]:
    """Yield the figures by name."""
    figure, ((left,),) = open_figure((4.8, 3.4))
    entries = curves(left, solvers(lines_of("runtime")), "seconds", "off_end")
    finish([left], "processor time (s)", "off the finest mesh at 0.5 s (m)", "Napkin in its plane")
    add_legend(figure, entries, 3)
    yield "runtime", figure

    figure, panels = open_figure((7.6, 5.6), 2, 2, sharex=True)
    entries = {}
    for line in (one for one in lines_of("components") if one["course"]):
        at = [int(iteration) for iteration in line["course"]]
        above, error = zip(*line["course"].values(), strict=True)
        dashes = DASHES[(line["case"] == ARC) + (line["settings"]["components"] == "covariant")]
        ink, column = INKS["ndf-published"], int(line["case"] == "pinched_cylinder_diaphragm")
        for axes, values in zip(panels[:, column], (above, error), strict=True):
            heights = [100 * value for value in values]
            axes.plot(at, heights, color=ink.colour, marker=ink.marker, linestyle=dashes, markersize=3.5)
        entries[basis_of(line)] = entry(ink, linestyle=dashes)
    for axes, title in zip(panels[0], ("Scordelis-Lo roof", "Pinched cylinder, diaphragms"), strict=True):
        finish([axes], y="certified energy above the least (%)", title=title, log="y")
    for axes in panels[1]:
        finish([axes], "iterations", "displacement off the known value (%)", log="")
        axes.axhline(0.0, color="black", linewidth=0.6)
    add_legend(figure, entries, 3)
    yield "components", figure


def main() -> None:
    """Write the tables into the page, and the figures beside it."""
    text = PAGE.read_text(encoding="utf-8")
    for name in re.findall(r"<!-- table (\w+) -->", text):
        made = "\n".join(TABLES[name]())
        text = re.sub(
            rf"(?s)(<!-- table {name} -->\n).*?(<!-- end -->)", lambda m, made=made: f"{m[1]}\n{made}\n\n{m[2]}", text
        )
    PAGE.write_text(text, encoding="utf-8")
    with style():
        for name, figure in figures():
            figure.savefig(ROOT / f"docs/figures/study_{name}.png", dpi=150)


TABLES: dict[str, Callable[[], list[str]]] = {one.__name__: one for one in (motions, times, constant, trained)}

if __name__ == "__main__":
    main()
