"""Weights of a field in a shorter floating-point format."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from shellbench.problem import NumberFormat
from shellbench.problems.rounding import shortened
from shellbench.solvers.ndf.network import Network


def short_enough(tensors: Iterable[Tensor], format: NumberFormat) -> bool:
    """Tell whether no tensor is longer than a format, so that rounding changes nothing."""
    return all(tensor.element_size() <= np.dtype(format).itemsize for tensor in tensors)


def rounded_tensors(tensors: Sequence[Tensor], format: NumberFormat) -> tuple[list[Tensor], int]:
    """Return tensors rounded to a format, in the precision they had, and the bytes that they take in the format.

    Each is scaled by its largest magnitude before (see `rounding`); one that is no longer than the format
    stays as it is.
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
