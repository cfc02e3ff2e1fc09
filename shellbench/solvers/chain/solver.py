"""The solver `chain`: positions and tensions of a hanging chain at once, by Newton's method.

The unknowns are the positions x_i of the inner nodes and the tension T_j of each link, over its length. A node is at
rest if

    T_{i+1} (x_{i+1} - x_i) - T_i (x_i - x_{i-1}) + M g = 0,

and link j is rigid if |x_j - x_{j-1}|^2 = l^2. The matrix of both is symmetric up to a factor. The method starts from a
circular arc with the tensions that balance it best, and halves a step that makes the residual worse. A solution counts
only if all links are pulled: the chain has other states at rest, which are no minima.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from shellbench.errors import InputError, SolveFailure
from shellbench.problem import Capabilities, Progress, ProgressCallback, Settings, Step
from shellbench.problems.rope.case import Chain, RopeCase
from shellbench.problems.rope.solution import RopeState
from shellbench.problems.rope.solving import RopeSolver

Array = NDArray[np.float64]

STEPS, HALVINGS = 100, 40  # more than any chain needs: 1000 links take 20 steps


class ChainSettings(Settings):
    """Settings of `ChainSolver`."""

    tolerance: float = Field(
        1e-12, gt=0, lt=1e-3, description="largest residual, relative to the chain's weight and length"
    )


@dataclass(frozen=True)
class ChainSolution:
    """Nodes (n + 1, 2), m, and tensions (n,), N, of a chain at rest."""

    case: RopeCase
    nodes: Array
    tensions: Array
    history: tuple[Step, ...]
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    extrapolated: Mapping[str, float] = field(default_factory=dict)

    def state(self, at: float) -> RopeState:
        """Return the state at rest, in space."""
        nodes = np.insert(self.nodes, 1, 0.0, axis=1)
        return RopeState(nodes, np.zeros_like(nodes), self.tensions)

    def stacked(self) -> dict[str, Array]:
        """Return the arrays that a file keeps, by name."""
        return {"nodes": self.nodes, "tensions": self.tensions}

    @property
    def parameters(self) -> int:
        """Number of unknowns."""
        return self.nodes[1:-1].size + self.tensions.size

    @property
    def storage_bytes(self) -> int:
        """Bytes of both arrays."""
        return self.nodes.nbytes + self.tensions.nbytes

    @property
    def diagnostics(self) -> Mapping[str, Any]:
        """The largest stretch of a link, relative to its length."""
        lengths = np.linalg.norm(np.diff(self.nodes, axis=0), axis=1)
        return {"stretch": float(np.abs(lengths / hanging(self.case).link_length - 1).max())}

    def save(self, path: Path) -> Path:
        """Write the solution as npz."""
        file = path.with_suffix(".npz")
        np.savez(file, case=self.case.model_dump_json(), nodes=self.nodes, tensions=self.tensions)
        return file


def hanging(case: RopeCase) -> Chain:
    """Return the chain of a case."""
    assert case.chain is not None
    return case.chain


def residual(case: RopeCase, nodes: Array, densities: Array) -> tuple[Array, Array]:
    """Return forces (n - 1, 2) over the weight, and excess of squared lengths (n,) over l^2."""
    chain = hanging(case)
    links = np.diff(nodes, axis=0)
    forces = np.diff(densities[:, None] * links, axis=0) - [0.0, chain.mass * chain.gravity]
    weight = chain.mass * chain.gravity * (chain.links - 1)
    return forces / weight, np.sum(links**2, axis=1) / chain.link_length**2 - 1


def jacobian(case: RopeCase, nodes: Array, densities: Array) -> Array:
    """Return the derivative of `residual` by inner nodes and force densities, dense."""
    chain = hanging(case)
    n = chain.links
    links = np.diff(nodes, axis=0)
    weight = chain.mass * chain.gravity * (n - 1)
    difference = np.diff(np.eye(n + 1), axis=0)[:, 1:-1]  # links by inner nodes
    by_nodes = -np.kron(difference.T @ (densities[:, None] * difference), np.eye(2)) / weight
    by_densities = -np.einsum("ji,jc->icj", difference, links).reshape(-1, n) / weight
    lengths = 2 * np.einsum("ji,jc->jic", difference, links).reshape(n, -1) / chain.link_length**2
    return np.block([[by_nodes, by_densities], [lengths, np.zeros((n, n))]])


def arc(case: RopeCase) -> tuple[Array, Array]:
    """Return nodes on a circular arc as long as the chain, and the force densities that balance them best."""
    chain = hanging(case)
    chord = np.array([chain.span, -chain.drop])
    distance = float(np.hypot(*chord))
    ratio = distance / (chain.links * chain.link_length)
    angle, high = 0.0, np.pi  # half of the arc's: sin(angle) / angle = ratio
    for _ in range(HALVINGS):
        middle = (angle + high) / 2
        angle, high = (middle, high) if np.sinc(middle / np.pi) > ratio else (angle, middle)
    turned = angle * np.linspace(-1.0, 1.0, chain.links + 1)
    radius = distance / (2 * np.sin(angle))
    along, below = radius * (np.sin(turned) + np.sin(angle)), radius * (np.cos(turned) - np.cos(angle))
    unit = chord / distance
    nodes = along[:, None] * unit + below[:, None] * np.array([unit[1], -unit[0]])
    unbalanced = residual(case, nodes, np.zeros(chain.links))[0].ravel()
    by_densities = jacobian(case, nodes, np.ones(chain.links))[: unbalanced.size, unbalanced.size :]
    densities = np.linalg.lstsq(by_densities, -unbalanced)[0]
    return nodes, np.maximum(densities, 0.1 * np.abs(densities).mean())


class ChainSolver(RopeSolver):
    """Newton's method on positions and tensions."""

    name: ClassVar[str] = "chain"
    capabilities: ClassVar[Capabilities] = Capabilities(("rigid-links",), "hanging chains by Newton's method")
    settings_type: ClassVar[type[Settings]] = ChainSettings

    def declines(self, case: Any) -> str | None:
        """Return the reason that it declines a problem, or None: it takes chains at rest between two ends only."""
        return None if isinstance(case, RopeCase) and case.chain else "it solves chains between two ends only"

    def answer(self, case: RopeCase, settings: Any, progress: ProgressCallback) -> ChainSolution:
        """Find the chain at rest; SolveFailure if Newton's method does not converge."""
        chain, began = hanging(case), time.perf_counter()
        nodes, densities = arc(case)
        history: list[Step] = []
        for number in range(STEPS):
            force, excess = residual(case, nodes, densities)
            wrong = np.concatenate([force.ravel(), excess])
            energy = float(chain.mass * chain.gravity * nodes[1:-1, 1].sum())
            history.append(Step(number, time.perf_counter() - began, energy, wrong.size))
            progress(Progress(number, None, f"residual {np.abs(wrong).max():.2g}"))
            if np.abs(wrong).max() <= settings.tolerance:
                if densities.min() <= 0:
                    raise SolveFailure("the state that was found is no minimum: a link is pushed")
                return ChainSolution(case, nodes, densities * chain.link_length, tuple(history))
            change = np.linalg.solve(jacobian(case, nodes, densities), -wrong)
            for part in 0.5 ** np.arange(HALVINGS):
                moved, pulled = nodes.copy(), densities + part * change[2 * (chain.links - 1) :]
                moved[1:-1] += part * change[: 2 * (chain.links - 1)].reshape(-1, 2)
                after = np.concatenate([r.ravel() for r in residual(case, moved, pulled)])
                if np.linalg.norm(after) < np.linalg.norm(wrong):
                    break
            nodes, densities = moved, pulled
        raise SolveFailure(f"the residual is {np.abs(wrong).max():.2g} after {STEPS} steps of Newton's method")

    def load(self, path: Path) -> ChainSolution:
        """Read a file of `save`; InputError in one sentence if it is no such file."""
        try:
            with np.load(path, allow_pickle=False) as data:
                case = RopeCase.model_validate_json(str(data["case"]))
                return ChainSolution(case, data["nodes"], data["tensions"], ())
        except (OSError, KeyError, ValueError) as error:
            raise InputError(f"{path} holds no chain: {' '.join(str(error).split())}") from None
