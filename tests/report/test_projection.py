import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from shellbench.report.figures.grids import facet_means, facets, inward, refined, wires
from shellbench.report.figures.shells import AMBIENT, Camera, shading

cameras = st.builds(Camera, st.floats(-90, 90), st.floats(-360, 360), st.sampled_from("xyz"))


def sheet(n1: int, n2: int, width: float = 1.0, length: float = 1.0) -> np.ndarray:
    x, y = np.meshgrid(np.linspace(0, width, n1), np.linspace(0, length, n2), indexing="ij")
    return np.stack([x, y, 0 * x], axis=-1)


@given(cameras)
def test_a_camera_turns_and_does_not_stretch_or_mirror(camera):
    assert camera.axes @ camera.axes.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(camera.axes) == pytest.approx(1.0)


@given(st.floats(-80, 80), st.floats(-360, 360), st.sampled_from("xyz"))
def test_up_is_up(elevation, azimuth, up):
    right, upwards, _ = Camera(elevation, azimuth, up).look(np.eye(3)["xyz".index(up)])
    assert right == pytest.approx(0.0, abs=1e-12)
    assert upwards > 0.1


def test_from_above_x_is_right_and_y_is_up():
    camera = Camera(90, -90)
    assert camera.look(np.array([1.0, 2.0, 3.0])) == pytest.approx([1.0, 2.0, 3.0])


def test_what_is_nearer_has_the_larger_depth():
    camera = Camera(0, 0)  # the viewer is on the positive x axis
    near, far = camera.look(np.array([[2.0, 0, 0], [1.0, 0, 0]]))
    assert near[2] > far[2]


def test_facets_cover_the_sheet_once():
    corners = facets(sheet(4, 6, 2.0, 3.0))
    assert corners.shape == (15, 4, 3)
    a, b, c, d = np.moveaxis(corners, 1, 0)
    area = 0.5 * np.linalg.norm(np.cross(c - a, d - b), axis=-1)
    assert area.sum() == pytest.approx(6.0)


def test_facet_means_belong_to_their_facets():
    grid = sheet(5, 7)
    assert facet_means(grid[..., 0]) == pytest.approx(facets(grid)[..., 0].mean(1))


def test_light_is_the_same_on_both_sides_and_never_dark():
    camera = Camera(30, 40)
    seen = camera.look(facets(sheet(4, 4)))
    lit = shading(seen)
    assert lit == pytest.approx(shading(seen[:, ::-1]))
    assert np.all((lit >= AMBIENT) & (lit <= 1))


def test_refining_keeps_the_given_points_and_reproduces_cubics():
    x, y = np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 1, 9), indexing="ij")
    grid = np.stack([x, y, x**3 - 2 * x * y**2], axis=-1)
    fine = refined(grid, 24)
    assert fine.shape[:2] == (25, 25)
    assert fine[::3, ::3] == pytest.approx(grid, abs=1e-12)
    assert fine[..., 2] == pytest.approx(fine[..., 0] ** 3 - 2 * fine[..., 0] * fine[..., 1] ** 2, abs=1e-12)


def test_wires_are_equally_far_apart_and_include_the_edges():
    pieces = wires(sheet(61, 61, 4.0, 1.0), 9)
    across = {round(float(v), 6) for v in pieces[np.ptp(pieces[..., 0], axis=1) < 1e-12][:, 0, 0]}
    along = {round(float(v), 6) for v in pieces[np.ptp(pieces[..., 1], axis=1) < 1e-12][:, 0, 1]}
    assert {0.0, 4.0} <= across
    assert {0.0, 1.0} <= along
    assert 4.0 / (len(across) - 1) == pytest.approx(1.0 / (len(along) - 1), rel=0.25)


@pytest.mark.parametrize("mirrored", [False, True])
def test_inward_is_toward_the_axis_of_a_cylinder_whichever_way_its_coordinates_run(mirrored):
    angle, y = np.meshgrid(np.linspace(0, 2 * np.pi, 181), np.linspace(5, 9, 4), indexing="ij")
    position = np.stack([3 + 2 * np.cos(angle), y, 2 * np.sin(angle) - 1], axis=-1)
    normal = inward(position[::-1] if mirrored else position)
    exact = -np.stack([np.cos(angle), 0 * y, np.sin(angle)], axis=-1)
    assert normal == pytest.approx(exact[::-1] if mirrored else exact, abs=1e-3)  # differences of second order
