"""Pages of the board from docs/board/figures.json: the table, a figure, and a page for each element."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from docs import board
from docs.board import CASES, DISTORTED, ENGINES, FIGURES, FOLDER, GRADES, LEVELS, ROOFS, SHEAR, Shell, percent
from docs.studies_page import table
from shellbench.report.data.exhibit import DASHES, style
from shellbench.report.figures.panel import open_figure

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#000000", "#E69F00", "#56B4E9")  # of Okabe & Ito
LEAST = 1e-8  # error: smaller ones are drawn there

PREFACE = """# How accurate are the shell elements you use?

<!-- Written by docs/board_page.py from docs/board/figures.json. Change those, and run `python -m nox -s board`. -->

Each element of this page solves the same shells on ever finer meshes. The values of a shell tend to a limit. The right
limit is known: its theory, its derivation and its uncertainty are on the page of the shell. Elements whose normals
shear are compared with the limit of Naghdi's theory, the others with that of Kirchhoff and Love. Simple supports are
soft for elements with shear: nothing keeps normals from turning along the edge.

Cells are counted across the part between planes of symmetry: 16 of them are 32 across the whole roof. Seconds are
processor time of the mesh, and hold whatever the program needs: it is started, reads, solves and writes. They are shown,
not ranked.

"""
COLUMNS = (
    "element", "grade", "limits that are right", "farthest limit", "cells to 1 %", "cells to .1 % (roof)",
    "seconds to 1 % (roof)", "error of the roof at 16 cells as it gets thinner", "with moved nodes",
)  # fmt: skip


def rows() -> dict[str, Any]:
    """Return the elements that were solved, by key, best grade first."""
    kept = json.loads(FIGURES.read_text())
    return dict(sorted(kept.items(), key=lambda item: (board.grade(item[1]), item[1]["label"])))


def engine(row: Mapping[str, Any]) -> str:
    """Return the name of the program."""
    return ENGINES[row["solver"].partition("-")[0]]


def error_at(shell: Shell | None, cells: int) -> str:
    """Return the error of the mesh with so many cells, or of the finest one before, which is then told."""
    if shell is None or shell.near is None or not shell.values:
        return "–"
    solved = shell.data["cells"][: len(shell.values)]
    number = max(k for k, n in enumerate(solved) if n <= cells)
    told = "" if solved[number] == cells else f" at {solved[number]}"
    return percent(shell.values[number] / shell.near - 1) + told


def cells_to(shell: Shell, level: float) -> str:
    """Return the cells to an error, or above which number they are."""
    return str(shell.cells_to(level) or f"above {shell.data['cells'][len(shell.values) - 1]}")


def summary(key: str, row: Mapping[str, Any]) -> list[Any]:
    """Return the row of an element."""
    shells = board.shells_of(row)
    judged = [s for name, s in shells.items() if name in CASES and s.known is not None and "declined" not in s.data]
    right = [shell for shell in judged if shell.right]
    distances = [shell.distance for shell in judged if shell.distance is not None]
    roof = shells.get(ROOFS[0])
    return [
        f"[{engine(row)} {row['label']}]({key}.md)",
        board.grade(row),
        f"{len(right)} of {len(judged)}",
        percent(max(distances, key=abs, default=None)),
        max(
            (cells_to(shell, LEVELS[0]) for shell in judged),
            key=lambda told: (told.startswith("above"), int(told.split()[-1])),
        ),
        cells_to(roof, LEVELS[1]) if roof else "–",
        None if roof is None else roof.seconds_to(LEVELS[0]),
        ", ".join(error_at(shells.get(name), 16) for name in ROOFS),
        error_at(shells.get(f"{DISTORTED}, distorted"), 16),
    ]


def page(found: Mapping[str, Any]) -> str:
    """Return the table of all elements, with what it means."""
    lines = [PREFACE, *table(COLUMNS, (summary(key, row) for key, row in found.items())), ""]
    lines += [
        "Grades. "
        + GRADES
        + " They were chosen before the first figure was seen, with two changes after: E began at .1 %, which CalculiX' S8R misses by .01 % on a plate, since its shear factor is 1 where others have 5/6; and A to C had 16, 32 and 64 cells, before the ladders lost their finest mesh for want of time. S6 and S8 end at 16 cells: their D may be a C. NGSolve ends at 16.",
        "",
    ]
    lines += ["![Error of the roof against unknowns, by element](roof.png)", ""]
    lines += [
        "CalculiX solves whole shells here, with four times the unknowns of a quarter: it does not take all supports of a plane of symmetry.",
        "",
    ]
    versions = sorted({row["version"] or engine(row) for row in found.values()})
    lines += ["Programs: " + ", ".join(versions) + ".", ""]
    lines += ["Notes on single programs: [findings](findings.md).", ""] if (FOLDER / "findings.md").exists() else []
    return "\n".join(lines)


def shell_row(name: str, shell: Shell) -> list[Any]:
    """Return the row of a shell on an element's page."""
    title = CASES.get(name, f"{CASES[shell.case]}, inner nodes moved")
    linked = f"[{title}](../cases/{shell.case}.md)"
    if "declined" in shell.data or not shell.values:
        why = shell.data.get("declined") or shell.data.get("failed", "")
        return [
            linked,
            shell.data["question"],
            f"{'declined' if 'declined' in shell.data else 'failed'}: {why}",
            *[None] * 6,
        ]
    limit = shell.limit
    known = shell.known
    told = "–" if limit is None else f"{limit.value:.6g} ± {limit.uncertainty:.1g}"
    if known is None and limit is not None:
        told = f"none: {percent(shell.drift)} in the last halving" if shell.case in board.POINT else told
    rate = None if limit is None or limit.rate is None else f"{limit.rate:.1f}"
    return [
        linked,
        f"`{shell.data['question']}`",
        told,
        None if known is None else f"{known:.6g}",
        percent(shell.distance) if shell.distance is not None else None,
        rate,
        error_at(shell, 16),
        *(cells_to(shell, level) if known else "–" for level in LEVELS),
    ]


def element_page(key: str, row: Mapping[str, Any]) -> str:
    """Return the page of an element."""
    shells = board.shells_of(row)
    heads = ("shell", "asked", "limit", "right limit", "off by", "rate", "error at 16", "cells to 1 %", "cells to .1 %")
    settings = "".join(f" --set {row['solver']}.{k}={json.dumps(v)}" for k, v in row["settings"].items())
    lines = [f"# {engine(row)}: {row['label']}", "", f"{row['words']}. Grade {board.grade(row)}. {row['version']}", ""]
    lines += [*table(heads, (shell_row(name, shell) for name, shell in shells.items())), ""]
    lines += ["## Values", "", *table(("shell", "cells", "unknowns", "value", "seconds"), values(shells)), ""]
    lines += ["## Do it again", "", "```", f"python -m pip install ./plugins/{package(row)}"]
    lines += [
        f"shellbench run scordelis_lo{'@naghdi_soft' if row['theory'] == SHEAR else ''} --solver {row['solver']}{settings}"
    ]
    lines += ["```", "", f"Decks by hand, with a mesher of their own, are in `plugins/{package(row)}/decks`.", ""]
    return "\n".join(lines)


def values(shells: Mapping[str, Shell]) -> Iterator[Sequence[Any]]:
    """Yield cells, unknowns, value and seconds of each mesh."""
    for name, shell in shells.items():
        data = shell.data
        for cells, unknowns, value, seconds in zip(
            data["cells"], data.get("unknowns", []), shell.values, data.get("seconds", []), strict=False
        ):
            yield CASES.get(name, name), str(cells), str(unknowns), f"{value:.9g}", seconds


def package(row: Mapping[str, Any]) -> str:
    """Return the folder of the plug-in."""
    name = row["solver"].partition("-")[0]
    return "nastran" if name == "mystran" else name


def figure(found: Mapping[str, Any]) -> None:
    """Draw the error of the roof against unknowns, a panel a program."""
    programs = sorted({engine(row) for row in found.values()})
    columns = 2
    with style():
        drawing, panels = open_figure(
            (7.6, 2.6 * -(-len(programs) // columns)), -(-len(programs) // columns), columns, sharex=True, sharey=True
        )
        for axes, program in itertools.zip_longest(panels.ravel(), programs):
            axes.set_visible(program is not None)
            rows_here = [row for row in found.values() if engine(row) == program]
            for number, row in enumerate(rows_here):
                shell = board.shells_of(row).get(ROOFS[0])
                if shell is not None and shell.errors:
                    axes.loglog(
                        shell.data["unknowns"],
                        [max(error, LEAST) for error in shell.errors],
                        color=COLOURS[number % len(COLOURS)],
                        linestyle=DASHES[number % len(DASHES)],
                        marker="o",
                        markersize=3,
                        label=row["label"].partition("-")[2],
                    )
            axes.set_title(program or "")
            if rows_here:
                axes.legend(fontsize=6)
        for axes in panels[:, 0]:
            axes.set_ylabel("relative error")
        for axes in panels[-1]:
            axes.set_xlabel("unknowns")
        drawing.savefig(FOLDER / "roof.png", dpi=150)


def write() -> None:
    """Write all pages."""
    found = rows()
    (FOLDER / "index.md").write_text(page(found), encoding="utf-8")
    for key, row in found.items():
        (FOLDER / f"{key}.md").write_text(element_page(key, row), encoding="utf-8")
    figure(found)
