"""The rolled plate's figure: how much bending each measure of strain sees."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from shellbench.report.palette import DASHES, OKABE_ITO, Ink
from shellbench.report.strains import EXACT, STRAINS, VANISHES, linear_energy, published_energy

HALF_TURN = 180.0  # degrees: the plate is rolled by t half turns
SIZE = (6.4, 2.9)  # inches
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


def rolled_figure(energies: Mapping[str, Mapping[float, float]]) -> Figure | None:
    """Draw the bending energy of a rolled plate against its angle, relative to the exact measure's; None without it.

    Parameters
    ----------
    energies
        By strain and by t, the angle in half turns: bending energy, J.
    """
    exact = energies.get(EXACT, {})
    if not exact:
        return None
    figure = Figure(figsize=SIZE, layout="constrained")
    left, right = figure.subplots(1, 2)
    angles = np.linspace(0.0, HALF_TURN, FINE)
    for strain in STRAINS:
        _closed_form(left, angles, ENERGY[strain], INKS[strain], strain)
        _closed_form(right, angles, CURVATURE[strain], INKS[strain], strain)
        computed = {at: value / exact[at] for at, value in energies.get(strain, {}).items() if exact.get(at)}
        left.plot(
            [HALF_TURN * at for at in computed],
            list(computed.values()),
            linestyle="none",
            marker=INKS[strain].marker,
            markersize=4.5,
            color=INKS[strain].colour,
            label=f"{strain}, computed",
        )
    left.set_xlabel(r"angle $\theta$ to which the plate is rolled (degrees)")
    left.set_ylabel("bending energy / exact")
    left.set_ylim(bottom=0.0)
    right.set_xlabel(r"angle $\varphi$ by which the normal has turned (degrees)")
    right.set_ylabel("curvature / exact")
    right.axhline(0.0, color="#999999", linewidth=0.6, zorder=0)
    _mark_zero(right)
    for axes in (left, right):
        axes.set_xticks(np.arange(0.0, HALF_TURN + 1, 45.0))
    handles, labels = left.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def _closed_form(axes: Axes, angles: np.ndarray, form: Callable[[float], float], ink: Ink, strain: str) -> None:
    axes.plot(
        angles,
        [form(math.radians(angle)) for angle in angles],
        color=ink.colour,
        linestyle=ink.dashes,
        linewidth=1.1,
        label=f"{strain}, closed form",
    )


def _mark_zero(axes: Axes) -> None:
    """Mark where no published curvature is left, whatever the bending."""
    degrees = math.degrees(VANISHES)
    axes.plot(
        [degrees], [0.0], marker="o", markersize=6, markerfacecolor="white", markeredgecolor=INKS["published"].colour
    )
    axes.annotate(
        f"published stiffness\nvanishes at {degrees:.2f}°",
        (degrees, 0.0),
        xytext=(-8, -26),
        textcoords="offset points",
        ha="right",
        va="center",
        fontsize=7.0,
        color=INKS["published"].colour,
        arrowprops={"arrowstyle": "-", "linewidth": 0.5, "color": INKS["published"].colour},
    )
