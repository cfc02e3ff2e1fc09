"""The solution of every neural recipe: a continuous field that can be asked anywhere, and kept in one file."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from pydantic import ValidationError
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from shellbench.case import Case
from shellbench.errors import InputError, ShellbenchError
from shellbench.ndf.build import FieldSpec, build_ansatz, build_features, build_inputs, focal_points
from shellbench.ndf.field import Ansatz, Field
from shellbench.ndf.geometry import geometry
from shellbench.ndf.jets import ACTIVATIONS, Array, Placement
from shellbench.ndf.network import Network
from shellbench.ndf.quadrature import RuleSpec
from shellbench.ndf.reaction import edge_reaction
from shellbench.ndf.strain import apply_rows, energy_rows, strain_rows
from shellbench.ndf.supports import point_supports
from shellbench.solution import FIELDS, Step

QUERY = 4096  # points that are evaluated at once
FORMAT = "shellbench-ndf-1"


@dataclass(frozen=True)
class NdfSolution:
    """A solved neural deformation field; see `shellbench.solution.Solution` for the protocol.

    All tensors that `displacement` needs are kept, those of a fixed random layer included: a seed would tie a file to
    one version of a random number generator.

    Attributes
    ----------
    solver
        Name of the recipe.
    spec
        The choices from which the field is rebuilt.
    rule
        The fine quadrature of energies and reactions.
    membrane, bending
        Parts of the strain energy on that quadrature, J.
    point_forces
        (k,) forces of the point supports, N, in the order of `shellbench.ndf.supports.point_supports`.
    """

    case: Case
    solver: str
    spec: FieldSpec
    field: Field
    rule: RuleSpec
    membrane: float
    bending: float
    parameters: int
    history: tuple[Step, ...] = ()
    diagnostics: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    uncertainty: Mapping[str, float] = dataclasses.field(default_factory=dict)
    extrapolated: Mapping[str, float] = dataclasses.field(default_factory=dict)
    point_forces: tuple[float, ...] = ()

    @property
    def storage_bytes(self) -> int:
        """Bytes of the tensors that the field is made of."""
        return sum(t.numel() * t.element_size() for t in self._tensors().values())

    def displacement(
        self, points: ArrayLike, at: float | None = None, parameters: Mapping[str, float] | None = None
    ) -> Array:
        """Return the displacement (..., 3), metres, at points (..., 2), angles in radians."""
        return self._at(points, lambda xi: self.field.displacement(xi))

    def evaluate(self, name: str, points: ArrayLike, at: float | None = None) -> Array:
        """Return one of `shellbench.solution.FIELDS` at points (..., 2); KeyError for an unknown name."""
        if name not in FIELDS:
            raise KeyError(name)
        part = slice(0, 3) if name.startswith("membrane") else slice(3, 6)

        def strain(xi: Array) -> Tensor:
            reference = geometry(self.case.surface, xi, self.field.features.placement)
            if name.endswith("strain"):
                rows = strain_rows(reference)
                return apply_rows(rows, self.field.jet(xi))[:, part] * rows.new_tensor([1.0, 1.0, 0.5])
            rows = energy_rows(reference, self.case.material)
            return 0.5 * (apply_rows(rows, self.field.jet(xi))[:, part] ** 2).sum(-1)

        return self._at(points, strain)

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Return the membrane and the bending part of the strain energy of the whole shell, J."""
        return self.membrane, self.bending

    def reaction(
        self, support: str, centre: ArrayLike = (0.0, 0.0, 0.0), at: float | None = None
    ) -> tuple[Array, Array]:
        """Return force (3,) in N and moment (3,) about `centre` in N m that a support exerts on the shell.

        Raises
        ------
        InputError
            If the support is not known, or its reaction can't be told from that of another one.
        """
        found = [s for s in self.case.supports if s.name == support]
        if not found:
            raise InputError(f"support '{support}' is not one of case '{self.case.name}'")
        origin = np.asarray(centre, dtype=float)
        held = np.asarray(self.point_forces)
        total = edge_reaction(self.field, found[0], origin, self.rule, focal_points(self.case), held)
        force, moment = total[:3], total[3:]
        for at_point, magnitude in zip(point_supports(self.case, self.spec.t), held, strict=True):
            if at_point.support.name == support:
                push = magnitude * np.eye(3)[at_point.component]
                arm = self.case.surface.position(np.asarray(at_point.point.xi)) - origin
                force, moment = force + push, moment + np.cross(arm, push)
        return force, moment

    def save(self, path: Path) -> Path:
        """Write the solution as safetensors, all else as JSON in its header; return the file with its suffix."""
        target = path.with_suffix(".safetensors")
        facts = {
            "format": FORMAT,
            "solver": self.solver,
            "case_name": self.case.name,
            "case": self.case.model_dump(mode="json", exclude={"name"}),
            "spec": self.spec.model_dump(mode="json"),
            "activation": self.field.features.network.activation,
            "rule": asdict(self.rule),
            "membrane": self.membrane,
            "bending": self.bending,
            "parameters": self.parameters,
            "history": [{**asdict(step), "quantities": dict(step.quantities)} for step in self.history],
            "diagnostics": dict(self.diagnostics),
            "uncertainty": dict(self.uncertainty),
            "extrapolated": dict(self.extrapolated),
            "point_forces": list(self.point_forces),
        }
        tensors = {name: tensor.detach().cpu().contiguous() for name, tensor in self._tensors().items()}
        save_file(tensors, target, metadata={"shellbench": json.dumps(facts)})
        return target

    def _tensors(self) -> dict[str, Tensor]:
        network = self.field.features.network
        layers = {f"weight.{k}": w for k, w in enumerate(network.weights)}
        layers |= {f"bias.{k}": b for k, b in enumerate(network.biases)}
        return {**layers, "output": self.field.output, "rigid": self.field.rigid}

    def _at(self, points: ArrayLike, function: Callable[[Array], Tensor]) -> Array:
        xi = np.asarray(points, dtype=float)
        flat = self.case.surface.domain.wrap(xi.reshape(-1, 2))
        with torch.no_grad():
            parts = [function(flat[k : k + QUERY]).cpu().numpy() for k in range(0, max(len(flat), 1), QUERY)]
        values = np.concatenate(parts).astype(float)
        return np.asarray(values.reshape(*xi.shape[:-1], *values.shape[1:]))


def load_solution(
    path: Path, solver: str, ansatz_of: Callable[[Case, FieldSpec], Ansatz] = build_ansatz
) -> NdfSolution:
    """Read what `NdfSolution.save` wrote; `ansatz_of` builds the supports in as the recipe does.

    Raises
    ------
    InputError
        In one sentence, if the file is not a whole and consistent solution of this solver.
    """
    try:
        with safe_open(path, framework="pt") as file:
            facts = json.loads((file.metadata() or {})["shellbench"])
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - not a mapping
        if facts["format"] != FORMAT or facts["solver"] != solver:
            raise InputError(f"it was written as {facts['format']} by solver '{facts['solver']}', not by '{solver}'")
        return _restore(facts, tensors, ansatz_of)
    except InputError as error:
        raise InputError(f"{path}: is not a solution of '{solver}': {error}") from None
    except OSError as error:
        raise InputError(f"{path}: can't be read ({error.strerror or error})") from None
    except (
        SafetensorError,
        ValidationError,
        ShellbenchError,
        KeyError,
        TypeError,
        ValueError,
        AttributeError,
    ) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"{path}: is damaged or not a solution of '{solver}' ({reason[:200]})") from None


def _restore(
    facts: dict[str, Any], tensors: dict[str, Tensor], ansatz_of: Callable[[Case, FieldSpec], Ansatz]
) -> NdfSolution:
    case = Case.model_validate({**facts["case"], "name": facts["case_name"]}, strict=False)
    spec = FieldSpec.model_validate(facts["spec"])
    layers = sum(name.startswith("weight.") for name in tensors)
    weights = tuple(tensors[f"weight.{k}"] for k in range(layers))
    biases = tuple(tensors[f"bias.{k}"] for k in range(layers))
    if facts["activation"] not in ACTIVATIONS:
        raise ValueError("unknown activation")
    placement = Placement(torch.device("cpu"), tensors["output"].dtype)
    inputs = build_inputs(case, spec)
    features = build_features(case, spec, Network(weights, biases, facts["activation"]), placement, inputs)
    _check_shapes(weights, biases, inputs.count)
    if tensors["output"].shape != (3, features.count) or tensors["rigid"].shape != (6,):
        raise ValueError("the tensors do not fit each other")
    if not all(bool(torch.isfinite(t).all()) for t in tensors.values()):
        raise ValueError("the weights are not finite")
    rule = RuleSpec(**{**facts["rule"], "panels": tuple(facts["rule"]["panels"])})
    return NdfSolution(
        case=case,
        solver=facts["solver"],
        spec=spec,
        field=Field(ansatz_of(case, spec), features, tensors["output"], tensors["rigid"]),
        rule=rule,
        membrane=float(facts["membrane"]),
        bending=float(facts["bending"]),
        parameters=int(facts["parameters"]),
        history=tuple(Step(**step) for step in facts["history"]),
        diagnostics=facts["diagnostics"],
        uncertainty=facts["uncertainty"],
        extrapolated=facts["extrapolated"],
        point_forces=tuple(map(float, facts["point_forces"])),
    )


def _check_shapes(weights: tuple[Tensor, ...], biases: tuple[Tensor, ...], inputs: int) -> None:
    width = inputs
    for weight, bias in zip(weights, biases, strict=True):
        if weight.ndim != 2 or weight.shape[1] != width or bias.shape != weight.shape[:1]:
            raise ValueError("the layers do not fit each other")
        width = weight.shape[0]
    if not weights:
        raise ValueError("there are no layers")
