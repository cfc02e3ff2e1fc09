"""The board: how accurate the shell elements are that people use. `python -m nox -s board` makes it again.

`python -m docs.board run [--solver NAME] [--case NAME] [--again]` solves the board's shells by each element that is
installed, and keeps the figures in docs/board/figures.json. `python -m docs.board page` writes the pages of docs/board/
from that file. A shell by one element is a process of its own, which is stopped after TIME_LIMIT seconds.

Each element solves a ladder of meshes. `shellbench.protocol.limit` extrapolates their values, and the limit is compared
with the known value of the element's theory: that of Kirchhoff and Love, or of Naghdi with the supports that the
element has. What decides the grade was chosen before the first figure was seen (see GRADES).
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from shellbench.bench.catalogue import catalog
from shellbench.protocol.limit import Limit, limit_of

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs/board"
FIGURES = FOLDER / "figures.json"
ENGINES = {
    "calculix": "CalculiX",
    "opensees": "OpenSees",
    "mystran": "MYSTRAN",
    "ngsolve": "NGSolve",
    "kratos": "Kratos Multiphysics",
}
CASES = {  # shell -> title; `roof` three times, thinner each time
    "square_plate": "Square plate",
    "scordelis_lo": "Scordelis-Lo roof, h/R = 1e-2",
    "roof_thinness_1e_3": "The same roof, h/R = 1e-3",
    "roof_thinness_1e_4": "The same roof, h/R = 1e-4",
    "hypar_clamped_1e_3": "Clamped hyperbolic paraboloid, h/L = 1e-3",
    "hyperboloid_clamped_1e_3": "Clamped hyperboloid, h/R = 1e-3",
    "hyperboloid_free_1e_3": "Free hyperboloid, h/R = 1e-3",
    "twisted_beam_thick_y": "Twisted beam, thick",
    "pinched_cylinder_diaphragm": "Pinched cylinder, rigid diaphragms",
    "pinched_cylinder_free": "Pinched cylinder, free ends",
}
ROOFS = ("scordelis_lo", "roof_thinness_1e_3", "roof_thinness_1e_4")
POINT = ("pinched_cylinder_diaphragm", "pinched_cylinder_free")  # forces at points: no limit if normals shear
LADDER, LONG_LADDER = (4, 8, 16, 32), (2, 4, 8)  # cells across the part; of the beam, which is long
LONG = ("twisted_beam_thick_y",)
WHOLE_QUADRATIC = ("calculix-s6", "calculix-s8")  # whole shells of solids: the finest takes minutes
HIGH, LADDER_OF_HIGH = ("ngsolve",), (2, 4, 8, 16)
DISTORTED, DISTORTION = "scordelis_lo", 0.25  # cells by which nodes of the roof's meshes are moved at random
TIME_LIMIT = 120.0  # seconds of wall time of one shell by one element
LEVELS = (1e-2, 1e-3)  # errors to which cells and seconds are counted
RIGHT = 1e-3  # relative distance of a limit from the right one, beyond which it is another limit
OTHER = 1e-2  # the same, beyond which an element gets no better grade than E
THIN, SHEAR = "kirchhoff-love-linear", "naghdi-linear"
GRADES = (
    "A: 8 cells across the symmetric part are enough for 1 % on every shell that has a limit; B: 16 are; C: 32 are; D:"
    " more are needed; E: the limit of some shell and its"
    " finest mesh are off by more than 1 %, or its values show no limit."
)


@dataclass(frozen=True)
class Element:
    """An element with its settings, a row of the board."""

    solver: str
    settings: Mapping[str, Any]
    label: str
    theory: str
    soft: bool
    words: str

    @property
    def key(self) -> str:
        """A name for files and links."""
        return "-".join([self.solver, *(f"{k}-{v}" for k, v in self.settings.items())]).lower().replace(".", "_")

    def question(self, case: str) -> str:
        """Return the case in the theory of the element: a twin if its normals shear."""
        if self.theory == THIN or case in POINT:
            return case
        twin = f"{case}@naghdi_soft"
        return twin if self.soft and has_case(twin) else f"{case}@naghdi"


@cache
def has_case(name: str) -> bool:
    """Return True if there is a case of this name."""
    try:
        catalog.named_case(name)
    except Exception:
        return False
    return True


@cache
def solvers() -> Mapping[str, Any]:
    """Return the installed solvers of other programs by name; those that can't be loaded are left out, with a word."""
    found = {}
    for entry in entry_points(group="shellbench.solvers"):
        if entry.name.partition("-")[0] in ENGINES:
            try:
                found[entry.name] = entry.load()()
            except Exception as error:
                print(f"{entry.name}: left out: {error}", file=sys.stderr)
    return found


def elements() -> Iterator[Element]:
    """Yield all installed elements, each with the settings that its class names for the board."""
    for name, solver in sorted(solvers().items()):
        for label, settings in getattr(solver, "board", {"": {}}).items():
            theory = solver.capabilities.theories[0]
            soft = getattr(solver, "supports", "soft") == "soft"
            told = f"{name}, {label}" if label else name
            yield Element(name, settings, told, theory, soft, solver.capabilities.label)


def ladder(case: str, solver: str) -> tuple[int, ...]:
    """Return the cells across the part of each mesh: fewer of the long beam, and of elements of high degree."""
    if solver in WHOLE_QUADRATIC and case not in LONG:
        return LADDER[:3]
    high = solver.partition("-")[0] in HIGH
    return LONG_LADDER if case in LONG else (LADDER_OF_HIGH if high else LADDER)


def processor_seconds() -> float:
    """Return the processor time of this process and of the programs that it has called: others don't disturb it."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def solve(solver_name: str, question: str, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return unknowns, seconds and headline of each mesh, as far as the program gets."""
    from shellbench.errors import SolveFailure

    solver, case = solvers()[solver_name], catalog.named_case(question)
    case = case.without([q.name for q in case.quantities if not q.primary])
    spent = [processor_seconds()]
    why = solver.declines(case) if case.theory in solver.capabilities.theories else None
    if why:
        return {"declined": why}
    try:
        given = solver.settings_type.model_validate(settings)
        found = solver.answer(case, given, None, lambda progress: spent.append(processor_seconds()))
    except SolveFailure as failure:
        found, why = failure.partial, str(failure)
    steps = list(found.history) if found is not None else []
    result: dict[str, Any] = {
        "values": [step.quantities[case.primary.name] for step in steps],
        "unknowns": [step.unknowns for step in steps],
        "seconds": [after - before for before, after in itertools.pairwise(spent)],
    }
    return result | ({"failed": why} if why else {})


def run(asked: Sequence[str], cases: Sequence[str], again: bool) -> None:
    """Solve what is not in the file of figures yet, and keep each answer at once."""
    kept = json.loads(FIGURES.read_text()) if FIGURES.exists() else {}
    for element in elements():
        if asked and element.solver not in asked:
            continue
        row = kept.setdefault(element.key, {})
        row |= {"solver": element.solver, "label": element.label, "words": element.words, "theory": element.theory}
        row |= {"settings": dict(element.settings), "version": version(element.solver), "soft": element.soft}
        shells = row.setdefault("shells", {})
        jobs = [(case, case, {}) for case in CASES] + [
            (f"{DISTORTED}, distorted", DISTORTED, {"distortion": DISTORTION})
        ]
        for name, case, more in jobs:
            if (cases and case not in cases) or (name in shells and not again):
                continue
            whole = case not in LONG and not getattr(solvers()[element.solver].settings_type(), "symmetry", True)
            cells = [n * (2 if whole else 1) for n in ladder(case, element.solver)]  # as fine on the whole as on a part
            settings = {**element.settings, **more, "cells": cells}
            shells[name] = {"question": element.question(case), "cells": list(ladder(case, element.solver))}
            shells[name] |= apart(element.solver, element.question(case), settings)
            values = shells[name].get("values", [])
            print(f"{element.label}, {name}: {values[-1:] or shells[name]}", flush=True)
            FIGURES.parent.mkdir(exist_ok=True)
            keep(kept)


def keep(found: Mapping[str, Any]) -> None:
    """Write the file of figures, an element a line."""
    lines = (f"{json.dumps(key)}: {json.dumps(row, sort_keys=True)}" for key, row in sorted(found.items()))
    FIGURES.write_text("{\n" + ",\n".join(lines) + "\n}\n")


def apart(solver: str, question: str, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Solve in a process of its own, with fewer meshes if time runs out."""
    cells = list(settings["cells"])
    while cells:
        command = [
            sys.executable,
            "-m",
            "docs.board",
            "one",
            solver,
            question,
            json.dumps({**settings, "cells": cells}),
        ]
        try:
            done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=TIME_LIMIT, check=False)
        except subprocess.TimeoutExpired:
            cells.pop()
            continue
        if done.returncode:
            return {"failed": (done.stderr.strip().splitlines() or ["without a word"])[-1]}
        return json.loads(done.stdout.splitlines()[-1])
    return {"failed": f"no mesh was solved within {TIME_LIMIT:g} s"}


def version(solver: str) -> str:
    """Return name and version of the program, as the solver's settings know it."""
    return str(getattr(solvers()[solver].settings_type(), "engine", ""))


@dataclass(frozen=True)
class Shell:
    """One shell by one element, and what the page says of it."""

    case: str
    data: Mapping[str, Any]
    theory: str

    @property
    def known(self) -> float | None:
        """The right limit: the known value of the element's theory; None if there is none."""
        if self.theory == SHEAR and self.case in POINT:
            return None
        question = self.data["question"]
        base = question.partition("@")[0]
        judge = None
        for name in (question, base):
            case = catalog.named_case(question)
            judge = judge or catalog.known_values(name).judge(case.primary.name, case.theory)
        return None if judge is None else float(judge.value)

    @property
    def near(self) -> float | None:
        """The value that thinner roofs are compared with: the right limit, or that of the thin shell.

        With shear the roof of 1e-3 is about .05 % softer, that of 1e-4 about .005 %.
        """
        if self.known is not None or self.case not in ROOFS:
            return self.known
        judge = catalog.known_values(self.case).judge(catalog.named_case(self.case).primary.name, THIN)
        return None if judge is None else float(judge.value)

    @property
    def values(self) -> Sequence[float]:
        """The headline of each mesh."""
        return self.data.get("values", [])

    @property
    def limit(self) -> Limit | None:
        """The limit of the values."""
        if len(self.values) < 2:
            return None
        return limit_of([1 / n for n in self.data["cells"][: len(self.values)]], self.values)

    @property
    def errors(self) -> list[float] | None:
        """Relative error of each mesh."""
        known = self.known
        return None if known is None else [abs(value / known - 1) for value in self.values]

    def cells_to(self, level: float) -> int | None:
        """Return the cells across the part from which on all meshes are as accurate; None if none is."""
        errors = self.errors
        if not errors:
            return None
        good = [n for k, n in enumerate(self.data["cells"][: len(errors)]) if max(errors[k:]) <= level]
        return good[0] if good else None

    def seconds_to(self, level: float) -> float | None:
        """Return the seconds of that mesh."""
        cells = self.cells_to(level)
        return None if cells is None else self.data["seconds"][self.data["cells"].index(cells)]

    @property
    def distance(self) -> float | None:
        """Relative distance of the limit from the right one."""
        return None if self.known is None or self.limit is None else self.limit.value / self.known - 1

    @property
    def right(self) -> bool | None:
        """True if the limit is the right one, within its own uncertainty; None if no limit is known."""
        if self.distance is None or self.limit is None or self.known is None:
            return None
        return abs(self.distance) <= max(RIGHT, self.limit.uncertainty / abs(self.known)) and (
            self.limit.uncertainty <= 0.05 * abs(self.known)
        )

    @property
    def off(self) -> bool:
        """True if the limit is off by more than `OTHER`, or the values have none."""
        if self.limit is None or self.known is None or self.distance is None:
            return True
        if self.drifts or (self.errors or [1.0])[-1] <= OTHER:
            return self.drifts
        return abs(self.distance) - self.limit.uncertainty / abs(self.known) > OTHER

    @property
    def drifts(self) -> bool:
        """True if the last halving moves the value by more than `OTHER`, and not toward the right limit."""
        errors = self.errors or [0.0, 0.0]
        return abs(self.drift or 0.0) > OTHER and errors[-1] >= errors[-2]

    @property
    def drift(self) -> float | None:
        """Relative change of the last halving of the cells."""
        return None if len(self.values) < 2 else self.values[-1] / self.values[-2] - 1


def shells_of(row: Mapping[str, Any]) -> dict[str, Shell]:
    """Return the shells of an element."""
    return {name: Shell(name.partition(",")[0], data, row["theory"]) for name, data in row["shells"].items()}


def grade(row: Mapping[str, Any]) -> str:
    """Return the grade; see GRADES."""
    shells = [
        s for name, s in shells_of(row).items() if name in CASES and s.known is not None and "declined" not in s.data
    ]
    if not shells or any(shell.off for shell in shells):
        return "E"
    cells = [shell.cells_to(LEVELS[0]) for shell in shells]
    if any(n is None for n in cells):
        return "D"
    worst = max(n for n in cells if n is not None)
    return "A" if worst <= 8 else "B" if worst <= 16 else "C" if worst <= 32 else "D"


def percent(value: float | None) -> str:
    """Return a share in per cent."""
    return "" if value is None else f"{100 * value:+.2g} %"


def main() -> None:
    """Run as a command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    runs = commands.add_parser("run", help="solve what is missing")
    runs.add_argument("--solver", action="append", default=[])
    runs.add_argument("--case", action="append", default=[])
    runs.add_argument("--again", action="store_true", help="solve again what is there")
    commands.add_parser("page", help="write the pages")
    one = commands.add_parser("one", help="solve one shell by one element; used by `run`")
    one.add_argument("solver")
    one.add_argument("question")
    one.add_argument("settings", type=json.loads)
    given = parser.parse_args()
    if given.command == "one":
        print(json.dumps(solve(given.solver, given.question, given.settings)))
    elif given.command == "run":
        run(given.solver, given.case, given.again)
    else:
        from docs.board_page import write

        write()


if __name__ == "__main__":
    main()
