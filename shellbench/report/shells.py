"""Pictures of shells: the reference surface as a light wire, the deformed one coloured by its displacement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from shellbench.report.digits import order_of, quoted
from shellbench.report.notation import MARKDOWN
from shellbench.report.projection import Camera, facet_means, facets, refined, shading, wires

Array = NDArray[np.float64]

SEQUENTIAL, DIVERGING = "viridis", "RdBu_r"  # both can be read by the colour-blind
BOTH_SIGNS = 0.1  # a component whose smaller side exceeds this share of its larger one is coloured about zero
EVEN = 1e-6  # share of a displacement within which it is the same everywhere, but for rounding
WIRES, FEW_WIRES = 13, 7  # coordinate lines of a square surface in each direction; of the reference beside it
CELLS = 64  # facets a side, at least: stored fields are refined to it for a smooth picture
STONE = (0.87, 0.88, 0.90)  # the reference surface
PLAIN_ORDERS = range(-2, 4)  # orders of magnitude that a colour bar shows without a power of ten
LETTERS = "abcdefghijklmnopqrstuvwxyz"
MOST_IN_A_ROW = 5  # shells of a suite
ARROW = 0.22  # length of a point load's arrow, in sizes of the shell


@dataclass(frozen=True)
class Shell:
    """One deformed shell, ready to be drawn.

    Attributes
    ----------
    position, displacement
        (n1, n2, 3), in `unit`.
    scale
        Factor of the displacement in the picture.
    direction
        Colour by the displacement along this direction; by its magnitude if None.
    held
        (n, 3) polylines of held edges, and single held points, on the reference surface.
    forces
        Point and direction (3,) of each point load.
    """

    case: str
    title: str
    solver: str
    position: Array
    displacement: Array
    scale: float
    camera: Camera
    direction: tuple[float, float, float] | None = None
    held: tuple[Array, ...] = field(default=())
    forces: tuple[tuple[Array, Array], ...] = field(default=())
    run_id: str = ""
    unit: str = "m"

    @property
    def size(self) -> float:
        """Largest extent of the reference surface along an axis."""
        return float(np.ptp(self.position.reshape(-1, 3), axis=0).max())

    @property
    def deformed(self) -> Array:
        """The deformed surface (n1, n2, 3) with its displacement magnified."""
        return self.position + self.scale * self.displacement

    @property
    def coloured(self) -> Array:
        """What the colour shows, (n1, n2), in `unit`."""
        if self.direction is None:
            return np.asarray(np.linalg.norm(self.displacement, axis=-1))
        along = np.asarray(self.direction) / np.linalg.norm(self.direction)
        return np.asarray(self.displacement @ along)


def shell_figure(shell: Shell) -> Figure:
    """Draw one deformed shell with its reference surface as a wire, and its colour bar."""
    figure = Figure(figsize=(3.4, 3.0), layout="constrained")
    axes = figure.subplots()
    draw_deformed(axes, shell)
    colour_bar(figure, axes, shell)
    axes.set_title(plain(shell.title), loc="left", pad=14)
    subtitle = f"{plain(shell.solver)}, displacement {times(shell.scale)}"
    axes.annotate(subtitle, (0, 1), (0, 4), xycoords="axes fraction", textcoords="offset points", color="#444444")
    return figure


def course_figure(shells: Sequence[Shell]) -> Figure:
    """Draw reference surfaces with supports and loads above deformed ones (after Kairanda et al., figure 6)."""
    columns, bands = min(len(shells), MOST_IN_A_ROW), -(-len(shells) // MOST_IN_A_ROW)
    figure = Figure(figsize=(1.85 * max(2, columns), 4.0 * bands), layout="constrained")
    panels = figure.subplots(2 * bands, columns, squeeze=False)
    for unused in panels[-2:, len(shells) - columns * (bands - 1) :].flat:
        unused.set_axis_off()
    for place, shell in enumerate(shells):
        band, column = divmod(place, columns)
        above, below = panels[2 * band, column], panels[2 * band + 1, column]
        draw_reference(above, shell)
        draw_deformed(below, shell)
        colour_bar(figure, below, shell)
        title = plain(shell.title).replace(", ", ",\n", 1)
        above.set_title(f"({LETTERS[place % len(LETTERS)]}) {title}" + ("" if "\n" in title else "\n"), loc="left")
        below.set_title(times(shell.scale), fontsize=7.5, pad=2)
    return figure


def draw_deformed(axes: Axes, shell: Shell, among: Sequence[Shell] = (), cells: int | None = None) -> None:
    """Draw the deformed surface, coloured and shaded, and the reference surface as a wire.

    Colours and the frame are common with the shells that it stands among. The surface has at least so many facets a
    side, `CELLS` unless told.
    """
    together = among or (shell,)
    fine = CELLS if cells is None else min(cells, CELLS)
    smooth = replace(
        shell, position=refined(shell.position, fine), displacement=refined(shell.displacement, fine), held=()
    )
    colours = colormaps[_map(together)](_norm(together)(facet_means(smooth.coloured)))[:, :3]
    behind = Strokes(wires(smooth.position, FEW_WIRES), (0.45, 0.45, 0.45, 0.6), 0.4, -1.5)
    _paint(axes, shell.camera, smooth.deformed, colours, [behind])
    _frame(axes, [shell.camera.look(grid) for one in together for grid in (one.position, one.deformed)])


def draw_reference(axes: Axes, shell: Shell) -> None:
    """Draw the reference surface with held edges as thick lines and point loads as arrows."""
    surface = refined(shell.position, CELLS)
    colours = np.tile(np.asarray(STONE), (len(facets(surface)), 1))
    held = [Strokes(np.stack([line[:-1], line[1:]], axis=1), (0.1, 0.1, 0.1, 1.0), 1.8, 2.0) for line in shell.held]
    _paint(axes, shell.camera, surface, colours, held)
    tails = []
    for point, force in shell.forces:
        tails.append(point - ARROW * shell.size * force / np.linalg.norm(force))
        axes.annotate(
            "",
            shell.camera.seen_at(point),
            xytext=shell.camera.seen_at(tails[-1]),
            arrowprops={"arrowstyle": "-|>", "color": "#D55E00", "linewidth": 1.2, "shrinkA": 0, "shrinkB": 0},
            zorder=4,
        )
    seen = [shell.camera.look(grid) for grid in (shell.position, np.array(tails).reshape(-1, 3))]
    _frame(axes, seen)
    _draw_triad(axes, shell.camera)


def colour_bar(
    figure: Figure, axes: Axes | Sequence[Axes], *shells: Shell, shrink: float = 0.85, aspect: float = 22
) -> None:
    """Draw the colour bar of shells below their axes, labelled with what it shows and its unit."""
    norm = _norm(shells)
    largest = max(abs(norm.vmin or 0.0), abs(norm.vmax or 0.0))
    order = order_of(largest) if largest > 0 else 0
    order = 0 if order in PLAIN_ORDERS else order
    factor = 10.0**-order
    shown = ScalarMappable(Normalize((norm.vmin or 0.0) * factor, (norm.vmax or 0.0) * factor), colormaps[_map(shells)])
    bar = figure.colorbar(shown, ax=axes, orientation="horizontal", shrink=shrink, aspect=aspect, pad=0.02)
    bar.outline.set_linewidth(0.4)
    bar.ax.grid(visible=False)
    unit = shells[0].unit if not order else rf"$10^{{{order}}}$ {shells[0].unit}"
    bar.set_label(f"{what_is_coloured(shells[0])} ({unit})", fontsize=7.5)
    bar.ax.tick_params(labelsize=7, length=2)
    bar.ax.locator_params(nbins=5)


def what_is_coloured(shell: Shell) -> str:
    """Say which part of the displacement the colour shows."""
    if shell.direction is None:
        return "displacement"
    for axis, name in enumerate("xyz"):
        unit = np.zeros(3)
        unit[axis] = 1.0
        for sign, text in ((1.0, ""), (-1.0, "\N{MINUS SIGN}")):
            if np.array_equal(np.asarray(shell.direction), sign * unit):
                return rf"$u_{{{name}}}$" if sign > 0 else rf"{text}$u_{{{name}}}$"
    return "displacement along (" + ", ".join(f"{d:g}" for d in shell.direction) + ")"


def times(scale: float) -> str:
    """Say by which factor the displacement is magnified."""
    order = order_of(scale) if scale else 0
    if -3 <= order <= 3:
        return rf"$\times$ {scale:g}"
    return rf"$\times\;{scale / 10.0**order:g} \cdot 10^{{{order}}}$"


def scale_words(shell: Shell) -> str:
    """Say in words how the picture shows the displacement."""
    if shell.scale == 1:
        return "at its true scale"
    return f"displacement magnified {MARKDOWN.number(quoted(shell.scale))} times"


def plain(text: str) -> str:
    """Make words harmless to matplotlib's mathematical text."""
    return text.replace("\\", "\\\\").replace("$", r"\$")


@dataclass(frozen=True)
class Strokes:
    """Straight pieces of line (m, 2, 3) in a colour and width, moved by `nearer` facets towards the viewer."""

    pieces: Array
    colour: tuple[float, float, float, float]
    width: float
    nearer: float


def _paint(axes: Axes, camera: Camera, surface: Array, colours: Array, strokes: Sequence[Strokes]) -> None:
    """Paint facets and lines from back to front, in one collection that is stored as pixels."""
    seen = camera.look(facets(surface))
    lit = np.clip(colours * shading(seen)[:, None], 0.0, 1.0)
    faces = np.column_stack([lit, np.ones(len(lit))])
    facet = float(np.linalg.norm(seen[:, 2] - seen[:, 0], axis=-1).mean())
    corners, depth = [seen[..., :2]], [seen[..., 2].mean(1)]
    fills, edges, widths = [faces], [faces], [np.full(len(faces), 0.3)]
    for stroke in (Strokes(wires(surface, WIRES), (0.0, 0.0, 0.0, 0.28), 0.35, 1.0), *strokes):
        lines = camera.look(stroke.pieces)
        corners.append(lines[:, [0, 1, 1, 0], :2])  # a line is a polygon without area
        depth.append(lines[..., 2].mean(1) + stroke.nearer * facet)
        fills.append(np.zeros((len(lines), 4)))
        edges.append(np.tile(stroke.colour, (len(lines), 1)))
        widths.append(np.full(len(lines), stroke.width))
    order = np.argsort(np.concatenate(depth), kind="stable")
    painted = PolyCollection(
        np.concatenate(corners)[order],  # type: ignore[arg-type] # an array is drawn faster than its list
        facecolors=np.concatenate(fills)[order],
        edgecolors=np.concatenate(edges)[order],
        linewidths=np.concatenate(widths)[order],
        capstyle="round",
        joinstyle="round",
        rasterized=True,
        zorder=2,
    )
    painted.set_in_layout(False)  # its extent is the frame's, and slow to find again
    axes.add_collection(painted, autolim=False)


def _frame(axes: Axes, seen: Sequence[Array]) -> None:
    """Show all of the given points (..., 3) of the camera's frame at equal scales, without axes."""
    flat = np.concatenate([points.reshape(-1, 3) for points in seen])[:, :2]
    axes.set_aspect("equal", adjustable="datalim")
    axes.update_datalim(flat)
    axes.margins(0.03)
    axes.autoscale_view()
    axes.set_axis_off()


def _draw_triad(axes: Axes, camera: Camera) -> None:
    """Draw the Cartesian directions in the lower left corner."""
    corner = axes.inset_axes((-0.04, -0.04, 0.24, 0.24))
    corner.set_axis_off()
    corner.set_aspect("equal")
    corner.set_xlim(-1.5, 1.5)
    corner.set_ylim(-1.5, 1.5)
    for name, tip in zip("xyz", camera.look(np.eye(3)), strict=True):
        corner.plot([0.0, tip[0]], [0.0, tip[1]], color="#444444", linewidth=0.7)
        corner.text(1.4 * tip[0], 1.4 * tip[1], f"${name}$", fontsize=6.5, ha="center", va="center", color="#444444")


def _map(shells: Sequence[Shell]) -> str:
    return DIVERGING if _signed(shells) else SEQUENTIAL


def _range(shells: Sequence[Shell]) -> tuple[float, float]:
    return min(float(one.coloured.min()) for one in shells), max(float(one.coloured.max()) for one in shells)


def _signed(shells: Sequence[Shell]) -> bool:
    low, high = _range(shells)
    return low < 0 < high and min(-low, high) > BOTH_SIGNS * max(-low, high)


def _norm(shells: Sequence[Shell]) -> Normalize:
    low, high = _range(shells)
    if _signed(shells):
        largest = max(-low, high)
        return Normalize(-largest, largest)
    if shells[0].direction is None or high - low < EVEN * max(abs(low), abs(high)):
        low, high = min(low, 0.0), max(high, 0.0)
    return Normalize(low, high if high > low else low + 1.0)
