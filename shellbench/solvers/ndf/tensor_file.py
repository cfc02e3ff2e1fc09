"""Files of tensors: safetensors with texts in their header. Nothing is ever unpickled."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import torch
from pydantic import ValidationError
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from shellbench.errors import InputError
from shellbench.model import one_sentence


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
    """Return the texts of a file; none of one that can't be read."""
    try:
        with safe_open(path, framework="pt") as file:
            return dict(file.metadata() or {})
    except (OSError, SafetensorError):
        return {}


@contextmanager
def telling_damage(path: Path) -> Iterator[None]:
    """Say in one sentence that what a file holds does not fit together, whatever is raised for that."""
    try:
        yield
    except ValidationError as error:
        raise InputError(f"{path}: is damaged: {one_sentence(error)}") from None
    except (ValueError, KeyError, TypeError, ArithmeticError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"{path}: is damaged: {reason[:200]}") from None


def are_finite(tensors: Iterable[Tensor]) -> bool:
    """Whether all tensors are of finite floating-point numbers."""
    return all(t.is_floating_point() and bool(torch.isfinite(t).all()) for t in tensors)


def check_like_numbers(tensors: Mapping[str, Tensor]) -> None:
    """Raise ValueError if tensors are not all of finite numbers in one precision."""
    if not are_finite(tensors.values()):
        raise ValueError("its weights are not all finite numbers")
    if len({t.dtype for t in tensors.values()}) > 1:
        raise ValueError("its weights differ in precision")
