"""Hanging chains: point masses on rigid links between two fixed ends, at rest under gravity.

Node 0 is at (0, 0) and node n at (span, -drop) of the plane (x, z), z upward; the links are rigid and hinged. Known
values are those of the discrete catenary; see `derivations.discrete_catenary`.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from shellbench.model import Finite, Model, Positive
from shellbench.problem import Kind, Problem, Quantity


class Chain(Model):
    """The chain and where it hangs, in SI units."""

    links: int = Field(ge=2, le=1000, strict=True, description="number of links; one mass between each two")
    link_length: Positive = Field(description="length of a link, m")
    mass: Positive = Field(description="mass of each node between the ends, kg")
    gravity: Positive = Field(9.81, description="acceleration, m/s^2")
    span: Positive = Field(description="horizontal distance of the ends, m")
    drop: Finite = Field(0.0, description="how far the last end is below the first, m")

    @model_validator(mode="after")
    def _reaches(self) -> Self:
        length, distance = self.links * self.link_length, np.hypot(self.span, self.drop)
        if distance >= length:
            raise ValueError(f"the ends are {distance:g} m apart, but the chain is {length:g} m long")
        return self


class NodePosition(Quantity):
    """The coordinate of a node, m."""

    kind: Literal["position"]
    node: int = Field(ge=0, strict=True, description="from 0, the first end")
    axis: Literal["x", "z"] = Field(description="which coordinate; z points upward")

    def measure(self, solution: Any) -> float:
        """Return the coordinate, m."""
        return float(solution.nodes[self.node, "xz".index(self.axis)])


class LinkTension(Quantity):
    """The force that a link carries, N."""

    kind: Literal["tension"]
    link: int = Field(ge=1, strict=True, description="from 1, the first one")
    unit: str = "N"

    def measure(self, solution: Any) -> float:
        """Return the force, N."""
        return float(solution.tensions[self.link - 1])


class RopeCase(Problem):
    """A chain that hangs between two ends, and what is asked of it.

    Attributes
    ----------
    chain
        The chain, and where it hangs.
    quantities
        What is asked of every answer; exactly one is primary.
    """

    kind: Literal["rope"]
    theory: Literal["rigid-links"]
    chain: Chain
    quantities: Annotated[
        tuple[Annotated[NodePosition | LinkTension, Field(discriminator="kind")], ...], Field(min_length=1)
    ]

    @model_validator(mode="after")
    def _parts_are_there(self) -> Self:
        for quantity in self.quantities:
            number = quantity.node if isinstance(quantity, NodePosition) else quantity.link
            if number > self.chain.links:
                raise ValueError(
                    f"quantity '{quantity.name}' is of number {number}, but {self.chain.links} is the last"
                )
        return self


def keep(solution: Any, case: RopeCase) -> dict[str, NDArray[np.float64]] | None:
    """Return the nodes (n + 1, 2), m, and the tensions (n,), N; None if they are not finite."""
    arrays = {"nodes": np.asarray(solution.nodes), "tensions": np.asarray(solution.tensions)}
    return arrays if all(np.all(np.isfinite(array)) for array in arrays.values()) else None


ROPE = Kind(problem=RopeCase, keep=keep)
