"""The ablation of strain measures: linear, published (Kairanda et al. 2023, eq. (30)) and exact, side by side."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.row import Row
from shellbench.report.data.columns import (
    Column,
    Line,
    at_most,
    column,
    error,
    in_its_unit,
    known_value,
    present,
    rounded_value,
    strong,
    words,
)
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import DASHES, OKABE_ITO, Ink
from shellbench.report.data.notation import SUPERSCRIPTS, Notation, quoted
from shellbench.report.data.runs import grouped, rows_of, suite_title
from shellbench.report.data.section import Section, given
from shellbench.report.data.solutions import STATUS_WORDS
from shellbench.report.data.table import Note, Table

SUITE = "strain_ablation"
STRAIN = "strain_"  # how names of figures begin
STRAINS = ("linear", "published", "exact")  # what the suite calls its runs
EXACT = "exact"
VANISHES = math.acos((1 - math.sqrt(5)) / 2)  # root of cos + sin^2: no published curvature there, 128.17 degrees
HALF_TURN = 180.0  # degrees: the plate is rolled by t half turns
SIZE = (7.2, 2.9)  # inches
FINE = 181  # points of a closed form


def strain_rows(evidence: Evidence) -> list[Row]:
    """Return the rows of the ablation, those of each case in the order of their marks; none of the exact alone."""
    shown = [row for row in rows_of(evidence.compared, SUITE) if row.label in STRAINS]
    if {row.label for row in shown} <= {EXACT}:
        return []
    of_cases = grouped(shown, lambda row: row.case).values()
    return [row for of_case in of_cases for row in sorted(of_case, key=lambda row: row.at or 0.0)]


def section(found: Evidence) -> Section:
    """Return the section of the ablation."""
    tables = given(strain_table(found))
    paragraphs = tuple(findings(found) if tables else ())
    return Section("strains", "Strain measures", paragraphs, tables, found.figures(STRAIN), place="one suite")


def strain_table(evidence: Evidence) -> Table | None:
    """Return answers and energies under each strain with their errors; None if there is nothing to compare."""
    shown = strain_rows(evidence)
    if not shown:
        return None
    notes = [
        Note(f"{row.case_title or row.case}, {row.label} ({STATUS_WORDS[row.status]})", row.reason)
        for row in shown
        if row.status not in ("ok", "declined") and row.reason
    ]
    return Table(
        name="strains",
        title=suite_title(SUITE).partition(";")[0],
        caption="The same solver with each measure of strain. Errors are relative to the known value of non-linear"
        " Kirchhoff–Love theory; those marked † to the exact measure's own figure, where no value is known, and those"
        " with a unit are absolute.",
        data=pd.DataFrame(list(map(_line, grouped(shown, lambda row: (row.case, row.quantity)).values()))),
        columns=(
            column("what", "Quantity", _with_unit, right=False),
            column("reference", way=strong(known_value)),
            *(one for strain in STRAINS for one in (_answer(strain), _error(strain))),
        ),
        notes=tuple(dict.fromkeys(notes)),
        suite=SUITE,
    )


def _line(rows: Sequence[Row]) -> dict[str, Any]:
    """Return value and error under each strain; without a known value, the departure from the exact strain's."""
    first, by_strain = rows[0], {row.label: row for row in rows}
    exact = by_strain[EXACT].value if EXACT in by_strain else None
    mark = f" at {first.mark}" if first.mark and "_" not in first.mark else ""
    line: dict[str, Any] = {
        "block": first.case_title or first.case,
        "case": first.case,
        "quantity": first.quantity,
        "what": f"{first.description or first.quantity.replace('_', ' ')}{mark}",
        "at": first.at,
        "unit": first.unit,
        "reference": next((row.reference for row in rows if row.reference is not None), None),
        "reference_uncertainty": first.reference_uncertainty,
    }
    for strain in STRAINS:
        row = by_strain.get(strain)
        departs = row is not None and row.reference is None and strain != EXACT and exact and row.value is not None
        line |= {
            strain: row.value if row else None,
            f"{strain}_error": row.relative_error if row else None,
            f"{strain}_absolute_error": row.absolute_error if row else None,
            f"{strain}_departure": row.value / exact - 1 if row and departs else None,  # type: ignore[operator]
            f"{strain}_status": row.status if row else "missing",
            f"{strain}_run_id": row.run_id if row else None,
        }
    return line


def findings(evidence: Evidence) -> list[str]:
    """Explain what the ablation shows, in paragraphs of plain words."""
    degrees = math.degrees(VANISHES)
    paragraphs = [
        "Equation (30) of Kairanda et al. 2023 measures bending with the deformed normal to first order in the gradient"
        " of the displacement, but multiplies it by second derivatives that are not small: the terms that it drops are"
        " as large as those it keeps.",
        "Derivation, for a plate of length L rolled to the angle θ: at ξ¹ the normal has turned by φ = θ ξ¹/L, so"
        " u,₁₁ = (θ/L)(−sin φ, 0, cos φ). With the true normal, (−sin φ, 0, cos φ), the exact curvature is"
        " κ = −θ/L. Equation (30) has (−sin φ, 0, 1) in its place: κ = −(θ/L)(cos φ + sin² φ). The linear measure has"
        " (0, 0, 1): κ = −(θ/L) cos φ.",
        "So the published bending stiffness of a point is (cos φ + sin² φ)² times the true one. It vanishes where"
        f" cos φ = (1 − √5)/2, at φ = {degrees:.2f}°, and beyond that the curvature has the wrong sign. The whole"
        " plate's energy, a mean of this over φ from 0 to θ, is 7/8 + (2/3 sin³ θ + 1/32 sin 4θ)/θ times the true one:"
        f" {published_energy(math.pi / 2):.2f} at 90°.",
    ]
    if turned := _turned(evidence):
        paragraphs.append(turned)
    return paragraphs


def published_energy(theta: float) -> float:
    """Return the published bending energy of a plate rolled to an angle (rad), relative to the true one.

    The mean of (cos + sin^2)^2 over [0, theta].
    """
    return 7 / 8 + (2 / 3 * math.sin(theta) ** 3 + math.sin(4 * theta) / 32) / theta if theta else 1.0


def linear_energy(theta: float) -> float:
    """Return the linear bending energy of a plate rolled to an angle (rad), relative to the true one.

    The mean of cos^2 over [0, theta].
    """
    return 1 / 2 + math.sin(2 * theta) / (4 * theta) if theta else 1.0


def _turned(evidence: Evidence) -> str:
    """Say what a rigid rotation costs under each strain; empty if no run tells."""
    case = catalog.find_suite(SUITE).turned if SUITE in catalog.suite_names() else None
    turned = [row for row in strain_rows(evidence) if row.case == case and row.primary and row.value is not None]
    if not turned:
        return ""
    by_strain = {row.label: row for row in turned}
    told = [
        f"{_number_words(row.value)} {row.unit} in the {strain} measure"
        for strain in reversed(STRAINS)
        if (row := by_strain.get(strain)) is not None and row.value is not None
    ]
    what = turned[0].description or turned[0].quantity
    return (
        "Nor is the published measure objective: a piece of a cylinder that is turned as a rigid body, and so not"
        f" strained at all, has a {what} of {', '.join(told)}."
    )


def _number_words(value: float) -> str:
    digits = quoted(float(f"{value:.3g}"))
    power = str(digits.exponent).translate(SUPERSCRIPTS)
    return digits.mantissa + (f" · 10{power}" if digits.exponent else "")


def bending_energies(evidence: Evidence, case: str) -> dict[str, dict[float, float]]:
    """Return the bending energy under each strain by mark, J, of the runs of a case in the ablation."""
    found: dict[str, dict[float, float]] = {}
    for row in strain_rows(evidence):
        record = evidence.records.get(row.run_id or "")
        if row.case == case and record is not None and record.energies:
            found.setdefault(row.label, {state.at: state.bending for state in record.energies})
    return found


def _with_unit(value: Any, line: Line, notation: Notation) -> str:
    return words(f"{value} ({line['unit']})" if present(line["unit"]) else value, line, notation)


def _answer(strain: str) -> Column:
    number = column(strain, strain.capitalize(), rounded_value)

    def written(line: Line, notation: Notation) -> str:
        status = STATUS_WORDS.get(line[f"{strain}_status"])
        if status is None:
            return number.show(line, notation)
        partly = f" ({number.show(line, notation)})" if present(line[strain]) else ""
        return notation.strong(notation.escape(status)) + partly

    return replace(number, show=written)


def _error(strain: str) -> Column:
    absolute = in_its_unit(f"{strain}_absolute_error", at_most(2))

    def otherwise(line: Line, notation: Notation) -> str:
        departure = line[f"{strain}_departure"]
        marked = notation.error(departure) + notation.escape("†") if present(departure) else ""
        return absolute(line, notation) or marked

    return column(f"{strain}_error", "Error", error, instead=otherwise)


INKS: Mapping[str, Ink] = {
    "linear": Ink(OKABE_ITO[6], "s", DASHES[2]),
    "published": Ink(OKABE_ITO[5], "^", DASHES[1]),
    "exact": Ink(OKABE_ITO[2], "o", DASHES[0]),
}
ENERGY: Mapping[str, Callable[[float], float]] = {
    "linear": linear_energy,
    "published": published_energy,
    "exact": lambda theta: 1.0,
}
CURVATURE: Mapping[str, Callable[[float], float]] = {
    "linear": math.cos,
    "published": lambda phi: math.cos(phi) + math.sin(phi) ** 2,
    "exact": lambda phi: 1.0,
}


def rolled_figure(energies: Mapping[str, Mapping[float, float]], stiffness: float) -> Figure | None:
    """Draw the bending energy of a rolled plate against its angle, as it is and relative to the exact one.

    Parameters
    ----------
    energies
        By strain and by t, the angle in half turns: bending energy, J. None is drawn if it is empty.
    stiffness
        Exact bending energy over half the square of the angle, J: B A / L^2, with B the bending stiffness, A the
        area and L the length that is rolled.
    """
    if not any(energies.values()):
        return None
    figure = Figure(figsize=SIZE, layout="constrained")
    panels = left, middle, right = figure.subplots(1, 3)
    angles = np.linspace(0.0, HALF_TURN, FINE)
    for strain, ink in INKS.items():
        ratio, curvature = (np.array([form[strain](a) for a in np.radians(angles)]) for form in (ENERGY, CURVATURE))
        energy = ratio * exact_energy(np.radians(angles), stiffness)
        for axes, values in zip(panels, (energy, ratio, curvature), strict=True):
            look = {"linestyle": ink.dashes, "linewidth": 1.1, "label": f"{strain}, closed form"}
            axes.plot(angles, values, color=ink.colour, **look)
        if marks := energies.get(strain):
            turned, computed = HALF_TURN * np.array(list(marks)), np.array(list(marks.values()))
            look = {"linestyle": "none", "marker": ink.marker, "markersize": 4.0, "label": f"{strain}, computed"}
            left.plot(turned, computed, color=ink.colour, **look)
            middle.plot(turned, computed / exact_energy(np.radians(turned), stiffness), color=ink.colour, **look)
    rolled, normal = r"rolled to $\theta$ (degrees)", r"normal turned by $\varphi$ (degrees)"
    words = ((rolled, "bending energy (J)"), (rolled, "bending energy / exact"), (normal, "curvature / exact"))
    for axes, (x, y) in zip(panels, words, strict=True):
        axes.set(xlabel=x, ylabel=y, xticks=np.arange(0.0, HALF_TURN + 1, 45.0))
    left.set_ylim(bottom=0.0)
    middle.set_ylim(bottom=0.0)
    right.axhline(0.0, color="#999999", linewidth=0.6, zorder=0)
    _mark_zero(right)
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def exact_energy(theta: Any, stiffness: float) -> Any:
    """Return the exact bending energy of a plate rolled to an angle (rad): kappa = theta/L everywhere, J."""
    return stiffness * theta**2 / 2


def _mark_zero(axes: Axes) -> None:
    """Mark where no published curvature is left, whatever the bending."""
    degrees, colour = math.degrees(VANISHES), INKS["published"].colour
    axes.plot([degrees], [0.0], marker="o", markersize=6, markerfacecolor="white", markeredgecolor=colour)
    axes.annotate(
        f"published stiffness\nvanishes at {degrees:.2f}°",
        (degrees, 0.0),
        xytext=(0.02, 0.2),
        textcoords="axes fraction",
        ha="left",
        va="center",
        fontsize=6.5,
        color=colour,
        arrowprops={"arrowstyle": "-", "linewidth": 0.5, "color": colour},
    )
