"""`surface.kind = "mesh"`: a surface fitted to a mesh file beside the case file."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator
from pydantic.json_schema import SkipJsonSchema

from shellbench.errors import InputError, without_middle
from shellbench.files import read_file
from shellbench.problems.shell.mesh.file import LARGEST
from shellbench.problems.shell.mesh.fit import MeshFit
from shellbench.problems.shell.question.surface import COORDINATES, AnalyticSurface, Coordinate

Array = NDArray[np.float64]
FITS = 16  # that are remembered: a process reads the cases of a suite more than once
NO_FORMULAS = "its surface is a mesh, which has no formulas"


class MeshSurface(AnalyticSurface):
    """A spline of degree 5 fitted to the vertices of a mesh, whose texture coordinates (u, v) are xi1 and xi2.

    The mesh is one patch that fills a rectangle of (u, v). The fit states errors of position and of curvature. The
    change of an answer from one fit to the other is part of its uncertainty. Bounds default to those of the mesh; they
    are in the units of (u, v), never degrees.

    Attributes
    ----------
    mesh
        File with triangles or polygons and texture coordinates, such as .obj; its path from the case file.
    periodic
        Coordinates in which the surface closes on itself, smoothly. A mesh whose sides meet is refused without it;
        `[]` says that it is slit there.
    knots
        Choice of one of the two fits. The second has other knots, and half of the vertices.
    fit
        The fit: computed from the mesh, never given in a file.
    """

    kind: Literal["mesh"]
    mesh: str
    periodic: tuple[Coordinate, ...] = ()
    knots: Literal["first", "second"] = "first"
    fit: SkipJsonSchema[MeshFit] = Field(repr=False)

    @model_validator(mode="before")
    @classmethod
    def _has_the_bounds_of_its_mesh(cls, data: Any) -> Any:
        if not isinstance(data, Mapping):
            return data
        if "fit" not in data:
            raise ValueError("a surface of kind 'mesh' stands in the file of a shell only")
        fit = MeshFit.model_validate(data["fit"])
        return {**dict(zip(COORDINATES, fit.bounds, strict=True)), **data, "fit": fit}

    @property
    def periodic_coordinates(self) -> tuple[Coordinate, ...]:
        """Coordinates in which the surface closes on itself."""
        return self.periodic

    @property
    def formulas(self) -> tuple[str, str, str]:
        """Raise InputError: a mesh has no formulas."""
        raise InputError(NO_FORMULAS)

    def derivatives(self, points: ArrayLike, order: int = 2) -> dict[tuple[int, int], Array]:
        """Return exact partial derivatives of the fitted spline; see `AnalyticSurface.derivatives`."""
        return (self.fit.first if self.knots == "first" else self.fit.second).derivatives(points, order)


def with_fit(data: Mapping[str, Any], folder: Path) -> Mapping[str, Any]:
    """Return the data of a case file, fitted to its mesh if it has one, whose path is relative to the folder.

    Raises
    ------
    InputError
        As a clause that names the field.
    """
    surface = data.get("surface")
    if not isinstance(surface, Mapping) or surface.get("kind") != "mesh":
        return data
    if "fit" in surface:
        raise InputError("field 'surface.fit' is not known here")
    if not isinstance(surface.get("mesh"), str):
        raise InputError("field 'surface.mesh' is missing, or is not the path of a file")
    periodic = surface.get("periodic")
    if periodic is not None and not (isinstance(periodic, list) and all(name in COORDINATES for name in periodic)):
        raise InputError(
            f"field 'surface.periodic': found {without_middle(repr(periodic))}, but it is a list of 'xi1' and 'xi2'"
        )
    path = folder / surface["mesh"]
    try:
        fit = _fitted(read_file(path, LARGEST), path.suffix, None if periodic is None else tuple(periodic))
    except InputError as error:
        raise InputError(f"field 'surface.mesh': {path.name}: {error}") from None
    return {**data, "surface": {**surface, "fit": fit}}


_fitted = lru_cache(maxsize=FITS)(MeshFit.of)
