"""A skinned cape: the arrays that a method fitted, from which it makes the meshes of any frame again."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from shellbench.errors import InputError
from shellbench.problem import Step
from shellbench.problems.skinning.case import SkinningCase
from shellbench.problems.skinning.data import Clips, clips_of
from shellbench.solvers.skinning.units import bones_used

Array = NDArray[np.float64]
Arrays = Mapping[str, NDArray[Any]]
Skin = Callable[[Arrays, SkinningCase, Clips, NDArray[np.int64]], Array]
"""Makes displacements from rest (n, 3 v), m, of numbered frames (n,) from fitted arrays."""


@dataclass(frozen=True)
class Skinned:
    """An answer; see `shellbench.problem.Solution`.

    Attributes
    ----------
    solver
        Name of the solver.
    skin
        Function that computes meshes.
    arrays
        Fitted arrays, its input.
    """

    case: SkinningCase
    solver: str
    skin: Skin
    arrays: Arrays
    history: tuple[Step, ...] = ()
    diagnostics: Mapping[str, Any] = field(default_factory=dict)
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    extrapolated: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def clips(self) -> Clips:
        """The simulation that it is compared with."""
        return clips_of(self.case)

    @cached_property
    def meshes(self) -> Array:
        """Meshes of the frames that are held out, (n, rows, columns, 3), m."""
        return self.meshes_of(self.case.held_out)

    @cached_property
    def fitted(self) -> Array:
        """Meshes of the frames that were seen, (n, rows, columns, 3), m."""
        return self.meshes_of(self.case.seen)

    @cached_property
    def bones(self) -> Array:
        """Bones of the frames that are held out, (n, nodes, chains, 3), m, from which the meshes are made."""
        return bones_used(self.arrays, self.case, self.clips, self.case.held_out)

    def meshes_of(self, frames: NDArray[np.int64]) -> Array:
        """Return the meshes of numbered frames, (n, rows, columns, 3), m."""
        moved = self.skin(self.arrays, self.case, self.clips, frames)
        return np.asarray(self.clips.rest + moved.reshape(len(frames), *self.clips.rest.shape))

    @property
    def parameters(self) -> int:
        """Number of values that were fitted to frames."""
        return sum(array.size for array in self.arrays.values() if array.dtype.kind == "f")

    @property
    def storage_bytes(self) -> int:
        """Bytes of all arrays."""
        return sum(array.nbytes for array in self.arrays.values())

    def save(self, path: Path) -> Path:
        """Write the arrays as safetensors, case and solver in its header."""
        file = path.with_suffix(".safetensors")
        whole = {name: np.ascontiguousarray(array) for name, array in self.arrays.items()}
        save_file(whole, file, metadata={"case": self.case.model_dump_json(), "solver": self.solver})
        return file

    @classmethod
    def load(cls, path: Path, solver: str, skin: Skin) -> Self:
        """Read a file of `save`; InputError in one sentence if it is no such file, or another solver's."""
        try:
            with safe_open(path, framework="numpy") as file:
                told = dict(file.metadata() or {})
                arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
            case = SkinningCase.model_validate_json(told["case"])
        except (OSError, SafetensorError, KeyError, ValidationError) as error:
            raise InputError(f"{path} holds no skinned cape: {' '.join(str(error).split())[:200]}") from None
        if told.get("solver") != solver:
            raise InputError(f"{path} was written by solver '{told.get('solver')}', not by '{solver}'")
        return cls(case, solver, skin, arrays)
