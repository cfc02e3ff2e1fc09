"""Second-order jets: functions of (xi1, xi2) with their first and second derivatives, propagated in one pass.

A jet is a tensor (6, N, ...): value, d1, d2, d11, d12, d22 at N points. Sums and linear maps act on all six planes at
once, so that a layer of a network is one batched matrix product; products follow the product rule and activations the
chain rule. Nested reverse differentiation gives the same numbers at several times the cost.

    >>> xi1, xi2 = coordinates(np.array([[2.0, 3.0]]), Placement())
    >>> product(xi1, xi2)[:, 0].tolist()
    [6.0, 3.0, 2.0, 0.0, 1.0, 0.0]

If only values are needed, jets of one plane (1, N, ...) take their place: a product of jets has the planes of the
shorter one, and a composition those of its argument.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from shellbench.errors import InputError

Array = NDArray[np.float64]
Integers = NDArray[np.integer[Any]]

VALUE, D1, D2, D11, D12, D22 = range(6)
PLANES: tuple[tuple[int, int], ...] = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
"""Orders of derivation in (xi1, xi2) of the six planes."""


class Placement(NamedTuple):
    """Device and precision of tensors, and the number of planes of new jets."""

    device: torch.device = torch.device("cpu")
    dtype: torch.dtype = torch.float64
    planes: int = 6

    @property
    def of_values(self) -> Placement:
        """The same place for jets of values alone."""
        return self._replace(planes=1)

    @property
    def order(self) -> int:
        """The highest order of derivation in the jets."""
        return sum(PLANES[self.planes - 1])

    def tensor(self, values: Array) -> Tensor:
        """Return an array as a tensor of this placement."""
        return torch.as_tensor(np.ascontiguousarray(values), device=self.device, dtype=self.dtype)

    def zeros(self, *shape: int) -> Tensor:
        """Return zeros of this placement."""
        return torch.zeros(shape, device=self.device, dtype=self.dtype)

    @classmethod
    def on(cls, device: str) -> Placement:
        """Return the placement for a device's name, in float64.

        Raises
        ------
        InputError
            If there is no such device.
        """
        if device == "cuda" and not torch.cuda.is_available():
            raise InputError("device 'cuda' is not available on this machine; allowed here is 'cpu'")
        return cls(torch.device(device), torch.float64)


def constant(values: Tensor, planes: int = 6) -> Tensor:
    """Return the jet (6, N, ...) of functions that do not vary, from their values (N, ...)."""
    jet = values.new_zeros((planes, *values.shape))
    jet[VALUE] = values
    return jet


def coordinates(points: Array, placement: Placement) -> tuple[Tensor, Tensor]:
    """Return the jets (6, N) of xi1 and xi2 at points (N, 2)."""
    first, second = (constant(placement.tensor(points[:, axis]), placement.planes) for axis in (0, 1))
    if placement.planes > 1:
        first[D1], second[D2] = 1.0, 1.0
    return first, second


def from_derivatives(
    derivatives: Mapping[tuple[int, int], Array], placement: Placement, shift: tuple[int, int] = (0, 0)
) -> Tensor:
    """Return the jet (6, N, ...) of a derived function: (i, j) -> (N, ...) up to order 2 + sum(shift).

    `shift` = (1, 0) gives the jet of the first derivative in xi1, and so on.
    """
    planes = [derivatives[i + shift[0], j + shift[1]] for i, j in PLANES[: placement.planes]]
    return placement.tensor(np.stack(planes))


Bilinear = Callable[[Tensor, Tensor], Tensor]


def bilinear(operation: Bilinear, a: Tensor, b: Tensor) -> Tensor:
    """Return the jet of any product of two jets that is linear in each (the product rule)."""
    if len(a) == 1 or len(b) == 1:
        return operation(a[VALUE], b[VALUE])[None]
    a0, a1, a2, a11, a12, a22 = a.unbind(0)
    b0, b1, b2, b11, b12, b22 = b.unbind(0)
    return torch.stack(
        [
            operation(a0, b0),
            operation(a1, b0) + operation(a0, b1),
            operation(a2, b0) + operation(a0, b2),
            operation(a11, b0) + 2 * operation(a1, b1) + operation(a0, b11),
            operation(a12, b0) + operation(a1, b2) + operation(a2, b1) + operation(a0, b12),
            operation(a22, b0) + 2 * operation(a2, b2) + operation(a0, b22),
        ]
    )


def product(a: Tensor, b: Tensor) -> Tensor:
    """Return the jet of the product of two jets; trailing shapes broadcast."""
    return bilinear(torch.mul, a, b)


def matrix_product(a: Tensor, b: Tensor) -> Tensor:
    """Return the jet of a matrix product of jets (6, N, i, j) and (6, N, j, k)."""
    return bilinear(torch.matmul, a, b)


def dot(a: Tensor, b: Tensor) -> Tensor:
    """Return the jet (6, N) of the dot product of two jets of vectors (6, N, 3)."""
    return product(a, b).sum(-1)


def cross(a: Tensor, b: Tensor) -> Tensor:
    """Return the jet of the cross product of two jets of vectors (6, N, 3)."""
    return bilinear(lambda u, v: torch.linalg.cross(u, v, dim=-1), a, b)


def compose(derivatives: Sequence[Tensor], z: Tensor) -> Tensor:
    """Return the jet of f(z), given f, f', f'' at z's values (the chain rule)."""
    if len(z) == 1:
        return derivatives[0][None]
    f0, f1, f2 = derivatives[:3]
    z1, z2 = z[D1], z[D2]
    if torch.is_grad_enabled() and (z.requires_grad or f0.requires_grad):
        _, z1, z2, z11, z12, z22 = z.unbind(0)  # unbind and stack: slices would be padded with zeros going backward
        s1, s2 = f2 * z1, f2 * z2
        return torch.stack([f0, f1 * z1, f1 * z2, f1 * z11 + s1 * z1, f1 * z12 + s1 * z2, f1 * z22 + s2 * z2])
    jet = torch.empty_like(z)
    jet[VALUE] = f0
    torch.mul(f1, z[1:], out=jet[1:])
    s1, s2 = f2 * z1, f2 * z2
    jet[D11].addcmul_(s1, z1)
    jet[D12].addcmul_(s1, z2)
    jet[D22].addcmul_(s2, z2)
    return jet


def power(z: Tensor, exponent: float | Tensor) -> Tensor:
    """Return the jet of z**exponent, z positive."""
    v = z[VALUE]
    if len(z) == 1:
        return v[None] ** exponent
    return compose(
        (v**exponent, exponent * v ** (exponent - 1), exponent * (exponent - 1) * v ** (exponent - 2)),
        z,
    )


Activation = Callable[[Tensor, int], tuple[Tensor, ...]]
"""Of z (any shape) and an order: the function and its derivatives up to that order (at most 3)."""


def sine(z: Tensor, order: int = 2) -> tuple[Tensor, ...]:
    """Return sin z and its derivatives (Sitzmann et al., SIREN)."""
    if order == 0:
        return (torch.sin(z),)
    s, c = torch.sin(z), torch.cos(z)
    return (s, c, *(-f for f in (s, c)[: order - 1]))


def cosine(z: Tensor, order: int = 2) -> tuple[Tensor, ...]:
    """Return cos z and its derivatives."""
    if order == 0:
        return (torch.cos(z),)
    s, c = torch.sin(z), torch.cos(z)
    return (c, -s, -c, s)[: order + 1]


def tanh(z: Tensor, order: int = 2) -> tuple[Tensor, ...]:
    """Return tanh z and its derivatives."""
    t = torch.tanh(z)
    slope = 1 - t * t
    return (t, slope, -2 * t * slope, slope * (6 * t * t - 2))[: order + 1]


def gelu(z: Tensor, order: int = 2) -> tuple[Tensor, ...]:
    """Return z Phi(z), Phi the normal distribution (Hendrycks & Gimpel's exact form), and its derivatives."""
    density = torch.exp(-0.5 * z * z) / math.sqrt(2 * math.pi)
    distribution = 0.5 * (1 + torch.erf(z / math.sqrt(2)))
    results = (z * distribution, distribution + z * density, (2 - z * z) * density, (z * z - 4) * z * density)
    return results[: order + 1]


def relu(z: Tensor, order: int = 2) -> tuple[Tensor, ...]:
    """Return max(z, 0) and its derivatives; the second derivative is zero on either side of the kink."""
    zero = torch.zeros_like(z)
    return (z.clamp_min(0.0), (z > 0).to(z.dtype), zero, zero)[: order + 1]


ACTIVATIONS: dict[str, Activation] = {"sine": sine, "tanh": tanh, "gelu": gelu, "relu": relu}
KINKED = {"relu"}  # their second derivatives vanish wherever they exist


def smooth_activation(name: str) -> Activation:
    """Return an activation that can bend a shell, by name.

    Raises
    ------
    InputError
        If it is unknown, or its second derivatives vanish.
    """
    if name in KINKED:
        raise InputError(
            f"activation '{name}' is refused: its second derivatives vanish, so it stores no bending energy;"
            f" allowed are {', '.join(sorted(ACTIVATIONS.keys() - KINKED))}"
        )
    return activation(name)


def activation(name: str) -> Activation:
    """Return an activation by name; InputError if it is unknown."""
    if name not in ACTIVATIONS:
        raise InputError(f"activation '{name}' is not known; allowed are {', '.join(ACTIVATIONS)}")
    return ACTIVATIONS[name]


def chebyshev(x: Tensor, count: int) -> list[Tensor]:
    """Return the jets of the first Chebyshev polynomials of a jet."""
    found = [constant(torch.ones_like(x[VALUE]), len(x)), x]
    while len(found) < count:
        found.append(2 * product(x, found[-1]) - found[-2])
    return found[:count]


COMPONENTS = 3
