"""Exported files are read by other programs with the same values, components, and a mesh without slits."""

import base64
import struct
import xml.etree.ElementTree as ElementTree
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.store.export import Sample, export, quadrilaterals, sample, stored_run
from shellbench.bench.store.store import Store
from shellbench.disk import StoreError
from shellbench.errors import InputError
from shellbench.problem import FIELDS
from shellbench.problems.shell.kind import COMPONENTS, ENERGY_DENSITY
from tests.bench.running import run

N = 13
BOTH_SEAMS = (True, True)


def formula_sample(name: str = "pinched_cylinder_free", jump: float = 0.0, at: float | None = None) -> Sample:
    """A surface of the catalog with a displacement from a formula, which may jump where the surface closes."""
    domain = catalog.named_case(name).surface.domain
    xi = domain.grid(N, N)
    a, b = ((xi[..., i] - domain.lower[i]) / domain.size[i] for i in (0, 1))
    wave = np.cos(4 * np.pi * a) * (1 + b)
    u = 1e-6 * np.stack([wave, np.sin(2 * np.pi * a) + jump * a, -2 * wave], axis=-1)
    strain = np.stack([wave, 2 + wave, 3 - wave], axis=-1)
    fields = {
        "membrane_strain": strain,
        "bending_strain": -7 * strain,
        "membrane_energy_density": wave**2,
        "bending_energy_density": 3 * wave**2,
        "strain_energy_density": 4 * wave**2,
    }
    position = catalog.named_case(name).surface.position(xi)
    return Sample(xi, position, u, fields, f"{name} by a formula", domain.periodic, at, COMPONENTS, ENERGY_DENSITY)


def vtk_arrays(path: Path) -> dict[str, tuple[np.ndarray, list[str]]]:
    """Arrays of a .vtu file with the names of their components, by the format's description and not by VTK.

    A binary array is a header (number of blocks, size of a block, size of the last, compressed sizes) and zlib
    blocks, each part in base64 (VTK file formats, "XML file formats").
    """
    root = ElementTree.parse(path).getroot()
    assert root.get("type") == "UnstructuredGrid"
    size = {"UInt32": 4, "UInt64": 8}[root.get("header_type", "UInt32")]
    code = "<" + {4: "I", 8: "Q"}[size]
    types = {"Float64": "<f8", "Int64": "<i8", "Int32": "<i4", "UInt8": "u1", "Float32": "<f4"}
    found = {}
    for array in root.iter("DataArray"):
        text = "".join((array.text or "").split())
        blocks = struct.unpack(code, base64.b64decode(text[: 4 * ((size + 2) // 3)])[:size])[0]
        head = 4 * -(-size * (3 + blocks) // 3)  # characters of the header
        sizes = struct.unpack(f"<{3 + blocks}{code[1]}", base64.b64decode(text[:head])[: size * (3 + blocks)])[3:]
        body, data, begin = base64.b64decode(text[head:]), b"", 0
        for length in sizes:
            data += zlib.decompress(body[begin : begin + length])
            begin += length
        count = int(array.get("NumberOfComponents", "1"))
        values = np.frombuffer(data, types[array.get("type", "")])
        names = [array.get(f"ComponentName{i}", "") for i in range(count)]
        found[array.get("Name", "")] = (values.reshape(-1, count) if count > 1 else values, names)
    return found


def corners_of(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Area vectors (m, 3) of quadrilaterals, half the cross product of their diagonals."""
    p = points[faces]
    return 0.5 * np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])


def edges_with_one_cell(faces: np.ndarray) -> int:
    """Return the number of edges that belong to one cell only: the free edges of a shell, or a slit."""
    edges = np.sort(np.concatenate([faces[:, [i, (i + 1) % 4]] for i in range(4)]), axis=1)
    return int((np.unique(edges, axis=0, return_counts=True)[1] == 1).sum())


def test_vtu_is_plain_xml_with_named_components(tmp_path: Path) -> None:
    pytest.importorskip("pyvista", reason="pyvista is not installed: .vtu can't be written")
    made = formula_sample()
    export(made, tmp_path / "shell.vtu")
    arrays = vtk_arrays(tmp_path / "shell.vtu")
    kept = slice(None, -1)  # the cylinder closes in xi1: the last row is the first
    for name, values in made.point_data.items():
        read, _ = arrays[name]
        np.testing.assert_array_equal(read, values[kept].reshape(read.shape))
    assert arrays["membrane_strain"][1] == arrays["bending_strain"][1] == ["11", "22", "12"]
    assert len(arrays["displacement"][1]) == 3
    assert arrays["xi"][1] == ["xi1", "xi2"]
    np.testing.assert_array_equal(arrays["Points"][0], made.position[kept].reshape(-1, 3))
    np.testing.assert_array_equal(
        arrays["strain_energy_density"][0], arrays["membrane_energy_density"][0] + arrays["bending_energy_density"][0]
    )


def test_pyvista_reads_vtu_and_warps_it(tmp_path: Path) -> None:
    pyvista = pytest.importorskip("pyvista", reason="pyvista is not installed: .vtu can't be written or read")
    made = replace(formula_sample(at=0.25), title="a title -- with --- dashes")
    export(made, tmp_path / "shell.vtu")
    mesh = pyvista.read(tmp_path / "shell.vtu")
    assert (mesh.n_points, mesh.n_cells) == ((N - 1) * N, (N - 1) ** 2)
    warped = mesh.warp_by_vector("displacement", factor=1e6)
    np.testing.assert_allclose(warped.points, made.deformed(1e6)[:-1].reshape(-1, 3), rtol=1e-12, atol=1e-9)
    assert mesh.active_vectors_name == "displacement"
    assert mesh.active_scalars_name == "strain_energy_density"
    assert mesh.field_data["TimeValue"] == [0.25]
    assert "a title - with - dashes" in (tmp_path / "shell.vtu").read_text(encoding="utf-8").splitlines()[1]
    edges = mesh.extract_feature_edges(boundary_edges=True, feature_edges=False, manifold_edges=False)
    assert edges.split_bodies().n_blocks == 2  # the two rims of the cylinder, and no slit from one to the other


def test_meshio_and_paraviews_reader_find_the_same_values_in_vtu(tmp_path: Path) -> None:
    meshio = pytest.importorskip("meshio")
    vtk = pytest.importorskip("vtkmodules.vtkIOXML", reason="VTK is not installed: .vtu can't be written or read")
    numpy_support = pytest.importorskip("vtkmodules.util.numpy_support")
    made = formula_sample(at=0.25)
    export(made, tmp_path / "shell.vtu")
    mesh = meshio.read(tmp_path / "shell.vtu")
    reader = vtk.vtkXMLUnstructuredGridReader()  # ParaView's own
    reader.SetFileName(str(tmp_path / "shell.vtu"))
    reader.Update()
    read = reader.GetOutput()
    assert [block.type for block in mesh.cells] == ["quad"]
    np.testing.assert_array_equal(mesh.cells[0].data, quadrilaterals(N, made.closed))
    np.testing.assert_array_equal(mesh.points, made.position[:-1].reshape(-1, 3))
    np.testing.assert_array_equal(numpy_support.vtk_to_numpy(read.GetPoints().GetData()), mesh.points)
    for name, values in made.point_data.items():
        expected = values[:-1].reshape(mesh.point_data[name].shape)
        np.testing.assert_array_equal(mesh.point_data[name], expected)
        np.testing.assert_array_equal(numpy_support.vtk_to_numpy(read.GetPointData().GetArray(name)), expected)


@pytest.mark.parametrize("name", ["square_plate", "scordelis_lo", "pinched_cylinder_free", "annular_plate"])
def test_normals_of_cells_point_along_the_director(name: str) -> None:
    made = formula_sample(name)
    surface = catalog.named_case(name).surface
    faces = quadrilaterals(N, made.closed)
    lower, step = made.xi[0, 0], (made.xi[-1, -1] - made.xi[0, 0]) / (N - 1)
    i, j = (index.ravel() for index in np.meshgrid(np.arange(N - 1), np.arange(N - 1), indexing="ij"))
    middle = lower + step * (np.stack([i, j], axis=-1) + 0.5)
    first = surface.derivatives(middle, order=1)
    director = np.cross(first[1, 0], first[0, 1])
    areas = corners_of(made.vertices(made.position), faces)
    cosine = np.sum(areas * director, axis=-1) / np.linalg.norm(areas, axis=-1) / np.linalg.norm(director, axis=-1)
    assert cosine.min() > 0.9


def test_a_seam_is_shared_where_surface_and_field_close() -> None:
    whole, torn = formula_sample(), formula_sample(jump=1e-3)
    rims = 2 * (N - 1)
    assert whole.closed == (True, False)
    assert edges_with_one_cell(quadrilaterals(N, whole.closed)) == rims
    assert torn.closed == (False, False)  # its jump must be seen
    assert edges_with_one_cell(quadrilaterals(N, torn.closed)) == rims + 2 * (N - 1)
    assert formula_sample("scordelis_lo").closed == (False, False)


def test_a_mesh_closed_both_ways_has_no_edge() -> None:
    faces = quadrilaterals(N, BOTH_SEAMS)
    assert edges_with_one_cell(faces) == 0
    vertices, edges = len(np.unique(faces)), 2 * len(faces)
    assert vertices == (N - 1) ** 2
    assert vertices - edges + len(faces) == 0  # Euler characteristic of a torus


def test_obj_keeps_displacements_far_smaller_than_the_shell(tmp_path: Path) -> None:
    made = formula_sample()
    export(made, tmp_path / "shell.obj", scale=2.0)
    lines = (tmp_path / "shell.obj").read_text(encoding="utf-8").splitlines()
    points = np.array([line.split()[1:] for line in lines if line.startswith("v ")], dtype=float)
    faces = np.array([line.split()[1:] for line in lines if line.startswith("f ")], dtype=int) - 1
    expected = made.position[:-1] + 2.0 * made.displacement[:-1]
    np.testing.assert_array_equal(points, expected.reshape(-1, 3))  # 1e-6 beside 300
    np.testing.assert_array_equal(faces, quadrilaterals(N, (True, False)))
    assert made.title in lines[0]


def test_npz_keeps_the_grid_with_both_sides_of_a_seam(tmp_path: Path) -> None:
    made = formula_sample()
    export(made, tmp_path / "shell.npz")
    with np.load(tmp_path / "shell.npz") as arrays:
        assert set(arrays) == {"xi", "position", "displacement", *FIELDS, "strain_energy_density"}
        np.testing.assert_array_equal(arrays["position"], made.position)
        for name, values in made.point_data.items():
            np.testing.assert_array_equal(arrays[name], values)


def test_an_unknown_suffix_leaves_nothing_behind(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\.npz, \.obj, \.vtu"):
        export(formula_sample(), tmp_path / "shell.stl")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", [".npz", ".obj", ".vtu"])
def test_a_disk_that_is_full_is_said_and_leaves_nothing(suffix: str, tmp_path: Path) -> None:
    """A limit on the size of files stands for the full disk: writing more fails in the same way, in C++ too."""
    resource = pytest.importorskip("resource", reason="no limits on files outside POSIX")
    if suffix == ".vtu":
        pytest.importorskip("pyvista", reason="pyvista is not installed: .vtu can't be written")
    path = tmp_path / f"shell{suffix}"
    path.write_bytes(b"an older export")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with pytest.raises(StoreError, match="can't be written"):
            export(formula_sample(), path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
    assert path.read_bytes() == b"an older export"


@pytest.mark.usefixtures("toys")
def test_a_stored_solution_is_exported_with_its_own_values(recorded: Store, tmp_path: Path) -> None:
    stored = stored_run(recorded, "strip", "toy", None)
    export(sample(recorded, stored, 9), tmp_path / "strip.npz")
    with np.load(tmp_path / "strip.npz") as arrays:
        energy = arrays["strain_energy_density"]
        np.testing.assert_array_equal(energy, arrays["membrane_energy_density"] + arrays["bending_energy_density"])
        stiffness, kappa = stored.case.material.bending_stiffness, arrays["bending_strain"][..., 0]
        np.testing.assert_allclose(energy, 0.5 * stiffness * kappa**2, rtol=1e-12)
        assert energy.max() > 0


@pytest.mark.long
def test_a_real_sleeve_reaches_paraview_as_it_was_solved(tmp_path: Path) -> None:
    """The finite element solution of a closed cylinder, through its file: largest displacement, energy, and seam."""
    pyvista = pytest.importorskip("pyvista", reason="pyvista is not installed: .vtu can't be written or read")
    store = Store(tmp_path / "runs")
    run(store, "sleeve_torque", solvers=("fem",))
    stored = stored_run(store, "sleeve_torque", "fem", None)
    export(sample(store, stored, 121), tmp_path / "sleeve.vtu")
    mesh = pyvista.read(tmp_path / "sleeve.vtu")
    assert mesh.n_points == 120 * 121
    values = {name: measured.value for name, measured in stored.record.values.items()}
    largest = np.linalg.norm(mesh.point_data["displacement"], axis=1).max()
    assert largest == pytest.approx(values["largest_displacement"], rel=1e-6)  # at a rim
    areas = np.linalg.norm(corners_of(np.asarray(mesh.points), quadrilaterals(121, (True, False))), axis=1)
    cells = mesh.point_data_to_cell_data().cell_data["strain_energy_density"]
    assert float(areas @ cells) == pytest.approx(values["strain_energy"], rel=1e-3)  # trapezoidal
