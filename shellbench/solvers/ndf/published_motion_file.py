"""The file of a trained motion: its weights as safetensors, all else as JSON in their header."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import torch
from pydantic import ValidationError
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from shellbench.errors import InputError
from shellbench.model import Finite, Model, Positive, one_sentence
from shellbench.problem import Step
from shellbench.problems.shell.case import Case
from shellbench.solvers.ndf.build import SavedPeriodicInput
from shellbench.solvers.ndf.choices import StrainName
from shellbench.solvers.ndf.published_network import Siren

HEADER = "shellbench-motion"
COMPONENTS = 3


class MotionHeader(Model):
    """All that a file says beside its weights."""

    format: Literal["shellbench-ndf-motion-1"] = "shellbench-ndf-motion-1"
    solver: str
    case_name: str
    case: dict[str, Any]
    periodic_input: SavedPeriodicInput
    omega0: Positive
    strain: StrainName
    history: tuple[Step, ...]
    diagnostics: dict[str, Any]
    uncertainty: dict[str, Finite]
    extrapolated: dict[str, Finite]

    def read_case(self) -> Case:
        """Return the case; ValidationError if it is not one."""
        return Case.model_validate({**self.case, "name": self.case_name})


def write_motion(path: Path, header: MotionHeader, siren: Siren) -> Path:
    """Write a file; return it with its suffix."""
    target = path.with_suffix(".safetensors")
    groups = (("weight", siren.weights), ("bias", siren.biases))
    tensors = {f"{name}.{k}": t.detach().cpu().contiguous() for name, group in groups for k, t in enumerate(group)}
    save_file(tensors, target, metadata={HEADER: header.model_dump_json()})
    return target


def is_motion(path: Path) -> bool:
    """Tell whether a file is that of a motion; a file that can't be read is none."""
    try:
        with safe_open(path, framework="pt") as file:
            return HEADER in (file.metadata() or {})
    except (OSError, SafetensorError):
        return False


def read_motion(path: Path, solver: str) -> tuple[MotionHeader, Case, Siren]:
    """Read what `write_motion` wrote.

    Raises
    ------
    InputError
        In one sentence, if the file is not a whole and consistent motion of this solver.
    """
    try:
        with safe_open(path, framework="pt") as file:
            header = MotionHeader.model_validate_json((file.metadata() or {}).get(HEADER, ""))
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - not a mapping
        case = header.read_case()
        layers = range(len(tensors) // 2)
        weights, biases = (tuple(tensors[f"{name}.{k}"] for k in layers) for name in ("weight", "bias"))
    except OSError as error:
        raise InputError(f"{path}: can't be read ({error.strerror or error})") from None
    except ValidationError as error:
        raise InputError(f"{path}: is damaged or holds no motion: {one_sentence(error)}") from None
    except (SafetensorError, KeyError, ValueError) as error:
        raise InputError(f"{path}: is damaged or no safetensors file ({str(error).splitlines()[0][:200]})") from None
    if header.solver != solver:
        raise InputError(f"{path}: was written by solver '{header.solver}', not by '{solver}'")
    if case.dynamics is None:
        raise InputError(f"{path}: is damaged: nothing moves in its case")
    siren = Siren(weights, biases, header.omega0)
    if not _fits(siren):
        raise InputError(f"{path}: is damaged: its weights do not fit each other, or are not all finite numbers")
    return header, case, siren


def _fits(siren: Siren) -> bool:
    """Tell whether layers follow each other, in one precision, with finite numbers and three outputs."""
    if not siren.weights or len({t.dtype for t in siren.tensors}) > 1:
        return False
    width: int | None = None
    for weight, bias in zip(siren.weights, siren.biases, strict=True):
        if weight.ndim != 2 or bias.shape != weight.shape[:1] or weight.shape[1] != (width or weight.shape[1]):
            return False
        width = weight.shape[0]
    finite = all(t.is_floating_point() and bool(torch.isfinite(t).all()) for t in siren.tensors)
    return finite and width == COMPONENTS
