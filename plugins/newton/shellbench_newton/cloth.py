"""A flat cloth as newton has it, and the map from E, nu and h to each solver's own numbers.

Numbers are read from the kernels of newton 1.8.0 (files below newton/_src/solvers). E h and G h are the stiffness of
stretch and shear, B that of bending, theta the angle of a hinge of length l, A1 and A2 the areas of its two triangles.

Stretch. `vbd` (vbd/particle_vbd_kernels.py, `evaluate_neo_hookean_membrane_force_hessian`) has per area mu/2 (I - 2) +
(lambda + mu)/2 (J - alpha)^2: tri_ke and tri_ka are Lame's constants of plane stress. `semi-implicit`
(semi_implicit/kernels_particle.py, `eval_triangle`) has lambda where `vbd` has lambda + mu, so tri_ka is lambda + mu.
`style3d` (style3d/kernels.py, `eval_stretch_kernel`) has ku/2 (|Fu| - 1)^2 + kv/2 (|Fv| - 1)^2 + ks/2 (Fu Fv)^2: no
Poisson's effect; ku = kv = E h, ks = G h. `xpbd` has no triangles: springs along the sides of cells and along both
diagonals, whose lattice has C12 = G h.

Bending. The wanted energy is k theta^2/2 with k = B l^2/(A1 + A2), exact for a cylinder along the sides of cells. `vbd`
has edge_ke l theta^2/2. `style3d` has 3 edge_ke/(A1 + A2) |w x|^2/2, where |w x| = 2 l sin(theta/2): edge_ke = B/3.
`semi-implicit` and `xpbd` (`eval_bending`, `bending_constraint`) multiply the angle's gradient by the triangle's
|n| = 2 A: their moments are edge_ke l 2A theta and edge_ke 2A theta.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.deck.deck import Deck
from shellbench.problems.shell.question.conditions import Material
from shellbench.problems.shell.symmetry.symmetry import whole_of

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Kind = Literal["vbd", "xpbd", "style3d", "semi-implicit"]
Cut = Literal["right", "left", "alternating"]
LEAST_NORMAL = 1e-6  # m^2, twice a triangle's area, below which newton's hinges have no force (`eps` of its kernels)


@dataclass(frozen=True)
class Cloth:
    """Triangles and hinges of a case; a ghost vertex stands behind each side that is clamped.

    Attributes
    ----------
    case
        A flat case.
    cells
        Cells along xi1 and xi2, two triangles each.
    cut
        Diagonals: all to the right, all to the left, or alternating.
    """

    case: Case
    cells: tuple[int, int]
    cut: Cut = "right"

    def deck(self, at: float = 1.0) -> Deck:
        """Return the mesh with its loads at a load factor or time."""
        return Deck.of(whole_of(self.case), self.cells, "tri3", at=at)

    @cached_property
    def mesh(self) -> Deck:
        """The mesh."""
        return self.deck()

    @property
    def material(self) -> Material:
        """The case's material."""
        return self.case.isotropic

    @cached_property
    def triangles(self) -> Integers:
        """(t, 3) vertices of the triangles, counter-clockwise about the normal; two after each other make a cell."""
        lower, upper = self.mesh.cells[::2], self.mesh.cells[1::2]
        turned = np.stack([lower[:, [0, 1]], lower[:, [1, 2]]], axis=1)
        last = np.repeat(upper[:, 2:], 2, axis=1)[..., None]
        left = np.concatenate([turned, last], axis=-1)
        right = np.stack([lower, upper], axis=1)
        first, second = np.indices(self.cells).reshape(2, -1)
        flip = {"right": first < 0, "left": first >= 0, "alternating": (first + second) % 2 == 1}[self.cut]
        return np.where(flip[:, None, None], left, right).reshape(-1, 3)

    @cached_property
    def flat(self) -> Array:
        """(v, 2) places of the vertices in the plane, m."""
        nodes = self.mesh.nodes
        first = nodes[self.mesh.cells[0, 1]] - nodes[self.mesh.cells[0, 0]]
        first = first / np.linalg.norm(first)
        frame = np.stack([first, np.cross(self.mesh.normals[0], first)], axis=-1)
        return np.asarray((nodes - nodes[0]) @ frame)

    @cached_property
    def areas(self) -> Array:
        """(t,) areas of the triangles, m^2."""
        one, other = (self.flat[self.triangles[:, k]] - self.flat[self.triangles[:, 0]] for k in (1, 2))
        return np.asarray((one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]) / 2)

    @cached_property
    def masses(self) -> Array:
        """(v,) lumped masses, kg, in the proportion of the loads; of 1 kg/m^2 if the cloth is at rest."""
        density = 1.0 if self.case.dynamics is None else self.material.areal_density
        total = np.zeros(len(self.flat))
        one, other = (self.flat[self.mesh.cells[:, k]] - self.flat[self.mesh.cells[:, 0]] for k in (1, 2))
        area = np.abs(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]) / 2
        np.add.at(total, self.mesh.cells, density * area[:, None] / 3)
        return total

    @cached_property
    def held(self) -> NDArray[np.bool_]:
        """(v,) True if a support holds a vertex."""
        return np.asarray(self.mesh.held[:, :3].any(axis=1))

    @cached_property
    def hinges(self) -> tuple[Integers, Array, Array]:
        """Hinges (e, 4), the opposite vertices and the ends; areas (e,) of their triangles; places (g, 3) of ghosts.

        A clamped side is a hinge to a ghost, the mirror image of its triangle, over half the distance of others: its
        area is that of its one triangle.
        """
        sides = {
            (t[k], t[k - 2]): (t[k - 1], a) for t, a in zip(self.triangles, self.areas, strict=True) for k in range(3)
        }
        found, areas, ghosts = [], [], []
        nodes, clamped = self.mesh.nodes, self.mesh.held.all(axis=1) | (self.mesh.held[:, 3:].any(axis=1) & self.held)
        for (k, m), (i, area) in sides.items():
            if (m, k) in sides and k < m:
                j, more = sides[m, k]
                found.append((i, j, k, m))
                areas.append(area + more)
            elif (m, k) not in sides and clamped[k] and clamped[m]:
                along = (nodes[m] - nodes[k]) / np.linalg.norm(nodes[m] - nodes[k])
                apart = nodes[i] - nodes[k]
                ghosts.append(nodes[i] - 2 * (apart - along * (apart @ along)))
                found.append((i, len(nodes) + len(ghosts) - 1, k, m))
                areas.append(area)
        return np.array(found, dtype=np.int64).reshape(-1, 4), np.array(areas), np.array(ghosts).reshape(-1, 3)

    def bending(self, kind: Kind) -> Array:
        """Return edge_ke (e,) of the hinges of a solver."""
        hinges, areas, _ = self.hinges
        length = np.linalg.norm(self.mesh.nodes[hinges[:, 3]] - self.mesh.nodes[hinges[:, 2]], axis=-1)
        wanted = self.material.bending_stiffness * length**2 / areas
        around = 2 * self.areas.mean()  # all triangles of a grid have one area
        numbers: dict[Kind, Array] = {
            "vbd": wanted / length,
            "style3d": np.full(len(areas), self.material.bending_stiffness / 3),
            "semi-implicit": wanted / (around * length),
            "xpbd": wanted / around,
        }
        return numbers[kind]

    def stretching(self, kind: Kind) -> tuple[float, float]:
        """Return tri_ke and tri_ka of a solver, N/m."""
        nu, stiff = self.material.poissons_ratio, self.material.youngs_modulus * self.material.thickness
        mu, lame = stiff / (2 * (1 + nu)), stiff * nu / (1 - nu**2)
        return {"vbd": (mu, lame), "semi-implicit": (mu, lame + mu), "style3d": (stiff, mu), "xpbd": (0.0, 0.0)}[kind]

    @cached_property
    def springs(self) -> tuple[Integers, Array]:
        """Springs (s, 2) of `xpbd`, and their stiffness (s,), N/m; long cells have less stiffness of shear."""
        stretch = self.material.youngs_modulus * self.material.thickness
        quads = np.stack([*self.mesh.cells[::2].T, self.mesh.cells[1::2, 2]], axis=-1)
        a, b = (float(np.linalg.norm(self.flat[quads[0, k]] - self.flat[quads[0, k - 1]])) for k in (1, 2))
        uneven = max(a / b, b / a) ** 2
        shear = stretch / (2 * (1 + self.material.poissons_ratio))
        if uneven > 1:
            shear = min(shear, stretch / (uneven - 1 / uneven))
        whole = (stretch + np.hypot(stretch, 2 * shear)) / 2  # C with C - C12^2/C = E h and C12 = G h
        along, across = (whole - shear * (a / b) ** 2) * b / a, (whole - shear * (b / a) ** 2) * a / b
        diagonal = shear * (a * a + b * b) / (2 * a * b)
        pairs = np.concatenate([quads[:, p] for p in ([0, 1], [3, 2], [0, 3], [1, 2], [0, 2], [1, 3])])
        sizes = np.repeat([along / 2, along / 2, across / 2, across / 2, diagonal, diagonal], len(quads))
        pairs, where = np.unique(np.sort(pairs, axis=1), axis=0, return_inverse=True)
        return pairs.astype(np.int64), np.bincount(where.ravel(), sizes).astype(float)

    def model(self, kind: Kind) -> Any:
        """Return newton's model on the CPU.

        Raises
        ------
        InputError
            If the triangles are so small that newton does not bend them.
        """
        import newton
        import warp as wp

        hinges, areas, ghosts = self.hinges
        if 2 * self.areas.min() < LEAST_NORMAL:
            raise InputError(f"field 'cells': newton has no bending in triangles below {LEAST_NORMAL / 2:g} m^2")
        builder = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
        more: dict[str, dict[str, Any]] = {"triangles": {}, "edges": {}}
        if kind == "style3d":
            newton.solvers.SolverStyle3D.register_custom_attributes(builder)
            stretch, shear = self.stretching(kind)
            more["triangles"] = {"style3d:tri_aniso_ke": [wp.vec3(stretch, stretch, shear)] * len(self.triangles)}
            cotangents = [wp.vec4(*row) for row in self._cotangents()]
            more["edges"] = {"style3d:edge_rest_area": areas.tolist(), "style3d:edge_bending_cot": cotangents}
        places = np.concatenate([self.mesh.nodes, ghosts])
        masses = np.concatenate([np.where(self.held, 0.0, self.masses), np.zeros(len(ghosts))])
        builder.add_particles(
            [wp.vec3(*place) for place in places], [wp.vec3()] * len(places), masses.tolist(), [0.0] * len(places)
        )
        if kind == "xpbd":
            for (i, j), stiffness in zip(*self.springs, strict=True):
                builder.add_spring(int(i), int(j), float(stiffness), 0.0, control=0.0)
        else:
            self._add_triangles(builder, kind, more["triangles"])
        builder.add_edges(
            *hinges.T.tolist(),
            rest=[0.0] * len(hinges),
            edge_ke=self.bending(kind).tolist(),
            edge_kd=[0.0] * len(hinges),
            custom_attributes=more["edges"] or None,
        )
        if kind == "vbd":
            builder.color(include_bending=True)
        return builder.finalize(device="cpu")

    def _add_triangles(self, builder: Any, kind: Kind, more: dict[str, Any]) -> None:
        stretch, area = self.stretching(kind)
        count = len(self.triangles)
        zeros = [0.0] * count
        builder.add_triangles(
            *self.triangles.T.tolist(),
            tri_ke=[stretch] * count,
            tri_ka=[area] * count,
            tri_kd=zeros,
            tri_drag=zeros,
            tri_lift=zeros,
            custom_attributes=more or None,
        )
        # newton's own frames turn from triangle to triangle, and the stretch of `style3d` has directions
        corners = self.flat[self.triangles]
        sides = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=-1)
        builder.tri_poses[:] = np.linalg.inv(sides).tolist()

    def _cotangents(self) -> Array:
        """Return the cotangents (e, 4) at the ends of the hinges: first end in both triangles, then the second end."""
        hinges, _, ghosts = self.hinges
        places = np.concatenate([self.mesh.nodes, ghosts])[hinges]

        def at(corner: int, other: int, opposite: int) -> Array:
            u, v = places[:, other] - places[:, corner], places[:, opposite] - places[:, corner]
            return np.asarray(np.sum(u * v, axis=-1) / np.linalg.norm(np.cross(u, v), axis=-1))

        return np.stack([at(2, 3, 0), at(2, 3, 1), at(3, 2, 0), at(3, 2, 1)], axis=-1)
