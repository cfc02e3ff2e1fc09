"""The solution of a motion: continuous over the shell and in time.

Output weights are kept at the accepted time steps with their first and second derivatives. Between two steps they are
the polynomial of the fifth degree with all six values (quintic Hermite interpolation): displacement, velocity and
acceleration are continuous, and the error of the displacement is of the sixth power of the step. Prescribed motions of
edges are evaluated at the requested time itself.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import cast

import numpy as np
import torch
from torch import Tensor

from shellbench.problem import NumberFormat
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.solution import time_reached
from shellbench.solvers.ndf.field.ansatz import Ansatz, Combined
from shellbench.solvers.ndf.field.build import build_ansatz, build_inputs
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.field import Features, Field
from shellbench.solvers.ndf.field.jets import VALUE, Array
from shellbench.solvers.ndf.field.network import Network
from shellbench.solvers.ndf.field.quadrature import NOWHERE, RuleSpec
from shellbench.solvers.ndf.field.supports import point_supports
from shellbench.solvers.ndf.field.weights import (
    Header,
    fits_format,
    input_errors,
    network_of,
    network_tensors,
    read,
    rounded_network,
    rounded_tensors,
    write,
)
from shellbench.solvers.ndf.linear.solution import FieldSolution, NdfSolution, PathSolution, features_of, read_states
from shellbench.solvers.ndf.motion.motion_parts import Energies
from shellbench.solvers.ndf.motion.motion_problem import Motion
from shellbench.solvers.ndf.motion.products import PRODUCT_TENSORS, Products

MOTION_TENSORS = ("times", "output", "rates", "seconds")  # tensors of a motion, beside those of its features


@dataclass(frozen=True)
class Course:
    """Output weights over time.

    Attributes
    ----------
    times
        (K,), increasing from 0, s.
    weights, rates, seconds
        (K, 3, M) output weights with their first and second derivatives in time.
    """

    times: Array
    weights: Tensor
    rates: Tensor
    seconds: Tensor

    def at(self, t: float, order: int = 0) -> Tensor:
        """Return a derivative (3, M) in time, at any time between the first and the last."""
        last = max(len(self.times) - 2, 0)
        k = min(max(int(np.searchsorted(self.times, t, side="right")) - 1, 0), last)
        if len(self.times) == 1:
            return (self.weights, self.rates, self.seconds)[order][0]
        step = float(self.times[k + 1] - self.times[k])
        shares = quintic((t - float(self.times[k])) / step, order) / step**order
        total = torch.zeros_like(self.weights[0])
        for side in (0, 1):
            for degree, values in enumerate((self.weights, self.rates, self.seconds)):
                total = total + float(shares[3 * side + degree]) * step**degree * values[k + side]
        return total


def quintic(s: float, order: int) -> Array:
    """Return the weights (6,) of value, slope and second derivative at 0 and 1 in quintic Hermite interpolation."""
    powers = np.zeros((3, 6))  # rows: conditions at 1; the first three coefficients are those at 0
    for row in range(3):
        for power in range(6):
            powers[row, power] = np.prod(np.arange(power, power - row, -1))
    coefficients = np.zeros((6, 6))  # of the powers of s, by condition
    coefficients[:3, :3] = np.diag([1.0, 1.0, 0.5])
    coefficients[3:, :3] = np.linalg.solve(powers[:, 3:], -powers[:, :3] @ coefficients[:3, :3])
    coefficients[3:, 3:] = np.linalg.inv(powers[:, 3:])
    monomials = [np.prod(np.arange(p, p - order, -1)) * s ** (p - order) if p >= order else 0.0 for p in range(6)]
    return np.asarray(monomials @ coefficients)


@dataclass(frozen=True)
class MotionSolution(FieldSolution):
    """A field in motion; see `shellbench.problem.Solution` for the protocol.

    Attributes
    ----------
    solver
        Name of the recipe.
    spec
        The choices from which the field is rebuilt.
    features
        Its combinations of the network's features.
    course
        Their output weights.
    rule
        The fine quadrature of energies and reactions.
    parameters
        Number of output weights of the equations of motion, at each time.
    """

    case: Case
    solver: str
    spec: FieldSpec
    features: Combined | Products
    course: Course
    rule: RuleSpec
    parameters: int

    def time(self, at: float | None) -> float:
        """Return a time that the motion has reached, its end if None; InputError if it has not reached it."""
        return time_reached(self.case, float(self.course.times[-1]), at)

    def displacement_at(self, xi: Array, at: float | None) -> Array:
        """Return the displacement (N, 3) at points (N, 2)."""
        return self._state(self.time(at)).displacement_at(xi, None)

    def velocity_at(self, xi: Array, at: float | None) -> Array:
        """Return the velocity (N, 3) at points (N, 2)."""
        return self._rate(xi, self.time(at), 1)

    def _rate(self, xi: Array, t: float, order: int) -> Array:
        """Return a derivative in time (N, 3) of the displacement at points (N, 2)."""
        flat = self.case.surface.domain.wrap(xi)
        state = self._state(t)
        still = replace(state.field, output=self._output(t, order))
        moved = replace(state, field=still).displacement_at(xi, None)
        if still.ansatz.lift.moves:
            placement = self.features.placement

            def lift(time: float) -> Tensor:
                return self._motion.ansatz(time).lift.jet(flat, placement)[VALUE]

            moved = moved + (self._motion.rate(lift, t, order) - lift(t)).cpu().numpy()
        return moved

    def field_at(self, name: str, xi: Array, at: float | None) -> Array:
        """Return strains (N, 3) or energy densities (N,) at points (N, 2)."""
        return self._state(self.time(at)).field_at(name, xi, None)

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Return the membrane and the bending part of the strain energy of the whole shell, J."""
        found = self.balance(self.time(at))
        return found.membrane, found.bending

    @cached_property
    def balance(self) -> Callable[[float], Energies]:
        """All parts of the energy at a time, on the fine quadrature."""

        def found(t: float) -> Energies:
            with torch.no_grad():
                w, rate = (self.course.at(t, order).reshape(-1) for order in (0, 1))
                return self._motion.energies(w, rate, t)

        return lru_cache(maxsize=64)(found)

    @cached_property
    def _motion(self) -> Motion:
        return Motion(self.case, self.spec, self.features, self.rule)

    def reaction_at(self, number: int, centre: Array, at: float | None) -> tuple[Array, Array]:
        """Return force (3,) in N and moment (3,) about `centre` in N m that a support exerts on the shell.

        Raises
        ------
        InputError
            If it can't be separated from that of another support.
        """
        t = self.time(at)
        state = replace(self._state(t), point_forces=tuple(self._point_forces(t)))

        def lag(points: Array) -> Array:
            """Inertia, damping by mass and springs as a force per area, N/m^2."""
            springs = self.case.spring_stiffness(points) * state.displacement(points)
            lag = self._rate(points, t, 2) + self._motion.dynamics.mass_damping * self._rate(points, t, 1)
            return -self.case.material.areal_density * lag - springs

        with torch.no_grad():
            return state.support_reaction(number, centre, NOWHERE, lag)

    def _point_forces(self, t: float) -> Array:
        """Return the forces (k,) of the point supports, N."""
        if not point_supports(self.case):
            return np.zeros(0)
        with torch.no_grad():
            w, rate, second = (self.course.at(t, order).reshape(-1) for order in range(3))
            return np.asarray(self._motion.support_forces(w, rate, second, t).cpu().numpy())

    def _output(self, t: float, order: int = 0) -> Tensor:
        """Return the output weights (3, M) of the network itself, or of products, or their derivative."""
        found = self.course.at(t, order)
        return found @ self.features.combine.T if isinstance(self.features, Combined) else found

    def _state(self, t: float) -> NdfSolution:
        """Return the field at a time as a solution of its own."""
        spec = self.spec.model_copy(update={"t": t})
        # Products have the methods of features that a field at rest needs here: values and jets.
        features = self.features.features if isinstance(self.features, Combined) else self.features
        output = self._output(t)
        return NdfSolution(
            case=self.case,
            solver=self.solver,
            spec=spec,
            field=Field(build_ansatz(self.case, spec), cast(Features, features), output, output.new_zeros(6)),
            rule=self.rule,
            membrane=float("nan"),
            bending=float("nan"),
            parameters=self.parameters,
        )

    def rounded(self, format: NumberFormat) -> tuple[MotionSolution, int]:
        """Return the motion with all weights, at all times and with their derivatives, rounded, and the bytes it takes.

        Every tensor is scaled by its largest magnitude before (see `rounding`). The times, of which there are few, are
        not rounded.
        """
        if fits_format(self.tensors().values(), format):
            return self, self.storage_bytes
        features, course = self.features, self.course
        network, hidden = rounded_network(self._network, format)
        combine = list(features.combine) if isinstance(features, Products) else [features.combine]
        moving = [course.weights, course.rates, course.seconds]
        (*combine, weights, rates, seconds), taken = rounded_tensors([*combine, *moving], format)
        if isinstance(features, Products):
            features = replace(features, network=network, combine=(combine[0], combine[1]))
            taken += features.pairs.numel() * combine[0].element_size() + features.degrees.nbytes
        else:
            assert isinstance(features.features, Features)
            features = Combined(replace(features.features, network=network), combine[0])
        motion = replace(self, features=features, course=Course(course.times, weights, rates, seconds))
        return motion, hidden + taken + course.times.nbytes

    @property
    def _network(self) -> Network:
        """The hidden layer."""
        if isinstance(self.features, Products):
            return self.features.network
        assert isinstance(self.features.features, Features)
        return self.features.features.network

    def tensors(self) -> dict[str, Tensor]:
        """Return the tensors that the field is made of, by the names they have in a file."""
        features, course = self.features, self.course
        combine = features.tensors() if isinstance(features, Products) else {"combine": features.combine}
        moving = (torch.as_tensor(course.times), course.weights, course.rates, course.seconds)
        return {**network_tensors(self._network), **combine, **dict(zip(MOTION_TENSORS, moving, strict=True))}

    def save(self, path: Path) -> Path:
        """Write the solution as safetensors, all other data as JSON in its header; return the file with its suffix."""
        header = Header(
            solver=self.solver,
            **self.facts(),
            spec=self.spec,
            activation=self._network.activation,
            rule=self.rule,
            membrane=0.0,
            bending=0.0,
            parameters=self.parameters,
            point_forces=(),
            moving=True,
        )
        return write(path, header, self.tensors())


def read_motion(path: Path, header: Header, tensors: Mapping[str, Tensor]) -> MotionSolution:
    """Return the motion of a file.

    Raises
    ------
    InputError
        In one sentence, if it is not a complete and consistent motion.
    """
    with input_errors(path):
        case = header.read_case()
        if any(name not in tensors for name in MOTION_TENSORS):
            raise ValueError("its motion is not whole")
        features = _features_of(case, header, tensors)
        times, *course = (tensors[name] for name in MOTION_TENSORS)
        if times.ndim != 1 or not len(times):
            raise ValueError("its tensors do not fit each other")
        if any(values.shape != (len(times), 3, features.count) for values in course):
            raise ValueError("its tensors do not fit each other")
        if times[0] != 0 or bool((times.diff() <= 0).any()):
            raise ValueError("its times do not increase from 0")
    return MotionSolution(
        case=case,
        solver=header.solver,
        spec=header.spec,
        features=features,
        course=Course(times.numpy(), *course),
        rule=header.rule,
        parameters=header.parameters,
        **header.course(),
    )


def _features_of(case: Case, header: Header, tensors: Mapping[str, Tensor]) -> Combined | Products:
    """Return the features of a motion's file; ValueError if its tensors do not match each other."""
    if "combine" in tensors:
        features, combine = features_of(case, header, tensors), tensors["combine"]
        if combine.ndim != 2 or len(combine) != features.count:
            raise ValueError("its tensors do not fit each other")
        return Combined(features, combine)
    if any(name not in tensors for name in PRODUCT_TENSORS):
        raise ValueError("its motion is not whole")
    inputs = build_inputs(case, header.spec)
    return Products.from_tensors(inputs, network_of(tensors, header.activation, inputs.count), tensors)


def load_solution(
    path: Path, solver: str, ansatz_of: Callable[[Case, FieldSpec], Ansatz] = build_ansatz
) -> NdfSolution | PathSolution | MotionSolution:
    """Read a field at rest, on a path or in motion; `ansatz_of` builds the supports in like the recipe.

    Raises
    ------
    InputError
        In one sentence, if the file is not a complete and consistent solution of this solver.
    """
    header, tensors = read(path, solver)
    if header.moving:
        return read_motion(path, header, tensors)
    states = read_states(path, header, tensors, ansatz_of)
    if not header.states:
        return replace(states[0], **header.course())
    return PathSolution(marks=tuple(s.mark for s in header.states), states=states, **header.course())
