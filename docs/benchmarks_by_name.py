"""Write the page of names that others use for cases, with the values that they quote: `python docs/benchmarks_by_name.py`.

Names come from `also_known_as` of the cases, limits and quoted values from references/.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from shellbench.bench.catalogue import catalog
from shellbench.problem import Problem

PAGE = Path(__file__).with_suffix(".md")
PREFACE = """# Benchmarks by name: NAFEMS, MacNeal-Harder, Belytschko, Abaqus

<!-- Written by docs/benchmarks_by_name.py from cases/ and references/. Change those, and run it. -->

Other sets of benchmarks have these cases, too. `shellbench list nafems` finds a case by any word of such a name.
"""
NAMES = """## Names

"With Abaqus S4R" means that the source used this element of Abaqus. `references/bibliography.bib` has the sources.
Krysl & Chen: *Benchmarking Computational Shell Models*, doi 10.1007/s11831-022-09798-5.
[Limits for their set](findings/krysl_chen.md) says where their values differ.

|known as|place there|case|
|---|---|---|
"""
QUOTED = """
## Quoted values and limits

A limit is the judging value of the case, in the theory of the case. Quoted values judge nothing. "Mixed" and "unstated"
theories are those of targets that were agreed on. Values of the literature at large displacements are on the pages of the cases.

|case|quantity|quoted by|its theory|quoted|limit|quoted is off by|
|---|---|---|---|---|---|---|
"""


def known_elsewhere() -> list[Problem]:
    """Return the cases that others know by a name."""
    cases = map(catalog.named_case, catalog.own_case_names())
    return [case for case in cases if case.also_known_as]


def names() -> Iterator[str]:
    """Yield the rows of names, in their order."""
    rows = [(other.name, other.locator, case.name) for case in known_elsewhere() for other in case.also_known_as]
    for name, locator, case in sorted(rows):
        yield f"|{name}|{locator}|[`{case}`](cases/{case}.md)|"


def quoted() -> Iterator[str]:
    """Yield the rows of values that others quote for small displacements and modes."""
    for case in known_elsewhere():
        known = catalog.known_values(case.name)
        for quantity in case.quantities if case.theory != "kirchhoff-love-nonlinear" else ():
            judge = known.judge(quantity.name, case.theory)
            for value in known.of(quantity.name, "literature", "published") if judge else ():
                label = f"{value.label or value.source} (`{value.source}`{', ' * bool(value.locator)}{value.locator})"
                off = f"{100 * (value.value / judge.value - 1):+.2g} %"
                figures = f"{value.value:.9g} {quantity.unit}|{judge.value:.9g} {quantity.unit}"
                yield f"|[`{case.name}`](cases/{case.name}.md)|`{quantity.name}`|{label}|{value.theory}|{figures}|{off}|"


def page() -> str:
    """Return the whole page."""
    return "\n".join([PREFACE, NAMES + "\n".join(names()), QUOTED + "\n".join(quoted()), ""])


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
