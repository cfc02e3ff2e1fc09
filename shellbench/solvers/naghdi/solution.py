"""The trained field, and its energies on a rule of points."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.stats import qmc
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.solution import Arrays, ShellSolution, Words
from shellbench.solvers.naghdi.network import Fields, Shape
from shellbench.solvers.naghdi.strains import Frame, load_density

Array = NDArray[np.float64]

RULE = 48  # Gauss points a side by which energies of an answer are certified
PARTS = slice(0, 3), slice(3, 6), slice(6, 8)  # rows of strains: membrane, bending, shear


def gauss_points(case: Case, side: int) -> tuple[Array, Array]:
    """Return points (side^2, 2) and weights in the coordinates."""
    s, w = np.polynomial.legendre.leggauss(side)
    domain = case.surface.domain
    shares = np.stack(np.meshgrid(s, s, indexing="ij"), axis=-1).reshape(-1, 2) / 2 + 0.5
    weights = np.outer(w, w).ravel() / 4 * domain.size[0] * domain.size[1]
    return np.asarray(domain.lower) + shares * np.asarray(domain.size), weights


def sobol_points(case: Case, count: int, seed: int) -> tuple[Array, Array]:
    """Return points (n, 2) of a scrambled Sobol sequence, n the power of two up to `count`, and equal weights."""
    domain = case.surface.domain
    shares = qmc.Sobol(2, seed=seed).random_base2(count.bit_length() - 1)
    weights = np.full(len(shares), domain.size[0] * domain.size[1] / len(shares))
    return np.asarray(domain.lower) + shares * np.asarray(domain.size), weights


class Energies(NamedTuple):
    """Membrane, bending and shear energy and the work of the load, J."""

    membrane: float
    bending: float
    shear: float
    work: float

    @property
    def potential(self) -> float:
        """Strain energy less work."""
        return self.membrane + self.bending + self.shear - self.work


@dataclass(frozen=True)
class Rule:
    """Quadrature of the energies at points; of their arguments only the jet z = (q, q,1, q,2) depends on the network.

    Attributes
    ----------
    roots
        Three of (N, R, 15): the square sum of roots z is twice the membrane, bending or shear energy.
    forces
        (N, 15): the sum of forces times z is the work.
    """

    roots: tuple[Tensor, Tensor, Tensor]
    forces: Tensor

    @classmethod
    def at(cls, case: Case, xi: Array, weights: Array) -> Rule:
        """Return the rule with points (N, 2) and weights (N,)."""
        frame = Frame.at(case, xi)
        areas = weights * frame.area
        operator = frame.operator()
        roots = []
        for part, of in zip(frame.stiffness(case), PARTS, strict=True):
            root = np.swapaxes(np.linalg.cholesky(part[:, of, of]), 1, 2)
            roots.append(torch.as_tensor(np.sqrt(areas)[:, None, None] * (root @ operator[:, of])))
        forces = np.zeros((len(xi), operator.shape[-1]))
        forces[:, :3] = areas[:, None] * load_density(case, frame, xi)
        return cls((roots[0], roots[1], roots[2]), torch.as_tensor(forces))

    def parts(self, z: Tensor) -> list[Tensor]:
        """Return membrane, bending and shear energy and work of jets (N, 15)."""
        strained = [0.5 * (root @ z[:, :, None]).square().sum() for root in self.roots]
        return [*strained, (self.forces * z).sum()]

    @cached_property
    def whole(self) -> Tensor:
        """All roots in one, (N, 8, 15)."""
        return torch.cat(self.roots, dim=1)

    def potential(self, z: Tensor) -> Tensor:
        """Return the potential energy of jets, J."""
        return 0.5 * (self.whole @ z[:, :, None]).square().sum() - (self.forces * z).sum()


@dataclass(frozen=True)
class NaghdiSolution(ShellSolution):
    """A network of five fields.

    Attributes
    ----------
    weights
        (parameters,) all weights.
    mean
        (3,) the free translation, m, which is subtracted.
    """

    formats: ClassVar[tuple[str | int, ...]] = ("pinn-naghdi, format 1",)
    numbers: ClassVar[tuple[str, ...]] = ("weights",)

    case: Case
    shape: Shape
    weights: Array
    mean: Array

    @property
    def parameters(self) -> int:
        """Number of weights."""
        return self.shape.parameters

    def jets(self, xi: Array) -> Array:
        """Return z (N, 15) at points (N, 2)."""
        with torch.no_grad():
            return np.asarray(Fields.at(self.case, self.shape, xi).jets(torch.as_tensor(self.weights)).numpy())

    def displacement_at(self, xi: Array, at: float | None) -> Array:
        """Return the displacement (N, 3) at points (N, 2)."""
        return np.asarray(self.jets(xi)[:, :3] - self.mean)

    def field_at(self, name: str, xi: Array, at: float | None) -> Array:
        """Return covariant strains (N, 3) or energy densities (N,); the energy of shear is counted with bending."""
        frame, z = Frame.at(self.case, xi), self.jets(xi)
        strain = np.einsum("nsz,nz->ns", frame.operator(), z)
        of, _, what = name.partition("_")
        if what == "strain":
            start = 0 if of == "membrane" else 3
            return np.asarray(strain[:, start : start + 3] * [1, 1, 0.5])
        membrane, bending, shear = frame.stiffness(self.case)
        stiffness = membrane if of == "membrane" else bending + shear
        return np.asarray(0.5 * np.einsum("ns,nst,nt->n", strain, stiffness, strain))

    @cached_property
    def certified(self) -> Energies:
        """Energies on a fine rule."""
        return Check.of(self.case, self.shape).energies(torch.as_tensor(self.weights))

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Return the membrane energy, and that of bending and shear, J."""
        found = self.certified
        return found.membrane, found.bending + found.shear

    def kept(self) -> tuple[Words, Arrays]:
        """Return the data that a file holds beside the case and the history."""
        shape = {"layers": self.shape.layers, "width": self.shape.width, "activation": self.shape.activation}
        return {"shape": shape}, {"weights": self.weights, "mean": self.mean}

    @classmethod
    def restored(cls, case: Case, words: Words, arrays: Arrays) -> NaghdiSolution:
        """Make a solution from the data of a file; ValueError or KeyError if they are inconsistent."""
        shape = Shape(**words["shape"])
        weights, mean = arrays["weights"], arrays["mean"]
        if weights.shape != (shape.parameters,) or mean.shape != (3,):
            raise ValueError("the weights do not fit the network")
        return cls(case, shape, weights, mean)


@dataclass(frozen=True)
class Check:
    """A fine rule on which no network is trained, for energies and mean translations."""

    case: Case
    fields: Fields
    rule: Rule
    areas: Array

    @classmethod
    def of(cls, case: Case, shape: Shape, side: int = RULE) -> Check:
        """Return the rule of side^2 Gauss points."""
        xi, at = gauss_points(case, side)
        return cls(case, Fields.at(case, shape, xi), Rule.at(case, xi, at), at * Frame.at(case, xi).area)

    @torch.no_grad()
    def energies(self, weights: Tensor) -> Energies:
        """Return the energies of a network, J."""
        return Energies(*(float(part) for part in self.rule.parts(self.fields.jets(weights))))

    @torch.no_grad()
    def mean_translation(self, weights: Tensor) -> Array:
        """Return the mean (3,) of the translations that the case removes, m; zero along the others."""
        u = self.fields.jets(weights)[:, :3].numpy()
        removed = [f"translation_{name}" in self.case.remove_rigid_motions for name in "xyz"]
        return np.where(removed, self.areas @ u / self.areas.sum(), 0.0)


def side_of(points: int) -> int:
    """Return the side of a square of so many points, rounded down."""
    return math.isqrt(points)
