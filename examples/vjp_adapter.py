"""Derivatives of a differentiable program for shellbench, from its vector-Jacobian product.

Programs in the manner of Tesseract (https://github.com/pasteurlabs/tesseract-core) offer two functions of dictionaries:

    apply(inputs) -> outputs
    vector_jacobian_product(inputs, vjp_inputs, vjp_outputs, cotangent_vector) -> {input: cotangent}

with outputs and inputs by name. If the inputs are called like the parameters of a case ("material.thickness") and the
outputs like its quantities, a solution needs no more than this class. One product gives the derivatives of a quantity
by all parameters. `Tesseract` objects, and plain Python objects with both functions, both fit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np


class Differentiable(Protocol):
    """A program with a vector-Jacobian product."""

    def apply(self, inputs: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the outputs."""
        ...

    def vector_jacobian_product(
        self,
        inputs: Mapping[str, Any],
        vjp_inputs: list[str],
        vjp_outputs: list[str],
        cotangent_vector: Mapping[str, Any],
    ) -> Mapping[str, Any]:
        """Return the cotangents of inputs, for cotangents of outputs."""
        ...


@dataclass
class ByProduct:
    """Gives derivatives of a program's outputs: mix it into a solution, or call it from `derivative`.

    Attributes
    ----------
    program, inputs
        The program, and the inputs at which it was applied.
    """

    program: Differentiable
    inputs: Mapping[str, Any]
    known: dict[str, Mapping[str, Any]] = field(default_factory=dict)

    def derivative(self, quantity: Any, parameter: str) -> float:
        """Return dQ/dp of a quantity (or of its name) by a parameter, in the units of both."""
        name = getattr(quantity, "name", quantity)
        if name not in self.known:  # one product for all parameters
            differentiable = [
                key for key, value in self.inputs.items() if np.issubdtype(np.asarray(value).dtype, np.floating)
            ]
            unit = {name: np.ones_like(np.asarray(self.program.apply(self.inputs)[name], dtype=float))}
            self.known[name] = self.program.vector_jacobian_product(self.inputs, differentiable, [name], unit)
        return float(np.sum(self.known[name][parameter]))
