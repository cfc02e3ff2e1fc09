"""The solution of the published training of a motion: one field, continuous in space and time."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from shellbench.errors import InputError
from shellbench.problem import FIELDS, NumberFormat, Step
from shellbench.problems.shell.case import Case
from shellbench.solvers.ndf.choices import StrainName
from shellbench.solvers.ndf.jets import Array
from shellbench.solvers.ndf.loads import force_density
from shellbench.solvers.ndf.published_motion_field import MotionField
from shellbench.solvers.ndf.published_motion_file import MotionHeader, write_motion
from shellbench.solvers.ndf.quadrature import RuleSpec, area_rule
from shellbench.solvers.ndf.rounding import rounded_tensors, short_enough
from shellbench.solvers.ndf.undeformed import Undeformed, stresses

QUERY = 4096  # points that are evaluated at once
FINE = RuleSpec((12, 12), 4)  # of energies and reactions: panels of about sqrt(sigma) on a shell of unit size
INSTANT = 1e-4  # of the final time, between the velocities by which an acceleration is found


@dataclass(frozen=True)
class TrainedMotion:
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
    history: tuple[Step, ...] = ()
    diagnostics: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    uncertainty: Mapping[str, float] = dataclasses.field(default_factory=dict)
    extrapolated: Mapping[str, float] = dataclasses.field(default_factory=dict)

    @property
    def case(self) -> Case:
        """The case it answers."""
        return self.field.ansatz.case

    @property
    def parameters(self) -> int:
        """Number of weights and biases."""
        return self.field.siren.parameters

    @property
    def storage_bytes(self) -> int:
        """Bytes of the weights."""
        return sum(t.numel() * t.element_size() for t in self.field.siren.tensors)

    def displacement(
        self, points: ArrayLike, at: float | None = None, parameters: Mapping[str, float] | None = None
    ) -> Array:
        """Return the displacement (..., 3), metres, at points (..., 2), angles in radians, and time `at`, s."""
        t = self._time(at)
        return self._at(points, lambda xi: self.field.displacement(xi, t))

    def velocity(self, points: ArrayLike, at: float | None = None) -> Array:
        """Return the velocity (..., 3), m/s, at points (..., 2)."""
        t = self._time(at)
        return self._at(points, lambda xi: self.field.velocity(xi, t))

    def evaluate(self, name: str, points: ArrayLike, at: float | None = None) -> Array:
        """Return one of `shellbench.problem.FIELDS` at points (..., 2); KeyError for an unknown name."""
        if name not in FIELDS:
            raise KeyError(name)
        t, part = self._time(at), slice(0, 3) if name.startswith("membrane") else slice(3, 6)

        def strain(xi: Array) -> Tensor:
            surface = Undeformed.of(self.case.surface, xi, self.field.placement)
            gradients = surface.gradients(self.field.planes(xi, t)[:6])
            strains = surface.strained(self.strain, gradients).strains
            if name.endswith("strain"):
                return strains[:, part] * strains.new_tensor([1.0, 1.0, 0.5])
            work = strains * stresses(surface.elasticity(self.case.material), strains)
            return 0.5 * work[:, part].sum(-1)

        return self._at(points, strain)

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Return the membrane and the bending part of the strain energy of the whole shell, J."""
        points, weights = self._rule()
        membrane, bending = (
            float(weights @ self.evaluate(f"{part}_energy_density", points, at)) for part in ("membrane", "bending")
        )
        return membrane, bending

    def reaction(
        self, support: str, centre: ArrayLike = (0.0, 0.0, 0.0), at: float | None = None
    ) -> tuple[Array, Array]:
        """Return force (3,) in N and moment (3,) about `centre` in N m that the only support exerts on the shell.

        They follow from Newton's law for the motion as it is: the rate of change of momentum, less the loads and the
        forces of springs. The functional itself balances no forces in time.

        Raises
        ------
        InputError
            If the support is not known, or is not the only one.
        """
        names = [s.name for s in self.case.supports]
        if support not in names:
            raise InputError(f"support '{support}' is not one of case '{self.case.name}'")
        if len(names) > 1:
            raise InputError(f"a trained motion does not tell the reaction of '{support}' from that of other supports")
        t, until = self._time(at), self.field.ansatz.until
        points, weights = self._rule()
        before, after = max(0.0, t - INSTANT * until), min(until, t + INSTANT * until)
        gained = (self.velocity(points, after) - self.velocity(points, before)) / (after - before)
        u = self.displacement(points, t)
        force = self.case.material.areal_density * gained - force_density(self.case, points, t)
        force = (force + self.case.spring_stiffness(points) * u) * weights[:, None]
        arm = self.case.surface.position(points) + u - np.asarray(centre, dtype=float)
        return force.sum(axis=0), np.cross(arm, force).sum(axis=0)

    def rounded(self, format: NumberFormat) -> tuple[TrainedMotion, int]:
        """Return the motion with all weights and biases rounded to a format, and the bytes it takes.

        Every tensor is scaled by its largest magnitude before (see `shellbench.problems.rounding`).
        """
        siren = self.field.siren
        if short_enough(siren.tensors, format):
            return self, self.storage_bytes
        tensors, bytes_taken = rounded_tensors(siren.tensors, format)
        return replace(self, field=replace(self.field, siren=siren.with_tensors(tensors))), bytes_taken

    def save(self, path: Path) -> Path:
        """Write the solution as safetensors, all else as JSON in its header; return the file with its suffix."""
        header = MotionHeader(
            solver=self.solver,
            case_name=self.case.name,
            case=self.case.model_dump(mode="json", exclude_unset=True, exclude={"name"}),
            periodic_input=self.field.ansatz.inputs.periodic,
            omega0=self.field.siren.omega0,
            strain=self.strain,
            history=tuple(self.history),
            diagnostics=dict(self.diagnostics),
            uncertainty=dict(self.uncertainty),
            extrapolated=dict(self.extrapolated),
        )
        return write_motion(path, header, self.field.siren)

    def _time(self, at: float | None) -> float:
        until = self.field.ansatz.until
        if at is not None and not 0 <= at <= until:
            raise InputError(f"{self.case.name}: moves from 0 to {until:g} s, and was asked for {at:g} s")
        return until if at is None else at

    def _rule(self) -> tuple[Array, Array]:
        """Return points (N, 2) and weights (N,), m^2, that integrate over the midsurface."""
        rule = area_rule(self.case.surface.domain, np.zeros((0, 2)), FINE)
        x = self.case.surface.derivatives(rule.points, 1)
        return rule.points, np.asarray(rule.weights * np.linalg.norm(np.cross(x[1, 0], x[0, 1]), axis=-1))

    def _at(self, points: ArrayLike, function: Callable[[Array], Tensor]) -> Array:
        xi = np.asarray(points, dtype=float)
        flat = self.case.surface.domain.wrap(xi.reshape(-1, 2))
        with torch.no_grad():
            parts = [function(flat[k : k + QUERY]).cpu().numpy() for k in range(0, max(len(flat), 1), QUERY)]
        values = np.concatenate(parts).astype(float)
        return np.asarray(values.reshape((*xi.shape[:-1], *values.shape[1:])))
