"""Surfaces from meshes: a fault of what is read or fitted turns the gate red, or the mesh is refused."""

import re

import numpy as np
import pytest

from docs.meshes import cylinder, obj, roof
from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError, SolveFailure
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.mesh import fit, patch, spline
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.protocol.schema import read_toml
from shellbench.solvers.fem.solver import FemSettings, FemSolver

# A free tube is so soft in bending that a ripple of 1e-5 of its radius moves it by 2e-3: it gets a finer mesh.
POINTS = {"roof_mesh": 24, "pinched_mesh": 24, "tube": 48}
CELLS = {"roof_mesh": (12, 12), "pinched_mesh": (24, 12), "tube": (8, 8)}
GRADED = 0.3


def graded(shape):
    """A shape with coordinates that are denser at the ends: second derivatives have tangential parts."""

    def shifted(u, v):
        return shape(*(x - GRADED / (4 * np.pi) * np.sin(4 * np.pi * x) for x in (u, v)))

    return shifted


def case_of(name, folder, **surface):
    """Return a case of the suite, or the tube, on a coarser mesh, that of the roof uneven."""
    shape = roof if name == "roof_mesh" else cylinder
    (folder / "mesh.obj").write_text(obj(graded(roof) if shape is roof else shape, POINTS[name], shape is cylinder))
    data = read_toml(catalog.data_folder("cases") / ("roof_mesh.toml" if name == "roof_mesh" else "pinched_mesh.toml"))
    data["surface"] |= {"mesh": "mesh.obj"} | surface
    if name == "tube":  # under pressure from within: a1 x a2 points to the axis
        data |= {
            "loads": [{"kind": "pressure", "value": -1.0}],
            "supports": [],
            "material": data["material"] | {"poissons_ratio": 0.0},
        }
        data["remove_rigid_motions"] = [f"{kind}_{axis}" for kind in ("translation", "rotation") for axis in "xyz"]
        data["quantities"][0]["direction"] = [[0, 0, 1], [0, 0, -1]]
    return build_case(data, name, str(folder / "case.toml"))


def errors(name, folder, **surface):
    """Solve on one mesh of elements; return errors in units of what the suite allows."""
    case = case_of(name, folder, **surface)
    values = measure_all(FemSolver().solve(case, FemSettings(cells=CELLS[name])))
    if name == "tube":
        radius, h, young = 300.0, 3.0, 3e6
        known = {
            "load_deflection": radius**2 / (young * h * (1 + h**2 / (12 * radius**2)))
        }  # R^2 p/(E h), and bending's share
    else:
        known = {q.name: catalog.known_values(name).judge(q.name, case.theory).value for q in case.quantities}
    return [abs(values[q] / value - 1) / 1e-3 for q, value in known.items()]


@pytest.mark.long
@pytest.mark.parametrize("name", CELLS)
def test_what_is_whole_is_green(name, tmp_path):
    assert max(errors(name, tmp_path)) < 1


def doubled(patch_):
    """Curvature twice what it is."""
    found = spline.Spline.derivatives
    patch_.setattr(
        spline.Spline,
        "derivatives",
        lambda self, points, order=2: {
            key: x * (2 if sum(key) == 2 else 1) for key, x in found(self, points, order).items()
        },
    )


def exchanged(patch_):
    """u and v exchanged where texture coordinates are read."""
    read = fit.read_mesh
    patch_.setattr(fit, "read_mesh", lambda *a: _with_texture(read(*a), lambda xi: xi[:, ::-1]))


def exchanged_unseen(patch_):
    """The same, and triangles turned round so that they do not show it."""
    read = fit.read_mesh

    def turned(*a):
        mesh = _with_texture(read(*a), lambda xi: xi[:, ::-1])
        return type(mesh)(mesh.positions, mesh.texture, mesh.triangles[:, ::-1], mesh.corners[:, ::-1])

    patch_.setattr(fit, "read_mesh", turned)


def flipped(patch_):
    """The other normal: v runs backwards, and nobody looks."""
    read = fit.read_mesh

    def turned(*a):
        mesh = _with_texture(read(*a), lambda xi: np.stack([xi[:, 0], 1 - xi[:, 1]], axis=-1))
        return type(mesh)(mesh.positions, mesh.texture, mesh.triangles[:, ::-1], mesh.corners[:, ::-1])

    patch_.setattr(fit, "read_mesh", turned)


def _with_texture(mesh, change):
    return type(mesh)(mesh.positions, change(mesh.texture), mesh.triangles, mesh.corners)


def seam_ignored(patch_):
    """A closed mesh is fitted as if it were slit."""
    patch_.setattr(patch, "_check_closure", lambda *a: None)


def stiff(patch_):
    """One span in each direction, however the surface curves."""
    patch_.setattr(fit._Fitting, "choose_spans", lambda self: (1, 1))


@pytest.mark.long
@pytest.mark.parametrize(
    ("fault", "name"),
    [
        (doubled, "roof_mesh"),
        (exchanged, "roof_mesh"),
        (exchanged_unseen, "roof_mesh"),
        (flipped, "tube"),
        (seam_ignored, "pinched_mesh"),
        (stiff, "pinched_mesh"),
    ],
)
def test_a_fault_is_red(fault, name, tmp_path, monkeypatch):
    fault(monkeypatch)
    from shellbench.problems.shell.mesh import surface

    monkeypatch.setattr(surface, "_fitted", fit.MeshFit.of)
    try:
        found = errors(name, tmp_path, **({"periodic": []} if fault is seam_ignored else {}))
    except (SolveFailure, InputError, ValueError) as error:
        if not re.search("clockwise|folds|degenerate|smoothly|singular", str(error)):
            raise
        return
    assert not max(found) < 1
