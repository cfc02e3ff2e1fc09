"""The clips of a case: they are simulated when first needed, and kept in a folder of their own.

The folder is that of the variable SHELLBENCH_DATA, or else `shellbench` in the user's folder of caches. The name of a
file has a digest of the cape, the body and the code that simulates them, so that outdated files are never read.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from shellbench.disk import cache_folder
from shellbench.problems.skinning import body, cape, motion
from shellbench.problems.skinning.body import Capsule, segments
from shellbench.problems.skinning.cape import Cape, draped, simulated
from shellbench.problems.skinning.motion import BodyMotion, body_motion

if TYPE_CHECKING:
    from shellbench.problems.skinning.case import SkinningCase

Array = NDArray[np.float64]
FOLDER = "SHELLBENCH_DATA"
Makers = tuple[ModuleType, ...]
MAKERS: Makers = (body, cape, motion)  # modules that determine the simulation


@dataclass(frozen=True)
class Clips:
    """All frames of all clips, one after another, in the frame of the neck.

    Attributes
    ----------
    rest
        Shape of the cape at rest, (rows, columns, 3), m.
    meshes
        (n, rows, columns, 3), m; kept in float32, to 1e-7 m.
    motion
        Of the body.
    axes
        Ends of the body's capsules, (n, c, 2, 3), m.
    radii
        Of the capsules, (c,), m.
    """

    rest: Array
    meshes: Array
    motion: BodyMotion
    axes: Array
    radii: Array

    @cached_property
    def moved(self) -> Array:
        """Displacements of all vertices from rest, (n, 3 v), m."""
        return np.asarray((self.meshes - self.rest).reshape(len(self.meshes), -1))


def clips_of(case: SkinningCase) -> Clips:
    """Return the clips of a case, simulated if they are not kept yet."""
    return simulated_clips(case.cape, case.body, case.margin)


@lru_cache(maxsize=2)
def simulated_clips(cape: Cape, body: tuple[Capsule, ...], margin: float) -> Clips:
    """Return the clips of a cape, simulated if they are not kept yet."""
    moves = body_motion(cape.seed, cape.clips, cape.frames, cape.drift)
    shapes = {"rest": cape.rest().shape, "meshes": (cape.clips, cape.frames, *cape.rest().shape)}
    found = kept_or_made(kept_at(cape, body, margin), shapes, lambda: _made(cape, body, margin, moves))
    meshes = found["meshes"].astype(float).reshape(-1, cape.rows, cape.columns, 3)
    axes = segments(body, moves.stride).reshape(len(meshes), len(body), 2, 3)
    return Clips(found["rest"].astype(float), meshes, moves, axes, np.array([part.radius for part in body]))


def kept_or_made(
    path: Path, shapes: Mapping[str, tuple[int, ...]], make: Callable[[], Mapping[str, NDArray[Any]]]
) -> Mapping[str, NDArray[Any]]:
    """Return the arrays of a file, by name and shape; they are made and kept if the file is not there, or damaged."""
    try:
        with np.load(path, allow_pickle=False) as kept:
            found: Mapping[str, NDArray[Any]] = {name: kept[name] for name in shapes}
        if any(found[name].shape != shape for name, shape in shapes.items()):
            raise ValueError("of another shape")
    except (OSError, KeyError, ValueError, EOFError, BadZipFile):
        found = make()
        _keep(path, found)
    return found


def _made(cape: Cape, body: tuple[Capsule, ...], margin: float, moves: BodyMotion) -> dict[str, NDArray[Any]]:
    tenth = max(cape.frames // 10, 1)

    def say(frame: int, of: int) -> None:
        if cape.rows * cape.columns * of > LONG and frame % tenth == 0:
            print(f"simulating the cape: frame {frame} of {of}", file=sys.stderr, flush=True)

    rest = draped(cape, body, margin)
    meshes = simulated(cape, body, margin, moves, rest, say)
    return {"rest": rest.astype(np.float32), "meshes": meshes.astype(np.float32)}


LONG = 100_000  # vertices times frames beyond which progress is reported


def kept_at(
    cape: Cape, body: tuple[Capsule, ...], margin: float, more: Mapping[str, Any] | None = None, makers: Makers = MAKERS
) -> Path:
    """Return the file of the clips, or of what `makers` make with `more` data."""
    root = os.environ.get(FOLDER) or cache_folder() or tempfile.gettempdir()
    told = {"cape": cape.model_dump(mode="json"), "body": [part.model_dump(mode="json") for part in body]}
    text = json.dumps(told | {"margin": margin} | dict(more or {}), sort_keys=True).encode()
    code = b"".join(Path(str(maker.__file__)).read_bytes() for maker in makers)
    return Path(root) / f"cape_{hashlib.sha256(text + code).hexdigest()[:16]}.npz"


def _keep(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays completely or not at all; arrays that can't be written are simulated again next time."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".part", delete=False) as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]
        Path(file.name).replace(path)
    except OSError as error:
        print(f"the clips can't be kept in {path.parent}: {error.strerror}", file=sys.stderr)
