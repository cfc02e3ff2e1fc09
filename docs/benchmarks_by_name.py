"""Write the page of names that others use for cases, and the tables of the finding on the set of Krysl & Chen.

`python docs/benchmarks_by_name.py`. Names come from `also_known_as` of the cases, limits and quoted values from
references/.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from shellbench.bench.catalogue import catalog
from shellbench.problem import Problem

PAGE = Path(__file__).with_suffix(".md")
FINDING = PAGE.with_name("findings") / "krysl_chen.md"
TABLE = re.compile(r"(<!-- table (\w+) -->\n).*?(?=<!-- end -->)", re.DOTALL)
Question = tuple[str, str, str, str]
"""Name, case, quantity, and the reason for differences between values."""
QUESTIONS: dict[str, tuple[Question, ...]] = {
    "krysl": (
        ("Clamped hyperboloid, t = 1e-2, energy", "hyperboloid_clamped_1e_2", "strain_energy", "Both are in the theory with shear, which adds so much."),
        ("Clamped hyperboloid, t = 1e-4, energy", "hyperboloid_clamped_1e_4", "strain_energy", "Two origins agree, and Hiller & Bathe with them. The value of Krysl & Chen, to whom the reason is unknown, is too high."),
        ("Hemisphere with a hole", "hemisphere_hole", "load_displacement", "Two origins agree. The element of Krysl & Chen or its extrapolation is too high, as on the closed hemisphere."),
        ("Scordelis-Lo roof", "scordelis_lo", "edge_deflection", "Series and exact exponentials agree."),
        ("Scordelis-Lo roof with shear, hard supports", "scordelis_lo_naghdi", "edge_deflection", "Naghdi's theory on rigid diaphragms decides for T3FF. Higher values leave normals free to turn in the plane of the diaphragms."),
        ("Clamped hypar, t/L = 1e-4, tip", "hypar_clamped_1e_4", "tip_deflection", "Two origins agree. S4 is extrapolated from meshes that do not resolve the layers."),
        ("Twisted beam, thin, force along y", "twisted_beam_thin_y", "tip_displacement", "Two derivations and `fem` agree. Shear can't be the reason in so thin a beam."),
        ("Twisted beam, thin, force along z", "twisted_beam_thin_z", "tip_displacement", "S4 agrees."),
        ("Twisted beam, thick, force along y", "twisted_beam_thick_y", "tip_displacement", "STRI3 has no shear, and agrees. The others have it."),
        ("Twisted beam, thick, force along z", "twisted_beam_thick_z", "tip_displacement", "STRI3 has no shear, and agrees. The others have it."),
        ("Raasch's hook", "raasch_hook", "middle_displacement", "The limit without shear, which Krysl & Chen do not have. Two origins agree to 2e-7; the solids shear."),
        ("NAFEMS LE5, axial stress at A", "z_section", "edge_stress", "Two origins agree to 3e-5. Beams whose section keeps its shape give -107.9 MPa, the thin shell 1.5 % more. Elements with shear are another 1.5 % higher."),
    ),
    "other": (
        ("Curved beam, force in its plane", "curved_beam_in_plane", "tip_displacement", "The quoted value is of curved beams, the limit of plane stress."),
        ("Curved beam, force normal to its plane", "curved_beam_out_of_plane", "tip_displacement", "A thin plate twists too stiffly where its section is only twice as wide as thick."),
        ("Razzaque's skew plate", "skew_plate_two_sides", "centre_deflection", "Moments are infinite at the obtuse corners: coarse elements miss them."),
        ("NAFEMS FV12, mode 4", "free_plate_modes", "frequency_4", "Two origins agree, and the values of Krysl's code."),
        ("NAFEMS FV15, mode 5", "rhombic_plate_modes", "frequency_5", "Shear would lower it: the target is unconverged."),
    ),
}  # fmt: skip
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
            for value in known.of(quantity.name, "literature", "published"):
                if judge is None:
                    continue
                label = f"{value.label or value.source} (`{value.source}`{', ' * bool(value.locator)}{value.locator})"
                off = f"{100 * (value.value / judge.value - 1):+.2g} %"
                figures = f"{value.value:.9g} {quantity.unit}|{judge.value:.9g} {quantity.unit}"
                yield f"|[`{case.name}`](cases/{case.name}.md)|`{quantity.name}`|{label}|{value.theory}|{figures}|{off}|"


def table(which: str) -> str:
    """Return a table of the finding: values that others quote beside the limit, and what decides."""
    lines = ["|shell|quantity|quoted by|quoted|limit|off by|what decides|", "|---|---|---|---|---|---|---|"]
    for words, name, quantity, decides in QUESTIONS[which]:
        case, known = catalog.named_case(name), catalog.known_values(name)
        judge, unit = known.judge(quantity, case.theory), case.quantity(quantity).unit
        assert judge is not None
        for value in known.of(quantity, "literature", "published"):
            if value.source in ("shellbench", "bastek2023", "kairanda2023"):
                continue
            off = f"{100 * (value.value / judge.value - 1):+.2g} %"
            start = f"|[{words}](../cases/{name}.md)|{quantity.replace('_', ' ')}|" if words else "|||"
            lines.append(f"{start}{value.label}|{value.value:.9g} {unit}|{judge.value:.10g} {unit}|{off}|{decides}|")
            words = decides = ""
    return "\n".join(lines) + "\n"


def finding() -> str:
    """Return the finding with its tables made anew."""
    return TABLE.sub(lambda found: found[1] + table(found[2]), FINDING.read_text(encoding="utf-8"))


def page() -> str:
    """Return the whole page."""
    return "\n".join([PREFACE, NAMES + "\n".join(names()), QUOTED + "\n".join(quoted()), ""])


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    FINDING.write_text(finding(), encoding="utf-8")
