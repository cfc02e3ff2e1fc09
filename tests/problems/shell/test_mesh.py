"""Surfaces from meshes: what is read and refused, how good the fit is, and what it says of itself."""

import itertools

import numpy as np
import pytest

from docs.meshes import SHAPES, cylinder, obj, roof
from shellbench.bench.catalogue import catalog
from shellbench.bench.run.worker import with_data_errors
from shellbench.bench.store.record import Measured
from shellbench.errors import InputError
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.mesh.file import read_mesh
from shellbench.problems.shell.mesh.fit import MeshFit
from shellbench.problems.shell.mesh.patch import patch_of
from shellbench.problems.shell.mesh.spline import fit_spline
from shellbench.problems.shell.mesh.template import case_of_mesh

GRID = np.stack(np.meshgrid(*[np.linspace(0, 1, 23)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)


def fit(text, periodic=None):
    return MeshFit.of(text.encode(), ".obj", periodic)


def scattered(shape, n=12, seed=3):
    """An OBJ of a triangulation in no order: inner points of a grid moved, then counted otherwise."""
    rng = np.random.default_rng(seed)
    xi = np.stack(np.meshgrid(*[np.linspace(0, 1, n)] * 2, indexing="ij"), axis=-1)
    xi[1:-1, 1:-1] += rng.uniform(-0.3, 0.3, (n - 2, n - 2, 2)) / n
    order = rng.permutation(n * n)
    number = np.argsort(order) + 1
    flat = xi.reshape(-1, 2)[order]
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in shape(*flat.T).tolist()] + [
        f"vt {u!r} {v!r}" for u, v in flat.tolist()
    ]
    for i, j in itertools.product(range(n - 1), repeat=2):
        a, b, c, d = (number[k] for k in (i * n + j, (i + 1) * n + j, (i + 1) * n + j + 1, i * n + j + 1))
        lines += [f"f {p}/{p} {q}/{q} {r}/{r}" for p, q, r in ((a, b, c), (a, c, d))]
    return "\n".join(lines)


def plane(u, v):
    return np.stack([3 * u + v, 2 * v - u, 1 + 0.5 * u], axis=-1)


def curvature(spline, points=GRID):
    """Of the lines along xi1, 1/m."""
    x = spline.derivatives(points, 2)
    normal = np.cross(x[1, 0], x[0, 1])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.abs(np.sum(x[2, 0] * normal, axis=-1)) / np.sum(x[1, 0] ** 2, axis=-1)


def test_a_plane_is_exact_whatever_its_triangles():
    found = fit(scattered(plane))
    assert found.first.spans == (1, 1)
    assert np.abs(found.first.derivatives(GRID, 0)[0, 0] - plane(*GRID.T)).max() < 1e-11
    assert max(found.position_error, found.curvature_error) < 1e-9


def test_derivatives_match_differences_and_the_third_is_continuous():
    spline = fit_spline(GRID, cylinder(*GRID.T), ((0, 0), (1, 1)), (4, 3), (True, False))
    at, step = np.array([[0.11, 0.2], [0.25, 1 / 3], [0.0, 0.7]]), 1e-4  # two of them on knots
    for (i, j), axis in itertools.product([(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)], (0, 1)):
        move = step * np.eye(2)[axis]
        before, after = (spline.derivatives(at + sign * move, 3)[i, j] for sign in (-1, 1))
        exact = spline.derivatives(at, 3)[i + (axis == 0), j + (axis == 1)]
        assert np.abs((after - before) / (2 * step) - exact).max() < 3e-3 * max(1, np.abs(exact).max())


def test_the_curvature_of_a_spline_converges_with_its_fourth_power():
    dense = np.stack(np.meshgrid(*[np.linspace(0, 1, 61), np.linspace(0, 1, 9)], indexing="ij"), axis=-1).reshape(-1, 2)
    spans, errors = (4, 6, 8), []
    for n in spans:
        spline = fit_spline(dense, roof(*dense.T), ((0, 0), (1, 1)), (n, 1), (False, False))
        errors.append(
            (np.abs(spline.derivatives(GRID, 0)[0, 0] - roof(*GRID.T)).max(), np.abs(25 * curvature(spline) - 1).max())
        )
    rates = -np.polyfit(np.log(spans), np.log(errors), 1)[0]
    assert rates == pytest.approx([6, 4], abs=0.6)


@pytest.mark.parametrize(
    ("shape", "periodic", "noise"), [(roof, None, 0.0), (roof, None, 1e-4), (cylinder, ("xi1",), 0.0)]
)
def test_the_stated_errors_hold(shape, periodic, noise):
    found = fit(obj(shape, 20, periodic is not None, noise), periodic)
    assert np.abs(found.first.derivatives(GRID, 0)[0, 0] - shape(*GRID.T)).max() <= 2 * found.position_error
    radius = 25 if shape is roof else 300
    assert np.abs(curvature(found.first) - 1 / radius).max() <= 2 * found.curvature_error
    assert found.curvature_error * radius < (0.5 if noise else 1e-2)


def test_an_ascii_ply_is_the_obj():
    mesh = read_mesh(scattered(roof, 6).encode(), ".obj")
    rows = [
        f"{x!r} {y!r} {z!r} {s!r} {t!r}"
        for (x, y, z), (s, t) in zip(mesh.positions.tolist(), mesh.texture.tolist(), strict=True)
    ]
    head = [
        "ply",
        "format ascii 1.0",
        f"element vertex {len(rows)}",
        *(f"property float {n}" for n in ("x", "y", "z", "s", "t")),
    ]
    head += [f"element face {len(mesh.triangles)}", "property list uchar int vertex_indices", "end_header"]
    ply = read_mesh("\n".join([*head, *rows, *(f"3 {a} {b} {c}" for a, b, c in mesh.triangles)]).encode(), ".ply")
    for name in ("positions", "texture", "triangles", "corners"):
        assert np.array_equal(getattr(ply, name), getattr(mesh, name))


SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
TUBE = obj(cylinder, 8, True)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (SQUARE + "f 1 2 3", "line 9: a face has no texture coordinates"),
        (SQUARE + "f 1/1 2/2 3/5", "line 9: a face names texture coordinate 5, and there are 4 before it"),
        (SQUARE + "f 1/1 2/2 x/3", "line 9: can't read 'f 1/1 2/2 x/3'"),
        (SQUARE, "it has no faces"),
        (SQUARE.replace("v 0 0 0", "v nan 0 0") + "f 1/1 2/2 3/3 4/4", "position 1 is not finite"),
        (SQUARE + "f 1/1 2/2 3/3\nf 1/1 4/4 3/3", "1 of 2 triangles are flipped"),
        (SQUARE + "f 4/4 3/3 2/2 1/1", "all its triangles wind clockwise in (u, v)"),
        (SQUARE + "f 1/1 2/2 3/3", "its boundary leaves the sides of the rectangle of (u, v), near (0.5, 0.5): a hole"),
        (SQUARE + "v 2 0 0\nf 1/1 2/2 3/3\nf 5/1 3/3 4/4", "texture vertex 1 at (0, 0) has two positions"),
        (SQUARE + "v 0 0 0\nv 1 1 0\nvt 0 0\nvt 1 1\nf 1/1 2/2 3/3\nf 5/5 6/6 4/4", "vertices are there twice, at a seam inside it"),
        (SQUARE + "vt 0.5 0\nf 1/1 2/2 3/3\nf 1/5 3/3 4/4", "a hole, or a ragged edge"),
        ("\n".join(line for line in obj(roof, 6, False).splitlines() if line != "f 15/15 21/21 22/22 16/16"), "a hole"),
        (SQUARE.replace("v 1 1 0", "v 0.2 0.2 0").replace("v 1 0 0", "v 1 1 0") + "f 1/1 2/2 3/3\nf 1/1 3/3 4/4", "folds near"),
    ],
)  # fmt: skip
def test_what_is_no_patch_is_refused_in_one_sentence(text, words):
    with pytest.raises(InputError) as caught:
        fit(text)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_other_files_are_refused():
    for content, suffix, words in ((b"ply\nformat binary_little_endian 1.0\n", ".ply", "binary"), (b"", ".step", "a mesh is one of .obj, .ply, .bdf"), (b"\xff", ".obj", "UTF-8")):  # fmt: skip
        with pytest.raises(InputError, match=words):
            read_mesh(content, suffix)


def test_a_closed_mesh_closes_only_if_the_case_says_so():
    mesh = read_mesh(TUBE.encode(), ".obj")
    with pytest.raises(InputError, match=r'meet in space: say periodic = \["xi1"\]'):
        patch_of(mesh, None)
    assert patch_of(mesh, ()).counts == (9, 8)  # slit
    with pytest.raises(InputError, match=r"periodic in xi2, but its sides across v are .* apart"):
        patch_of(mesh, ("xi1", "xi2"))
    spline = fit(TUBE, ("xi1",)).first
    ends = spline.derivatives(np.array([[0.0, 0.3], [1.0, 0.3]]), 3)
    assert all(np.allclose(value[0], value[1], rtol=0, atol=1e-12 * np.abs(value).max()) for value in ends.values())


def test_a_case_finds_its_mesh_and_is_known_by_its_content(tmp_path):
    (tmp_path / "mine.obj").write_text(obj(roof, 12, False))
    text = case_of_mesh(tmp_path / "mine.obj", tmp_path / "mine.toml").replace(
        (tmp_path / "mine.obj").as_posix(), "mine.obj"
    )
    (tmp_path / "mine.toml").write_text(text)
    case = catalog.find_case(str(tmp_path / "mine.toml"))
    assert case.surface.domain.upper == (1.0, 1.0)
    assert "coefficients" not in str(case.shown())
    again = type(case).model_validate(case.data())
    assert again.digest() == case.digest() != case.asked_as_well().digest()
    (tmp_path / "mine.obj").write_text(obj(roof, 12, False, 1e-5))
    assert catalog.find_case(str(tmp_path / "mine.toml")).digest() != case.digest()
    for surface, words in (
        ({"mesh": "none.obj"}, "none.obj: it can't be read"),
        ({}, "field 'surface.mesh' is missing"),
        ({"mesh": "mine.obj", "periodic": ["xi3"]}, "field 'surface.periodic'"),
        ({"mesh": "mine.obj", "fit": {}}, "field 'surface.fit' is not known here"),
    ):
        with pytest.raises(InputError, match=r"^[^\n]*$") as caught:
            build_case({"surface": {"kind": "mesh", **surface}}, "x", str(tmp_path / "x.toml"))
        assert words in str(caught.value)


@pytest.mark.parametrize(
    ("name", "formula"), [("roof_mesh", "scordelis_lo"), ("pinched_mesh", "pinched_cylinder_diaphragm")]
)
def test_a_mesh_is_the_shell_of_which_values_are_known(name, formula):
    case, other = catalog.named_case(name), catalog.named_case(formula)
    known = {(v.quantity, v.origin): v for v in catalog.known_values(formula).values}
    assert all(known[v.quantity, v.origin] == v for v in catalog.known_values(name).values)
    for place, point in case.points.items():
        assert np.allclose(case.surface.position(point), other.surface.position(other.places[place].xi), atol=1e-5)
    assert (case.material, case.loads, case.quantities) == (other.material, other.loads, other.quantities)
    shape = SHAPES[name][0]
    assert np.abs(case.surface.position(GRID) - shape(*GRID.T)).max() <= 2 * case.surface.fit.position_error


def test_what_the_mesh_leaves_open_is_part_of_the_uncertainty():
    class Other:
        uncertainty = extrapolated = {}  # noqa: RUF012

    class Solver:
        def solve(self, case, settings, progress):
            return Other()

    class Quantity:
        name, factor = "w", 1.0

        def measure(self, solution):
            return 2.5

    class Problem:
        quantities = (Quantity(),)

        def asked_as_well(self):
            return self

    values = {"w": Measured(value=2.0, uncertainty=0.1), "v": Measured(value=1.0, uncertainty=0.1)}
    found = with_data_errors(Solver(), None, Problem(), values, None)
    assert (found["w"].data_error, found["w"].uncertainty) == (1.0, 1.1)
    assert (found["v"].data_error, found["v"].uncertainty) == (None, None)


def split_corners(shape, n):
    """An OBJ with a texture vertex for each corner of a face, in eight digits as programs write them."""
    lines = obj(shape, n, False).splitlines()
    texture = [line for line in lines if line.startswith("vt")]
    faces = [[corner.split("/") for corner in line.split()[1:]] for line in lines if line.startswith("f")]
    corners = [corner for face in faces for corner in face]
    shift = [1e-8 * (number % 3 - 1) for number in range(len(corners))]
    split = [
        " ".join(["vt", *(f"{float(x) + d:.8f}" for x in texture[int(t) - 1].split()[1:])])
        for (_, t), d in zip(corners, shift, strict=True)
    ]
    count = itertools.count(1)
    return "\n".join(
        [
            *(line for line in lines if line.startswith("v ")),
            *split,
            *("f " + " ".join(f"{v}/{next(count)}" for v, _ in face) for face in faces),
        ]
    )


def test_corners_that_are_split_at_the_same_texture_coordinates_are_no_seam():
    found, whole = fit(split_corners(roof, 9)), fit(obj(roof, 9, False))
    assert (found.vertices, found.triangles) == (81, 128)
    points = np.array([[0.3, 0.7], [0.9, 0.1]])
    assert found.first.derivatives(points, 0)[0, 0] == pytest.approx(whole.first.derivatives(points, 0)[0, 0], abs=1e-6)


def test_a_true_seam_stays_one():
    """Vertices of the cylinder's seam are at u = 0 and at u = 1: they count twice."""
    texture, positions = (sum(line.startswith(word) for line in TUBE.splitlines()) for word in ("vt ", "v "))
    assert fit(TUBE, ("xi1",)).vertices == texture > positions


def test_a_line_of_an_obj_goes_on_after_a_backslash():
    lines = obj(roof, 6, False).splitlines()
    broken = [line.replace(" ", " \\\n ", 2) if line[0] in "fv" else line for line in lines]
    found = read_mesh("\r\n".join(["# C:\\meshes\\", *broken]).encode(), ".obj")
    whole = read_mesh("\n".join(lines).encode(), ".obj")
    assert np.array_equal(found.positions, whole.positions)
    assert np.array_equal(found.corners, whole.corners)
    with pytest.raises(InputError, match="line 9: can't read"):
        read_mesh((SQUARE + "f 1/1 \\\n2/2 x/3").encode(), ".obj")


def by_meshio(folder, suffix, data=None):
    """A mesh of the roof as another program writes it."""
    meshio = pytest.importorskip("meshio")
    whole = read_mesh(obj(roof, 9, False).encode(), ".obj")
    faces = whole.triangles
    texture = np.zeros((81, 2))
    texture[whole.triangles.ravel()] = whole.texture[whole.corners.ravel()]
    named = {name: values(texture) for name, values in (data or {}).items()}
    path = folder / f"mesh{suffix}"
    cells = [("line", faces[:3, :2]), ("triangle", faces)] if suffix not in {".stl", ".msh"} else [("triangle", faces)]
    meshio.Mesh(whole.positions, cells, point_data=named).write(
        path, **({"file_format": "gmsh"} if suffix == ".msh" else {})
    )
    return path


U_AND_V = {"u": lambda texture: texture[:, 0], "v": lambda texture: texture[:, 1]}


@pytest.mark.parametrize(
    ("suffix", "data"),
    [(".vtu", U_AND_V), (".vtu", {"xi": lambda texture: texture}), (".vtk", U_AND_V), (".msh", U_AND_V)],
)
def test_meshes_of_other_programs_are_the_same_surface(tmp_path, suffix, data):
    read, whole = (
        read_mesh(by_meshio(tmp_path, suffix, data).read_bytes(), suffix),
        read_mesh(obj(roof, 9, False).encode(), ".obj"),
    )
    assert read.positions == pytest.approx(whole.positions, rel=1e-9, abs=1e-9)
    assert np.array_equal(read.triangles, whole.triangles)
    assert read.texture[read.corners] == pytest.approx(whole.texture[whole.corners], abs=1e-9)


def test_no_abaqus_file_includes_another(tmp_path):
    (tmp_path / "other.inp").write_text("*NODE\n1,0,0,0\n2,1,0,0\n3,0,1,0\n*ELEMENT, TYPE=S3\n1,1,2,3\n")
    for word in ("*INCLUDE", "*inc*lude", "include", " * Include"):
        for line in ("\n", "\r", "\r\n"):
            with pytest.raises(InputError, match="includes another file"):
                read_mesh(f"*HEADING{line}{word}, INPUT={tmp_path / 'other.inp'}{line}".encode(), ".inp")
    with pytest.raises(InputError, match="no texture"):
        read_mesh(b"** include, in a comment\n" + (tmp_path / "other.inp").read_bytes(), ".inp")


@pytest.mark.parametrize("suffix", [".bdf", ".inp", ".msh", ".stl", ".vtk", ".vtu"])
def test_meshes_without_texture_coordinates_say_how_to_add_them(tmp_path, suffix):
    with pytest.raises(
        InputError, match=r"^it has no texture coordinates \(u, v\).*write the mesh as OBJ with lines 'vt u v'"
    ):
        read_mesh(by_meshio(tmp_path, suffix).read_bytes(), suffix)


@pytest.mark.parametrize("suffix", [".bdf", ".inp", ".msh", ".stl", ".vtk", ".vtu"])
@pytest.mark.parametrize(
    "content", [b"", b"$MeshFormat\n9 9 9\n", b"<VTKFile>", b"*NODE\n1,a,b", b"*include, input=/dev/zero\n", bytes(300)]
)
def test_a_broken_mesh_of_another_program_is_one_sentence(suffix, content, capsys):
    with pytest.raises(InputError, match=r"^[^\n]{1,300}$"):
        read_mesh(content, suffix)
    assert capsys.readouterr() == ("", "")
