"""One neural field in space, time and material: `ndf-conditioned` for cloth that moves in its plane.

The hidden layer is drawn once. Its output weights are a function of time and of the material,

    u(xi, t; material) = W(t, log(E h), nu) phi(xi),

a polynomial through Chebyshev points of a box; thickness and modulus enter only by their product (`plane_motion`). At
each material point Newton's law is integrated for the output weights. In contrast to the answers of a linear shell
(`reduced`), its states do not lie in the span of a few fields, so that nothing is reduced.

The stated uncertainty of a value or derivative q comes from the construction alone. With q' from the same field of
features of a lower degree, and q_k from the field without its last `LAST_POLYNOMIALS` along time, log(E h) or nu, it is

    the largest, over the held-out materials at the end, of  abs(q - q') + sum over k of abs(q - q_k),

where the derivative is that of each field itself. Values are compared relative to themselves.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import get_args

import numpy as np
import torch
from numpy.polynomial import chebyshev
from torch import Tensor

from shellbench.errors import InputError, SolveFailure
from shellbench.problem import Progress, ProgressCallback, Step
from shellbench.problems.series.conditioned import ConditionedCase, Material
from shellbench.problems.series.conditioned_answer import SECONDS_BEFORE, SECONDS_EACH, ConditionedAnswer
from shellbench.problems.series.quantities import Parameter, Value
from shellbench.solvers.ndf.conditioned.conditioned import ASKED_TIMES, read_features
from shellbench.solvers.ndf.conditioned.plane_motion import PLANE, coordinates, features_of, plane_motion
from shellbench.solvers.ndf.field.ansatz import Combined
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.field import Features
from shellbench.solvers.ndf.field.jets import Array
from shellbench.solvers.ndf.field.network import Network
from shellbench.solvers.ndf.field.weights import HEADER, network_tensors, read_described, read_tensors, write_described
from shellbench.solvers.ndf.linear.refinement import SETTLED
from shellbench.solvers.ndf.linear.ritz_settings import ConditionedSettings
from shellbench.solvers.ndf.motion.motion import degree_of
from shellbench.solvers.ndf.motion.motion_problem import Motion
from shellbench.solvers.ndf.strains.energy import why_exploited
from shellbench.solvers.ndf.strains.smooth import finer, width_for

FORMAT = "ndf-conditioned in motion, format 2"
DEGREE, FEWER = 13, 3  # of the features along a side; and the difference to the lower degree that estimates the error
COUNTS = (33, 9, 5)  # points along time, log(E h) and nu
LAST_POLYNOMIALS = 2  # last polynomials of each axis, which must be negligible: odd and even ones may differ
SETTLED_DERIVATIVE = 1e-2  # of the logarithm: required by gates of fields; not tuned
ROUNDING_OF_SUMS = 500 * np.finfo(float).eps  # relative rounding of a sum of so many polynomials
UNUSED = ("snapshots", "tolerance")  # settings of shells at rest


@dataclass(frozen=True)
class Polynomials:
    """Products of Chebyshev polynomials of time, log(E h) and nu on a box, by its corners."""

    lower: Array
    upper: Array

    @classmethod
    def of_case(cls, case: ConditionedCase) -> Polynomials:
        """Return the polynomials of all materials of a case, from rest to its end."""
        ends = [coordinates(case.ranges.material((share, share, share))) for share in (0.0, 1.0)]
        until = case.shell_of(case.middle).states[-1]
        return cls(np.array([0.0, *ends[0]]), np.array([until, *ends[1]]))

    def points(self, axis: int, count: int) -> Array:
        """Return the Chebyshev extrema (count,) of an axis, increasing."""
        share = (1 - np.cos(np.linspace(0, np.pi, count))) / 2
        return np.asarray(self.lower[axis] + share * (self.upper[axis] - self.lower[axis]))

    def coefficients(self, values: Array) -> Array:
        """Return the coefficients of values (times, log(E h), nu, ...) at the points, of the same shape."""
        for axis, count in enumerate(values.shape[:3]):
            matrix = chebyshev.chebvander(-np.cos(np.linspace(0, np.pi, count)), count - 1)
            values = np.moveaxis(np.tensordot(np.linalg.inv(matrix), values, (1, axis)), 0, axis)
        return values

    def evaluate(
        self, coefficients: Array, at: float, place: tuple[float, float], order: tuple[int, int, int] = (0, 0, 0)
    ) -> Array:
        """Return the sum (...) of coefficients (times, n, m, ...) at a time and material, or a derivative."""
        half = (self.upper - self.lower) / 2
        for x, k, size in zip((np.array([at, *place]) - self.lower) / half - 1, order, half, strict=True):
            rows = chebyshev.chebval(x, chebyshev.chebder(np.eye(len(coefficients)), k, 1 / size))
            coefficients = np.tensordot(rows, coefficients, 1)
        return coefficients

    def asked_value(self, asked: Array, at: float, material: Material, by: Parameter | None) -> float:
        """Return the asked value of coefficients (times, n, m), or the derivative of its logarithm by a parameter.

        Raises
        ------
        InputError
            If the value is zero up to rounding, and a derivative is asked.
        """
        place = coordinates(material)
        value = float(self.evaluate(asked, at, place))
        if by is None:
            return value
        if abs(value) <= ROUNDING_OF_SUMS * float(np.abs(asked).sum()):
            raise InputError(f"at {at:g} s the displacement is zero: its logarithm has no derivative")
        order = (0, 0, 1) if by == "poissons_ratio" else (0, 1, 0)
        return float(self.evaluate(asked, at, place, order)) / value


@dataclass(frozen=True, kw_only=True)
class ConditionedMotion(ConditionedAnswer):
    """A field for all materials of a range, at all times; see `shellbench.problem.Solution`.

    Attributes
    ----------
    spec
        The choices from which the field is rebuilt.
    features
        Scalar features, orthonormal in the area.
    coefficients
        (times, n, m, 2, r): Chebyshev coefficients of the output weights.
    """

    spec: FieldSpec
    features: Combined
    coefficients: Tensor

    @cached_property
    def _polynomials(self) -> Polynomials:
        return Polynomials.of_case(self.case)

    @cached_property
    def _values(self) -> Array:
        """The asked displacement's coefficients."""
        return asked_values(self.case, self.features, self.coefficients.numpy())

    @property
    def _network(self) -> Network:
        features = self.features.features
        assert isinstance(features, Features)
        return features.network

    @property
    def parameters(self) -> int:
        """Number of output weights that were solved for, at all points."""
        return int(self.coefficients.numel())

    @property
    def storage_bytes(self) -> int:
        """Bytes of all tensors."""
        return sum(t.numel() * t.element_size() for t in self.tensors().values())

    def displacement(
        self, points: Array, at: float | None = None, material: Material | Mapping[str, float] | None = None
    ) -> Array:
        """Return the displacement (..., 3), m, at points (..., 2) and a time, the end if None; of the middle material.

        Raises
        ------
        InputError
            If the material is beyond the ranges, or the time beyond the motion.
        """
        place, moment = coordinates(self.case.chosen_material(material)), self._time(at)
        flat = np.asarray(points, dtype=float).reshape(-1, 2)
        found = np.zeros((len(flat), 3))
        weights = self._polynomials.evaluate(self.coefficients.numpy(), moment, place)
        found[:, :PLANE] = self.features.values(flat).numpy() @ weights.T
        return found.reshape(*np.shape(points)[:-1], 3)

    def _time(self, at: float | None) -> float:
        until = float(self._polynomials.upper[0])
        if at is not None and not 0 <= at <= until:
            raise InputError(f"{self.case.name}: the time is {at:g} s, but the motion goes from 0 to {until:g} s")
        return until if at is None else at

    def asked(self, material: Material | Mapping[str, float], at: float | None = None) -> float:
        """Return the asked displacement, m, at any material and time, the end if None; InputError beyond them."""
        return self._polynomials.asked_value(self._values, self._time(at), self.case.chosen_material(material), None)

    def derivative(self, material: Material | Mapping[str, float], by: Parameter, at: float | None = None) -> float:
        """Return the derivative of its logarithm by log h, log E or nu; InputError beyond the ranges and at rest."""
        return self._polynomials.asked_value(self._values, self._time(at), self.case.chosen_material(material), by)

    def value(self, number: int) -> float:
        """Return the asked displacement, m, at a held-out material."""
        return self.asked(self.case.materials[number])

    def sensitivity(self, number: int, by: Parameter) -> float:
        """Return the derivative of its logarithm at a held-out material."""
        return self.derivative(self.case.materials[number], by)

    def tensors(self) -> dict[str, Tensor]:
        """Return all tensors by the names they have in a file."""
        own = {"combine": self.features.combine, "coefficients": self.coefficients}
        return {**network_tensors(self._network), **own}

    def save(self, path: Path) -> Path:
        """Write the field as safetensors, all other data as JSON in its header; return the file with its suffix."""
        words = {
            "format": FORMAT,
            "case": self.case.data(),
            "spec": self.spec.model_dump(mode="json"),
            "activation": self._network.activation,
            "uncertainty": dict(self.uncertainty),
        }
        return write_described(path, self.tensors(), words)

    @classmethod
    def load(cls, path: Path) -> ConditionedMotion:
        """Read a file of `save`; InputError in one sentence if it is no such file."""
        with read_described(path, FORMAT, "conditioned field") as (words, tensors):
            case = ConditionedCase.model_validate(words["case"])
            spec, features = read_features(case, words, tensors)
            combined, kept = Combined(features, tensors["combine"]), tensors["coefficients"]
            if kept.ndim != 5 or kept.shape[3:] != (PLANE, combined.count) or features.count != len(combined.combine):
                raise ValueError("its tensors do not fit each other")
            told = {"uncertainty": words["uncertainty"], "spec": spec, "features": combined, "coefficients": kept}
            return cls(case=case, **told)


def is_motion(path: Path) -> bool:
    """Return True if the header of a file states that it holds such a field; InputError if it can't be read."""
    return FORMAT in read_tensors(path)[0].get(HEADER, "")


def asked_values(case: ConditionedCase, features: Combined, weights: Array) -> Array:
    """Return the asked displacement (...), m, of output weights (..., 2, r)."""
    shell = case.shell_of(case.middle)
    points = np.array([shell.points[name] for name in case.asked.points])
    directions = np.broadcast_to(np.array(case.asked.direction, dtype=float), (len(points), 3))[:, :PLANE]
    return np.asarray(np.einsum("...cr,pr,pc->...", weights, features.values(points).numpy(), directions) / len(points))


def solve(case: ConditionedCase, settings: ConditionedSettings, progress: ProgressCallback) -> ConditionedMotion:
    """Build the field of a case.

    Raises
    ------
    InputError
        If settings do not apply to motions, or there are too few neurons.
    SolveFailure
        If a motion can't be followed, or exploits its quadrature.
    """
    # 1. Build features of one degree, and Newton's law of their weights.
    # 2. Integrate the motions of all materials of the grid, those of one stiffness together, and interpolate the
    #    weights.
    # 3. Repeat with features of a lower degree: this and the last polynomials give the uncertainty.
    # 4. Compute the energies at the end on a finer rule.
    begin, shell = time.perf_counter(), case.shell_of(case.middle)
    for name in UNUSED:
        if name in settings.model_fields_set:
            raise InputError(f"{case.name}: a motion has no use for the setting '{name}'")
    degree = degree_of(shell, settings.neurons) if settings.neurons else DEGREE
    if degree <= FEWER:  # nothing is left to compare with
        fewest = width_for(shell, FEWER + 1)
        raise InputError(f"field 'neurons': found {settings.neurons}, but a motion needs {fewest} or more")
    polynomials = Polynomials.of_case(case)
    times, stiffnesses, ratios = (polynomials.points(axis, count) for axis, count in enumerate(COUNTS))
    steps: list[Step] = []

    def built(degree: int) -> tuple[Array, ConditionedMotion, float]:
        """Return the coefficients of the asked displacement, the field of a degree, and its quadrature gap."""
        motion, features = features_of(shell, degree, settings)
        law = plane_motion(motion, features)
        fine = plane_motion(Motion(shell, motion.spec, features, finer(motion.rule_spec)), features)
        followed, gap = [], 0.0
        for stiffness in stiffnesses:
            progress(Progress(len(steps), 2 * len(stiffnesses), f"degree {degree}, E h = {np.exp(stiffness):.4g} N/m"))
            places = np.array([(stiffness, nu) for nu in ratios])
            weights, evaluations = law.follow(places, times)
            energies, work = law.energies(weights[:, -1], places), np.sum(law.gravity * weights[:, -1], axis=(1, 2))
            gap = max(gap, float(np.max(np.abs(energies - fine.energies(weights[:, -1], places)) / work)))
            followed.append(weights)
            seconds = time.perf_counter() - begin
            steps.append(Step(len(steps), seconds, float(energies[0]), PLANE * law.count, iterations=evaluations))
        coefficients = polynomials.coefficients(np.stack(followed).transpose(2, 0, 1, 3, 4))
        field = ConditionedMotion(
            case=case, spec=motion.spec, features=features, coefficients=torch.as_tensor(coefficients)
        )
        return asked_values(case, features, coefficients), field, gap

    with torch.no_grad():
        asked, found, gap = built(degree)
        coarse, _, _ = built(degree - FEWER)
    told: tuple[Parameter | None, ...] = (None, *get_args(Parameter))
    shares = {by: relative_uncertainty(polynomials, (asked, coarse), case.materials, by) for by in told}
    uncertainty = {}
    for quantity in case.quantities:
        by = None if isinstance(quantity, Value) else quantity.by
        uncertainty[quantity.name] = shares[by] * (abs(quantity.measure(found)) if by is None else 1.0)
    before = time.perf_counter() - begin
    start = time.perf_counter()
    for number in range(ASKED_TIMES):
        found.value(number % len(case.materials))
    found = replace(
        found,
        history=tuple(steps),
        uncertainty=uncertainty,
        unsettled=why_unsettled(shares),
        diagnostics={
            SECONDS_BEFORE: before,
            SECONDS_EACH: (time.perf_counter() - start) / ASKED_TIMES,
            "energy_gap": gap,
            "degree": degree,
            "independent_features": found.features.count,
        },
    )
    if (reason := why_exploited(gap, settings.largest_gap)) is not None:
        raise SolveFailure(reason, found)
    return found


def why_unsettled(shares: Mapping[Parameter | None, float]) -> str | None:
    """Return the uncertainty that is too large, as one clause, or None if none is; the key None is that of values."""
    for by, share in shares.items():
        if not share <= (SETTLED if by is None else SETTLED_DERIVATIVE):
            asked = "displacements" if by is None else f"derivatives by {by}"
            return f"{asked} may be off by {share:.1e}"
    return None


def relative_uncertainty(
    polynomials: Polynomials, both: tuple[Array, Array], materials: tuple[Material, ...], by: Parameter | None
) -> float:
    """Return the uncertainty at the end, relative for values. `both` are the results of more and fewer features."""
    asked, coarse = both
    shorter = []
    for axis in range(asked.ndim):
        cut = np.moveaxis(asked.copy(), axis, 0)
        cut[-LAST_POLYNOMIALS:] = 0.0
        shorter.append(np.moveaxis(cut, 0, axis))
    until, largest = float(polynomials.upper[0]), 0.0
    for material in materials:
        told = polynomials.asked_value(asked, until, material, by)
        apart = sum(abs(told - polynomials.asked_value(other, until, material, by)) for other in (coarse, *shorter))
        share = apart / abs(told) if told != 0 else np.inf
        largest = max(largest, share if by is None else apart)
    return largest
