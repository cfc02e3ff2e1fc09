"""Answers about fields: fields themselves, samples of a density, distances. Each provides its quantities.

Arrays are kept as safetensors, all other data as JSON in the header.
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from shellbench.errors import InputError
from shellbench.problem import Step
from shellbench.problems.field.case import FieldCase
from shellbench.problems.field.structure import TURN, bend, corners, depths, strain

Array = NDArray[Any]
DRAWN = 65  # points of a surface along a side


@dataclass(frozen=True)
class FieldAnswer:
    """Base of the answers: the case, arrays by name, how to read them (JSON data), and the history of the solve."""

    case: FieldCase
    tensors: Mapping[str, Array]
    form: Mapping[str, Any] = field(default_factory=dict)
    history: tuple[Step, ...] = ()
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    diagnostics: Mapping[str, Any] = field(default_factory=dict)
    extrapolated: Mapping[str, float] = field(default_factory=dict)
    unsettled: str | None = None
    pictures: Mapping[str, Array] = field(default_factory=dict)

    @property
    def parameters(self) -> int:
        """Numbers that the answer consists of."""
        return sum(tensor.size for tensor in self.tensors.values())

    @property
    def storage_bytes(self) -> int:
        """Bytes of these numbers."""
        return sum(tensor.nbytes for tensor in self.tensors.values())

    def kept(self) -> dict[str, Array]:
        """Return the arrays that a record keeps; `pictures` are arrays that only a report looks at."""
        return {**self.tensors, **self.pictures}

    def save(self, path: Path) -> Path:
        """Write the answer."""
        file = path.with_suffix(".safetensors")
        texts = {"case": self.case.model_dump_json(), "form": json.dumps(dict(self.form))}
        save_file({name: np.ascontiguousarray(array) for name, array in self.tensors.items()}, file, metadata=texts)
        return file

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a file of `save`; InputError in one sentence if it is no such file."""
        try:
            with safe_open(path, framework="numpy") as file:
                texts = file.metadata() or {}
                tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
            return cls(FieldCase.model_validate_json(texts["case"]), tensors, json.loads(texts["form"]))
        except (OSError, SafetensorError, KeyError, ValueError) as error:
            raise InputError(f"{path} holds no answer about a field: {' '.join(str(error).split())[:200]}") from None


class FieldSolution(FieldAnswer, ABC):
    """A field: a displacement at each point of the unit square."""

    def kept(self) -> dict[str, Array]:
        """Return the arrays that a record keeps: with a body also the surface, so that it can be drawn."""
        if self.case.body is None:
            return super().kept()
        along = np.linspace(0, 1, DRAWN)
        xi = np.stack(np.meshgrid(along, along, indexing="ij"), axis=-1)
        points = xi.reshape(-1, 2)
        surface = {"position": self.case.rest(points), "displacement": self.displacement(points)}
        return super().kept() | {"xi": xi} | {name: a.reshape(DRAWN, DRAWN, 3) for name, a in surface.items()}

    @abstractmethod
    def displacement(self, points: NDArray[np.float64], orders: tuple[int, int] = (0, 0)) -> NDArray[np.float64]:
        """Return the displacement (n, 3), m, at points (n, 2), or its derivative of these orders in u and v.

        Raises
        ------
        ValueError
            If the representation has no such derivative.
        """

    def structures(self, points: Array, angles: Array, count: int) -> tuple[Array, Array]:
        """Return places and rest places (n, count, 3), m, of corners of structures about points (n, 2), turned."""
        assert self.case.cloth is not None
        at = corners(points, angles, self.case.cloth.side, count, self.case.cloth.past_edges).reshape(-1, 2)
        rest = self.case.rest(at)
        return (rest + self.displacement(at)).reshape(-1, count, 3), rest.reshape(-1, count, 3)

    def losses(self, points: Array, turns: int = 1) -> dict[str, Array]:
        """Return each loss (n,) at points (n, 2), as the mean over so many orientations of the structure."""
        assert self.case.cloth is not None
        body = self.case.body
        found = {name: np.zeros(len(points)) for name in ("strain", "bend", *(["collision"] if body else []))}
        for angle in TURN * np.arange(turns) / turns:
            turned = np.full(len(points), angle)
            found["strain"] += strain(*self.structures(points, turned, 3)) / turns
            stars = self.structures(points, turned, 6)[0]
            found["bend"] += bend(stars) / turns
            if body:
                found["collision"] += depths(stars, body) / turns
        heights = self.case.rest(points)[:, 2] + self.displacement(points)[:, 2]
        return found | {"gravity": self.case.cloth.mass_gravity * heights}
