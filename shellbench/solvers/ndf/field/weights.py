"""The file of a field: its tensors as safetensors, all other data as JSON in their header.

The module also reads and writes files of tensors: safetensors with texts in their header; nothing is ever unpickled.

It also rounds weights to a shorter floating-point format.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from pydantic import Field, ValidationError
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from shellbench.errors import InputError
from shellbench.problem import NumberFormat, Step
from shellbench.problems.shell.case import Case
from shellbench.problems.shortened import shortened
from shellbench.protocol.schema import Finite, Model, one_sentence
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.jets import activation
from shellbench.solvers.ndf.field.network import Network
from shellbench.solvers.ndf.field.quadrature import RuleSpec


def write_tensors(path: Path, tensors: Mapping[str, Tensor], texts: Mapping[str, str]) -> None:
    """Write a file."""
    kept = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    save_file(kept, path, metadata=dict(texts))


def read_tensors(path: Path) -> tuple[dict[str, str], dict[str, Tensor]]:
    """Return texts and tensors of a file.

    Raises
    ------
    InputError
        In one sentence, if it can't be read, or is no safetensors file.
    """
    try:
        with safe_open(path, framework="pt") as file:
            return dict(file.metadata() or {}), {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except OSError as error:
        raise InputError(f"{path}: can't be read ({error.strerror or error})") from None
    except (SafetensorError, ValueError, RuntimeError) as error:
        raise InputError(f"{path}: is damaged or no safetensors file ({str(error).splitlines()[0][:200]})") from None


def texts_of(path: Path) -> dict[str, str]:
    """Return the texts of a file; empty if it can't be read."""
    try:
        with safe_open(path, framework="pt") as file:
            return dict(file.metadata() or {})
    except (OSError, SafetensorError):
        return {}


@contextmanager
def input_errors(path: Path) -> Iterator[None]:
    """Turn errors of inconsistent data of a file into InputError, in one sentence."""
    try:
        yield
    except ValidationError as error:
        raise InputError(f"{path}: is damaged: {one_sentence(error)}") from None
    except (ValueError, KeyError, TypeError, ArithmeticError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"{path}: is damaged: {reason[:200]}") from None


def write_described(path: Path, tensors: Mapping[str, Tensor], words: Mapping[str, Any]) -> Path:
    """Write tensors, and words as JSON in the header; return the path with its suffix."""
    target = path.with_suffix(".safetensors")
    write_tensors(target, tensors, {HEADER: json.dumps(words)})
    return target


@contextmanager
def read_described(path: Path, form: str, what: str) -> Iterator[tuple[dict[str, Any], dict[str, Tensor]]]:
    """Yield words and tensors of a file of `write_described`; turn exceptions on inconsistent data into InputError.

    Raises
    ------
    InputError
        In one sentence, if it can't be read, or its words do not have this `format`, so that it holds no `what`.
    """
    texts, tensors = read_tensors(path)
    with input_errors(path):
        words = json.loads(texts.get(HEADER, "{}"))
        if words.get("format") != form:
            raise ValueError(f"it holds no {what}")
        yield words, tensors


def are_finite(tensors: Iterable[Tensor]) -> bool:
    """Return True if all tensors hold finite floating-point numbers."""
    return all(t.is_floating_point() and bool(torch.isfinite(t).all()) for t in tensors)


def check_like_numbers(tensors: Mapping[str, Tensor]) -> None:
    """Raise ValueError if tensors are not all of finite numbers in one precision."""
    if not are_finite(tensors.values()):
        raise ValueError("its weights are not all finite numbers")
    if len({t.dtype for t in tensors.values()}) > 1:
        raise ValueError("its weights differ in precision")


HEADER = "shellbench"


class StateHeader(Model):
    """File header of one state of a path; see `shellbench.solvers.ndf.linear.solution.PathSolution`."""

    mark: Finite
    t: Finite
    membrane: Finite
    bending: Finite
    point_forces: tuple[Finite, ...]


class CaseHeader(Model):
    """Header of every file: the recipe, the case, the history and the results of the solve."""

    solver: str
    case_name: str
    case: dict[str, Any]
    history: tuple[Step, ...]
    diagnostics: dict[str, Any]
    uncertainty: dict[str, float]
    extrapolated: dict[str, float]
    unsettled: str | None = None
    mode_values: dict[str, float] = Field(default_factory=dict)

    def read_case(self) -> Case:
        """Return the case; ValidationError if it is not one."""
        return Case.model_validate({**self.case, "name": self.case_name})

    def course(self) -> dict[str, Any]:
        """Return the fields of a solution with its history and uncertainty."""
        names = ("history", "diagnostics", "uncertainty", "extrapolated", "unsettled")
        modes = {int(number): value for number, value in self.mode_values.items()}
        return {"mode_values": modes, **{name: getattr(self, name) for name in names}}


class Header(CaseHeader):
    """Data of a file beside its tensors; see `NdfSolution` for the fields."""

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
    with input_errors(path):
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
        If its layers do not match each other or the number of inputs.
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


def fits_format(tensors: Iterable[Tensor], format: NumberFormat) -> bool:
    """Return True if no tensor is longer than a format, so that rounding changes nothing."""
    return all(tensor.element_size() <= np.dtype(format).itemsize for tensor in tensors)


def rounded_tensors(tensors: Sequence[Tensor], format: NumberFormat) -> tuple[list[Tensor], int]:
    """Return tensors rounded to a format, in the precision they had, and the bytes that they take in the format.

    Each is scaled by its largest magnitude before (see `rounding`); a tensor that already fits the format is unchanged.
    """
    result, bytes_taken = [], 0
    for tensor in tensors:
        numbers = tensor.detach().cpu().numpy()
        short = shortened(numbers, format)
        result.append(tensor if short.numbers is numbers else torch.from_numpy(short.expanded()).to(tensor))
        bytes_taken += short.nbytes
    return result, bytes_taken


def rounded_network(network: Network, format: NumberFormat) -> tuple[Network, int]:
    """Return a network with all weights and biases rounded, and the bytes that they take in the format."""
    weights, first = rounded_tensors(network.weights, format)
    biases, second = rounded_tensors(network.biases, format)
    return replace(network, weights=tuple(weights), biases=tuple(biases)), first + second
