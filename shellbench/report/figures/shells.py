"""Pictures of shells: the reference surface as a light wire, the deformed one coloured by its displacement.

A camera without perspective sees them, painted from back to front. matplotlib's own 3-D axes sort whole collections, so
that a wire and a surface never hide each other rightly. Here one collection has all facets and pieces of wire by depth.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure, FigureBase
from numpy.typing import NDArray

from shellbench.report.data.notation import MARKDOWN, plain, quoted
from shellbench.report.figures.grids import facet_means, facets, inward, refined, wires

Array = NDArray[np.float64]
Up = Literal["x", "y", "z"]

AXES_TO_UP: dict[Up, tuple[int, int, int]] = {"z": (0, 1, 2), "y": (2, 0, 1), "x": (1, 2, 0)}
AMBIENT = 0.6  # share of the light that reaches every facet
LIGHT = (-0.35, 0.55, 0.76)  # in the camera's frame: from the upper left, in front
SEQUENTIAL, DIVERGING = "viridis", "RdBu_r"  # both can be read by the colour-blind
BOTH_SIGNS = 0.1  # a component whose smaller side exceeds this share of its larger one is coloured about zero
EVEN = 1e-6  # share of a displacement within which it is the same everywhere, but for rounding
WIRES, FEW_WIRES = 13, 7  # coordinate lines of a square surface in each direction; of the reference beside it
CELLS, FEW_CELLS = 64, 48  # facets a side, at least, for a smooth picture; of a small one
STONE = (0.87, 0.88, 0.90)  # the reference surface
BODY = (0.80, 0.74, 0.66)  # obstacles
PLAIN_ORDERS = (-2, 3)  # orders of magnitude between which a colour bar has no power of ten
LETTERS = "abcdefghijklmnopqrstuvwxyz"
COLUMN = 28  # letters of a line of a title in a row
MOST_IN_A_ROW = 6  # shells of a suite
ARROW = 0.22  # length of a point load's arrow, in sizes of the shell
WIDTH, WIDEST = 7.2, 2.4  # inches of a row of shapes, and of one shape
LOWEST, HIGHEST = 0.8, 2.2  # inches of a shape
BAR = 0.75  # inches for the colour bar of shapes


@dataclass(frozen=True)
class Camera:
    """A camera at an infinite distance.

    Attributes
    ----------
    elevation, azimuth
        Degrees, as in matplotlib's 3-D axes.
    up
        The Cartesian axis that points up in the picture.
    """

    elevation: float
    azimuth: float
    up: Up = "z"

    @property
    def axes(self) -> Array:
        """Rows: right, upwards and towards the viewer, as (3, 3) in Cartesian components."""
        e, a = np.radians([self.elevation, self.azimuth])
        right = [-np.sin(a), np.cos(a), 0.0]
        upwards = [-np.sin(e) * np.cos(a), -np.sin(e) * np.sin(a), np.cos(e)]
        towards = [np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]
        turned = np.zeros((3, 3))
        turned[:, list(AXES_TO_UP[self.up])] = np.array([right, upwards, towards])
        return turned

    def look(self, points: Array) -> Array:
        """Return (..., 3): right, up and depth (larger is nearer) of points (..., 3) in metres."""
        return points @ self.axes.T


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
        Colour by the displacement along this direction, or into what the surface encloses; by its magnitude if None.
    held
        (n, 3) polylines of held edges, and single held points, on the reference surface.
    forces
        Point and direction (3,) of each point load.
    obstacles
        Points at rest (n1, n2, 3), and their ways to where they would touch one; NaN where none is drawn.
    """

    case: str
    title: str
    solver: str
    position: Array
    displacement: Array
    scale: float
    camera: Camera
    direction: tuple[float, float, float] | Literal["inward"] | None = None
    held: tuple[Array, ...] = field(default=())
    forces: tuple[tuple[Array, Array], ...] = field(default=())
    run_id: str = ""
    unit: str = "m"
    obstacles: tuple[tuple[Array, Array], ...] = field(default=())

    @property
    def size(self) -> float:
        """Largest extent of the reference surface along an axis."""
        return float(np.ptp(self.position.reshape(-1, 3), axis=0).max())

    @property
    def deformed(self) -> Array:
        """The deformed surface (n1, n2, 3) with its displacement magnified."""
        return self.position + self.scale * self.displacement

    @property
    def touched(self) -> tuple[Array, ...]:
        """Obstacles (n1, n2, 3), whose distance is magnified like the displacement."""
        return tuple(at + self.scale * way for at, way in self.obstacles)

    @property
    def coloured(self) -> Array:
        """Values that the colour shows, (n1, n2), in `unit`."""
        if self.direction is None:
            return np.asarray(np.linalg.norm(self.displacement, axis=-1))
        if self.direction == "inward":
            return np.asarray(np.sum(self.displacement * inward(self.position), axis=-1))
        return np.asarray(self.displacement @ (np.asarray(self.direction) / np.linalg.norm(self.direction)))

    @property
    def words(self) -> str:
        """Description of the picture for readers who can't see it: the range of the displacement."""
        low, high = (f"{value:.3g} {self.unit}".rstrip() for value in (self.coloured.min(), self.coloured.max()))
        return f"{'displacement' if self.unit else 'scaled displacement'} from {low} to {high}"


def shell_figure(shell: Shell) -> Figure:
    """Draw one deformed shell with its reference surface as a wire, and its colour bar."""
    figure = Figure(figsize=(3.4, 3.0), layout="constrained")
    axes = figure.subplots()
    draw_deformed(axes, shell)
    colour_bar(figure, axes, shell)
    axes.set_title(plain(shell.title), loc="left", pad=14)
    shown = f"displacement {times(shell.scale)}" if shell.unit else "shape, scaled"
    subtitle = ", ".join(filter(None, (plain(shell.solver), shown)))
    axes.annotate(subtitle, (0, 1), (0, 4), xycoords="axes fraction", textcoords="offset points", color="#444444")
    return figure


def course_figure(shells: Sequence[Shell]) -> Figure:
    """Draw reference surfaces with supports and loads above deformed ones (after Kairanda et al. 2023, figure 6)."""
    columns, bands = min(len(shells), MOST_IN_A_ROW), -(-len(shells) // MOST_IN_A_ROW)
    figure = Figure(figsize=(min(1.85 * max(2, columns), 9.6), 4.0 * bands), layout="constrained")
    panels = figure.subplots(2 * bands, columns, squeeze=False)
    for unused in panels[-2:, len(shells) - columns * (bands - 1) :].flat:
        unused.set_axis_off()
    for place, shell in enumerate(shells):
        band, column = divmod(place, columns)
        above, below = panels[2 * band, column], panels[2 * band + 1, column]
        draw_reference(above, shell)
        draw_deformed(below, shell)
        colour_bar(figure, below, shell)
        title = f"({LETTERS[place % len(LETTERS)]}) " + shell.title.replace(", ", ",\n", 1)
        title = plain(title if "\n" in title else textwrap.fill(title, COLUMN))
        above.set_title(title + ("" if "\n" in title else "\n"), loc="left")
        below.set_title(times(shell.scale) if shell.unit else "scaled", fontsize=7.5, pad=2)
    return figure


def shapes_figure(rows: Sequence[Sequence[Shell | None]], words: Sequence[str], names: Sequence[str] = ()) -> Figure:
    """Draw rows of shapes in one frame and one range of colours; None is a shape that was not reached.

    Parameters
    ----------
    words
        For each shape, row by row; or for those of the first row alone, if all rows show the same.
    names
        For each row; none if the rows go on one after another.
    """
    shells = [shell for row in rows for shell in row if shell is not None]
    columns = max(map(len, rows))
    width = min(WIDEST, WIDTH / columns)
    height = float(np.clip(width * aspect(shells), LOWEST, HIGHEST)) + (0.1 if names else 0.25)
    figure = Figure(figsize=(max(3.4, width * columns), height * len(rows) + BAR), layout="constrained")
    grid = figure.subplots(len(rows), columns, squeeze=False)
    for axes in grid.flat:
        axes.set_axis_off()
    for axes, one in zip(grid.flat, words, strict=False):
        axes.set_title(plain(one), loc="center" if names else "left", fontsize=7.5)
    for panels, row in zip(grid, rows, strict=True):
        for axes, shell in zip(panels, row, strict=False):
            if shell is None:
                axes.text(0.5, 0.5, "not reached", transform=axes.transAxes, ha="center", va="center", color="#666666")
            else:
                draw_deformed(axes, shell, shells, FEW_CELLS if names else CELLS)
    for panels, name in zip(grid, names, strict=False):
        name_row(panels[0], name)
    colour_bar(figure, list(grid.flat), *shells, shrink=0.5, aspect=34)
    return figure


def name_row(axes: Axes, name: str, colour: str = "black") -> None:
    """Write the name of a row of panels upright beside its first one."""
    look: dict[str, Any] = {"rotation": 90, "ha": "right", "va": "center", "fontsize": 7.5, "color": colour}
    axes.annotate(plain(name), (0, 0.5), (-4, 0), xycoords="axes fraction", textcoords="offset points", **look)


def aspect(shells: Sequence[Shell]) -> float:
    """Return height over width of what the camera sees."""
    seen = np.concatenate([s.camera.look(grid).reshape(-1, 3) for s in shells for grid in (s.position, s.deformed)])
    width, height, _ = np.ptp(seen, axis=0)
    return float(height / width) if width > 0 else 1.0


def draw_deformed(axes: Axes, shell: Shell, among: Sequence[Shell] = (), cells: int | None = None) -> None:
    """Draw the deformed surface, coloured and shaded, and the reference surface as a wire.

    Colours and the frame are common with the shells that it stands among. The surface has at least so many facets a
    side, `CELLS` unless told.
    """
    together, fine = among or (shell,), CELLS if cells is None else min(cells, CELLS)
    position, displacement = refined(shell.position, fine), refined(shell.displacement, fine)
    smooth = replace(shell, position=position, displacement=displacement, held=())
    colours = _colours(together).to_rgba(facet_means(smooth.coloured))[:, :3]
    behind = Strokes(wires(smooth.position, FEW_WIRES), (0.45, 0.45, 0.45, 0.6), 0.4, -1.5)
    _paint(axes, shell.camera, smooth.deformed, colours, [behind], shell.touched)
    grids = [grid for one in together for grid in (one.position, one.deformed, *one.touched)]
    _frame(axes, [shell.camera.look(grid) for grid in grids])


def draw_reference(axes: Axes, shell: Shell) -> None:
    """Draw the reference surface with held edges as thick lines, held points as dots and point loads as arrows."""
    surface = refined(shell.position, CELLS)
    colours = np.tile(np.asarray(STONE), (len(facets(surface)), 1))
    held = [Strokes(np.stack([line[:-1], line[1:]], axis=1), (0.1, 0.1, 0.1, 1.0), 1.8, 2.0) for line in shell.held]
    _paint(axes, shell.camera, surface, colours, held)
    pins = [shell.camera.look(line[0])[:2] for line in shell.held if len(line) == 1]
    x, y = np.array(pins).reshape(-1, 2).T
    axes.scatter(x, y, s=14, color=(0.1, 0.1, 0.1), zorder=3)
    ends = [(point, point - ARROW * shell.size * force / np.linalg.norm(force)) for point, force in shell.forces]
    arrow = {"arrowstyle": "-|>", "color": "#D55E00", "linewidth": 1.2, "shrinkA": 0, "shrinkB": 0}
    for (x, y, _), (tail_x, tail_y, _) in (shell.camera.look(np.array(pair)) for pair in ends):
        axes.annotate("", (x, y), xytext=(tail_x, tail_y), arrowprops=arrow, zorder=4)
    tails = np.array([tail for _, tail in ends]).reshape(-1, 3)
    _frame(axes, [shell.camera.look(grid) for grid in (shell.position, tails)])
    _draw_triad(axes, shell.camera)


def colour_bar(
    figure: FigureBase, axes: Axes | Sequence[Axes], *shells: Shell, shrink: float = 0.85, aspect: float = 22
) -> None:
    """Draw the colour bar of shells below their axes, labelled with what it shows and its unit."""
    look: dict[str, Any] = {"orientation": "horizontal", "shrink": shrink, "aspect": aspect, "pad": 0.02}
    bar = figure.colorbar(_colours(shells), ax=axes, **look)
    bar.outline.set_linewidth(0.4)
    bar.ax.grid(visible=False)
    bar.ax.tick_params(labelsize=7, length=2)
    bar.ax.locator_params(nbins=5)
    bar.ax.ticklabel_format(scilimits=PLAIN_ORDERS, useMathText=True)
    # matplotlib would write the power of ten over the label where the bar is narrow
    bar.formatter.set_locs(list(bar.ax.get_xticks()))
    unit = (bar.formatter.get_offset().replace(r"\times", "") + f" {shells[0].unit or 'scaled'}").lstrip()
    bar.ax.xaxis.get_offset_text().set_visible(False)
    bar.set_label(f"{what_is_coloured(shells[0])} ({unit})", fontsize=7.5)


def what_is_coloured(shell: Shell) -> str:
    """Say which part of the displacement the colour shows."""
    if shell.direction is None:
        return "displacement"
    if shell.direction == "inward":
        return "inward $u$"
    if axis := axis_of(shell.direction):
        return rf"{axis[0]}$u_{{{axis[1]}}}$".replace("-", "\N{MINUS SIGN}")
    return "displacement along (" + ", ".join(f"{d:g}" for d in shell.direction) + ")"


def axis_of(direction: Sequence[float]) -> tuple[str, str] | None:
    """Return sign and letter of the axis along which a direction is; None if it is along none."""
    axis = int(np.argmax(np.abs(direction)))
    return ("-" if direction[axis] < 0 else "", "xyz"[axis]) if np.count_nonzero(direction) == 1 else None


def times(scale: float) -> str:
    """Say by which factor the displacement is magnified."""
    return f"× {MARKDOWN.number(quoted(scale))}"


def scale_words(shell: Shell) -> str:
    """Say in words how the picture shows the displacement."""
    if not shell.unit:
        return "its size without meaning"
    if shell.scale == 1:
        return "at its true scale"
    return f"displacement magnified {MARKDOWN.number(quoted(shell.scale))} times"


def shading(seen: Array) -> Array:
    """Return the light (m,) in [AMBIENT, 1] on facets (m, 4, 3) in the camera's frame, whichever side is seen."""
    normal = np.cross(seen[:, 2] - seen[:, 0], seen[:, 3] - seen[:, 1])
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    unit = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    unit *= np.where(unit[:, 2:] < 0, -1.0, 1.0)
    direction = np.asarray(LIGHT) / np.linalg.norm(LIGHT)
    lit: Array = AMBIENT + (1.0 - AMBIENT) * np.clip(unit @ direction, 0.0, 1.0)
    return lit


@dataclass(frozen=True)
class Strokes:
    """Straight pieces of line (m, 2, 3) in a colour and width, moved by `nearer` facets towards the viewer."""

    pieces: Array
    colour: tuple[float, float, float, float]
    width: float
    nearer: float


def _paint(
    axes: Axes,
    camera: Camera,
    surface: Array,
    colours: Array,
    strokes: Sequence[Strokes],
    obstacles: Sequence[Array] = (),
) -> None:
    """Paint facets and lines from back to front, in one collection that is stored as pixels."""
    seen = camera.look(facets(surface))
    faces = np.column_stack([np.clip(colours * shading(seen)[:, None], 0.0, 1.0), np.ones(len(seen))])
    facet = float(np.linalg.norm(seen[:, 2] - seen[:, 0], axis=-1).mean())
    corners, depth = [seen[..., :2]], [seen[..., 2].mean(1)]
    fills, edges, widths = [faces], [faces], [np.full(len(faces), 0.3)]
    for obstacle in obstacles:
        bodies = camera.look(facets(obstacle))
        bodies = bodies[np.isfinite(bodies).all(axis=(1, 2))]
        corners.append(bodies[..., :2])
        depth.append(bodies[..., 2].mean(1) - facet)  # what touches is in front
        look = np.column_stack([np.asarray(BODY) * shading(bodies)[:, None], np.ones(len(bodies))])
        fills.append(look)
        edges.append(look)
        widths.append(np.full(len(bodies), 0.3))
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
    axes.update_datalim(flat[np.isfinite(flat).all(axis=1)])
    axes.margins(0.03)
    axes.autoscale_view()
    axes.set_axis_off()


def _draw_triad(axes: Axes, camera: Camera) -> None:
    """Draw the Cartesian directions in the lower left corner."""
    corner = axes.inset_axes((-0.04, -0.04, 0.24, 0.24))
    corner.set_axis_off()
    corner.set(aspect="equal", xlim=(-1.5, 1.5), ylim=(-1.5, 1.5))
    for name, tip in zip("xyz", camera.look(np.eye(3)), strict=True):
        corner.plot([0.0, tip[0]], [0.0, tip[1]], color="#444444", linewidth=0.7)
        corner.text(1.4 * tip[0], 1.4 * tip[1], f"${name}$", fontsize=6.5, ha="center", va="center", color="#444444")


def _colours(shells: Sequence[Shell]) -> ScalarMappable:
    """Return colours that shells have in common: about zero where both signs matter, else from low to high."""
    low, high = min(float(s.coloured.min()) for s in shells), max(float(s.coloured.max()) for s in shells)
    if low < 0 < high and min(-low, high) > BOTH_SIGNS * max(-low, high):
        largest = max(-low, high)
        return ScalarMappable(Normalize(-largest, largest), DIVERGING)
    if shells[0].direction is None or high - low < EVEN * max(abs(low), abs(high)):
        low, high = min(low, 0.0), max(high, 0.0)
    return ScalarMappable(Normalize(low, high if high > low else low + 1.0), SEQUENTIAL)
