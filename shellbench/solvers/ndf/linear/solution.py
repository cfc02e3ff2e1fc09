"""The solution of every neural recipe: a continuous field that can be evaluated anywhere, and kept in one file.

Along a path it is one field at each kept mark, all with the same features.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from dataclasses import field as kept
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from shellbench.problem import NumberFormat
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.contact import Touch, kept_touch, restored_touch
from shellbench.problems.shell.solution import ShellSolution, state_number
from shellbench.solvers.ndf.field.ansatz import Ansatz
from shellbench.solvers.ndf.field.build import build_features, build_inputs, graded_points
from shellbench.solvers.ndf.field.choices import FieldSpec, StrainName
from shellbench.solvers.ndf.field.field import Features, Field
from shellbench.solvers.ndf.field.jets import Array, Placement
from shellbench.solvers.ndf.field.quadrature import RuleSpec, area_rule
from shellbench.solvers.ndf.field.supports import point_supports
from shellbench.solvers.ndf.field.weights import (
    Header,
    StateHeader,
    fits_format,
    input_errors,
    network_of,
    network_tensors,
    rounded_network,
    rounded_tensors,
    write,
)
from shellbench.solvers.ndf.linear.patches import Balances, Recovery
from shellbench.solvers.ndf.strains.reaction import edge_reaction
from shellbench.solvers.ndf.strains.strain_measures import Undeformed

QUERY = 2048  # points at which values are computed at once: more would not fit into the processor's cache
JETS = 512  # the same for jets, which are six times as large


@dataclass(frozen=True)
class FieldSolution(ShellSolution):
    """Base of the solutions of all recipes: tensors, and values at points, computed in portions."""

    @property
    def storage_bytes(self) -> int:
        """Bytes of the tensors that the field is made of."""
        return sum(t.numel() * t.element_size() for t in self.tensors().values())

    def tensors(self) -> dict[str, Tensor]:
        """Return the tensors that the field is made of, by the names they have in a file."""
        raise NotImplementedError

    def in_portions(self, xi: Array, function: Callable[[Array], Tensor], at_once: int = QUERY) -> Array:
        """Return values (N, ...) of a function of points (N, 2) within the domain, so many points at once."""
        flat = self.case.surface.domain.wrap(xi)
        with torch.no_grad():
            parts = [function(flat[k : k + at_once]).cpu().numpy() for k in range(0, max(len(flat), 1), at_once)]
        return np.concatenate(parts).astype(float)


def strain_data(case: Case, xi: Array, placement: Placement, jet: Tensor, measure: StrainName) -> tuple[Tensor, Tensor]:
    """Return membrane and bending strains (N, 6) of a displacement jet at points (N, 2), and their energy densities."""
    surface = Undeformed.at_points(case.surface, xi, placement)
    strains = surface.strained(measure, surface.gradients(jet)).strains
    return strains, surface.respond(case.material, strains)[1]


def field_by_name(name: str, strains: Tensor, densities: Tensor) -> Tensor:
    """Return the result of `evaluate`: covariant strains (N, 3), or an energy density (N,)."""
    part = slice(0, 3) if name.startswith("membrane") else slice(3, 6)
    if name.endswith("strain"):
        return strains[:, part] * strains.new_tensor([1.0, 1.0, 0.5])
    return densities[:, part].sum(-1)


@dataclass(frozen=True)
class NdfSolution(FieldSolution):
    """A solved neural deformation field; see `shellbench.problem.Solution` for the protocol.

    The file has all tensors that `displacement` needs, including those of a fixed random layer: a seed would tie a file
    to one version of a random number generator.

    Attributes
    ----------
    solver
        Name of the recipe.
    spec
        The choices from which the field is rebuilt.
    rule
        The fine quadrature of energies and reactions.
    membrane, bending
        Parts of the strain energy on that quadrature, J; NaN if they are integrated on demand.
    point_forces
        (k,) forces of the point supports, N, in the order of `shellbench.solvers.ndf.field.supports.point_supports`.
    touching
        Contact forces; None without obstacles.
    balances
        Data of stress resultants on patches that depend on the case and its supports only.
    """

    case: Case
    solver: str
    spec: FieldSpec
    field: Field
    rule: RuleSpec
    membrane: float
    bending: float
    parameters: int
    point_forces: tuple[float, ...] = ()
    touching: Touch | None = None
    balances: Balances = kept(default_factory=dict, compare=False, repr=False)

    def touch(self, at: float | None = None) -> Touch:
        """Return the contact forces of obstacles on the shell."""
        return super().touch(at) if self.touching is None else self.touching

    def displacement_at(self, xi: Array, at: float | None) -> Array:
        """Return the displacement (N, 3) at points (N, 2)."""
        mirrors = self.field.ansatz.mirrors  # points that are each other's images count once
        return self.in_portions(xi, self.field.displacement, QUERY * (mirrors.parts if mirrors else 1))

    def field_at(self, name: str, xi: Array, at: float | None) -> Array:
        """Return strains (N, 3) or energy densities (N,) at points (N, 2)."""
        key = xi.tobytes()
        if key not in self._last_strains:
            self._last_strains.clear()
            self._last_strains[key] = self.in_portions(xi, lambda part: torch.cat(self._strain_data(part), dim=1), JETS)
        both = torch.from_numpy(self._last_strains[key])
        return field_by_name(name, both[:, :6], both[:, 6:]).numpy()

    def resultant_at(self, name: str, xi: Array, at: float | None) -> Array:
        """Return membrane forces or moments (N, 3), or shear forces (N, 2), at points (N, 2)."""
        finer: Array = self.recovered_resultants(name, xi)[1]
        return finer

    def recovered_resultants(self, name: str, xi: Array) -> Array:
        """Return resultants (2, N, ...) at points (N, 2), coarser and finer; see `Recovery.resultants`."""
        with torch.no_grad():
            return self._recovery.resultants(name, self.case.surface.domain.wrap(xi))

    @cached_property
    def _last_strains(self) -> dict[bytes, Array]:
        """Strains and energy densities (N, 12) at the last points, cached."""
        return {}

    @cached_property
    def _recovery(self) -> Recovery:
        linear = self.case.linear and self.spec.strain == "linear"
        still = self.case.dynamics is None and not self.case.modal and self.touching is None
        return Recovery(self.field, self.spec.strain, linear and still, self.balances)

    def _strain_data(self, xi: Array) -> tuple[Tensor, Tensor]:
        """Return membrane and bending strains (N, 6) at points (N, 2), and the energy density of each of them."""
        placement = self.field.features.placement
        return strain_data(self.case, xi, placement, self.field.jet(xi), self.spec.strain)

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Return the membrane and the bending part of the strain energy of the whole shell, J."""
        return self._integrated_energies if math.isnan(self.membrane) else (self.membrane, self.bending)

    @cached_property
    def _integrated_energies(self) -> tuple[float, float]:
        rule = area_rule(self.case.surface.domain, graded_points(self.case, self.spec), self.rule)
        parts = rule.areas(self.case.surface) @ self.in_portions(rule.points, lambda xi: self._strain_data(xi)[1], JETS)
        return float(parts[:3].sum()), float(parts[3:].sum())

    def reaction_at(self, number: int, centre: Array, at: float | None) -> tuple[Array, Array]:
        """Return force (3,) in N and moment (3,) about `centre` in N m that a support exerts on the shell.

        Raises
        ------
        InputError
            If it can't be separated from that of another support.
        """
        return self.support_reaction(number, centre, graded_points(self.case, self.spec))

    def support_reaction(
        self, number: int, centre: Array, focal: Array, lag: Callable[[Array], Array] | None = None
    ) -> tuple[Array, Array]:
        """Return force and moment of a support: along its edges by virtual work, and those of its points.

        `focal` (k, 2) are points toward which quadrature is graded; `lag` returns further forces per area, N/m^2.
        """
        support, held = self.case.supports[number], np.asarray(self.point_forces)
        total = edge_reaction(self.field, support, centre, self.rule, focal, held, self.spec.strain, lag, self.touching)
        force, moment = total[:3], total[3:]
        for at_point, magnitude in zip(point_supports(self.case, self.spec.t), held, strict=True):
            if at_point.support.name == support.name:
                push = magnitude * np.eye(3)[at_point.component]
                point = np.asarray(at_point.point.xi)
                arm = self.case.surface.position(point) - centre
                if self.spec.strain != "linear" or self.case.dynamics:
                    arm = arm + self.displacement(point)
                force, moment = force + push, moment + np.cross(arm, push)
        return force, moment

    def rounded(self, format: NumberFormat) -> tuple[NdfSolution, int]:
        """Return the field with all its weights, those of hidden layers included, rounded, and the bytes it takes.

        Every tensor is scaled by its largest magnitude before (see `shellbench.problems.shell.solution`).
        """
        if fits_format(self.tensors().values(), format):
            return self, self.storage_bytes
        network, hidden = rounded_network(self.field.features.network, format)
        features = replace(self.field.features, network=network)
        last, bytes_taken = self.with_rounded_features(features, format)
        return last, hidden + bytes_taken

    def with_rounded_features(self, features: Features, format: NumberFormat) -> tuple[NdfSolution, int]:
        """Return the field on already rounded features, and the bytes of output weights and rigid motion."""
        (output, rigid), bytes_taken = rounded_tensors([self.field.output, self.field.rigid], format)
        field = Field(self.field.ansatz, features, output, rigid)
        return replace(self, field=field, membrane=float("nan"), bending=float("nan")), bytes_taken

    @property
    def header(self) -> Header:
        """Data of a file beside its tensors."""
        return Header(
            solver=self.solver,
            **self.facts(),
            spec=self.spec,
            activation=self.field.features.network.activation,
            rule=self.rule,
            membrane=self.membrane,
            bending=self.bending,
            parameters=self.parameters,
            point_forces=tuple(self.point_forces),
        )

    def save(self, path: Path) -> Path:
        """Write the solution as safetensors, all other data as JSON in its header; return the file with its suffix."""
        touched = {} if self.touching is None else kept_touch([self.touching])
        return write(path, self.header, {**self.tensors(), **{k: torch.as_tensor(v) for k, v in touched.items()}})

    def tensors(self) -> dict[str, Tensor]:
        """Return the tensors that the field is made of, by the names they have in a file."""
        layers = network_tensors(self.field.features.network)
        return {**layers, "output": self.field.output, "rigid": self.field.rigid}


def features_of(case: Case, header: Header, tensors: Mapping[str, Tensor]) -> Features:
    """Return the features of a file.

    Raises
    ------
    ValueError
        If its layers do not match each other or the case.
    """
    inputs = build_inputs(case, header.spec)
    network = network_of(tensors, header.activation, inputs.count)
    placement = Placement(torch.device("cpu"), network.weights[0].dtype)
    return build_features(case, header.spec, network, placement, inputs)


def read_states(
    path: Path,
    header: Header,
    tensors: Mapping[str, Tensor],
    ansatz_of: Callable[[Case, FieldSpec], Ansatz],
) -> tuple[NdfSolution, ...]:
    """Return the field of a file, or the fields of all states of a path, without their history.

    `ansatz_of` builds the supports in like the recipe.

    Raises
    ------
    InputError
        In one sentence, if the file is not a complete and consistent solution.
    """
    with input_errors(path):
        case = header.read_case()
        features = features_of(case, header, tensors)
        output, rigid = tensors.get("output"), tensors.get("rigid")
        many = (len(header.states),) if header.states else ()
        expected = (*many, 3, features.count), (*many, 6)
        if output is None or rigid is None or (output.shape, rigid.shape) != expected:
            raise ValueError("its tensors do not fit each other")
        touching = restored_touch({name: tensor.numpy() for name, tensor in tensors.items()})
    one = StateHeader(
        mark=header.spec.t,
        t=header.spec.t,
        membrane=header.membrane,
        bending=header.bending,
        point_forces=header.point_forces,
    )
    solutions: list[NdfSolution] = []
    for state, weights, motion in zip(
        header.states or (one,), output.view(-1, 3, features.count), rigid.view(-1, 6), strict=True
    ):
        spec = header.spec.model_copy(update={"t": state.t})
        solutions.append(
            NdfSolution(
                case=case,
                solver=header.solver,
                spec=spec,
                field=Field(ansatz_of(case, spec), features, weights, motion),
                rule=header.rule,
                membrane=state.membrane,
                bending=state.bending,
                parameters=header.parameters,
                point_forces=state.point_forces,
                touching=touching[len(solutions)] if touching else None,
            )
        )
    return tuple(solutions)


@dataclass(frozen=True)
class PathSolution(FieldSolution):
    """Fields at increasing marks; see `shellbench.problem.Solution` for the protocol.

    Attributes
    ----------
    marks
        Load factors, or values of the path's displacement quantity.
    states
        The field at each of them; its `spec.t` is the load factor.
    """

    marks: tuple[float, ...]
    states: tuple[NdfSolution, ...]

    @property
    def case(self) -> Case:
        """The case it answers."""
        return self.states[-1].case

    @property
    def parameters(self) -> int:
        """Number of output weights that were solved for at each state, and of those that were trained."""
        return self.states[-1].parameters

    def state(self, at: float | None) -> NdfSolution:
        """Return the state at a mark, the last one if None; InputError if the case has no state there."""
        return self.states[state_number(self.case, self.marks, at)]

    def displacement_at(self, xi: Array, at: float | None) -> Array:
        """Return the displacement (N, 3) at points (N, 2)."""
        return self.state(at).displacement_at(xi, None)

    def field_at(self, name: str, xi: Array, at: float | None) -> Array:
        """Return strains (N, 3) or energy densities (N,) at points (N, 2)."""
        return self.state(at).field_at(name, xi, None)

    def resultant_at(self, name: str, xi: Array, at: float | None) -> Array:
        """Return membrane forces or moments (N, 3), or shear forces (N, 2), at points (N, 2)."""
        return self.state(at).resultant_at(name, xi, None)

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Return the membrane and the bending part of the strain energy of the whole shell, J."""
        return self.state(at).energies()

    def reaction_at(self, number: int, centre: Array, at: float | None) -> tuple[Array, Array]:
        """Return force (3,) in N and moment (3,) about `centre` in N m that a support exerts on the shell."""
        return self.state(at).reaction_at(number, centre, None)

    def touch(self, at: float | None = None) -> Touch:
        """Return the contact forces of obstacles on the shell."""
        return self.state(at).touch()

    def tensors(self) -> dict[str, Tensor]:
        """Return the tensors of the features, which all states share, and those of all states."""
        return {
            **self.states[-1].tensors(),
            "output": torch.stack([s.field.output for s in self.states]),
            "rigid": torch.stack([s.field.rigid for s in self.states]),
        }

    def rounded(self, format: NumberFormat) -> tuple[PathSolution, int]:
        """Return the path with all weights rounded to a format, and the bytes it takes; see `NdfSolution.rounded`."""
        if all(fits_format(state.tensors().values(), format) for state in self.states):
            return self, self.storage_bytes
        last, bytes_taken = self.states[-1].rounded(format)
        states = [last]
        for state in self.states[-2::-1]:
            before, more = state.with_rounded_features(last.field.features, format)
            states.insert(0, before)
            bytes_taken += more
        return replace(self, states=tuple(states)), bytes_taken

    def save(self, path: Path) -> Path:
        """Write the solution as safetensors, all other data as JSON in its header; return the file with its suffix."""
        headers = tuple(
            StateHeader(
                mark=mark, t=s.spec.t, membrane=s.membrane, bending=s.bending, point_forces=tuple(s.point_forces)
            )
            for mark, s in zip(self.marks, self.states, strict=True)
        )
        header = self.states[-1].header.model_copy(update={**self.facts(), "states": headers})
        touched = kept_touch([s.touching for s in self.states if s.touching is not None])
        return write(path, header, {**self.tensors(), **{k: torch.as_tensor(v) for k, v in touched.items()}})
