"""The same shell in other curvilinear coordinates: reversed, exchanged, stretched, graded, oblique, helical.

A chart gives the old coordinates as functions of the new ones. Formulas of the case are composed with it, and points
are mapped back through it. The midsurface and its loads and supports stay in place.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from shellbench.errors import InputError
from shellbench.problems.formula_text import Formula, substituted, times
from shellbench.problems.shell.posed.shell import Shell
from shellbench.problems.shell.question.orthotropic import OrthotropicMaterial
from shellbench.problems.shell.question.places import Edge
from shellbench.problems.shell.question.surface import COORDINATES, Domain

Pair = tuple[float, float]
DIGITS = 12  # of a point's coordinates; sines of other libraries differ in later ones, and digests must not
HALVINGS = 200  # at most, of the interval in which a coordinate is sought
GRADED = 0.4  # departure of a graded coordinate from an even one; it must be below 1, or the map would fold
OBLIQUE = 0.3  # the same of oblique ones; below 1/2
AXES = ("11", "22", "12")  # components of a tensor along the axes of the shell's frame
ANGLES, RIGHT = 9, 1e-9  # points a side at which coordinate lines are compared, and the cosine of a right angle
PITCH = 0.8  # radians that a helix turns by along the shell
STRETCH: tuple[Pair, Pair] = ((4e-4, -1.3), (2500.0, 0.7))  # factor and offset of each coordinate: none is near 1


@dataclass(frozen=True)
class Chart:
    """Old coordinates as functions of new ones, angles in radians.

    Attributes
    ----------
    formulas
        xi1 and xi2 of the case, as formulas in the new xi1 and xi2.
    lower, upper, periodic
        Of the new parametric rectangle.
    to_new
        Takes a point of the case; returns its new coordinates.
    edges
        Names of the case's edges in the new rectangle; edges that keep their names may be left out.
    turned_over
        Whether a1 x a2 points to the other side.
    """

    formulas: tuple[str, str]
    lower: Pair
    upper: Pair
    periodic: tuple[bool, bool]
    to_new: Callable[[Pair], Pair]
    edges: tuple[tuple[str, str], ...] = ()
    turned_over: bool = False


MakeChart = Callable[[Domain], Chart]


def flipped(domain: Domain) -> Chart:
    """Reverse the first coordinate; the normal points to the other side."""
    return Chart(
        formulas=("-(xi1)", "xi2"),
        lower=(-domain.upper[0], domain.lower[1]),
        upper=(-domain.lower[0], domain.upper[1]),
        periodic=domain.periodic,
        to_new=lambda xi: (-xi[0], xi[1]),
        edges=(("xi1_min", "xi1_max"), ("xi1_max", "xi1_min")),
        turned_over=True,
    )


def swapped(domain: Domain) -> Chart:
    """Exchange the coordinates; the normal points to the other side."""
    return Chart(
        formulas=("xi2", "xi1"),
        lower=domain.lower[::-1],
        upper=domain.upper[::-1],
        periodic=domain.periodic[::-1],
        to_new=lambda xi: (xi[1], xi[0]),
        edges=tuple((f"xi{i}_{side}", f"xi{3 - i}_{side}") for i in (1, 2) for side in ("min", "max")),
        turned_over=True,
    )


def stretched(domain: Domain) -> Chart:
    """Stretch and shift each coordinate by other numbers."""

    def to_new(xi: Pair) -> Pair:
        first, second = ((x - offset) / factor for x, (factor, offset) in zip(xi, STRETCH, strict=True))
        return first, second

    return Chart(
        formulas=_pair(
            f"{factor!r}*{name} + ({offset!r})" for name, (factor, offset) in zip(COORDINATES, STRETCH, strict=True)
        ),
        lower=to_new(domain.lower),
        upper=to_new(domain.upper),
        periodic=domain.periodic,
        to_new=to_new,
    )


def warped(domain: Domain) -> Chart:
    """Grade each coordinate: x = l + L (s + a sin(2 pi s)/(2 pi)), s = (xi - l)/L."""

    def old(axis: int) -> Callable[[float], float]:
        low, length = domain.lower[axis], domain.size[axis]
        turn = 2 * math.pi / length
        return lambda x: x + GRADED / turn * math.sin(turn * (x - low))

    return Chart(
        formulas=_pair(
            f"{name} + {GRADED * length / (2 * math.pi)!r}*sin({2 * math.pi / length!r}*({name} - ({low!r})))"
            for name, low, length in zip(COORDINATES, domain.lower, domain.size, strict=True)
        ),
        lower=domain.lower,
        upper=domain.upper,
        periodic=domain.periodic,
        to_new=lambda xi: _pair(_solve_by_bisection(old(axis), xi[axis], domain, axis) for axis in (0, 1)),
    )


def oblique(domain: Domain) -> Chart:
    """Shear one coordinate along the other, but not at its own edges, so that the metric has a_12.

    x1 = xi1 + 4 a (xi1 - l1)(u1 - xi1)(xi2 - m2)/(L1 L2), m2 the middle. Where one coordinate is periodic, the other is
    sheared instead, by the sine of it.
    """
    if all(domain.periodic):
        raise InputError("both coordinates close on themselves")
    sheared = 1 if domain.periodic[0] else 0
    along = 1 - sheared
    low, up, size = domain.lower[sheared], domain.upper[sheared], domain.size[sheared]
    start, length, name = domain.lower[along], domain.size[along], COORDINATES[along]
    if domain.periodic[along]:
        factor, turn = 2 * OBLIQUE / size, 2 * math.pi / length
        profile = f"sin({turn!r}*({name} - ({start!r})))"
    else:
        factor, middle = 4 * OBLIQUE / (size * length), (start + domain.upper[along]) / 2
        profile = f"({name} - ({middle!r}))"

    def shear(at: float) -> float:
        return factor * (math.sin(turn * (at - start)) if domain.periodic[along] else at - middle)

    def to_new(xi: Pair) -> Pair:
        slope = shear(xi[along])
        new = _solve_by_bisection(lambda x: x + slope * (x - low) * (up - x), xi[sheared], domain, sheared)
        return (new, xi[1]) if sheared == 0 else (xi[0], new)

    formulas: list[str] = list(COORDINATES)
    old = COORDINATES[sheared]
    formulas[sheared] = f"{old} + {factor!r}*({old} - ({low!r}))*({up!r} - {old})*{profile}"
    return Chart((formulas[0], formulas[1]), domain.lower, domain.upper, domain.periodic, to_new)


def helical(domain: Domain) -> Chart:
    """Wind the coordinate lines of a closed shell along it, oblique everywhere: x1 = xi1 + c xi2."""
    if domain.periodic == (True, False):
        around, along = 0, 1
    elif domain.periodic == (False, True):
        around, along = 1, 0
    else:
        raise InputError("no coordinate closes on itself" if not any(domain.periodic) else "both close on themselves")
    slope = PITCH / (2 * math.pi) * domain.size[around] / domain.size[along]
    formulas: list[str] = list(COORDINATES)
    formulas[around] = f"{COORDINATES[around]} + {slope!r}*{COORDINATES[along]}"

    def to_new(xi: Pair) -> Pair:
        turned = list(xi)
        low, size = domain.lower[around], domain.size[around]
        turned[around] = low + (xi[around] - slope * xi[along] - low) % size
        return turned[0], turned[1]

    return Chart(_pair(formulas), domain.lower, domain.upper, domain.periodic, to_new)


def _pair(items: Any) -> Any:
    first, second = items
    return first, second


def _solve_by_bisection(old: Callable[[float], float], wanted: float, domain: Domain, axis: int) -> float:
    """Return the place where an increasing function of a coordinate has a value, by bisection, which can't fail.

    Values that are whole turns away on a closed coordinate stay so.
    """
    low, high = domain.lower[axis], domain.upper[axis]
    if domain.periodic[axis] and not low <= wanted <= high:
        turns = math.floor((wanted - low) / (high - low)) * (high - low)
        return _solve_by_bisection(old, min(max(wanted - turns, low), high), domain, axis) + turns
    for end in (low, high, (low + high) / 2):  # exact where the chart is the identity
        if old(end) == wanted:
            return end
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if old(middle) < wanted else (low, middle)
    return (low + high) / 2


def in_chart(case: Shell, make: MakeChart) -> dict[str, Any]:
    """Return the data of a case in the coordinates of a chart.

    Raises
    ------
    InputError
        If the chart does not fit the case's domain, as one clause.
    """
    return _Reparametrisation(case, make(case.surface.domain)).data()


class _Reparametrisation:
    def __init__(self, case: Shell, chart: Chart) -> None:
        self.case, self.chart = case, chart
        constants = {name: repr(value) for name, value in case.surface.named_constants.items()}
        # Replace constants first: a chart's formula has none, and names of the case must not clash with the new
        # coordinates.
        self.names = constants | dict(zip(COORDINATES, chart.formulas, strict=True))

    def formula(self, formula: Formula) -> Formula:
        return substituted(formula, self.names)

    def vector(self, vector: Sequence[Formula]) -> list[Formula]:
        return [self.formula(f) for f in vector]

    def place(self, name: str) -> str:
        """Return the name that an edge, a corner or a point has in the chart."""
        edges = dict(self.chart.edges)
        return ",".join(sorted(edges.get(part, part) for part in name.split(",")))

    def data(self) -> dict[str, Any]:
        case, chart = self.case, self.chart
        mixes = any(re.search(r"\bxi1\b", f) and re.search(r"\bxi2\b", f) for f in chart.formulas)
        if mixes and any(case.kinks):
            raise InputError("a formula would have kinks across these coordinates")
        data = case.model_dump(mode="json", exclude_unset=True)
        data["surface"] = {
            "kind": "expression",
            **{c: str(self.formula(f)) for c, f in zip("xyz", case.surface.formulas, strict=True)},
            "xi1": [chart.lower[0], chart.upper[0]],
            "xi2": [chart.lower[1], chart.upper[1]],
            "periodic": [name for name, closed in zip(COORDINATES, chart.periodic, strict=True) if closed],
            **self._folds(),
        }
        data["points"] = {
            name: [float(f"{x:.{DIGITS}g}") for x in chart.to_new(case.surface.domain.internal(xi))]
            for name, xi in data.get("points", {}).items()
        }
        if case.edge_parts:
            data["edge_parts"] = {name: self._edge_part(name) for name in case.edge_parts}
        for name in ("modulus_factor", "thickness_factor"):
            if name in data["material"]:
                data["material"][name] = self.formula(data["material"][name])
        if isinstance(case.material, OrthotropicMaterial):
            along = self._coordinate(COORDINATES.index(case.material.along), "the material's direction is")
            data["material"] |= {"along": along} | (case.material.turned_over() if chart.turned_over else {})
        data["supports"] = [self._support(s) for s in data.get("supports", [])]
        data["springs"] = [{**s, "stiffness": self.formula(s["stiffness"])} for s in data.get("springs", [])]
        data["loads"] = [self._load(load) for load in data.get("loads", [])]
        data["focus"] = [self.place(name) for name in data.get("focus", [])]
        for quantity in data["quantities"]:
            if "points" in quantity:
                quantity["points"] = [self.place(name) for name in quantity["points"]]
            if "along" in quantity:
                quantity |= self._line(quantity)
            if "on" in quantity:
                quantity |= self._resultant(quantity) | {"on": [self.place(name) for name in quantity["on"]]}
            if "exact" in quantity:
                quantity["exact"] = self.vector(quantity["exact"])
        return data

    def _coordinate(self, axis: int, words: str) -> str:
        """Return the coordinate of the chart that runs along one of the case; InputError, as a clause, if none does."""
        name = COORDINATES[1 - axis if self.chart.formulas == COORDINATES[::-1] else axis]
        if re.search(rf"\b{name}\b", self.chart.formulas[1 - axis]):
            raise InputError(f"{words} along a line on which both of these coordinates change")
        return name

    def _folds(self) -> dict[str, dict[str, list[float]]]:
        """Return the folds and hinges in the chart."""
        found: dict[str, dict[str, list[float]]] = {}
        exchanged = self.chart.formulas == COORDINATES[::-1]
        for fold in self.case.surface.fold_lines:
            point = list(self.case.surface.domain.lower)
            point[fold.axis] = fold.at
            new = 1 - fold.axis if exchanged else fold.axis
            at = self.chart.to_new((point[0], point[1]))[new]
            found.setdefault("hinges" if fold.hinged else "folds", {}).setdefault(COORDINATES[new], []).append(at)
        return found

    def _line(self, quantity: dict[str, Any]) -> dict[str, Any]:
        """Return the start, the coordinate and the end of a line of contact in the chart."""
        axis, toward = COORDINATES.index(quantity["along"]), quantity.get("toward", "max")
        along = self._coordinate(axis, "where contact begins is asked")
        if self.chart.formulas[axis].startswith("-"):
            toward = {"min": "max", "max": "min"}[toward]
        return {"point": self.place(quantity["point"]), "along": along, "toward": toward}

    def _resultant(self, quantity: dict[str, Any]) -> dict[str, Any]:
        """Return the component of a resultant in the frame that belongs to the chart."""
        # e_1 goes along xi1, e_3 along the normal, and e_2 = e_3 x e_1. Moments change their sign with the normal;
        # shear forces change it with the normal and with their direction. Factors of quantities have no sign.
        # The stress at a side keeps its sign, and the sides are exchanged.
        chart, component = self.chart, quantity["component"]
        turned = {"top": "bottom", "bottom": "top"} if chart.turned_over else {}
        side = {"side": turned.get(quantity["side"], quantity["side"])} if "side" in quantity else {}
        if side and (quantity.get("direction") or component not in AXES):
            if component == "12" and chart.turned_over:
                raise InputError("a shear stress changes its sign with the normal of these coordinates")
            return side | self._fold_side(quantity)
        if quantity.get("axes") == "material":  # one of the axes is turned over with the normal
            if chart.turned_over and (component == "12") != (quantity["kind"] == "moment"):
                raise InputError("a resultant changes its sign with the normal of these coordinates")
            return self._fold_side(quantity)
        exchanged = chart.formulas == COORDINATES[::-1]
        if exchanged and not self._orthogonal():
            raise InputError("a resultant's axes would turn, as the coordinate lines are oblique")
        if not exchanged and re.search(r"\bxi1\b", chart.formulas[1]):
            raise InputError("a resultant's axes go along xi1, which is another direction in these coordinates")
        normal = -1.0 if chart.turned_over else 1.0
        first = -1.0 if chart.formulas[0].startswith("-") else 1.0
        signs = {"1": first, "2": 1.0 if exchanged else normal * first}
        sign = 1.0 if component.startswith("principal") else math.prod(signs[index] for index in component)
        sign *= 1.0 if side or quantity["kind"] == "membrane_force" else normal
        if sign < 0:
            raise InputError("a resultant changes its sign with the normal of these coordinates")
        other = {"11": "22", "22": "11", "1": "2", "2": "1"} if exchanged else {}
        return {"component": other.get(component, component)} | side | self._fold_side(quantity)

    def _fold_side(self, quantity: dict[str, Any]) -> dict[str, str]:
        """Return the side of a fold, if there is one, in the chart."""
        if not quantity.get("fold_side"):
            return {}
        backward = self.chart.formulas[self.case.surface.fold_lines[0].axis].startswith("-")
        return {"fold_side": ("before", "after")[(quantity["fold_side"] == "after") ^ backward]}

    def _orthogonal(self) -> bool:
        """Return True if the coordinate lines of the case meet at right angles everywhere."""
        surface = self.case.surface
        x = surface.derivatives(surface.domain.grid(ANGLES, ANGLES).reshape(-1, 2), order=1)
        lengths = np.linalg.norm(x[1, 0], axis=-1) * np.linalg.norm(x[0, 1], axis=-1)
        return bool(np.all(np.abs(np.sum(x[1, 0] * x[0, 1], axis=-1)) <= RIGHT * lengths))

    def _edge_part(self, name: str) -> dict[str, Any]:
        part, edge = self.case.edge_parts[name], self.case.places[name]
        assert isinstance(edge, Edge)
        renamed = self.place(part.edge)
        running = COORDINATES.index(renamed[:3]) ^ 1
        domain = self.case.surface.domain
        ends = edge.samples(domain, 3)  # both ends and the middle
        start, middle, stop = (self.chart.to_new((float(x), float(y)))[running] for x, y in ends)
        start, stop = min(start, stop), max(start, stop)
        if not start < middle < stop:
            raise InputError(f"the seam of these coordinates would run through '{name}'")
        return {"edge": renamed, "between": [float(f"{x:.{DIGITS}g}") for x in (start, stop)]}

    def _support(self, support: dict[str, Any]) -> dict[str, Any]:
        result = support | {"on": [self.place(name) for name in support["on"]]}
        motion = dict(support.get("motion") or {})
        for name in ("x", "y", "z", "angle"):
            if name in motion:
                motion[name] = self.formula(motion[name])
        if "vector" in motion:
            motion["vector"] = self.vector(motion["vector"])
        return result | ({"motion": motion} if motion else {})

    def _local(self, load: dict[str, Any], vector: list[Formula]) -> list[Formula]:
        """Return a vector by its parts along, across and normal, whose directions may be reversed in the chart."""
        normal = -1.0 if self.chart.turned_over else 1.0
        edges = [self.case.places[name] for name in load.get("on", ())]
        axes = {1 - edge.axis for edge in edges if isinstance(edge, Edge)} or {0}
        if load["kind"] == "area" and re.search(r"\bxi1\b", self.chart.formulas[1]):
            raise InputError("a load goes along xi1, which is another direction in these coordinates")
        along = {-1.0 if self.chart.formulas[axis].startswith("-") else 1.0 for axis in axes}
        if len(along) > 1:
            raise InputError("a load goes along edges of which some are reversed in these coordinates")
        (sign,) = along
        # across an edge is outward, whatever the coordinates; elsewhere it is normal x along
        across = 1.0 if edges else normal * sign
        return [times(f, s) for f, s in zip(vector, (sign, across, normal), strict=True)]

    def _load(self, load: dict[str, Any]) -> dict[str, Any]:
        result = dict(load)
        if "on" in load:
            result["on"] = [self.place(name) for name in load["on"]]
        for name in ("vector", "force", "acceleration"):
            if name in load:
                result[name] = self.vector(load[name])
        if load.get("frame") == "local":
            result["vector"] = self._local(load, result["vector"])
        if "value" in load:
            # A pressure acts along the normal. A moment turns about an axis in space, whatever the normal's side.
            over = load["kind"] == "pressure" and self.chart.turned_over
            result["value"] = times(self.formula(load["value"]), -1.0 if over else 1.0)
        return result
