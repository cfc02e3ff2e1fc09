"""Quantities of chains and of loose masses.

A solution gives its states by `state(at)`, a `RopeState`; a chain between two ends has one state, whatever the mark.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from shellbench.problem import Quantity
from shellbench.protocol.schema import Finite

Axis = Literal["x", "y", "z"]
AXES = "xyz"


class NodePosition(Quantity):
    """The coordinate of a node, m."""

    kind: Literal["position"]
    node: int = Field(ge=0, strict=True, description="from 0, the first end or the root; or the first loose mass")
    axis: Axis = Field(description="which coordinate; z points upward")

    def measure(self, solution: Any) -> float:
        """Return the coordinate, m."""
        return float(solution.state(self.at).nodes[self.node, AXES.index(self.axis)])


class LinkTension(Quantity):
    """The force that a link carries, N."""

    kind: Literal["tension"]
    link: int = Field(ge=1, strict=True, description="from 1, the first one")
    unit: str = "N"

    def measure(self, solution: Any) -> float:
        """Return the force, N."""
        return float(solution.state(self.at).tensions[self.link - 1])


class NodeSpeed(Quantity):
    """Speed of a node, m/s."""

    kind: Literal["speed"]
    node: int = Field(ge=0, strict=True, description="from 0, the root; or the first loose mass")
    unit: str = "m/s"

    def measure(self, solution: Any) -> float:
        """Return the speed, m/s."""
        return float(np.linalg.norm(solution.state(self.at).velocities[self.node]))


class AngularSpeed(Quantity):
    """Angular velocity of a link in the plane (x, z), positive from x to z, rad/s."""

    kind: Literal["angular_speed"]
    link: int = Field(ge=1, strict=True, description="from 1, at the root")
    unit: str = "rad/s"

    def measure(self, solution: Any) -> float:
        """Return the rate of the link's angle, rad/s."""
        state = solution.state(self.at)
        along = state.nodes[self.link] - state.nodes[self.link - 1]
        apart = state.velocities[self.link] - state.velocities[self.link - 1]
        return float((along[0] * apart[2] - along[2] * apart[0]) / (along[0] ** 2 + along[2] ** 2))


class Stretch(Quantity):
    """The largest excess of a link's length over its longest, relative to it, at the end of any step so far."""

    kind: Literal["stretch"]
    unit: str = ""

    def measure(self, solution: Any) -> float:
        """Return the stretch, without unit."""
        return float(solution.state(self.at).stretch)


class Penetration(Quantity):
    """Largest depth of a mass in an obstacle, over the ends of all steps so far, m."""

    kind: Literal["penetration"]

    def measure(self, solution: Any) -> float:
        """Return the depth, m."""
        return float(solution.state(self.at).penetration)


class Momentum(Quantity):
    """A component of the momentum of all masses, kg m/s."""

    kind: Literal["momentum"]
    axis: Axis = Field(description="which component")
    unit: str = "kg m/s"

    def measure(self, solution: Any) -> float:
        """Return the momentum, kg m/s."""
        velocities = solution.case.free(solution.state(self.at).velocities)
        return float(solution.case.masses @ velocities[:, AXES.index(self.axis)])


class Energy(Quantity):
    """The energy of all masses, J: of their motion, of their height over z = 0, or both."""

    kind: Literal["kinetic_energy", "potential_energy", "energy"]
    unit: str = "J"

    def measure(self, solution: Any) -> float:
        """Return the energy, J."""
        state, case = solution.state(self.at), solution.case
        kinetic, potential = energies(case, state.nodes, state.velocities)
        return {"kinetic_energy": kinetic, "potential_energy": potential, "energy": kinetic + potential}[self.kind]


def energies(case: Any, nodes: Any, velocities: Any) -> tuple[float, float]:
    """Return the energies of motion, and of height over z = 0, J, of places and velocities of all nodes (n, 3)."""
    kinetic = 0.5 * float(case.masses @ np.sum(case.free(velocities) ** 2, axis=1))
    return kinetic, case.gravity * float(case.masses @ case.free(nodes)[:, 2])


class Share(Quantity):
    """The share of masses that lie beyond a coordinate."""

    kind: Literal["share"]
    axis: Axis = Field(description="which coordinate")
    beyond: Finite = Field(description="what it must exceed, m")
    unit: str = ""

    def measure(self, solution: Any) -> float:
        """Return the share, from 0 to 1."""
        nodes = solution.case.free(solution.state(self.at).nodes)
        return float(np.mean(nodes[:, AXES.index(self.axis)] > self.beyond))


STILL = (NodePosition, LinkTension)  # quantities of a chain between two ends
RopeQuantity = Annotated[
    NodePosition | LinkTension | NodeSpeed | AngularSpeed | Stretch | Penetration | Momentum | Energy | Share,
    Field(discriminator="kind"),
]
