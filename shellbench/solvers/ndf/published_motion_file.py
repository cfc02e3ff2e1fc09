"""The file of a trained motion: its weights as safetensors, all else as JSON in their header."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from torch import Tensor

from shellbench.errors import InputError
from shellbench.model import Positive
from shellbench.problems.shell.case import Case
from shellbench.solvers.ndf.build import SavedPeriodicInput
from shellbench.solvers.ndf.choices import StrainName
from shellbench.solvers.ndf.published_network import Siren
from shellbench.solvers.ndf.tensor_file import check_like_numbers, read_tensors, telling_damage, texts_of, write_tensors
from shellbench.solvers.ndf.weights import CaseHeader

HEADER = "shellbench-motion"
COMPONENTS = 3


class MotionHeader(CaseHeader):
    """All that a file says beside its weights."""

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
    write_tensors(target, tensors_of(siren), {HEADER: header.model_dump_json()})
    return target


def is_motion(path: Path) -> bool:
    """Tell whether a file is that of a motion; a file that can't be read is none."""
    return HEADER in texts_of(path)


def read_motion(path: Path, solver: str) -> tuple[MotionHeader, Case, Siren]:
    """Read what `write_motion` wrote.

    Raises
    ------
    InputError
        In one sentence, if the file is not a whole and consistent motion of this solver.
    """
    texts, tensors = read_tensors(path)
    with telling_damage(path):
        header = MotionHeader.model_validate_json(texts.get(HEADER, ""))
        case = header.read_case()
        check_like_numbers(tensors)
        layers = range(len(tensors) // 2)
        weights, biases = (tuple(tensors[f"{name}.{k}"] for k in layers) for name in ("weight", "bias"))
        siren = Siren(weights, biases, header.omega0)
        if not _fits(siren):
            raise ValueError("its weights do not fit each other")
        if case.dynamics is None:
            raise ValueError("nothing moves in its case")
    if header.solver != solver:
        raise InputError(f"{path}: was written by solver '{header.solver}', not by '{solver}'")
    return header, case, siren


def _fits(siren: Siren) -> bool:
    """Whether layers follow each other, to three outputs."""
    width: int | None = None
    for weight, bias in zip(siren.weights, siren.biases, strict=True):
        if weight.ndim != 2 or bias.shape != weight.shape[:1] or weight.shape[1] != (width or weight.shape[1]):
            return False
        width = weight.shape[0]
    return width == COMPONENTS
