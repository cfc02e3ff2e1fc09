"""The solution of the published training of a motion: one field, continuous in space and time.

The file of a trained motion: its weights as safetensors, all other data as JSON in their header.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from torch import Tensor

from shellbench.errors import InputError
from shellbench.problem import NumberFormat
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.contact import Touch
from shellbench.problems.shell.solution import time_reached
from shellbench.protocol.schema import Positive
from shellbench.solvers.ndf.field.choices import SavedPeriodicInput, StrainName
from shellbench.solvers.ndf.field.jets import COMPONENTS, Array
from shellbench.solvers.ndf.field.quadrature import NOWHERE, RuleSpec, area_rule
from shellbench.solvers.ndf.field.supports import force_density
from shellbench.solvers.ndf.field.weights import (
    CaseHeader,
    check_like_numbers,
    fits_format,
    input_errors,
    read_tensors,
    rounded_tensors,
    texts_of,
    write_tensors,
)
from shellbench.solvers.ndf.linear.solution import FieldSolution, field_by_name, strain_data
from shellbench.solvers.ndf.published.published_motion_field import MotionField, contact_forces
from shellbench.solvers.ndf.published.published_network import Siren

MOTION_HEADER = "shellbench-motion"


class MotionHeader(CaseHeader):
    """Data of a file beside its weights."""

    format: Literal["shellbench-ndf-motion-1"] = "shellbench-ndf-motion-1"
    periodic_input: SavedPeriodicInput
    omega0: Positive
    strain: StrainName


def tensors_of(siren: Siren) -> dict[str, Tensor]:
    """Return weights and biases by the names they have in a file."""
    groups = (("weight", siren.weights), ("bias", siren.biases))
    return {f"{name}.{k}": tensor for name, group in groups for k, tensor in enumerate(group)}


def write_motion(path: Path, header: MotionHeader, siren: Siren) -> Path:
    """Write a file; return it with its suffix."""
    target = path.with_suffix(".safetensors")
    write_tensors(target, tensors_of(siren), {MOTION_HEADER: header.model_dump_json()})
    return target


def is_motion(path: Path) -> bool:
    """Return True if a file is that of a motion; False if it can't be read."""
    return MOTION_HEADER in texts_of(path)


def read_motion(path: Path, solver: str) -> tuple[MotionHeader, Case, Siren]:
    """Read a file of `write_motion`.

    Raises
    ------
    InputError
        In one sentence, if the file is not a complete and consistent motion of this solver.
    """
    texts, tensors = read_tensors(path)
    with input_errors(path):
        header = MotionHeader.model_validate_json(texts.get(MOTION_HEADER, ""))
        case = header.read_case()
        check_like_numbers(tensors)
        layers = range(len(tensors) // 2)
        weights, biases = (tuple(tensors[f"{name}.{k}"] for k in layers) for name in ("weight", "bias"))
        siren = Siren(weights, biases, header.omega0)
        if not _layers_fit(siren):
            raise ValueError("its weights do not fit each other")
        if case.dynamics is None:
            raise ValueError("nothing moves in its case")
    if header.solver != solver:
        raise InputError(f"{path}: was written by solver '{header.solver}', not by '{solver}'")
    return header, case, siren


def _layers_fit(siren: Siren) -> bool:
    """Return True if the layers fit each other and end in three outputs."""
    width: int | None = None
    for weight, bias in zip(siren.weights, siren.biases, strict=True):
        if weight.ndim != 2 or bias.shape != weight.shape[:1] or weight.shape[1] != (width or weight.shape[1]):
            return False
        width = weight.shape[0]
    return width == COMPONENTS


MOTION_QUERY = 4096  # points that are evaluated at once
ENERGY_RULE = RuleSpec((12, 12), 4)  # of energies and reactions: panels of about sqrt(sigma) on a shell of unit size
INSTANT = 1e-4  # of the final time: distance of the velocities that give an acceleration


@dataclass(frozen=True)
class TrainedMotion(FieldSolution):
    """A trained motion; see `shellbench.problem.Solution` for the protocol.

    Attributes
    ----------
    solver
        Name of the recipe.
    field
        The motion.
    strain
        Strains of its energies.
    """

    solver: str
    field: MotionField
    strain: StrainName

    @property
    def case(self) -> Case:
        """The case it answers."""
        return self.field.ansatz.case

    @property
    def parameters(self) -> int:
        """Number of weights and biases."""
        return self.field.siren.parameters

    def tensors(self) -> dict[str, Tensor]:
        """Return weights and biases by the names they have in a file."""
        return tensors_of(self.field.siren)

    def displacement_at(self, xi: Array, at: float | None) -> Array:
        """Return the displacement (N, 3) at points (N, 2) and time `at`, s."""
        t = self._time(at)
        return self.in_portions(xi, lambda part: self.field.displacement(part, t), MOTION_QUERY)

    def velocity_at(self, xi: Array, at: float | None) -> Array:
        """Return the velocity (N, 3) at points (N, 2)."""
        t = self._time(at)
        return self.in_portions(xi, lambda part: self.field.velocity(part, t), MOTION_QUERY)

    def field_at(self, name: str, xi: Array, at: float | None) -> Array:
        """Return strains (N, 3) or energy densities (N,) at points (N, 2)."""
        t = self._time(at)

        def asked(xi: Array) -> Tensor:
            jet = self.field.planes(xi, t)[:6]
            return field_by_name(name, *strain_data(self.case, xi, self.field.placement, jet, self.strain))

        return self.in_portions(xi, asked, MOTION_QUERY)

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Return the membrane and the bending part of the strain energy of the whole shell, J."""
        points, weights = self._rule()
        membrane, bending = (
            float(weights @ self.evaluate(f"{part}_energy_density", points, at)) for part in ("membrane", "bending")
        )
        return membrane, bending

    def touch(self, at: float | None = None) -> Touch:
        """Return the contact forces of the loss of collisions, at points that stand for square patches."""
        t, (points, weights) = self._time(at), self._rule()
        forces = contact_forces(self.case, points, weights, t, self.displacement(points, t))
        lengths = np.repeat(np.sqrt(weights)[:, None], 2, axis=1)
        return Touch(points, forces, lengths, 2 * lengths.max(axis=0))

    def reaction_at(self, number: int, centre: Array, at: float | None) -> tuple[Array, Array]:
        """Return force (3,) in N and moment (3,) about `centre` in N m that the only support exerts on the shell.

        They follow from Newton's law for the given motion: the rate of change of momentum, less the loads and the
        forces of springs. The functional itself balances no forces in time.

        Raises
        ------
        InputError
            If the support is not the only one.
        """
        if len(self.case.supports) > 1:
            name = self.case.supports[number].name
            raise InputError(f"a trained motion does not tell the reaction of '{name}' from that of other supports")
        t, until = self._time(at), self.field.ansatz.until
        points, weights = self._rule()
        before, after = max(0.0, t - INSTANT * until), min(until, t + INSTANT * until)
        gained = (self.velocity(points, after) - self.velocity(points, before)) / (after - before)
        u = self.displacement(points, t)
        force = self.case.material.areal_density * gained - force_density(self.case, points, t)
        force = (force + self.case.spring_stiffness(points) * u) * weights[:, None]
        if self.case.obstacles:
            force = force - contact_forces(self.case, points, weights, t, u)
        arm = self.case.surface.position(points) + u - centre
        return force.sum(axis=0), np.cross(arm, force).sum(axis=0)

    def rounded(self, format: NumberFormat) -> tuple[TrainedMotion, int]:
        """Return the motion with all weights and biases rounded to a format, and the bytes it takes.

        Every tensor is scaled by its largest magnitude before (see `shellbench.problems.shell.solution`).
        """
        siren = self.field.siren
        if fits_format(siren.tensors, format):
            return self, self.storage_bytes
        tensors, bytes_taken = rounded_tensors(siren.tensors, format)
        return replace(self, field=replace(self.field, siren=siren.with_tensors(tensors))), bytes_taken

    def save(self, path: Path) -> Path:
        """Write the solution as safetensors, all other data as JSON in its header; return the file with its suffix."""
        header = MotionHeader(
            solver=self.solver,
            **self.facts(),
            periodic_input=self.field.ansatz.inputs.periodic,
            omega0=self.field.siren.omega0,
            strain=self.strain,
        )
        return write_motion(path, header, self.field.siren)

    def _time(self, at: float | None) -> float:
        return time_reached(self.case, self.field.ansatz.until, at)

    def _rule(self) -> tuple[Array, Array]:
        """Return points (N, 2) and weights (N,), m^2, that integrate over the midsurface."""
        rule = area_rule(self.case.surface.domain, NOWHERE, ENERGY_RULE)
        return rule.points, rule.areas(self.case.surface)
