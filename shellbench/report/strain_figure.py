"""The rolled plate's figure: how much bending each measure of strain sees."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from shellbench.report.palette import DASHES, OKABE_ITO, Ink
from shellbench.report.strains import STRAINS, VANISHES, linear_energy, published_energy

HALF_TURN = 180.0  # degrees: the plate is rolled by t half turns
SIZE = (7.2, 2.9)  # inches
FINE = 181  # points of a closed form

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
    left, middle, right = figure.subplots(1, 3)
    angles = np.linspace(0.0, HALF_TURN, FINE).tolist()
    exact = [exact_energy(math.radians(angle), stiffness) for angle in angles]
    for strain in STRAINS:
        ink = INKS[strain]
        ratios = [ENERGY[strain](math.radians(angle)) for angle in angles]
        _closed_form(left, angles, [a * b for a, b in zip(ratios, exact, strict=True)], ink, strain)
        _closed_form(middle, angles, ratios, ink, strain)
        _closed_form(right, angles, [CURVATURE[strain](math.radians(angle)) for angle in angles], ink, strain)
        marks = energies.get(strain, {})
        turned, computed = [HALF_TURN * at for at in marks], list(marks.values())
        if not marks:
            continue
        true = [exact_energy(math.pi * at, stiffness) for at in marks]
        _computed(left, turned, computed, ink, strain)
        _computed(middle, turned, [a / b for a, b in zip(computed, true, strict=True)], ink, strain)
    left.set_ylabel("bending energy (J)")
    middle.set_ylabel("bending energy / exact")
    for axes in (left, middle):
        axes.set_xlabel(r"rolled to $\theta$ (degrees)")
        axes.set_ylim(bottom=0.0)
    right.set_xlabel(r"normal turned by $\varphi$ (degrees)")
    right.set_ylabel("curvature / exact")
    right.axhline(0.0, color="#999999", linewidth=0.6, zorder=0)
    _mark_zero(right)
    for axes in (left, middle, right):
        axes.set_xticks(np.arange(0.0, HALF_TURN + 1, 45.0))
    handles, labels = left.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def exact_energy(theta: float, stiffness: float) -> float:
    """Return the exact bending energy of a plate rolled to an angle (rad): kappa = theta/L everywhere, J."""
    return stiffness * theta**2 / 2


def _computed(axes: Axes, x: Sequence[float], y: Sequence[float], ink: Ink, strain: str) -> None:
    axes.plot(x, y, linestyle="none", marker=ink.marker, markersize=4.0, color=ink.colour, label=f"{strain}, computed")


def _closed_form(axes: Axes, angles: Sequence[float], values: Sequence[float], ink: Ink, strain: str) -> None:
    axes.plot(angles, values, color=ink.colour, linestyle=ink.dashes, linewidth=1.1, label=f"{strain}, closed form")


def _mark_zero(axes: Axes) -> None:
    """Mark where no published curvature is left, whatever the bending."""
    degrees = math.degrees(VANISHES)
    axes.plot(
        [degrees], [0.0], marker="o", markersize=6, markerfacecolor="white", markeredgecolor=INKS["published"].colour
    )
    axes.annotate(
        f"published stiffness\nvanishes at {degrees:.2f}°",
        (degrees, 0.0),
        xytext=(0.02, 0.2),
        textcoords="axes fraction",
        ha="left",
        va="center",
        fontsize=6.5,
        color=INKS["published"].colour,
        arrowprops={"arrowstyle": "-", "linewidth": 0.5, "color": INKS["published"].colour},
    )
