"""Write a page and a figure for each case, in the manner of a validation manual: `python docs/cases.py [--store DIR]`.

A page has a sketch, the names under which others know the case, the problem, its quantities, the known values with
their uncertainty and origins, the tolerances, the results of all solvers, and remarks. Everything comes from the case
files, references/ and records: those of the store, or the rows committed in reports/. Pages are built
into docs/cases/, and not committed; `python -m nox -s docs` builds them with the site.
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.about import about, question, tolerance_words
from shellbench.bench.judge import compare
from shellbench.bench.judge.row import Row
from shellbench.bench.plugins.kinds import portrait_of_named
from shellbench.bench.store.current import current_runs
from shellbench.bench.store.record import Record
from shellbench.bench.store.store import Store
from shellbench.problem import VARIANT, Problem
from shellbench.problems.moving import moved
from shellbench.problems.rope.case import RopeCase
from shellbench.problems.series.conditioned import ConditionedCase
from shellbench.problems.series.edited import EditingCase
from shellbench.report.data.document import Source, read_bibliography
from shellbench.report.data.exhibit import style
from shellbench.report.data.notation import escape_markdown
from shellbench.report.figures.pictures import held_lines, point_forces, shell
from shellbench.report.figures.shells import Camera, Shell, colour_bar, draw_deformed, draw_reference, scale_words

ROOT = Path(__file__).parents[1]
FOLDER = Path(__file__).with_name("cases")
BIBLIOGRAPHY = ROOT / "references" / "bibliography.bib"
KEPT = "course", "example", "example_engines"  # folders of committed rows below reports/, the newest first
POINTS = 33  # a side of the grid on which a reference surface is drawn
CHAINS_DRAWN = 12  # at most, of a crowd of chains
SHELL_CAPTION = (
    "Reference surface; supports are thick lines and dots, point forces are arrows. With results, the deformed shell."
)
ROPE_CAPTION = "The masses at the start; a square is a root."
SIZE, DPI = (3.2, 2.6), 110  # inches of a panel, dots an inch
Data = dict[str, Any]


def words(text: str) -> str:
    """Return text for Markdown as the site reads it: there `$` is no markup, and `&` and `<` can't be escaped."""
    return re.sub(r"\\([$~])", r"\1", escape_markdown(text)).replace(r"\&", "&amp;").replace(r"\<", "&lt;")


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """Yield the lines of a Markdown table, without columns that are empty; nothing if it has no rows."""
    columns = [(name, *cells) for name, *cells in zip(head, *rows, strict=True) if any(cells)]
    lines = [f"| {' | '.join(row)} |" for row in zip(*columns, strict=True)]
    if lines:
        yield from (lines[0], f"|{'---|' * len(columns)}", *lines[1:], "")


def page(case: Problem, rows: Sequence[Row], figure: str, sources: dict[str, Source]) -> str:
    """Return the page of a case.

    Parameters
    ----------
    rows
        Of runs with default settings; none if no store is given.
    figure
        Name of the picture's file; empty if nothing can be drawn.
    """
    data = about(case.name)
    lines = [f"# {words(case.title)}", ""]
    if case.also_known_as:
        lines += [f"**Also known as:** {words(names_elsewhere(case))}.", ""]
    lines += [words(case.description), ""]
    if figure:
        caption = ROPE_CAPTION if isinstance(case, RopeCase) else SHELL_CAPTION
        lines += [f"![{words(case.title)}]({figure})", "", f"*{caption}*", ""]
    lines += ["## Problem", ""]
    named = [("name", code(case.name)), ("theory", case.theory), ("suites", ", ".join(map(code, case.suites)))]
    parts = ((code(name), words(value)) for name, value in question(data))
    lines += table(("part", "value"), (*named, *parts))
    lines += ["## Quantities", ""]
    lines += table(("quantity", "description", "unit", "where"), map(asked, data["quantities"]))
    lines += ["## Reference values", ""]
    lines += list(table(("quantity", "role", "value", "theory", "method", "source"), known(data))) or [
        "No value is known.",
        "",
    ]
    lines += [f"- `{key}`: {words(sources[key].words)}" for key in cited(data) if key in sources]
    lines += ["", "## Tolerances", ""]
    lines += list(table(("quantity", "largest error"), allowed(data))) or [
        "None: no solver is gated by this case.",
        "",
    ]
    lines += ["## Results", ""]
    shown = list(table(RESULTS, results(rows, gated_by(data))))
    lines += [RESULTS_WORDS, "", *shown] if shown else [NO_RESULTS.format(case.name), ""]
    lines += ["## Remarks", "", *(f"- {remark}" for remark in [*remarks(data), *units_read(case)]), ""]
    return "\n".join(lines)


NO_RESULTS = "No results are kept for this case. Make them: `shellbench run {}`."
RESULTS_WORDS = (
    "Default settings. Of several seeds, a row shows the one with the largest error. Error and uncertainty are relative,"
    " unless marked absolute. A solver without a tolerance above is not gated."
)
UNITS = {
    "scordelis_lo": "feet", "scordelis_lo_naghdi": "feet", "scordelis_lo_nonlinear": "feet",
    "pinched_cylinder_diaphragm": "inches", "pinched_cylinder_free": "inches",
    "twisted_beam_thick_y": "inches", "twisted_beam_thick_z": "inches", "twisted_beam_thin_y": "inches",
    "twisted_beam_thin_z": "inches", "curved_beam_in_plane": "inches", "curved_beam_out_of_plane": "inches",
}  # fmt: skip  # lengths of the cases whose published numbers are kept; their forces are in pounds


def units_read(case: Problem) -> list[str]:
    """Return the remark on units of a case that keeps published numbers; nothing for other cases."""
    found = UNITS.get(case.name)
    return [f"The original numbers are kept; {found} and pounds are read as metres and newtons."] if found else []


def names_elsewhere(case: Problem) -> str:
    """Return the names under which others know a case, with the places there."""
    return "; ".join(other.words for other in case.also_known_as)


def kept_rows() -> list[Row]:
    """Return the rows that are committed in reports/; of a case, solver, quantity and seed those of the newest folder."""
    found: dict[tuple[object, ...], Row] = {}
    for folder in KEPT:
        for data in json.loads((ROOT / "reports" / folder / "table.json").read_bytes()):
            variant = data.pop("variant", None)
            row = Row.model_validate(data | ({"case": f"{data['case']}{VARIANT}{variant}"} if variant else {}))
            if row.default_settings:
                found.setdefault((row.case, row.solver, row.quantity, row.seed), row)
    return list(found.values())


def code(name: str) -> str:
    """Return a name in typewriter."""
    return f"`{name}`"


def asked(quantity: Data) -> tuple[str, ...]:
    """Return the row of a quantity."""
    name = code(quantity["name"]) + (", headline" if quantity["primary"] else "")
    return (
        name,
        words(quantity["description"] or quantity["kind"].replace("_", " ")),
        quantity["unit"] or "1",
        words(quantity["mark"]),
    )


def known(data: Data) -> Iterator[tuple[str, ...]]:
    """Yield the rows of what is known; what judges is in bold."""
    for quantity in data["quantities"]:
        for value in quantity["known"]:
            sure = f" ± {value['uncertainty']:.2g}" if value.get("uncertainty") is not None else ""
            figure = f"{value['value']:.13g}{sure} {quantity['unit']}".rstrip()
            source = code(value["source"]) + (f", {words(value['locator'])}" if value.get("locator") else "")
            how = words(f"{value['label']}: {value['origin']}" if value.get("label") else value["origin"])
            shown = f"**{figure}**" if value["judges"] else figure
            yield code(quantity["name"]), value["role"], shown, value["theory"], how, source


def cited(data: Data) -> list[str]:
    """Return the keys of what a case cites, each once."""
    keys = [value["source"] for quantity in data["quantities"] for value in quantity["known"]]
    return list(dict.fromkeys([*keys, *(curve["source"] for curve in data["curves"])]))


def allowed(data: Data) -> Iterator[tuple[str, str]]:
    """Yield the rows of tolerances."""
    for quantity in data["quantities"]:
        if quantity["tolerances"]:
            yield code(quantity["name"]), words(tolerance_words(quantity))


def gated_by(data: Data) -> set[tuple[str, str]]:
    """Return quantity and solver of each tolerance that the page shows."""
    return {(quantity["name"], solver) for quantity in data["quantities"] for solver in quantity["tolerances"]}


RESULTS = ("quantity", "solver", "seeds", "value (worst seed)", "error", "stated uncertainty", "verdict")


def results(rows: Sequence[Row], gated: set[tuple[str, str]]) -> Iterator[tuple[str, ...]]:
    """Yield the results: for each quantity and solver the run that is farthest from the known value.

    Parameters
    ----------
    gated
        Quantity and solver of each tolerance; other results are not gated.
    """
    lines: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        lines.setdefault((row.quantity, row.solver), []).append(row)
    order = list(dict.fromkeys(quantity for quantity, _ in lines))
    for (quantity, solver), found in sorted(lines.items(), key=lambda entry: order.index(entry[0][0])):
        worst = max(found, key=lambda row: (row.status != "ok", abs(row.judged_error or 0.0)))
        seeds = ", ".join(str(row.seed) for row in found if row.seed is not None)
        value = "–" if worst.value is None else f"{worst.value:.8g} {worst.unit}".rstrip()
        yield (
            code(quantity),
            code(solver),
            seeds or "–",
            value,
            error_of(worst),
            stated_by(worst),
            words(verdict_on(worst, (quantity, solver) in gated)),
        )


def error_of(row: Row) -> str:
    """Return the error of a row, relative unless its tolerance or its value forbids."""
    if row.relative_error is not None and not row.tolerance_is_absolute:
        return f"{row.relative_error:+.1e}"
    return "–" if row.absolute_error is None else f"{row.absolute_error:+.1e} {row.unit}".rstrip() + " absolute"


def stated_by(row: Row) -> str:
    """Return the uncertainty that a row states, relative where its error is."""
    if row.uncertainty is None:
        return "–"
    if row.relative_error is not None and not row.tolerance_is_absolute:
        return f"± {row.uncertainty / abs(row.reference or 1.0):.1e}"
    return f"± {row.uncertainty:.1e} {row.unit}".rstrip() + " absolute"


def verdict_on(row: Row, gated: bool) -> str:
    """Return the verdict of the gate on a row; of a run that did not end well its status."""
    if row.status != "ok":
        return f"{row.status}: {row.reason or ''}".rstrip(": ")
    if not (row.gated and gated):
        return "not gated"
    if row.passed is None:
        return f"open finding: {row.open_finding}"
    return "pass" if row.passed else f"FAIL: {row.reason}"


def remarks(data: Data) -> Iterator[str]:
    """Yield notes on known values, curves, and the variants of the question."""
    judged = [q["name"] for q in data["quantities"] if any(value["judges"] for value in q["known"])]
    yield f"{len(judged)} of {len(data['quantities'])} quantities have a judge."
    for quantity in data["quantities"]:
        for value in quantity["known"]:
            if value.get("note"):
                yield f"{code(quantity['name'])}, {value['role']} of `{value['source']}`: {words(value['note'])}"
    for curve in data["curves"]:
        yield f"A curve of {code(curve['quantity'])} with {curve['points']} points is in `{curve['source']}`: {words(curve['origin'])}."
    if data["variants"]:
        yield f"Variants: {', '.join(code(variant['name']) for variant in data['variants'])}."


def picture(case: Problem, store: Store | None, records: Sequence[Record]) -> Figure | None:
    """Draw the shell at rest, and beside it the deformed one if a run kept it; None if nothing can be drawn."""
    if isinstance(case, RopeCase):
        return masses(case)
    at_rest = shell_at_rest(case)
    surface, scene = getattr(at_rest, "surface", None), portrait_of_named(at_rest).scene
    if surface is None or scene is None:
        return None
    solved = deformed(case, store, records)
    figure = Figure(figsize=(SIZE[0] * (2 if solved else 1), SIZE[1]), dpi=DPI, layout="constrained")
    panels = figure.subplots(1, 2 if solved else 1, squeeze=False)[0]
    xi = surface.domain.grid(POINTS, POINTS)
    position = np.asarray(surface.position(xi))
    held, forces = held_lines(scene, xi, position), point_forces(scene, xi, position)
    camera = Camera(*scene.view, scene.up)
    reference = Shell(case.name, case.title, "", position, np.zeros_like(position), 1.0, camera)
    draw_reference(panels[0], Shell(**{**vars(reference), "held": held, "forces": forces}))
    if solved:
        draw_deformed(panels[1], solved)
        panels[1].set_title(f"{solved.solver}, {scale_words(solved)}", fontsize=7.5, loc="left")
        colour_bar(figure, panels[1], solved)
    return figure


def shell_at_rest(case: Problem) -> Problem:
    """Return the shell of a case: that of the middle material of a series, the one before an edit, or the case itself."""
    if isinstance(case, ConditionedCase):
        return case.shell_of(case.middle)
    return case.original if isinstance(case, EditingCase) else case


def masses(case: RopeCase) -> Figure | None:
    """Draw where the masses of a rope start, in the plane (x, z); None of a chain at rest and of a single loose mass."""
    if case.moving is None or (case.rope is None and len(case.moving.places) == 1):
        return None
    figure = Figure(figsize=SIZE, dpi=DPI, layout="constrained")
    axes = figure.subplots()
    if case.rope is not None:
        root, *_ = moved(case.rope.root, 0.0)
        for nodes in case.rope.around(np.concatenate([root[None], case.rope.places]))[
            :: -(-case.rope.count // CHAINS_DRAWN)
        ]:
            axes.plot(nodes[:, 0], nodes[:, 2], "-o", color="C0", markersize=3, linewidth=1)
        axes.plot(root[0], root[2], "s", color="black", markersize=5)
    else:
        axes.plot(case.moving.places[:, 0], case.moving.places[:, 2], "o", color="C0", markersize=3)
    axes.set(xlabel="x, m", ylabel="z, m", aspect="equal", adjustable="datalim")
    return figure


def deformed(case: Problem, store: Store | None, records: Sequence[Record]) -> Shell | None:
    """Return the deformed shell of the first run of a case that kept one."""
    if store is None:
        return None
    of_case = (r for r in records if r.case_name == case.name and not r.own_case and r.status == "ok")
    return next((found for record in of_case if (found := shell(record, store.folder)) is not None), None)


def index(cases: Sequence[Problem]) -> str:
    """Return the page that leads to the others: the cases with names elsewhere first, then all of them."""
    links = {case.name: f"[{words(case.title)}]({case.name}.md)" for case in cases}
    elsewhere = [(words(names_elsewhere(case)), links[case.name]) for case in cases if case.also_known_as]
    rows = ((links[case.name], code(case.name), case.theory, ", ".join(map(code, case.suites))) for case in cases)
    preface = "Each case has a page: sketch, problem, reference values with sources, tolerances and results."
    lines = ["# The cases", "", preface, ""]
    if elsewhere:
        lines += [
            "## By other names: NAFEMS, MacNeal-Harder, Abaqus",
            "",
            *table(("also known as", "case"), elsewhere),
        ]
    return "\n".join([*lines, "## All cases", "", *table(("case", "name", "theory", "suites"), rows)])


def write(names: Sequence[str], store: Store | None, folder: Path) -> None:
    """Write the pages and figures of cases, and the index."""
    folder.mkdir(parents=True, exist_ok=True)
    sources = read_bibliography(BIBLIOGRAPHY)
    rows = (compare.rows(store) if store else []) or kept_rows()
    records = [run.record for run in current_runs(store.read()).runs] if store else []
    cases = [catalog.named_case(name) for name in names]
    for case in cases:
        with style():
            drawn = picture(case, store, records)
            if drawn is not None:
                drawn.savefig(folder / f"{case.name}.png")
        own = [row for row in rows if row.case == case.name and not row.own_case and row.default_settings]
        text = page(case, own, f"{case.name}.png" if drawn is not None else "", sources)
        (folder / f"{case.name}.md").write_text(text, encoding="utf-8")
    (folder / "index.md").write_text(index(cases), encoding="utf-8")


def main() -> None:
    """Write what the command line asks for."""
    parser = argparse.ArgumentParser(description="Write a page and a figure for each case.")
    parser.add_argument("cases", nargs="*", help="names of cases; all if none")
    parser.add_argument("--store", type=Path, help="folder of records, for results and deformed shapes")
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder to write")
    options = parser.parse_args()
    store = Store(options.store) if options.store and options.store.is_dir() else None
    write(options.cases or catalog.case_names(), store, options.out)
    print(f"written to {options.out / 'index.md'}")


if __name__ == "__main__":
    main()
