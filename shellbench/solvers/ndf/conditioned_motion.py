"""One neural field in space, time and material: `ndf-conditioned` for cloth that moves in its plane.

The hidden layer is drawn once. Its output weights are a function of time and of the material,

    u(xi, t; material) = W(t, log(E h), nu) phi(xi),

a polynomial on the Chebyshev points of a box; thickness and modulus enter by their product alone (`plane_motion`).
At each node of the materials Newton's law is integrated for the output weights; between the nodes they are
interpolated. The residual of Newton's law at materials that were not solved for is told, and is too coarse to bound the
error. The stated uncertainty is an estimate.

The states of a motion do not lie in the span of a few fields, as the answers of a linear shell do (`reduced`). Measured
on the napkin, E h from 4 to 32 N/m, with all states of 14 materials: 40 fields leave 2e-3 of the free corner's
displacement, 120 still 4e-4, and a motion of 120 fields costs more than one of all 166.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from shellbench.errors import InputError, SolveFailure
from shellbench.problem import FULL, Progress, ProgressCallback, Step
from shellbench.problems.conditioned.case import ConditionedCase, Material
from shellbench.problems.conditioned.quantities import Parameter, Value
from shellbench.problems.conditioned.solving import SECONDS_BEFORE, SECONDS_EACH, ConditionedAnswer
from shellbench.solvers.ndf.build import FieldSpec
from shellbench.solvers.ndf.chebyshev_box import Box
from shellbench.solvers.ndf.conditioned import ASKED_TIMES, kept_features
from shellbench.solvers.ndf.conditioned_solver import ConditionedSettings
from shellbench.solvers.ndf.energy import exploits
from shellbench.solvers.ndf.field import Features, Network
from shellbench.solvers.ndf.jets import Array
from shellbench.solvers.ndf.motion import degree_of
from shellbench.solvers.ndf.motion_problem import Motion
from shellbench.solvers.ndf.plane_motion import PLANE, PlaneMotion, coordinates, features_of, plane_motion
from shellbench.solvers.ndf.refinement import SAFETY, SETTLED
from shellbench.solvers.ndf.sampled import Combined, finer
from shellbench.solvers.ndf.weights import HEADER, described, network_tensors, read_tensors, write_described

FORMAT = "ndf-conditioned in motion, format 1"
DEGREE, CHECKED_BY = 13, 10  # of the features along a side; of those by which their error is told
FIRST_NODES = (5, 4)  # materials along log(E h) and nu; twice as many where the last coefficients are too large
TOLERANCE = 1e-5  # share of the asked displacement that the last coefficients may have
INSTANTS = 33  # Chebyshev points of time
RESIDUALS = 9  # times at which the residual is told


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
    def _box(self) -> Box:
        return Box.of_case(self.case)

    @cached_property
    def _asked(self) -> Array:
        """(times, n, m): coefficients of what is asked, m."""
        return asked_of(self.case, self.features, self.coefficients.numpy())

    @property
    def _network(self) -> Network:
        features = self.features.features
        assert isinstance(features, Features)
        return features.network

    @property
    def parameters(self) -> int:
        """Output weights that were solved for, at all nodes."""
        return int(self.coefficients.numel())

    @property
    def storage_bytes(self) -> int:
        """Bytes of all tensors."""
        return sum(t.numel() * t.element_size() for t in self.tensors().values())

    def weights(self, material: Material, at: float, order: int = 0) -> Array:
        """Return the output weights (2, r), or their derivative in time, of a material at a time."""
        return self._box.evaluated(self.coefficients.numpy(), at, coordinates(material), (order, 0, 0))

    def displacement(
        self, points: Array, at: float | None = None, material: Material | Mapping[str, float] | None = None
    ) -> Array:
        """Return the displacement (..., 3), m, at points (..., 2) and a time, the end if None; of the middle material.

        Raises
        ------
        InputError
            If the material is beyond the ranges, or the time beyond the motion.
        """
        chosen, moment = self.case.chosen_material(material), self._time(at)
        flat = np.asarray(points, dtype=float).reshape(-1, 2)
        found = np.zeros((len(flat), 3))
        found[:, :PLANE] = self.features.values(flat).numpy() @ self.weights(chosen, moment).T
        return found.reshape(*np.shape(points)[:-1], 3)

    def _time(self, at: float | None) -> float:
        until = self._box.upper[0]
        if at is None:
            return until
        if not 0 <= at <= until:
            raise InputError(f"{self.case.name}: the time is {at:g} s, but the motion goes from 0 to {until:g} s")
        return at

    def asked(self, material: Material | Mapping[str, float], at: float | None = None) -> float:
        """Return the asked displacement, m, at any material and time; InputError beyond them."""
        place = coordinates(self.case.chosen_material(material))
        return float(self._box.evaluated(self._asked, self._time(at), place))

    def derivative(self, material: Material | Mapping[str, float], by: Parameter, at: float | None = None) -> float:
        """Return the derivative of its logarithm by log h, log E or nu; InputError beyond the ranges."""
        chosen, moment = self.case.chosen_material(material), self._time(at)
        order = (0, 0, 1) if by == "poissons_ratio" else (0, 1, 0)
        return float(self._box.evaluated(self._asked, moment, coordinates(chosen), order)) / self.asked(chosen, moment)

    def value(self, number: int, at: float = FULL) -> float:
        """Return the asked displacement, m, at a held-out material and a time."""
        return self.asked(self.case.materials[number], at)

    def sensitivity(self, number: int, by: Parameter, at: float = FULL) -> float:
        """Return the derivative of its logarithm at a held-out material and a time."""
        return self.derivative(self.case.materials[number], by, at)

    def tensors(self) -> dict[str, Tensor]:
        """Return all tensors by the names they have in a file."""
        own = {"combine": self.features.combine, "coefficients": self.coefficients}
        return {**network_tensors(self._network), **own}

    def save(self, path: Path) -> Path:
        """Write the field as safetensors, all else as JSON in its header; return the file with its suffix."""
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
        """Read what `save` wrote; InputError in one sentence if it is none."""
        with described(path, FORMAT, "conditioned field") as (words, tensors):
            case = ConditionedCase.model_validate(words["case"])
            spec, features = kept_features(case, words, tensors)
            combined = Combined(features, tensors["combine"])
            kept = tensors["coefficients"]
            if kept.ndim != 5 or kept.shape[3:] != (PLANE, combined.count) or features.count != len(combined.combine):
                raise ValueError("its tensors do not fit each other")
            return cls(
                case=case, uncertainty=words["uncertainty"], spec=spec, features=combined, coefficients=kept
            )  # fmt: skip


def is_motion(path: Path) -> bool:
    """Whether a file says that it holds such a field; InputError if it can't be read."""
    return FORMAT in read_tensors(path)[0].get(HEADER, "")


def asked_of(case: ConditionedCase, features: Combined, weights: Array) -> Array:
    """Return what is asked (...), m, of output weights (..., 2, r)."""
    shell = case.shell_of(case.middle)
    points = np.array([shell.points[name] for name in case.asked.points])
    directions = np.broadcast_to(np.array(case.asked.direction, dtype=float), (len(points), 3))[:, :PLANE]
    return np.asarray(np.einsum("...cr,pr,pc->...", weights, features.values(points).numpy(), directions) / len(points))


def solve(case: ConditionedCase, settings: ConditionedSettings, progress: ProgressCallback) -> ConditionedMotion:
    """Build the field of a case.

    Raises
    ------
    SolveFailure
        If a motion can't be followed, or exploits its quadrature.
    """
    # 1. Features of one degree, and Newton's law of their weights.
    # 2. Follow the motions of all materials of a small grid of Chebyshev points, those of one stiffness together.
    # 3. Where the last coefficients of what is asked are too large along an axis, take twice as many points there. The
    #    old ones are among them.
    # 4. Error: the last coefficients along all axes, and what features of a lower degree find at the softest material,
    #    where waves are the shortest.
    # 5. Told besides: the residual of Newton's law at the held-out materials, and energies on a finer rule.
    with torch.no_grad():
        return _Build(case, settings, progress).field()


class _Build:
    """The steps of `solve`, and what they share."""

    def __init__(self, case: ConditionedCase, settings: ConditionedSettings, progress: ProgressCallback) -> None:
        self.begin = time.perf_counter()
        self.case, self.settings, self.progress = case, settings, progress
        self.shell = case.shell_of(case.middle)
        self.degree = degree_of(self.shell, settings.neurons) if settings.neurons else DEGREE
        self.motion, self.features, self.neurons = features_of(self.shell, self.degree, settings)
        self.law = plane_motion(self.motion, self.features)
        self.box = Box.of_case(case)
        self.times = self.box.nodes(0, INSTANTS)
        self.found: dict[tuple[float, float], Array] = {}
        self.steps: list[Step] = []

    def field(self) -> ConditionedMotion:
        nodes, coefficients, asked = self._settled()
        rule = finer(self.motion.rule_spec)
        gap = self._gap(Motion(self.shell, self.motion.spec, self.features, rule), nodes)
        coarse = self._coarse()
        built = time.perf_counter() - self.begin
        apart = float(abs(coarse / asked_of(self.case, self.features, self.found[self._softest][-1]) - 1))
        uncertainty: dict[str, float] = {}
        for quantity in self.case.quantities:
            place = coordinates(self.case.materials[quantity.material])
            here = abs(float(self.box.evaluated(asked, quantity.at, place)))
            last = SAFETY * sum(tails(asked, self.box, quantity.at)) / here
            # A derivative of the last coefficients is larger than they are, by the square of their number at most.
            of_value = isinstance(quantity, Value)
            uncertainty[quantity.name] = (apart + last) * here if of_value else apart + last * max(nodes) ** 2
        found = ConditionedMotion(
            case=self.case,
            history=tuple(self.steps),
            uncertainty=uncertainty,
            spec=self.motion.spec,
            features=self.features,
            coefficients=torch.as_tensor(coefficients),
        )
        worst = max(uncertainty[q.name] / abs(q.measure(found)) for q in self.case.quantities if isinstance(q, Value))
        seconds = _seconds_each(found)
        left = max(residual(found, self.law, material) for material in self.case.materials)
        found = replace(
            found,
            unsettled=None if worst <= SETTLED else f"displacements may be off by {worst:.1e}",
            diagnostics={
                SECONDS_BEFORE: built,
                SECONDS_EACH: seconds,
                "energy_gap": gap,
                "newton_residual": left,
                "materials": list(nodes),
                "instants": len(self.times),
                "degree": self.degree,
                "independent_features": self.features.count,
                "neurons": self.neurons,
                "quadrature_points": len(self.law.share),
            },
        )
        if (reason := exploits(gap, self.settings.largest_gap)) is not None:
            raise SolveFailure(reason, found)
        return found

    def _settled(self) -> tuple[tuple[int, int], Array, Array]:
        """Return how many nodes there are along both axes, and coefficients of the weights and of what is asked."""
        allowed = self.settings.tolerance or TOLERANCE
        first, second = FIRST_NODES
        while True:
            values = np.stack([self._followed(float(s), second) for s in self.box.nodes(1, first)], axis=1)
            coefficients = self.box.coefficients(values)
            asked = asked_of(self.case, self.features, coefficients)
            middle = coordinates(self.case.middle)
            shares = np.max(
                [
                    np.array(tails(asked, self.box, at)) / abs(self.box.evaluated(asked, at, middle))
                    for at in self.case.states
                ],
                axis=0,
            )
            more = (2 * first - 1, second) if shares[0] >= shares[1] else (first, 2 * second - 1)
            if max(shares) <= allowed or more[0] * more[1] > self.settings.snapshots:
                return (first, second), coefficients, asked
            first, second = more

    def _followed(self, stiffness: float, count: int) -> Array:
        """Return the weights (times, nu, 2, r) of all nodes of one stiffness; those that are new are followed."""
        ratios = [float(nu) for nu in self.box.nodes(2, count)]
        new = [nu for nu in ratios if (stiffness, nu) not in self.found]
        if new:
            self.progress(Progress(len(self.found), None, f"following E h = {np.exp(stiffness):.4g} N/m"))
            weights, evaluations = self.law.follow(np.array([(stiffness, nu) for nu in new]), self.times)
            self.found |= {(stiffness, nu): one for nu, one in zip(new, weights, strict=True)}
            energy = float(self.law.energies(weights[:, -1], np.array([(stiffness, nu) for nu in new]))[0])
            seconds = time.perf_counter() - self.begin
            self.steps.append(Step(len(self.steps), seconds, energy, PLANE * self.law.count, iterations=evaluations))
        return np.stack([self.found[stiffness, nu] for nu in ratios], axis=1)

    def _gap(self, motion: Motion, nodes: tuple[int, int]) -> float:
        """Return the quadrature gap at the end, of all nodes: relative to the work of gravity."""
        fine = plane_motion(motion, self.features)
        places = np.array(list(self.found))
        last = np.stack([weights[-1] for weights in self.found.values()])
        work = np.sum(self.law.gravity * last, axis=(1, 2))
        return float(np.max(np.abs(self.law.energies(last, places) - fine.energies(last, places)) / work))

    @property
    def _softest(self) -> tuple[float, float]:
        """Coordinates of the least stiffness with the largest ratio."""
        return float(self.box.nodes(1, 2)[0]), float(self.box.nodes(2, 2)[-1])

    def _coarse(self) -> Any:
        """Return what is asked at the end, of the softest material, as features of a lower degree find it."""
        self.progress(Progress(len(self.found), None, "following with fewer features"))
        degree = max(self.degree - (DEGREE - CHECKED_BY), 1)
        motion, features, _ = features_of(self.shell, degree, self.settings)
        weights, _ = plane_motion(motion, features).follow(np.array([self._softest]), self.times)
        return asked_of(self.case, features, weights[0, -1])


def tails(asked: Array, box: Box, at: float) -> tuple[float, float]:
    """Return the sizes of the last coefficients (times, n, m) along log(E h) and along nu at a time, m.

    Those after them, which are left out, are smaller where the coefficients fall.
    """
    here = np.tensordot(box.rows(0, at, len(asked)), asked, 1)
    return float(np.abs(here[-1]).sum()), float(np.abs(here[:, -1]).sum())


def residual(found: ConditionedMotion, law: PlaneMotion, material: Material) -> float:
    """Return the largest residual of Newton's law over time: its norm over the cloth, as a share of gravity's."""
    until, place = found.case.shell_of(material).states[-1], np.array([coordinates(material)])
    gravity = float(np.linalg.norm(law.gravity)) / law.density
    left = []
    for at in until * (np.arange(RESIDUALS) + 0.5) / RESIDUALS:
        weights, second = (found.weights(material, float(at), order) for order in (0, 2))
        left.append(float(np.linalg.norm(second - law.accelerations(weights[None], place)[0])) / gravity)
    return max(left)


def _seconds_each(found: ConditionedMotion) -> float:
    """Return the wall time of one answer, s."""
    start = time.perf_counter()
    for number in range(ASKED_TIMES):
        found.value(number % len(found.case.materials), found.case.states[-1])
    return (time.perf_counter() - start) / ASKED_TIMES
