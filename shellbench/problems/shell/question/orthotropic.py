"""Orthotropic shells as data of a case file: woven cloth, ribbed plates, symmetric laminates.

The strain energy per reference area is W = 1/2 (A e . e + D k . k), of the strains e = (e11, e22, 2 e12) and changes of
curvature k = (k11, k22, 2 k12) in the directions 1 and 2 of the material. They are orthonormal on the shell at rest:
direction 1 is that of a coordinate line, turned by an angle about the normal, and direction 2 is the normal x 1.
A single orthotropic layer (Reddy 2004, sec. 2.4) has A = h Q and D = h^3 Q / 12, with Q11 = E1/(1 - nu12 nu21),
Q22 = E2/(1 - nu12 nu21), Q12 = nu12 Q22, Q66 = G and nu21 = nu12 E2/E1.

The membrane of woven cloth may stiffen (Clyde, Teran & Tamstorf 2017): its energy is then

    A11 eta_1(e11^2)/2 + A12 e11 e22 + A22 eta_2(e22^2)/2 + 2 A66 eta_3(e12^2),
    eta(x) = sum_i mu_i/alpha_i ((1 + x)^alpha_i - 1),

each term continued by its Taylor series of second degree beyond the range in which it was measured.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Discriminator, Field, Tag, model_validator

from shellbench.problems.shell.question.conditions import LIMITS, Formula, Material
from shellbench.protocol.schema import LARGEST, SMALLEST, Finite, Model, Positive

Array = NDArray[np.float64]
Stiffnesses = tuple[Finite, Finite, Finite, Finite] | tuple[tuple[Finite, Finite, Finite], ...]
SYMMETRIC = 1e-12  # relative difference of two entries that is rounding
RANGE_SAMPLES = 201  # strains of a measured range at which the stiffness is checked
UNIT_SLOPE = 1e-9  # difference of eta'(0) from one that is rounding
SINGLY = ("youngs_modulus", "poissons_ratio", "shear_modulus")  # of one layer


class StiffeningCurve(Model):
    """A curve eta of a squared strain, with eta'(0) = 1.

    Attributes
    ----------
    mu
        Factors of its terms; they add up to one.
    alpha
        Powers of its terms, none of them zero.
    until
        Strain at which the measured range ends.
    """

    mu: Annotated[tuple[Finite, ...], Field(min_length=1)]
    alpha: tuple[Finite, ...]
    until: Positive

    @model_validator(mode="after")
    def _stiffness_is_positive(self) -> Self:
        if len(self.mu) != len(self.alpha) or not all(self.alpha):
            raise ValueError("each of its mu needs one alpha, and none may be zero")
        if not abs(sum(self.mu) - 1) < UNIT_SLOPE * max(map(abs, self.mu)):
            raise ValueError(f"its mu add up to {sum(self.mu):.6g}, but it must be one: A is the stiffness at rest")
        strains = np.linspace(0, self.until, RANGE_SAMPLES)
        with np.errstate(all="ignore"):
            x, mu, alpha = strains[:, None] ** 2, np.array(self.mu), np.array(self.alpha)
            stiffness = (mu * (1 + x) ** (alpha - 2) * (1 + (2 * alpha - 1) * x)).sum(axis=1)
        if not (np.isfinite(stiffness) & (stiffness > 0)).all():
            at = strains[np.argmin(np.where(np.isfinite(stiffness), stiffness, -np.inf))]
            raise ValueError(f"its stiffness at the strain {at:.3g} is not positive and finite")
        return self


class Stiffening(Model):
    """Curves of a membrane that stiffens.

    Attributes
    ----------
    warp
        Along direction 1, of E11^2.
    weft
        Along direction 2, of E22^2.
    shear
        In shear, of E12^2.
    """

    warp: StiffeningCurve
    weft: StiffeningCurve
    shear: StiffeningCurve


class OrthotropicMaterial(Model):
    """Stiffnesses in two directions at right angles: of one layer, or of stretching and bending apart.

    Either a single layer has `youngs_modulus`, `poissons_ratio`, `shear_modulus` and `thickness`. Or the stiffnesses
    are given, `membrane` and `bending`: cloth, whose bending does not follow from its thickness, needs them, and so do
    laminates.

    Attributes
    ----------
    membrane, bending
        Stiffnesses [A11, A12, A22, A66] in N/m and [D11, D12, D22, D66] in N m, or the rows of the whole
        matrices A and D of a laminate. A66 and D66 multiply 2 e12 and 2 k12.
    stiffening
        Curves of [A11, A12, A22, A66] over the strain, for shells at rest in the non-linear theory.
    coupling
        The matrix B of a laminate, N: a symmetric one has none, and no other is taken.
    angle
        degrees, from the coordinate line to direction 1, about the normal by the right hand.
    along
        Coordinate whose line direction 1 is turned from.
    """

    limits: ClassVar[str] = LIMITS
    uniform: ClassVar[bool] = True
    modulus_factor: ClassVar[Formula] = 1.0
    thickness_factor: ClassVar[Formula] = 1.0
    bending_factor: ClassVar[float] = 1.0

    kind: Literal["orthotropic"] = Field(description="the kind")
    youngs_modulus: tuple[Positive, Positive] | None = Field(None, description="E1 and E2, Pa")
    poissons_ratio: Finite | None = Field(None, description="Poisson's ratio nu12; nu21 = nu12 E2/E1")
    shear_modulus: Positive | None = Field(None, description="G12, Pa")
    thickness: Positive = Field(description="h, metres; given stiffnesses do not depend on it")
    membrane: Stiffnesses | None = None
    bending: Stiffnesses | None = None
    stiffening: Stiffening | None = None
    coupling: tuple[tuple[Finite, Finite, Finite], ...] | None = None
    angle: Finite = 0.0
    along: Literal["xi1", "xi2"] = "xi1"
    areal_density: Annotated[Finite, Field(ge=0)] = Field(0.0, description="rho, kg per square metre")

    @model_validator(mode="after")
    def _is_a_material(self) -> Self:
        layer, apart = [getattr(self, n) is not None for n in SINGLY], [self.membrane, self.bending]
        if any(layer) and not all(layer):
            missing = next(name for name, there in zip(SINGLY, layer, strict=True) if not there)
            raise ValueError(f"'{missing}' is missing: a layer has {', '.join(SINGLY)} and thickness")
        if any(layer) and any(apart):
            raise ValueError("it has moduli of a layer, or membrane and bending stiffnesses, not both")
        if not any(layer) and not all(apart):
            raise ValueError("it needs the moduli of a layer, or both membrane and bending")
        if self.stiffening is not None and (self.membrane is None or len(self.membrane) != 4):
            raise ValueError("its stiffening needs the four membrane stiffnesses at rest, [A11, A12, A22, A66]")
        if self.coupling is not None and np.any(np.asarray(self.coupling)):
            raise ValueError(
                "its 'coupling' must be zero: a laminate that is not symmetric bends as it stretches, which no solver"
                " here takes"
            )
        for name, matrix in zip(("membrane", "bending"), self.stiffnesses, strict=True):
            if not SMALLEST <= np.abs(np.diag(matrix)).min() <= np.abs(matrix).max() <= LARGEST:
                raise ValueError(f"its {name} stiffnesses must be from {SMALLEST:g} to {LARGEST:g}")
            scale = 1 / np.sqrt(np.abs(np.diag(matrix)))
            if np.diag(matrix).min() <= 0 or np.linalg.eigvalsh(scale[:, None] * matrix * scale).min() <= SYMMETRIC:
                raise ValueError(f"its {name} stiffnesses are not positive definite: some strain would free energy")
        return self

    @property
    def stiffnesses(self) -> tuple[Array, Array]:
        """A (3, 3), N/m, and D (3, 3), N m, on (11, 22, twice 12) in the directions of the material."""
        if self.youngs_modulus is not None and self.poissons_ratio is not None and self.shear_modulus is not None:
            (first, second), nu = self.youngs_modulus, self.poissons_ratio
            share = 1 - nu**2 * second / first
            if share <= 0:
                raise ValueError(f"its 'poissons_ratio' is {nu:g}, but nu12^2 must be below E1/E2")
            layer = _matrix((first / share, nu * second / share, second / share, self.shear_modulus))
            return self.thickness * layer, self.thickness**3 / 12 * layer
        assert self.membrane is not None
        assert self.bending is not None
        return _matrix(self.membrane), _matrix(self.bending)

    @property
    def curves(self) -> tuple[tuple[StiffeningCurve, float, float], ...]:
        """The curves with the factor of eta(e^2)/2, N/m, and the least strain of their range: warp, weft, shear."""
        assert self.stiffening is not None
        (first, _, _), (_, second, _), (_, _, shear) = self.stiffnesses[0].tolist()
        own = self.stiffening
        return (own.warp, first, 0.0), (own.weft, second, 0.0), (own.shear, 4 * shear, -own.shear.until)

    @property
    def turned_stiffnesses(self) -> tuple[Array, Array]:
        """A and D on (11, 22, twice 12) in the frame of the coordinate line `along` and the normal x it."""
        c, s = math.cos(math.radians(self.angle)), math.sin(math.radians(self.angle))
        turn = np.array([[c * c, s * s, c * s], [s * s, c * c, -c * s], [-2 * c * s, 2 * c * s, c * c - s * s]])
        membrane, bending = (turn.T @ matrix @ turn for matrix in self.stiffnesses)
        return membrane, bending

    def turned_over(self) -> dict[str, Any]:
        """Return the fields of the same material where the normal points to the other side."""
        # Directions have no sign, but one of them is turned over: what couples shear with the rest changes its sign.
        signs = np.outer([1.0, 1.0, -1.0], [1.0, 1.0, -1.0])
        whole = {n: m for n in ("membrane", "bending") if len(m := getattr(self, n) or ()) == len(signs)}
        return {"angle": -self.angle} | {name: (signs * np.asarray(matrix)).tolist() for name, matrix in whole.items()}

    def factors(self, points: ArrayLike, constants: Mapping[str, float]) -> tuple[Array, Array]:
        """Return the factors (...) of modulus and thickness at points (..., 2): ones."""
        ones = np.ones(np.shape(points)[:-1])
        return ones, ones

    @property
    def membrane_stiffness(self) -> float:
        """The scale of A, N/m: the geometric mean of A11 and A22."""
        return float(np.sqrt(self.stiffnesses[0][0, 0] * self.stiffnesses[0][1, 1]))

    @property
    def bending_stiffness(self) -> float:
        """The scale of D, N m: the geometric mean of D11 and D22."""
        return float(np.sqrt(self.stiffnesses[1][0, 0] * self.stiffnesses[1][1, 1]))

    @property
    def poissons_ratios(self) -> tuple[float, float]:
        """A12 and D12 by these scales: an isotropic shell's Poisson's ratios."""
        membrane, bending = (m[0, 1] / np.sqrt(m[0, 0] * m[1, 1]) for m in self.stiffnesses)
        return float(membrane), float(bending)


def _matrix(given: Stiffnesses) -> Array:
    """Return a matrix (3, 3) from four stiffnesses or its own rows; ValueError for other shapes."""
    if len(given) == 4 and not isinstance(given[0], tuple):
        first, coupled, second, shear = given
        return np.array([[first, coupled, 0.0], [coupled, second, 0.0], [0.0, 0.0, shear]], dtype=float)
    matrix = np.asarray(given, dtype=float)
    if matrix.shape != (3, 3) or np.abs(matrix - matrix.T).max() > SYMMETRIC * np.abs(matrix).max():
        raise ValueError("stiffnesses are four numbers, or the three rows of a symmetric matrix")
    return matrix


def _kind(data: Any) -> Any:
    return data.get("kind", "isotropic") if isinstance(data, Mapping) else getattr(data, "kind", "isotropic")


AnyMaterial = Annotated[
    Annotated[Material, Tag("isotropic")] | Annotated[OrthotropicMaterial, Tag("orthotropic")], Discriminator(_kind)
]
