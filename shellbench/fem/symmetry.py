"""Mirror symmetry of a linear case: solve on the part that the rest of the shell mirrors, and unfold the answer.

A reflection of the parametric rectangle about one of its coordinate lines is a symmetry where it carries the surface,
the loads and the supports into their mirror images in a Cartesian plane. A linear problem has one solution (but for the
rigid motions that are taken from it), so that this one is its own mirror image,

    u(xi') = R u(xi),    R = 1 - 2 e e^T,

and the lines of symmetry of the part are edges in planes of symmetry (see `shellbench.conditions.Support`). The part
of the mesh has exactly the solution of the whole mesh, and the unfolded answer is the one on the whole mesh.

That a reflection is a symmetry is never assumed. It is observed on the mesh at hand: of the mesh lines, of the surface
with its derivatives and of the loads at every Gauss point of the whole mesh, of forces at points, and of the motion of
supports at nodes and between them. What the whole mesh would see is symmetric, then; otherwise the whole is solved.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from shellbench.case import Case
from shellbench.conditions import COMPONENTS, EdgeLoad, Formula, MomentLoad, PointLoad, Support, VectorFormula
from shellbench.fem.constraints import support_nodes
from shellbench.fem.equilibrium import Equilibrium
from shellbench.fem.hermite import KINDS
from shellbench.fem.loads import EDGE_GAUSS_POINTS
from shellbench.fem.mesh import TensorMesh
from shellbench.measure import load_density
from shellbench.places import SIDES, Edge, Place, Point, Whole
from shellbench.quantities import EnergyQuantity
from shellbench.surface import COORDINATES, Domain, SurfaceModel

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
_Index = slice | Integers
_Places = tuple[_Index, _Index]  # of a grid of points

SYMMETRIC = 1e-12  # relative difference to the mirror image that is rounding
WHOLE, HALF, QUARTER = 1, 2, 4  # images of the part along a coordinate; quarters of a closed one only
ASKED = EnergyQuantity(name="strain_energy", kind="strain_energy", primary=True)  # a case must ask for something


@dataclass(frozen=True)
class Mirror:
    """A reflection xi -> 2 c - xi of one coordinate that is a symmetry of a case.

    Attributes
    ----------
    axis
        Number of the coordinate.
    normal
        Number of the Cartesian component that is normal to the plane of symmetry.
    supports
        For each support the number of its mirror image.
    """

    axis: int
    normal: int
    supports: tuple[int, ...]


@dataclass(frozen=True)
class Image:
    """The part, or one of its mirror images, along a coordinate.

    Attributes
    ----------
    nodes
        (n + 1,) number along the coordinate of each line of nodes of the part.
    signs
        (3,) of the components of the displacement.
    parity
        -1 if the coordinate is reversed, else 1.
    supports
        For each support the number of its image.
    """

    nodes: Integers
    signs: Array
    parity: int
    supports: tuple[int, ...]


@dataclass(frozen=True)
class Fold:
    """How the mesh is mirrored along a coordinate.

    Attributes
    ----------
    start, cells
        First mesh line of the part, and its number of cells.
    mirrors
        What the part's first and last line are mirrors of; None at an end that is no line of symmetry.
    """

    start: int
    cells: int
    mirrors: tuple[Mirror | None, Mirror | None] = (None, None)

    def lines(self, line: Array, domain: Domain, axis: int) -> Array:
        """Return the part of the mesh lines, inside the domain."""
        twice = np.concatenate([line, line[1:] + domain.size[axis]])  # it may end in the next period
        part = twice[self.start : self.start + self.cells + 1]
        turns = np.round((part.mean() - (domain.lower[axis] + domain.upper[axis]) / 2) / domain.size[axis])
        return np.asarray(part - turns * domain.size[axis] if domain.periodic[axis] else part)

    def images(self, nodes: int, supports: int) -> tuple[Image, ...]:
        """Return the part and its mirror images in the order of the coordinate; `nodes` of the whole mesh along it."""
        run = np.arange(self.cells + 1) if self.mirrors != (None, None) else np.arange(nodes)
        found = [Image((self.start + run) % nodes, np.ones(len(COMPONENTS)), 1, tuple(range(supports)))]
        first, last = self.mirrors
        around = (last, first, last) if first is not None and first is not last else (last,)
        for number, mirror in enumerate(around, start=1):
            if mirror is None:
                break
            at = (number + 1) * self.cells - run if number % 2 else number * self.cells + run
            before = found[-1]
            signs = before.signs * _signs(mirror.normal)
            swapped = tuple(mirror.supports[s] for s in before.supports)
            found.append(Image((self.start + at) % nodes, signs, -before.parity, swapped))
        return tuple(found)


@dataclass(frozen=True)
class Part:
    """The part of a case and its mesh that the rest mirrors.

    Attributes
    ----------
    whole, whole_mesh
        What it is a part of.
    folds
        By coordinate.
    case, mesh
        The part: a case of its own, with planes of symmetry.
    """

    whole: Case
    whole_mesh: TensorMesh
    folds: tuple[Fold, Fold]
    case: Case
    mesh: TensorMesh

    @classmethod
    def of(cls, case: Case, mesh: TensorMesh, quadrature_order: int) -> Part | None:
        """Find the symmetries of a case on a mesh; None if there is none."""
        moments = any(isinstance(load, MomentLoad) for load in case.loads)
        if not case.linear or case.springs or moments:
            return None
        observed = _Observed(case, mesh, quadrature_order)
        folds = observed.folds()
        if folds[0].mirrors == folds[1].mirrors == (None, None):
            return None
        lines = [fold.lines(line, mesh.domain, a) for a, (fold, line) in enumerate(zip(folds, mesh.lines, strict=True))]
        part = _part_case(case, folds, (lines[0], lines[1]))
        return cls(case, mesh, folds, part, TensorMesh(part.surface.domain, (lines[0], lines[1])))

    @cached_property
    def images(self) -> tuple[tuple[Image, ...], tuple[Image, ...]]:
        """The images of the part along each coordinate."""
        first, second = (
            fold.images(nodes, len(self.whole.supports))
            for fold, nodes in zip(self.folds, self.whole_mesh.shape, strict=True)
        )
        return first, second

    def unfolded(self, found: Equilibrium) -> Equilibrium:
        """Return the answer on the whole mesh, of that on the part."""
        solution, mesh, case = found.solution, self.whole_mesh, self.whole
        tail = solution.coefficients.shape[1:]
        numbers = [[s.name for s in case.supports].index(s.name) for s in self.case.supports[: solution_supports(self)]]
        forces = np.zeros((len(numbers), self.mesh.node_count, *tail))
        forces[:, solution.support_nodes] = solution.support_forces[: len(numbers)]
        forces = forces.reshape(len(numbers), *self.mesh.shape, *tail)
        field = solution.coefficients.reshape(*self.mesh.shape, *tail)
        whole = np.empty((*mesh.shape, *tail))
        whole_forces = np.zeros((len(case.supports), *mesh.shape, *tail))
        for first, second in product(*self.images):
            kinds = [float(first.parity**k * second.parity**m) for k, m in KINDS]
            signs = np.multiply.outer(first.signs * second.signs, kinds)[..., None]
            at = np.ix_(first.nodes, second.nodes)
            whole[at] = signs * field
            for number, force in zip(numbers, forces, strict=True):
                whole_forces[second.supports[first.supports[number]]][at] += signs * force  # halves add up on a mirror
        held = [support_nodes(mesh, place) for _, place in case.supported_places()]
        nodes = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *held]))
        images = (len(self.images[0]), len(self.images[1]))
        return replace(
            found,
            solution=replace(
                solution,
                case=case,
                mesh=mesh,
                coefficients=whole.reshape(mesh.node_count, *tail),
                support_nodes=nodes,
                support_forces=whole_forces.reshape(len(case.supports), mesh.node_count, *tail)[:, nodes],
                images=images,
            ),
            potential_energy=found.potential_energy * images[0] * images[1],
        )


def solution_supports(part: Part) -> int:
    """Return how many supports of the part are the whole's own: they stand before the planes of symmetry."""
    planes = sum(mirror is not None for fold in part.folds for mirror in fold.mirrors)
    return len(part.case.supports) - planes


class _Observed:
    """What the whole mesh sees of a case: its Gauss points with all that is evaluated at them."""

    def __init__(self, case: Case, mesh: TensorMesh, quadrature_order: int) -> None:
        self.case, self.mesh, self.domain = case, mesh, mesh.domain
        self.gauss = quadrature_order // 2 + 1
        self.runs = [_gauss_points(line, self.gauss) for line in mesh.lines]
        self.kept: list[_Index] = [slice(None), slice(None)]  # the others are images of these

    @cached_property
    def points(self) -> Array:
        """(n1, n2, 2) Gauss points."""
        return self.domain.wrap(np.stack(np.meshgrid(*self.runs, indexing="ij"), axis=-1))

    @cached_property
    def surface(self) -> dict[tuple[int, int], Array]:
        """Position and derivatives (n1, n2, 3)."""
        return self.case.surface.derivatives(self.points, order=2)

    @cached_property
    def densities(self) -> list[Array]:
        """Load per area (n1, n2, 3) at each state."""
        flat = self.points.reshape(-1, 2)
        return [load_density(self.case, flat, t).reshape(*self.points.shape[:2], -1) for t in self.case.states]

    def folds(self) -> tuple[Fold, Fold]:
        """Return how the mesh is mirrored along each coordinate."""
        return self.fold(0), self.fold(1)

    def fold(self, axis: int) -> Fold:
        """Return how the mesh is mirrored along a coordinate; a fold without mirrors if it is not."""
        cells, periodic = self.mesh.cells[axis], self.domain.periodic[axis]
        if cells % HALF:
            return Fold(0, cells)
        if not periodic:
            mirror = self.mirror(axis, cells // HALF, cells // HALF)
            found = [Fold(0, cells // HALF, (None, mirror))] if mirror else []
        else:
            found = list(self._closed_folds(axis))
        for fold in found:
            self.kept[axis] = slice(fold.start * self.gauss, (fold.start + fold.cells) * self.gauss)
            # formulas of a closed surface may hold inside the domain only
            lines, slack = fold.lines(self.mesh.lines[axis], self.domain, axis), SYMMETRIC * self.domain.size[axis]
            if lines[0] >= self.domain.lower[axis] - slack and lines[-1] <= self.domain.upper[axis] + slack:
                return fold
        return Fold(0, cells)

    def _closed_folds(self, axis: int) -> Iterator[Fold]:
        """Yield the parts that mirrors about the first mesh line and a quarter of the turn from it make."""
        cells = self.mesh.cells[axis]
        first = self.mirror(axis, 0, cells // HALF)
        second = None
        if cells % QUARTER == 0:
            second = self.mirror(axis, cells // QUARTER, cells // (QUARTER if first else HALF))
        mirrors = [m for m in (first, second) if m is not None]
        if mirrors:
            size, start = cells // (HALF * len(mirrors)), 0 if first else cells // QUARTER
            for k in range(HALF * len(mirrors)):
                ends = mirrors[k % len(mirrors)], mirrors[(k + 1) % len(mirrors)]
                yield Fold((start + k * size) % cells, size, ends)

    def mirror(self, axis: int, line: int, cells: int) -> Mirror | None:
        """Return the reflection about a mesh line if it is a symmetry; so many cells on either side are compared."""
        steps = np.diff(self.mesh.lines[axis])
        reversed_steps = steps[(2 * line - 1 - np.arange(len(steps))) % len(steps)]
        if np.abs(steps - reversed_steps).max() > SYMMETRIC * self.domain.size[axis]:
            return None
        sides = self._sides(axis, line * self.gauss, cells * self.gauss)
        turned = _Reflection(self.domain, axis, float(self.mesh.lines[axis][line]))
        normal = self._plane(axis, *sides)
        if normal is None:
            return None
        signs, (here, there) = _signs(normal), sides
        if not all(_alike(density[there], signs * density[here]) for density in self.densities):
            return None
        if not (self._edge_loads_agree(turned, signs) and self._point_loads_agree(turned, signs)):
            return None
        supports = self._mirrored_supports(turned, signs)
        return None if supports is None else Mirror(axis, normal, supports)

    def _sides(self, axis: int, middle: int, points: int) -> tuple[_Places, _Places]:
        """Return so many Gauss points along a coordinate on either side of one, next to it first."""
        count = len(self.runs[axis])
        here: _Index = slice(middle, middle + points)
        there: _Index = slice((middle or count) - 1, None if middle == points else (middle or count) - 1 - points, -1)
        if middle + points > count or 0 < middle < points:  # one of them lies beyond the seam
            here, there = (middle + np.arange(points)) % count, (middle - 1 - np.arange(points)) % count
        other = self.kept[1 - axis]
        return ((here, other), (there, other)) if axis == 0 else ((other, here), (other, there))

    def _plane(self, axis: int, here: _Places, there: _Places) -> int | None:
        """Return the component that is normal to the plane in which a reflection mirrors the surface."""
        position = self.surface[0, 0]
        spread = np.abs(position[there] - position[here]).max(axis=(0, 1))
        normal = int(np.argmax(spread))  # images differ along the normal alone
        if np.any(np.delete(spread, normal) > SYMMETRIC * spread[normal]):
            return None
        middle = position[there][..., normal] + position[here][..., normal]
        if np.ptp(middle) > SYMMETRIC * spread[normal]:
            return None
        signs = _signs(normal)
        for key, x in self.surface.items():
            if key != (0, 0) and not _alike(x[there], (-1) ** key[axis] * signs * x[here]):
                return None
        return normal

    def _edge_loads_agree(self, turned: _Reflection, signs: Array) -> bool:
        loads = [load for load in self.case.loads if isinstance(load, EdgeLoad)]
        edges = [place for place in self.case.places.values() if isinstance(place, Edge)] if loads else []

        def density(edge: Edge, points: Array, t: float) -> Array:
            acting = [load.vector for load in loads if edge.name in load.on]
            return np.asarray(sum((self.case.evaluate(v, points, t)[0, 0] for v in acting), np.zeros((len(points), 3))))

        for edge, t in product(edges, self.case.states):
            run = _gauss_points(self.mesh.lines[1 - edge.axis], EDGE_GAUSS_POINTS)
            image = turned.place(edge)
            assert isinstance(image, Edge)
            points = edge.points(self.domain, run)
            here, there = (self.domain.wrap(p) for p in (points, turned.points(points)))
            if not _alike(density(image, there, t), signs * density(edge, here, t)):
                return False
        return True

    def _point_loads_agree(self, turned: _Reflection, signs: Array) -> bool:
        forces = list(point_forces(self.case))
        if not forces:
            return True
        scale = max(float(np.abs(force).max()) for _, force in forces)
        for xi, _ in forces:
            here = sum(f for at, f in forces if turned.same(at, xi))
            there = sum(f for at, f in forces if turned.same(at, turned.points(xi)))
            if np.abs(there - signs * here).max() > SYMMETRIC * scale:
                return False
        return True

    def _mirrored_supports(self, turned: _Reflection, signs: Array) -> tuple[int, ...] | None:
        """Return for each support the number of its mirror image; None if one has none."""
        found = []
        for support in self.case.supports:
            images = (n for n, other in enumerate(self.case.supports) if self._mirrors(support, other, turned, signs))
            found.append(next(images, None))
        return tuple(n for n in found if n is not None) if None not in found else None

    def _mirrors(self, support: Support, other: Support, turned: _Reflection, signs: Array) -> bool:
        alike = set(support.held) == set(other.held) and support.clamped == other.clamped
        if not alike or support.symmetry != other.symmetry or len(support.on) != len(other.on):
            return False
        there = [self.case.places[name] for name in other.on]
        for place in (self.case.places[name] for name in support.on):
            image = next((p for p in there if turned.carries(place, p)), None)
            if image is None or not self._motions_agree(support, place, other, image, turned, signs):
                return False
        return True

    def _motions_agree(
        self, support: Support, place: Place, other: Support, image: Place, turned: _Reflection, signs: Array
    ) -> bool:
        if support.motion is None and other.motion is None:
            return True
        if isinstance(place, Edge):
            line = self.mesh.lines[1 - place.axis]
            points = place.points(self.domain, np.concatenate([line, _gauss_points(line, self.gauss)]))
        else:
            points = np.array([place.xi]) if isinstance(place, Point) else np.zeros((0, 2))
        for t in self.case.states:
            here = self.case.motion(support, place, self.domain.wrap(points), t, order=2)
            there = self.case.motion(other, image, self.domain.wrap(turned.points(points)), t, order=2)
            if not all(_alike((-1) ** key[turned.axis] * there[key], signs * here[key]) for key in here):
                return False
        return True


@dataclass(frozen=True)
class _Reflection:
    """A reflection of the parametric rectangle about a coordinate line."""

    domain: Domain
    axis: int
    centre: float

    def points(self, xi: Array | tuple[float, float]) -> Array:
        """Return the reflected points (..., 2)."""
        turned = np.array(xi, dtype=float)
        turned[..., self.axis] = 2 * self.centre - turned[..., self.axis]
        return turned

    def same(self, one: Array | tuple[float, float], other: Array | tuple[float, float]) -> bool:
        """Tell whether two points are the same."""
        gap, size = np.asarray(one) - np.asarray(other), np.asarray(self.domain.size)
        gap = np.where(self.domain.periodic, gap - size * np.round(gap / size), gap)
        return bool(np.all(np.abs(gap) <= SYMMETRIC * size))

    def place(self, edge: Edge) -> Edge:
        """Return the edge that an edge is carried to."""
        if edge.axis != self.axis:
            return edge
        side = SIDES[edge.side == SIDES[0]]
        return Edge(f"{COORDINATES[edge.axis]}_{side}", edge.axis, side)

    def carries(self, place: Place, other: Place) -> bool:
        """Tell whether a place is carried to another one."""
        match place, other:
            case Edge(), Edge():
                return self.place(place) == other
            case Point(xi=xi), Point(xi=there):
                return self.same(self.points(xi), there)
            case _:
                return False


def _signs(normal: int) -> Array:
    """Return the diagonal (3,) of R."""
    return np.where(np.arange(len(COMPONENTS)) == normal, -1.0, 1.0)


def _gauss_points(line: Array, count: int) -> Array:
    x, _ = np.polynomial.legendre.leggauss(count)
    return np.asarray((line[:-1, None] + np.diff(line)[:, None] * (x + 1) / 2).ravel())


def _alike(one: Array, other: Array) -> bool:
    scale = max(float(other.max(initial=0.0)), -float(other.min(initial=0.0)))
    return bool(np.abs(one - other).max(initial=0.0) <= SYMMETRIC * scale)


def point_forces(case: Case) -> Iterator[tuple[tuple[float, float], Array]]:
    """Yield the points of all forces at points, and the force (states, 3)."""
    for load in case.loads:
        if isinstance(load, PointLoad):
            for place in (case.places[name] for name in load.on):
                if isinstance(place, Point):
                    at = np.array([place.xi])
                    yield place.xi, np.concatenate([case.evaluate(load.force, at, t)[0, 0] for t in case.states])


def _part_case(case: Case, folds: tuple[Fold, Fold], lines: tuple[Array, Array]) -> Case:
    """Return the part as a case of its own; it is not checked again, because its pieces were."""
    kept = _Kept(case, folds, lines)
    planes = [
        Support(name=f"mirror_{COORDINATES[a]}_{side}", on=(f"{COORDINATES[a]}_{side}",), symmetry=COMPONENTS[m.normal])
        for a, fold in enumerate(folds)
        for side, m in zip(SIDES, fold.mirrors, strict=True)
        if m is not None
    ]
    supports = [support.model_copy(update={"on": on}) for support in case.supports if (on := kept.of_support(support))]
    normals = {m.normal for fold in folds for m in fold.mirrors if m is not None}
    return Case.model_construct(
        name=case.name,
        title=case.title,
        theory=case.theory,
        surface=_part_surface(case.surface, folds, lines),
        material=case.material,
        points={name: point for name, point in case.points.items() if kept.holds(case.places[name])},
        supports=(*supports, *planes),
        remove_rigid_motions=tuple(name for name in case.remove_rigid_motions if _is_symmetric(name, normals)),
        loads=tuple(kept.loads()),
        quantities=(ASKED,),
    )


def _is_symmetric(motion: str, normals: set[int]) -> bool:
    """Tell whether a rigid motion is its own mirror image: an axis of rotation is turned round in planes through it."""
    kind, along = motion.split("_")
    across = {COMPONENTS[n] for n in normals}
    return along not in across if kind == "translation" else across <= {along}


def _part_surface(surface: SurfaceModel, folds: tuple[Fold, Fold], lines: tuple[Array, Array]) -> SurfaceModel:
    """Return the surface on the part of its domain, closed no more along a coordinate that is mirrored."""
    data = surface.model_dump()
    for axis, name in enumerate(COORDINATES):
        if folds[axis].mirrors == (None, None):
            continue
        bounds = lines[axis][[0, -1]]
        data[name] = tuple(np.degrees(bounds) if surface.domain.angle[axis] else bounds)
        if surface.domain.periodic[axis]:
            if "closed" in data:
                data["closed"] = False
            else:
                data["periodic"] = tuple(other for other in data["periodic"] if other != name)
    return type(surface).model_validate(data)


@dataclass(frozen=True)
class _Kept:
    """What of a case lies on the part."""

    case: Case
    folds: tuple[Fold, Fold]
    lines: tuple[Array, Array]

    def holds(self, place: Place) -> bool:
        """Tell whether a place lies on the part."""
        if isinstance(place, Edge):
            return self.folds[place.axis].mirrors[SIDES.index(place.side)] is None
        if not isinstance(place, Point):
            return True
        slack = SYMMETRIC * np.asarray(self.case.surface.domain.size)
        inside = []
        for axis, at in enumerate(self._brought_in(place)):
            inside.append(self.lines[axis][0] - slack[axis] <= at <= self.lines[axis][-1] + slack[axis])
        return all(inside)

    def _brought_in(self, point: Point) -> Sequence[float]:
        """Return the coordinates of a point with the seam of a closed coordinate on the part's side."""
        domain, found = self.case.surface.domain, list(point.xi)
        for axis in (0, 1):
            if domain.periodic[axis]:
                turns = np.round((found[axis] - (self.lines[axis][0] + self.lines[axis][-1]) / 2) / domain.size[axis])
                found[axis] -= turns * domain.size[axis]
        return found

    def of_support(self, support: Support) -> tuple[str, ...]:
        """Return the places of a support that lie on the part."""
        return tuple(name for name in support.on if self.holds(self.case.places[name]))

    def loads(self) -> Iterator[object]:
        """Yield the loads of the part; forces on its lines of symmetry are shared with the images."""
        for load in self.case.loads:
            if isinstance(load, PointLoad):
                for name in load.on:
                    place = self.case.places[name]
                    if isinstance(place, Point) and self.holds(place):
                        yield load.model_copy(
                            update={"on": (name,), "force": _divided(load.force, self._shared(place))}
                        )
            elif isinstance(load, EdgeLoad):
                if on := tuple(name for name in load.on if self.holds(self.case.places[name])):
                    yield load.model_copy(update={"on": on})
            else:
                yield load

    def _shared(self, point: Point) -> int:
        """Return how many images of the part a point belongs to."""
        share = 1
        for axis, at in enumerate(self._brought_in(point)):
            slack = SYMMETRIC * self.case.surface.domain.size[axis]
            for mirror, line in zip(self.folds[axis].mirrors, self.lines[axis][[0, -1]], strict=True):
                share *= 2 if mirror is not None and abs(at - line) <= slack else 1
        return share


def _divided(force: VectorFormula, by: int) -> VectorFormula:
    def divide(formula: Formula) -> Formula:
        return f"({formula})/{by}" if isinstance(formula, str) else formula / by

    first, second, third = (divide(f) for f in force)
    return first, second, third
