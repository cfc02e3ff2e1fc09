"""A template of a case file for a user's own mesh: `shellbench new-case NAME --mesh FILE`."""

from __future__ import annotations

import json
from pathlib import Path

from shellbench.errors import InputError
from shellbench.files import read_file
from shellbench.problems.shell.mesh.file import LARGEST
from shellbench.problems.shell.mesh.fit import MeshFit

MESH_CASE = """\
# A shell of your own from a mesh. `shellbench run {file} --quick` solves it by two solvers.
title = "{title}, from a mesh"
theory = "kirchhoff-love-linear"

[surface]
kind = "mesh"
mesh = "{mesh}"
{periodic}
[material]                     # yours
youngs_modulus = 2e11          # Pa
poissons_ratio = 0.3
thickness = 0.01               # m
areal_density = 80             # kg/m^2

[points]
tip = {tip}                    # (u, v) of the mesh

[[supports]]
name = "wall"
on = ["{held}"]
clamped = true

[[loads]]
kind = "gravity"
acceleration = [0, 0, -9.81]

[[quantities]]
name = "tip_deflection"
kind = "displacement"
primary = true
points = ["tip"]
direction = [0, 0, -1]

[[quantities]]
name = "largest_displacement"
kind = "largest_displacement"
"""


def case_of_mesh(mesh: Path, path: Path) -> str:
    """Return the text of a case file: the mesh is held on one side, and the quantity is a displacement of the other.

    The function finds where the mesh closes. The mesh's path stands in the file as given.

    Raises
    ------
    InputError
        As a clause, if the mesh can't be read, or is no surface.
    """
    content = read_file(mesh, LARGEST)
    try:
        fit = MeshFit.of(content, mesh.suffix, None)
    except InputError as error:
        fit = _closed(content, mesh.suffix, error)
    closed = [name for name, goes_round in zip(("xi1", "xi2"), fit.first.periodic, strict=True) if goes_round]
    held = 1 if closed == ["xi1"] else 0
    tip = [sum(bounds) / 2 for bounds in fit.bounds]
    tip[held] = fit.bounds[held][1]
    return MESH_CASE.format(
        file=path.name,
        title=path.stem.replace("_", " "),
        mesh=mesh.as_posix(),
        periodic=f"periodic = {json.dumps(closed)}\n" if closed else "",
        held=f"xi{held + 1}_min",
        tip=json.dumps(tip),
    )


def _closed(content: bytes, suffix: str, error: InputError) -> MeshFit:
    for name in ("xi1", "xi2"):
        try:
            return MeshFit.of(content, suffix, (name,))
        except InputError:
            continue
    raise error
