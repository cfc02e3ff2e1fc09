r"""Prismatic folded plates between diaphragms under their weight, strip by strip in exact Levy solutions.

Flat strips of the length L along x meet at straight folds. A cross-section is a polyline of points (y, z); on a strip s runs
from its first point to its second along t, and n = e_x cross t. The diaphragms at x = 0 and x = L hold the displacement in
their plane and leave the axial one and rotations free, v = w = 0, N_x = M_x = 0, which

    u = sum U_m(s) cos(a x),   v = sum V_m(s) sin(a x),   w = sum W_m(s) sin(a x),   a = m pi / L, m odd

meets term by term. A constant load per area p has the amplitudes q = 4 p / (m pi), and on a strip, with ' = d/ds,

    D (-a^2 U + nu a V') + G h (U'' + a V') = 0,   D (V'' - nu a U') - G h a (U' + a V) + q . t = 0,
    B (W'''' - 2 a^2 W'' + a^4 W) = q . n.

Solutions are (c + d s) exp(+-a s) and the constants V = q.t / (G h a^2), W = q.n / (B a^4). Eight coefficients give the
displacements U, V, W and the rotation W' about the fold at both edges, and the forces there,

    N_xs = G h (U' + a V),   N_s = D (V' - nu a U),   Q = -B (W''' - (2 - nu) a^2 W'),   -M_s = B (W'' - nu a^2 W),

so that each strip has a stiffness of 8 rows. At a fold, the displacement vector and the rotation are those of all its strips, and
their forces and moments add to zero; at a free edge they vanish (Goldberg & Leve 1957; Timoshenko & Woinowsky-Krieger,
sections 29 and 30). Nothing is approximated but the number of harmonics. At mid-length the terms alternate, and partial sums
are averaged repeatedly (Euler); the energies are sums of positive terms.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .estimate import Estimate
from .surface_strains import Array

HARMONICS = 400
"""Odd harmonics that are summed; energies then lack 1e-12."""
AVERAGED = 40
"""Partial sums that Euler's averages combine."""
ROUNDING_OF_STRIPS = 1e-11
"""Relative rounding of a solved harmonic: membrane and bending stiffness differ by the square of width over thickness."""


@dataclass(frozen=True)
class FoldedPlate:
    """Geometry (m), material (Pa) and load (N/m^2 of midsurface, along y and z) of a prismatic shell of flat strips."""

    nodes: tuple[tuple[float, float], ...]
    strips: tuple[tuple[int, int], ...]
    length: float
    thickness: float
    young: float
    poisson: float
    load: tuple[float, float] = (0.0, 0.0)

    @property
    def stretching(self) -> float:
        """D = E h / (1 - nu^2), N/m."""
        return self.young * self.thickness / (1 - self.poisson**2)

    @property
    def bending(self) -> float:
        """B = E h^3 / (12 (1 - nu^2)), N m."""
        return self.stretching * self.thickness**2 / 12

    def width(self, strip: int) -> float:
        """Width of a strip, m."""
        first, second = (np.array(self.nodes[i]) for i in self.strips[strip])
        return float(np.linalg.norm(second - first))

    def frame(self, strip: int) -> tuple[Array, Array]:
        """Unit vectors t along the section and n = e_x cross t, each (2,) along y and z."""
        first, second = (np.array(self.nodes[i]) for i in self.strips[strip])
        t = (second - first) / self.width(strip)
        return t, np.array([-t[1], t[0]])


ROOF = FoldedPlate(
    nodes=((-1 - np.sqrt(3), -1.0), (-1.0, 0.0), (1.0, 0.0), (1 + np.sqrt(3), -1.0)),
    strips=((0, 1), (1, 2), (2, 3)),
    length=10.0,
    thickness=0.1,
    young=2e10,
    poisson=0.2,
    load=(0.0, -4000.0),
)
"""Three plates 2 m wide, the outer ones sloping down by 30 degrees to free edges."""
BOX = FoldedPlate(
    nodes=((-1.0, -1.0), (1.0, -1.0), (1.0, 0.0), (-1.0, 0.0)),
    strips=((0, 1), (1, 2), (2, 3), (3, 0)),
    length=10.0,
    thickness=0.1,
    young=2e10,
    poisson=0.2,
    load=(0.0, -4000.0),
)
"""A closed box, 2 m wide and 1 m deep."""


@dataclass(frozen=True)
class Waves:
    """Functions (c + d sigma) exp(sigma) of a strip's edges, sigma = a (s - b) and -a s, by harmonic."""

    a: Array
    b: float
    at_right: Array
    """(harmonic, 2, 4): c and d of four functions that decay from the right edge."""
    at_left: Array

    def derivative(self) -> Waves:
        """Derivatives by s."""

        def along(pair: Array, rate: Array) -> Array:
            c, d = pair[:, 0], pair[:, 1]
            return rate[:, None, None] * np.stack([c + d, d], axis=1)

        return Waves(self.a, self.b, along(self.at_right, self.a), along(self.at_left, -self.a))

    def at(self, s: float) -> Array:
        """Values (harmonic, 8): the functions of the left edge, then those of the right one."""

        def value(pair: Array, sigma: Array) -> Array:
            return (pair[:, 0] + pair[:, 1] * sigma[:, None]) * np.exp(sigma)[:, None]

        left, right = value(self.at_left, -self.a * s), value(self.at_right, self.a * (s - self.b))
        return np.concatenate([left, right], axis=1)

    def integral(self) -> Array:
        """Integrals over the strip, (harmonic, 8)."""

        def whole(pair: Array) -> Array:
            c, d, reach = pair[:, 0], pair[:, 1], (self.a * self.b)[:, None]
            return (c - d - (c - d - d * reach) * np.exp(-reach)) / self.a[:, None]

        return np.concatenate([whole(self.at_left), whole(self.at_right)], axis=1)


def _waves(plate: FoldedPlate, strip: int, a: Array) -> dict[str, Waves]:
    """U, V and W of the eight homogeneous solutions: two of bending and two of stretching from either edge."""
    behind = -(3 - plate.poisson) / (1 + plate.poisson)  # V - U of the solution sigma exp(sigma)
    pairs = {
        "u": [[0, 0, 1, 0], [0, 0, 0, 1]],
        "v": [[0, 0, 1, behind], [0, 0, 0, 1]],
        "w": [[1, 0, 0, 0], [0, 1, 0, 0]],
    }
    found = {}
    for name, pair in pairs.items():
        right = np.broadcast_to(np.array(pair, float), (len(a), 2, 4))
        # seen from the left edge, s is reversed and with it V
        found[name] = Waves(a, plate.width(strip), right, -right if name == "v" else right)
    return found


class Strip:
    """One strip in all harmonics: its edges' displacements and forces by eight coefficients."""

    def __init__(self, plate: FoldedPlate, number: int, a: Array, load: Array):
        self.plate, self.a, self.b, self.number = plate, a, plate.width(number), number
        t, n = plate.frame(number)
        self.orders = {name: [wave] for name, wave in _waves(plate, number, a).items()}
        for waves in self.orders.values():
            for _ in range(3):
                waves.append(waves[-1].derivative())
        self.push, self.press = load * (t @ plate.load), load * (n @ plate.load)
        shear = plate.stretching * (1 - plate.poisson) / 2
        self.constant = {
            "u": 0 * a,
            "v": self.push / (shear * a**2),
            "w": self.press / (plate.bending * a**4),
        }

    def rows(self, name: str, s: float) -> tuple[Array, Array]:
        """Return a quantity at s by the coefficients, (harmonic, 8), and that of the load alone, (harmonic,)."""
        p, a = self.plate, self.a[:, None]
        nu, shear = p.poisson, p.stretching * (1 - p.poisson) / 2

        def of(kind: str, order: int) -> tuple[Array, Array]:
            constant = self.constant[kind] if order == 0 else 0 * self.a
            return np.concatenate([self.orders[kind][order].at(s), constant[:, None]], axis=1)

        found = {
            "u": lambda: of("u", 0),
            "v": lambda: of("v", 0),
            "w": lambda: of("w", 0),
            "turn": lambda: of("w", 1),
            "n_xs": lambda: shear * (of("u", 1) + a * of("v", 0)),
            "n_s": lambda: p.stretching * (of("v", 1) - nu * a * of("u", 0)),
            "n_x": lambda: p.stretching * (nu * of("v", 1) - a * of("u", 0)),
            "q": lambda: -p.bending * (of("w", 3) - (2 - nu) * a**2 * of("w", 1)),
            "m_s": lambda: -p.bending * (of("w", 2) - nu * a**2 * of("w", 0)),
            "m_x": lambda: -p.bending * (nu * of("w", 2) - a**2 * of("w", 0)),
        }[name]()
        return found[:, :8], found[:, 8]

    @cached_property
    def edges(self) -> tuple[Array, Array, Array, Array]:
        """Displacements by coefficients and by the load, then forces on the strip: 8 rows, left edge first."""
        moved, pushed = [], []
        for s, sign in ((0.0, -1.0), (self.b, 1.0)):
            moved += [self.rows(name, s) for name in ("u", "v", "w", "turn")]
            pushed += [(sign * r, sign * c) for r, c in (self.rows(name, s) for name in ("n_xs", "n_s", "q"))]
            r, c = self.rows("m_s", s)
            pushed += [(-sign * r, -sign * c)]
        return tuple(np.stack(part, axis=1) for pairs in (moved, pushed) for part in zip(*pairs, strict=True))

    @property
    def to_local(self) -> Array:
        """Matrix (8, 8) from (u, u_y, u_z, turn) of both edges to (u, v, w, turn)."""
        t, n = self.plate.frame(self.number)
        turn = np.eye(4)
        turn[1, 1:3], turn[2, 1:3] = t, n
        return np.kron(np.eye(2), turn)


class Series:
    """All odd harmonics of a folded plate, solved."""

    def __init__(self, plate: FoldedPlate, count: int = HARMONICS):
        # 1. Each strip's stiffness, K = F E^-1, in the axes of the section.
        # 2. Balance at each node: sum over its strips of K (d - d of the load) + the load's forces = 0.
        # 3. The coefficients of each strip from the displacement of its edges.
        self.plate, self.m = plate, 2 * np.arange(count) + 1
        a = self.m * np.pi / plate.length
        self.strips = [Strip(plate, i, a, 4 / (np.pi * self.m)) for i in range(len(plate.strips))]
        size = 4 * len(plate.nodes)
        whole, right = np.zeros((count, size, size)), np.zeros((count, size))
        for strip in self.strips:
            moved, rest, pushed, held = strip.edges
            stiffness = np.swapaxes(np.linalg.solve(np.swapaxes(moved, 1, 2), np.swapaxes(pushed, 1, 2)), 1, 2)
            turn, places = strip.to_local, self._places(strip)
            whole[:, places[:, None], places] += turn.T @ stiffness @ turn
            right[:, places] += (np.einsum("mij,mj->mi", stiffness, rest) - held) @ turn
        scale = 1 / np.sqrt(np.abs(np.diagonal(whole, axis1=1, axis2=2)))
        balanced = scale[:, :, None] * whole * scale[:, None, :]
        moved_nodes = scale * np.linalg.solve(balanced, (scale * right)[..., None])[..., 0]
        self.coefficients = []
        for strip in self.strips:
            moved, rest = strip.edges[:2]
            edge = moved_nodes[:, self._places(strip)] @ strip.to_local.T - rest
            self.coefficients.append(np.linalg.solve(moved, edge[..., None])[..., 0])

    def _places(self, strip: Strip) -> Array:
        first, second = self.plate.strips[strip.number]
        return np.concatenate([4 * first + np.arange(4), 4 * second + np.arange(4)])

    def amplitudes(self, name: str, strip: int, s: float) -> Array:
        """Amplitudes (harmonic,) of a quantity of a strip at s."""
        rows, constant = self.strips[strip].rows(name, s)
        return np.asarray(np.einsum("mj,mj->m", rows, self.coefficients[strip]) + constant)

    def at_middle(self, name: str, strip: int, s: float) -> float:
        """Value at x = L / 2, for quantities that go as sin(a x)."""
        partial = np.cumsum(np.where(self.m % 4 == 1, 1, -1) * self.amplitudes(name, strip, s))
        for _ in range(AVERAGED):
            partial = (partial[1:] + partial[:-1]) / 2
        return float(partial[-1])

    def displacement(self, strip: int, s: float) -> Array:
        """Displacement (y, z) at mid-length, m."""
        t, n = self.plate.frame(strip)
        return t * self.at_middle("v", strip, s) + n * self.at_middle("w", strip, s)

    def energies(self) -> tuple[float, float]:
        """Energies of stretching and of bending, J: half of the work of each strip's load and edge forces."""
        stretching = bending = 0.0
        for strip, c in zip(self.strips, self.coefficients, strict=True):
            moved, rest, pushed, held = strip.edges
            edge = np.einsum("mij,mj->mi", moved, c) + rest
            work = edge * (np.einsum("mij,mj->mi", pushed, c) + held)
            along = np.einsum("mj,mj->m", strip.orders["v"][0].integral(), c) + strip.b * strip.constant["v"]
            across = np.einsum("mj,mj->m", strip.orders["w"][0].integral(), c) + strip.b * strip.constant["w"]
            stretching += float(np.sum(work[:, [0, 1, 4, 5]].sum(axis=1) + strip.push * along))
            bending += float(np.sum(work[:, [2, 3, 6, 7]].sum(axis=1) + strip.press * across))
        return self.plate.length / 4 * stretching, self.plate.length / 4 * bending


def _values(plate: FoldedPlate, count: int, fold: tuple[int, int]) -> dict[str, float]:
    """Values at mid-length beside a fold, which is the end of the first strip and the start of the second."""
    series, (before, after) = Series(plate, count), fold
    end = plate.width(before)
    stretching, bending = series.energies()
    start = series.displacement(before, 0.0)
    at_fold = series.displacement(before, end)
    return {
        "edge_displacement_y": start[0],
        "edge_deflection": -start[1],
        "fold_displacement_y": at_fold[0],
        "fold_deflection": -at_fold[1],
        "fold_turn": series.at_middle("turn", before, end),
        "crown_deflection": -series.displacement(after, plate.width(after) / 2)[1],
        "fold_moment": series.at_middle("m_s", before, end),
        "fold_axial_moment_before": series.at_middle("m_x", before, end),
        "fold_axial_moment_after": series.at_middle("m_x", after, 0.0),
        "fold_axial_force_before": series.at_middle("n_x", before, end),
        "fold_axial_force_after": series.at_middle("n_x", after, 0.0),
        "fold_force_before": series.at_middle("n_s", before, end),
        "fold_force_after": series.at_middle("n_s", after, 0.0),
        "edge_axial_force": series.at_middle("n_x", before, 0.0),
        "crown_moment": series.at_middle("m_s", after, plate.width(after) / 2),
        "membrane_energy": stretching,
        "bending_energy": bending,
        "strain_energy": stretching + bending,
    }


def unit(name: str) -> str:
    """Unit of a quantity: moments are per length, as forces are."""
    units = {"energy": "J", "turn": "rad", "moment": "N", "force": "N/m"}
    return next((u for key, u in units.items() if key in name), "m")


def estimates(fine: dict[str, float], coarse: dict[str, float], rounding: float) -> dict[str, Estimate]:
    """Values, uncertain by the change from a coarser level and by rounding relative to the largest of their unit."""
    largest = {unit(name): max(abs(v) for other, v in fine.items() if unit(other) == unit(name)) for name in fine}
    return {
        name: Estimate.between(value, coarse[name], unit(name), rounding * largest[unit(name)])
        for name, value in fine.items()
    }


def folded_roof() -> dict[str, Estimate]:
    """Known values of three plates with free edges; the fold is that at (-1, 0)."""
    return estimates(*(_values(ROOF, count, (0, 1)) for count in (HARMONICS, HARMONICS // 2)), ROUNDING_OF_STRIPS)


def folded_box() -> dict[str, Estimate]:
    """Known values of a closed box under its weight; the fold is that at (1, 0), the "edge" that at (1, -1)."""
    return estimates(*(_values(BOX, count, (1, 2)) for count in (HARMONICS, HARMONICS // 2)), ROUNDING_OF_STRIPS)
