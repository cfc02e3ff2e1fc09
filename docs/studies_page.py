"""Tables and figures of docs/studies.md from reports/studies: `python docs/studies_page.py` writes both, in seconds.

What stands between `<!-- table NAME -->` and `<!-- end -->` is written anew; words around it are ours.
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
INKS = inks(("fem", "ndf-ritz", "ndf-published"))
AREA_DENSITY, GRAVITY = 0.144, 9.8  # of the napkin that falls freely for 1 s, kg/m2 and m/s2
LEAST = -AREA_DENSITY * GRAVITY**2 / 6  # J: ∫ (½ρu̇² - ρgu) dt at u = g(t - t²/2), the stationary point for T = 1 s
Line = dict[str, Any]


def lines_of(name: str) -> list[Line]:
    """Return the stored lines of a study's runs: numbers as numbers, settings by name."""
    with (ROOT / f"reports/studies/{name}.csv").open(newline="") as file:
        return [{key: number(value) for key, value in line.items()} for line in csv.DictReader(file)]


def number(text: str) -> Any:
    """Return a cell as what it is; None if it is empty."""
    if text.startswith("{"):
        return json.loads(text)
    try:
        return float(text) if text else None
    except ValueError:
        return text


def called(line: Line, steps: bool = True) -> str:
    """Say which run of its solver it is, with the steps that it took: more than asked where some were halved."""
    settings = line["settings"]
    if line["solver"] == "fem":
        cells = settings["cells"]
        return f"`fem`, {2 * cells[0]} x {2 * cells[1]} cells" + f", {line['time_steps']:.0f} steps" * steps
    if line["solver"] == "ndf-ritz":
        return f"`ndf-ritz`, {settings['neurons']} neurons" + (f", {s} strain" if (s := settings.get("strain")) else "")
    words = [f"{settings['cells'][0]}² x {settings['times']} samples", f"{settings['iterations']} iterations"]
    return "`ndf-published`, " + ", ".join(words) + (f", {s} strain" if (s := settings.get("strain")) else "")


def short(value: Any, digits: int = 2) -> str:
    """Write a number with so many digits; a dash for none, words as they are."""
    return "–" if value is None else value if isinstance(value, str) else f"{value:.{digits}g}"


def table(heads: Iterable[str], rows: Iterable[Iterable[Any]]) -> list[str]:
    """Return a table in Markdown."""
    heads = list(heads)
    cells = ["| " + " | ".join(row if isinstance(row, str) else short(row) for row in one) + " |" for one in rows]
    return ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads), *cells]


def share(line: Line, best: Line | None, name: str) -> float | None:
    """Return the difference of a value from that of the yardstick, relative to it."""
    return line[name] / best[name] - 1 if best and best[name] and line[name] is not None else None


def percent(value: float | None) -> str:
    """Write a relative difference; one above 1 as the multiple that it makes."""
    if value is None:
        return "–"
    return (
        f"{1 + value:.{0 if value > 9 else 1}f} times"
        if value >= 1
        else f"{100 * value:+.{3 if abs(value) > 0.995 else 2}g} %"
    )


def ended(line: Line) -> str:
    return "" if line["status"] == "ok" else f" ({line['status']})"


def is_yardstick(line: Line) -> bool:
    return line["off_end"] is None and line["status"] == "ok" and line["solver"] == "fem"


def thin() -> list[str]:
    rows = []
    for h, of_one in by("thickness", lines_of("thin")):
        best = next(filter(is_yardstick, of_one), None)
        for line in of_one:
            apart = [share(line, best, f"{kind}_energy_end") for kind in ("membrane", "bending")]
            off = "yardstick" if line is best else short(line["off_end"])
            rows.append((f"{h:g} m", called(line) + ended(line), off, *map(percent, apart), line["seconds"]))
    return table(("thickness", "run", "off at .3 s, m", "membrane energy", "bending energy", "seconds"), rows)


def times() -> list[str]:
    rows = []
    for line in lines_of("times"):
        found, gap = line["fine_functional"], line["energy_gap"] if line["solver"] != "fem" else None
        above = None if found is None or line["case"] != "free_fall" else (found - LEAST) / -LEAST
        name = called(line) + (f", seed {line['seed']:.0f}" if line["case"] == "free_fall" else "")
        off = "yardstick" if is_yardstick(line) and line["case"] != "free_fall" else short(line["off_end"])
        rows.append((line["case"], name, short(found, 4), percent(above), gap, line["scatter"], off, line["seconds"]))
    heads = ("case", "run", "functional, J", "above the least", "gap", "scatter, J", "off at the end, m", "seconds")
    return table(heads, rows)


def runtime() -> list[str]:
    rows = [
        (
            called(line) + ended(line),
            line["seconds"],
            line["off_half"],
            "yardstick" if is_yardstick(line) else short(line["off_end"]),
        )
        for line in lines_of("runtime")
    ]
    return table(("run", "seconds", "off at .25 s, m", "off at .5 s, m"), rows)


def long() -> list[str]:
    rows = []
    for until, of_one in by("until", lines_of("long")):
        for line in of_one:
            kept, solve = ((line[key] or 0) / 1e6 for key in ("storage_bytes", "solve_bytes"))
            together = "yardstick" if is_yardstick(line) else short(line["together"])
            rows.append(
                (f"{until:g} s", called(line) + ended(line), line["seconds"], kept, solve, together, line["off_end"])
            )
    return table(
        ("until", "run", "seconds", "kept, MB", "memory of the solve, MB", "within 1 cm till, s", "off at the end, m"),
        rows,
    )


def constant() -> list[str]:
    rows = [
        (
            f"{line['until']:g} s",
            f"{line['features']:.0f}",
            line["bytes"] / 1e6,
            line["history_bytes"] / 1e6,
            line["off"],
        )
        for line in lines_of("constant")
    ]
    return table(("until", "features", "field, MB", "`fem`'s history, MB", "off in the mean, m"), rows)


def droop() -> list[str]:
    lines = lines_of("droop")
    best = next(filter(is_yardstick, lines), None)
    rows = [
        (
            called(line) + ended(line),
            line["off_half"],
            "yardstick" if line is best else short(line["off_end"]),
            *(percent(share(line, best, f"{kind}_energy_end")) for kind in ("membrane", "bending")),
            line["seconds"],
        )
        for line in lines
    ]
    return table(("run", "off at .2 s, m", "off at .4 s, m", "membrane energy", "bending energy", "seconds"), rows)


def trained() -> list[str]:
    rows = []
    for line in lines_of("trained"):
        what = line["settings"]["activation"] + ended(line)
        rows.append((line["case"], what, percent(line["above"]), percent(line["error"])))
    return table(("shell", "repaired training with", "certified energy above the least", "displacement"), rows)


BASES = {"cartesian": "Cartesian", "covariant": "covariant"}
ARC = "roof_by_arc_length"


def basis_of(line: Line) -> str:
    """Say which components the output layer gives."""
    return BASES[line["settings"]["components"]] + (", by arc length" if line["case"] == ARC else "")


def components() -> list[str]:
    rows = []
    for line in lines_of("components"):
        course = line["course"] or {}
        above = [percent(course[at][0]) if at in course else "–" for at in ("500", "1000")]
        shell = "scordelis_lo" if line["case"] == ARC else line["case"]
        what = (shell, basis_of(line) + ended(line), f"{line['seed']:.0f}")
        rows.append((*what, *above, percent(line["above"]), percent(line["error"])))
    heads = ("shell", "output", "seed", "energy above the least at 500", "at 1000", "at the end")
    return table((*heads, "displacement"), rows)


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


def grouped(lines: Iterable[Line]) -> dict[str, list[Line]]:
    groups: dict[str, list[Line]] = {}
    for line in lines:
        groups.setdefault(called(line, steps=False).replace("`", ""), []).append(line)
    return groups


def solvers(lines: Iterable[Line]) -> dict[str, list[Line]]:
    groups: dict[str, list[Line]] = {}
    for line in lines:
        groups.setdefault(line["solver"], []).append(line)
    return groups


def figures() -> Iterator[tuple[str, Any]]:
    """Yield the figures by name."""
    figure, ((left, right),) = open_figure((7.2, 3.4), 1, 2)
    curves(left, grouped(lines_of("thin")), "thickness", "off_end")
    entries = curves(right, grouped(lines_of("thin")), "thickness", "seconds")
    finish([left], "thickness (m), napkin of 1 m", "off the finest mesh at 0.3 s (m)")
    finish([right], "thickness (m), napkin of 1 m", "processor time (s)")
    for axes in (left, right):
        axes.invert_xaxis()
    add_legend(figure, entries, 2)
    yield "thin", figure

    figure, ((left, middle, right),) = open_figure((9.0, 3.2), 1, 3)
    fall = [line for line in lines_of("times") if line["case"] == "free_fall"]
    napkin = [
        line
        for line in lines_of("times")
        if line["case"] == "napkin_plane" and line["solver"] != "fem" and line["settings"]["cells"] == [8, 8]
    ]
    steps = [line for line in lines_of("times") if line["solver"] == "fem"]
    count = lambda line: line["settings"]["times"]  # noqa: E731
    groups = {f"ndf-published, seed {seed:.0f}": lines for seed, lines in by("seed", fall)}
    entries = curves(left, groups, count, lambda line: 100 * (line["fine_functional"] - LEAST) / -LEAST)
    entries |= curves(
        middle,
        {**{f"{k}": v for k, v in groups.items()}, "ndf-published, napkin in its plane": napkin},
        count,
        lambda line: 100 * line["energy_gap"],
    )
    entries |= curves(right, {"fem, napkin in its plane": steps}, "time_steps", "off_end")
    finish([left], "samples in time $N_t$", "functional above the least (%)", "Free fall")
    finish([middle], "samples in time $N_t$", "gap to a fine rule (%)", "Training's samples")
    finish([right], "steps to 0.5 s", "off 120 steps at 0.5 s (m)", "Steps in time")
    add_legend(figure, entries, 2)
    yield "times", figure

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

    figure, ((left, middle, right),) = open_figure((9.0, 3.2), 1, 3)
    groups = grouped(lines_of("long"))
    entries = curves(left, groups, "until", "seconds")
    curves(middle, groups, "until", lambda line: (line["storage_bytes"] or 0) / 1e6)
    held = [{**line, "solver": "ndf-ritz"} for line in lines_of("constant")]
    entries |= curves(
        right, {f"fitted field, {n:.0f} features": lines for n, lines in by("features", held)}, "until", "off"
    )
    finish([left], "simulated time (s)", "processor time (s)", "Runtime")
    finish([middle], "simulated time (s)", "bytes that keep it (MB)", "Memory")
    finish([right], "simulated time (s)", "off fem in the mean (m)", "Field of constant size")
    add_legend(figure, entries, 2)
    yield "long", figure


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


TABLES: dict[str, Callable[[], list[str]]] = {
    one.__name__: one for one in (thin, times, runtime, long, constant, droop, trained, components)
}

if __name__ == "__main__":
    main()
