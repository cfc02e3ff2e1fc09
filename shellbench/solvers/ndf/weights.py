"""The file of a field: its tensors as safetensors, all else as JSON in their header."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from torch import Tensor

from shellbench.errors import InputError
from shellbench.model import Finite, Model
from shellbench.problem import Step
from shellbench.problems.shell.case import Case
from shellbench.solvers.ndf.build import FieldSpec
from shellbench.solvers.ndf.jets import activation
from shellbench.solvers.ndf.network import Network
from shellbench.solvers.ndf.quadrature import RuleSpec
from shellbench.solvers.ndf.tensor_file import check_like_numbers, read_tensors, telling_damage, write_tensors

HEADER = "shellbench"


class StateHeader(Model):
    """What a file says of one state of a path; see `shellbench.solvers.ndf.path_solution.PathSolution`."""

    mark: Finite
    t: Finite
    membrane: Finite
    bending: Finite
    point_forces: tuple[Finite, ...]


class CaseHeader(Model):
    """What every file says: the recipe, the case, the history and what came of it."""

    solver: str
    case_name: str
    case: dict[str, Any]
    history: tuple[Step, ...]
    diagnostics: dict[str, Any]
    uncertainty: dict[str, float]
    extrapolated: dict[str, float]

    def read_case(self) -> Case:
        """Return the case; ValidationError if it is not one."""
        return Case.model_validate({**self.case, "name": self.case_name})

    def course(self) -> dict[str, Any]:
        """Return the fields of a solution that say how it came about."""
        return {name: getattr(self, name) for name in ("history", "diagnostics", "uncertainty", "extrapolated")}


class Header(CaseHeader):
    """All that a file says beside its tensors; see `shellbench.solvers.ndf.solution.NdfSolution` for the fields."""

    format: Literal["shellbench-ndf-1"] = "shellbench-ndf-1"
    spec: FieldSpec
    activation: str
    rule: RuleSpec
    membrane: Finite
    bending: Finite
    parameters: int
    point_forces: tuple[Finite, ...]
    states: tuple[StateHeader, ...] = ()
    moving: bool = False


def write(path: Path, header: Header, tensors: Mapping[str, Tensor]) -> Path:
    """Write a file; return it with its suffix."""
    target = path.with_suffix(".safetensors")
    write_tensors(target, tensors, {HEADER: header.model_dump_json()})
    return target


def read(path: Path, solver: str) -> tuple[Header, dict[str, Tensor]]:
    """Read a file.

    Raises
    ------
    InputError
        In one sentence, if it can't be read, is damaged, or was written by another solver.
    """
    texts, tensors = read_tensors(path)
    with telling_damage(path):
        header = Header.model_validate_json(texts.get(HEADER, ""))
        check_like_numbers(tensors)
    if header.solver != solver:
        raise InputError(f"{path}: was written by solver '{header.solver}', not by '{solver}'")
    return header, tensors


def network_tensors(network: Network) -> dict[str, Tensor]:
    """Return the tensors of a network by the names they have in a file."""
    weights = {f"weight.{k}": w for k, w in enumerate(network.weights)}
    return weights | {f"bias.{k}": b for k, b in enumerate(network.biases)}


def network_of(tensors: Mapping[str, Tensor], name: str, inputs: int) -> Network:
    """Return the network of a file.

    Raises
    ------
    ValueError
        If its layers do not fit each other or the number of inputs.
    """
    activation(name)
    layers = range(sum(key.startswith("weight.") for key in tensors))
    if not layers or not all(f"{kind}.{k}" in tensors for k in layers for kind in ("weight", "bias")):
        raise ValueError("its layers are not whole")
    network = Network(tuple(tensors[f"weight.{k}"] for k in layers), tuple(tensors[f"bias.{k}"] for k in layers), name)
    width = inputs
    for weight, bias in zip(network.weights, network.biases, strict=True):
        if weight.ndim != 2 or weight.shape[1] != width or bias.shape != weight.shape[:1]:
            raise ValueError("its layers do not fit each other")
        width = weight.shape[0]
    return network
