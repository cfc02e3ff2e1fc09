"""The kinds of surface that a case file can name."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from shellbench.problems.shell.mesh.surface import MeshSurface
from shellbench.problems.shell.question.surface import Cylinder, ExpressionSurface, Plane

SurfaceModel = Annotated[Plane | Cylinder | ExpressionSurface | MeshSurface, Field(discriminator="kind")]
