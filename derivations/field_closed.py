"""Fields over the unit square: closed forms of what solvers of kind `field` are held to, and a second form of each.

Source: Shu et al., "Spatially Adaptive Cloth Regression with Implicit Neural Representations". A local structure of
side s measures the strain loss sum (|F t| - 1)^2 over three directions 60 degrees apart, and the bending loss sum
|n1 - n2|^2 over three pairs of faces. For small strains E and curvatures k their means over orientations are
3 (2 tr E^2 + tr^2 E)/8 and s^2 (3/4 tr^2 k - 2 det k). Data of cases are repeated here on purpose.
"""

from __future__ import annotations

import math
from functools import partial
from itertools import pairwise

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.spatial import ConvexHull, SphericalVoronoi
from scipy.special import ellipe

from derivations.estimate import Estimate

SINE_AT = (0.3, 0.15)
STRAIN_WEIGHT, WEIGHT = 0.005, 2e-4  # of the strain loss, and of a sample: w_g m g
STRETCH, SHEAR, LESS = 0.02, 0.004, 0.01  # displacement gradient of the stretched sheet
STRETCHED_AT = (0.37, 0.61)
CURVATURE, SIDE = np.array([[2e-3, 5e-4], [5e-4, -1e-3]]), 0.01
RADIUS, VERTICES = 0.2, 25_060
OUTSIDE, INSIDE = (0.15, 0.16, 0.05), (0.02, -0.11, 0.13)
POINTS, ROWS = 1000, 20
STEPS = (0, 100, 10_000)
DIRECTIONS = 720  # of a mean over directions: far more than its smooth integrand needs


def count(value: float) -> Estimate:
    """Return a whole number."""
    return Estimate(float(value), 0.0, "")


def dense(sizes: tuple[int, ...]) -> int:
    """Return the weights and biases of layers of these sizes."""
    return sum(one * other + other for one, other in pairwise(sizes))


# Parameters: as layers of section 4.1, and as the paper's sums.


def field_count_plain() -> dict[str, Estimate]:
    """Return the parameters of the plain network."""
    return {"parameters": count(dense((2, 152, 152, 152, 3)))}


def field_count_positional() -> dict[str, Estimate]:
    """Return those of the network with two coordinates and sixteen sines and cosines."""
    return {"parameters": count(dense((2 + 2 * 2 * 4, 148, 148, 148, 3)))}


def field_count_grid() -> dict[str, Estimate]:
    """Return those of the grid with two levels of three features."""
    return {"parameters": count(3 * (101**2 + 51**2) + dense((6, 64, 64, 64, 3)))}


def field_count_vertices() -> dict[str, Estimate]:
    """Return those of a mesh of 128 x 128 vertices."""
    return {"parameters": count(3 * 128**2)}


def printed(value: int) -> dict[str, Estimate]:
    """Return the count that the paper states."""
    return {"parameters": count(value)}


# The sine surface.


def field_sine() -> dict[str, Estimate]:
    """Return no error, for that is what is asked, and a height."""
    u, v = SINE_AT
    value = 0.1 * math.sin(2 * math.pi * u) * math.sin(2 * math.pi * v)
    value += 0.01 * math.sin(16 * math.pi * u) * math.sin(16 * math.pi * v)
    return {"rms_error": Estimate(0.0, 0.0, "m"), "z": Estimate.exact(value, "m")}


def field_sine_by_cosines() -> dict[str, Estimate]:
    """Return the same by sums of cosines, and that the function's own mean square distance from itself is none."""
    u, v = SINE_AT
    value = sum(
        a / 2 * (math.cos(w * (u - v)) - math.cos(w * (u + v))) for a, w in ((0.1, 2 * math.pi), (0.01, 16 * math.pi))
    )
    return {"rms_error": Estimate(0.0, 0.0, "m"), "z": Estimate(value, 1e-15, "m")}


def none(*names: str) -> dict[str, Estimate]:
    """Return no error, for each of these quantities: what matches the function has none."""
    return {name: Estimate(0.0, 0.0, "m") for name in names}


ORDER = {
    "field_order_grid": partial(none, "rms_error"),
    "field_order_positional": partial(none, "rms_error", "as_the_grid"),
    "field_order_plain": partial(none, "as_positional"),
}


# Strain: the mean over directions.


def strain_loss(cauchy_green: np.ndarray) -> float:
    """Return the mean strain loss by complete elliptic integrals; the tensor is C = F^T F, (2, 2)."""
    less, more = np.linalg.eigvalsh(cauchy_green)
    mean_stretch = 2 / math.pi * math.sqrt(more) * ellipe(1 - less / more)
    return 3 * ((less + more) / 2 - 2 * mean_stretch + 1)


def strain_loss_by_directions(gradient: np.ndarray) -> float:
    """Return the same as the mean of (|F t| - 1)^2 over directions, by the midpoint rule."""
    angle = math.pi * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
    stretched = np.linalg.norm(gradient @ np.stack([np.cos(angle), np.sin(angle)]), axis=0)
    return float(3 * np.mean((stretched - 1) ** 2))


def stretch_gradient() -> np.ndarray:
    """Return F of the stretched sheet."""
    return np.eye(2) + np.array([[STRETCH, SHEAR], [SHEAR, LESS]])


def field_stretch() -> dict[str, Estimate]:
    """Return the strain loss, and a displacement: the edges' own everywhere, for an even strain is least."""
    gradient = stretch_gradient()
    u, v = STRETCHED_AT
    return {
        "strain": Estimate(strain_loss(gradient.T @ gradient), 1e-14, ""),
        "x": Estimate.exact(STRETCH * u + SHEAR * v, "m"),
    }


def field_stretch_by_directions() -> dict[str, Estimate]:
    """Return the same by the mean over directions, and by the matrix of the displacement."""
    value = (stretch_gradient() - np.eye(2)) @ np.array(STRETCHED_AT)
    return {
        "strain": Estimate(strain_loss_by_directions(stretch_gradient()), 1e-14, ""),
        "x": Estimate(float(value[0]), 1e-15, "m"),
    }


# A hanging strip, one direction only: w_s W'(stretch) = w_g m g y, y the length below.


def strip_loss(stretch: float) -> float:
    """Return the mean strain loss of a strip stretched along its length, and not across."""
    return strain_loss(np.diag([1.0, stretch**2]))


def strip_force(stretch: float) -> float:
    """Return the derivative of `strip_loss` by elliptic integrals: 3 (stretch - 2 d mean / d stretch)."""
    if stretch == 1.0:
        return 0.0
    share = 1 - 1 / stretch**2
    slope = 2 / math.pi * (ellipe(share) + (ellipe(share) - elliptic_k(share)) / (2 * share) * 2 / stretch**2)
    return 3 * (stretch - 2 * slope)


def elliptic_k(share: float) -> float:
    """Return the complete elliptic integral of the first kind."""
    from scipy.special import ellipk

    return float(ellipk(share))


def field_hang() -> dict[str, Estimate]:
    """Return the elongation: the integral of the stretch less one, found at each height from its force."""

    def excess(below: float) -> float:
        force = WEIGHT * below / STRAIN_WEIGHT
        return brentq(lambda stretch: strip_force(stretch) - force, 1.0 + 1e-12, 1.1, xtol=1e-15) - 1 if below else 0.0

    places, weights = np.polynomial.legendre.leggauss(24)

    def below(height: float) -> Estimate:
        """Return the displacement of a height: what the strip above it has grown."""
        share = 1 - height
        value = sum(w / 2 * share * excess(height + share * (x + 1) / 2) for x, w in zip(places, weights, strict=True))
        return Estimate(float(value), 1e-11, "m")

    return {"elongation": below(0.0), "middle": Estimate(-below(0.5).value, 1e-11, "m")}


def field_hang_by_energy() -> dict[str, Estimate]:
    """Return the same by parts: top stretch less one, less the complementary energy; forces by means over directions."""
    angle = math.pi * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
    cos2, sin2 = np.cos(angle) ** 2, np.sin(angle) ** 2

    def force(stretch: float) -> float:
        length = np.sqrt(cos2 + stretch**2 * sin2)
        return float(3 * np.mean(2 * (length - 1) * stretch * sin2 / length))

    def stretch_and_loss(height: float) -> tuple[float, float]:
        stretch = brentq(lambda s: force(s) - WEIGHT * height / STRAIN_WEIGHT, 1.0, 1.1, xtol=1e-15)
        return stretch, strain_loss_by_directions(np.diag([1.0, stretch]))

    (top, most), (middle, less) = map(stretch_and_loss, (1.0, 0.5))
    scale = STRAIN_WEIGHT / WEIGHT
    grown = top - 1 - (middle - 1) / 2 - (most - less) * scale
    return {
        "elongation": Estimate(top - 1 - most * scale, 1e-11, "m"),
        "middle": Estimate(-grown, 1e-11, "m"),
    }


# Directions of folds of a sheet with the symmetry of its square.

FOLDS = {"two": (2, 0.0), "six": (6, 0.0), "six_22": (6, 22.5), "six_45": (6, 45.0)}  # orders and angles, degrees


def field_folds() -> dict[str, Estimate]:
    """Return zero: a quarter of a turn, which leaves the sheet as it is, changes the sign of these harmonics."""
    assert all(order % 4 == 2 for order, _ in FOLDS.values())
    return {name: Estimate.exact(0.0, "") for name in FOLDS}


def field_folds_by_images() -> dict[str, Estimate]:
    """Return the mean over a fold line at any angle and its images under the turns of the square."""
    turned = 0.3 + math.pi / 2 * np.arange(4)
    means = {name: np.mean(np.cos(order * (turned - math.radians(along)))) for name, (order, along) in FOLDS.items()}
    return {name: Estimate(float(mean), 1e-14, "") for name, mean in means.items()}


# Constant curvature: three pairs of faces.


def field_curvature() -> dict[str, Estimate]:
    """Return the bending loss of a shallow sheet; slopes to 4e-3 change it by their square."""
    trace, determinant = float(np.trace(CURVATURE)), float(np.linalg.det(CURVATURE))
    value = SIDE**2 * (0.75 * trace**2 - 2 * determinant)
    return {"bend": Estimate(value, 5e-6 * value, ""), "curvature": Estimate.exact(float(CURVATURE[0, 0]), "1/m")}


def field_curvature_by_triangles() -> dict[str, Estimate]:
    """Return the mean of 2 - 2 cos of the dihedral angles, measured on the surface, and a difference of its heights."""

    def height(place: np.ndarray) -> np.ndarray:
        return np.einsum("...i,ij,...j->...", place, CURVATURE, place) / 2

    def lifted(place: np.ndarray) -> np.ndarray:
        return np.append(place, height(place))

    losses = []
    for middle in (np.arange(8) + 0.5) / 8:
        for other in (np.arange(8) + 0.5) / 8:
            for turn in np.arange(4) * math.pi / 6:
                angles = turn + np.array([0, 2, 4]) * math.pi / 3
                inner = SIDE / math.sqrt(3) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
                places = [lifted(np.array([middle, other]) + offset) for offset in (*inner, *(-2 * inner))]
                for i, j, k, far in ((1, 2, 0, 3), (2, 0, 1, 4), (0, 1, 2, 5)):
                    # Both faces' heights over their shared edge are turned against each other by the dihedral angle.
                    edge = places[j] - places[i]
                    edge = edge / np.linalg.norm(edge)
                    one, two = (p - places[i] - (p - places[i]) @ edge * edge for p in (places[k], places[far]))
                    one, two = one / np.linalg.norm(one), two / np.linalg.norm(two)
                    losses.append(np.sum((one + two) ** 2))  # 2 - 2 cos of the angle, without cancellation
    value = 3 * float(np.mean(losses))
    step, place = 0.1, np.array([0.3, 0.6])
    up = np.array([step, 0.0])
    second = (height(place + up) - 2 * height(place) + height(place - up)) / step**2
    return {"bend": Estimate(value, 2e-5 * value, ""), "curvature": Estimate(float(second), 1e-15, "1/m")}


# Samplers: numbers of section 3.2, by cumulated sums and by counting.


def field_sampler() -> dict[str, Estimate]:
    """Return degrees of freedom, rows and columns, and shares of the second row."""
    return {
        "chi_squared": count(3),
        "row_at": count(1),
        "row_above": count(2),
        "column": count(2),
        "first_column": Estimate.exact(3 / 7, ""),
        "last_column": count(1),
    }


def picked(cells: tuple[tuple[int, ...], ...], u: float, v: float) -> tuple[int, int]:
    """Return row and column, from 1, by counting: the first whose share of all, with those before, reaches a number."""
    row = next(
        i for i, line in enumerate(cells) if sum(line) and sum(map(sum, cells[: i + 1])) >= u * sum(map(sum, cells))
    )
    line = cells[row]
    column = next(j for j, cell in enumerate(line) if cell and sum(line[: j + 1]) >= v * sum(line))
    return row + 1, column + 1


def field_sampler_by_counting() -> dict[str, Estimate]:
    """Return the same by counting tenths; the mean of Pearson's statistic is cells less one."""
    cells = ((1, 2), (3, 4))
    return {
        "chi_squared": count(sum(map(len, cells)) - 1),
        "row_at": count(picked(cells, 0.3, 0.5)[0]),
        "row_above": count(picked(cells, 0.31, 0.5)[0]),
        "column": count(picked(cells, 0.9, 0.43)[1]),
        "first_column": Estimate(1 - 4 / sum(cells[1]), 1e-15, ""),
        "last_column": count(sum(cells[1]) / sum(cells[1])),
    }


def field_empty_row() -> dict[str, Estimate]:
    """Return degrees of freedom of three cells, and the cells at both ends."""
    return {"chi_squared": count(2), "row": count(2), "column": count(2), "last_row": count(4)}


def field_empty_row_by_counting() -> dict[str, Estimate]:
    """Return the same by counting."""
    cells = ((0, 0, 0), (0, 1, 3), (0, 0, 0), (0, 4, 0))
    row, column = picked(cells, 0.0, 0.0)
    filled = sum(cell > 0 for line in cells for cell in line)
    return {
        "chi_squared": count(filled - 1),
        "row": count(row),
        "column": count(column),
        "last_row": count(picked(cells, 1.0, 1.0)[0]),
    }


# Lloyd's relaxation on a line is linear: each point goes to the mean of the borders about it.


def quantiles() -> np.ndarray:
    """Return the quantiles (i - 1/2)/n of the density whose rows are 1, 3, 5, ...: linear within a row."""
    below = (np.arange(POINTS) + 0.5) / POINTS
    row = np.floor(np.sqrt(below) * ROWS + 1e-12)  # the first i rows have the probability (i / rows)^2
    return (row + (below * ROWS**2 - row**2) / (2 * row + 1)) / ROWS


def field_lloyd() -> dict[str, Estimate]:
    """Return the mean place after steps, one by one."""
    places, found = quantiles(), {}
    for step in range(STEPS[-1] + 1):
        if step in STEPS:
            found[f"mean_{step}"] = Estimate(float(places.mean()), 1e-12, "")
        mirrored = np.concatenate([[-places[0]], places, [2 - places[-1]]])
        places = (mirrored[:-2] + 2 * mirrored[1:-1] + mirrored[2:]) / 4
    return found


def field_lloyd_by_modes() -> dict[str, Estimate]:
    """Return the same by modes: of places about even ones, sines sin(m pi (i - 1/2)/n), each times cos^2(m pi/2 n)."""
    number = np.arange(POINTS) + 0.5
    even = number / POINTS
    mode = np.arange(1, POINTS + 1)
    shapes = np.sin(np.outer(number, mode) * math.pi / POINTS)
    norms = np.where(mode == POINTS, POINTS, POINTS / 2)
    parts = shapes.T @ (quantiles() - even) / norms
    rates = np.cos(mode * math.pi / (2 * POINTS)) ** 2
    means = {step: float(np.mean(even + shapes @ (parts * rates**step))) for step in STEPS}
    return {f"mean_{step}": Estimate(mean, 1e-11, "") for step, mean in means.items()}


# A ball of vertices: between them a place on the surface is d^2 / 2 R above the nearest vertex's plane.


def fibonacci() -> np.ndarray:
    """Return unit vectors (n, 3) on a Fibonacci spiral."""
    number = np.arange(VERTICES)
    height = 1 - (2 * number + 1) / VERTICES
    angle = math.pi * (3 - math.sqrt(5)) * number
    return np.stack([np.sqrt(1 - height**2) * np.cos(angle), np.sqrt(1 - height**2) * np.sin(angle), height], axis=1)


def of_places() -> dict[str, Estimate]:
    """Return the exact distances of two places; the solver's bound is half the square of the way to a vertex over R."""
    return {
        name: Estimate.exact(math.dist(place, (0, 0, 0)) - RADIUS, "m")
        for name, place in (("outside", OUTSIDE), ("inside", INSIDE))
    }


def field_ball() -> dict[str, Estimate]:
    """Return the largest error on the surface: R (1 - cos a), a the widest circle without a vertex, of the hull."""
    corners = fibonacci()
    hull = ConvexHull(corners)
    value = RADIUS * float(np.max(1 + hull.equations[:, 3]))  # a face is cos a away from the centre
    return {"distance_error": Estimate(value, 1e-14, "m"), **of_places()}


def field_ball_by_regions() -> dict[str, Estimate]:
    """Return the same by the corners of Voronoi's regions on the sphere, and distances by components."""
    points = fibonacci()
    regions = SphericalVoronoi(points, 1.0, np.zeros(3))
    worst = max(
        float(np.max(np.sum((regions.vertices[region] - point) ** 2, axis=1)))
        for region, point in zip(regions.regions, points, strict=True)
    )
    places = {
        name: Estimate(math.sqrt(sum(x * x for x in place)) - RADIUS, 1e-16, "m")
        for name, place in (("outside", OUTSIDE), ("inside", INSIDE))
    }
    return {"distance_error": Estimate(RADIUS * worst / 2, 1e-14, "m"), **places}


def biased_elongation() -> float:
    """Return the linear elongation if half the samples follow a density that grows as the height, and all count alike.

    With q = 1/2 + y: 9/4 w_s e q = w_g m g times the integral of q below; its integral is c (1/2 - ln 3 / 8).
    """
    return WEIGHT / (9 / 4 * STRAIN_WEIGHT) * (0.5 - math.log(3) / 8)


def biased_by_quadrature() -> float:
    """Return the same by quadrature."""
    scale = WEIGHT / (9 / 4 * STRAIN_WEIGHT)
    return scale * quad(lambda y: (y / 2 + y**2 / 2) / (0.5 + y), 0, 1, epsabs=1e-15)[0]
