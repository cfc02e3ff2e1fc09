"""Series of states are read back as other programs read them, and one garment is the same at any resolution."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shellbench.bench.store.export import Sample, sample, samples, stored_run
from shellbench.bench.store.frames import as_pvd, export_series, numbered_file
from shellbench.bench.store.store import Store
from shellbench.errors import InputError
from shellbench.report.figures.film import film
from shellbench.report.figures.shells import Camera, Shell
from tests.bench.test_export import formula_sample

TIMES = (0.0, 0.25, 1.0)


def motion(jump: float = 0.0) -> list[Sample]:
    """A closed shell that moves along a formula, in three frames."""
    whole = formula_sample(jump=jump)
    return [replace(whole, displacement=t**2 * whole.displacement, at=t) for t in TIMES]


def test_a_series_is_numbered_files(tmp_path: Path) -> None:
    assert export_series(motion(), tmp_path / "shell.npz") == len(TIMES)
    for number, state in enumerate(motion()):
        with np.load(numbered_file(tmp_path / "shell.npz", number)) as arrays:
            np.testing.assert_array_equal(arrays["displacement"], state.displacement)


def test_pvd_lists_what_paraview_opens(tmp_path: Path) -> None:
    pyvista = pytest.importorskip("pyvista", reason="pyvista is not installed: .vtu can't be written or read")
    export_series(motion(), tmp_path / "shell.pvd")
    reader = pyvista.get_reader(tmp_path / "shell.pvd")
    assert tuple(reader.time_values) == TIMES
    reader.set_active_time_value(0.25)
    read = reader.read()[0].point_data["displacement"]
    np.testing.assert_array_equal(read, motion()[1].displacement[:-1].reshape(-1, 3))
    assert b'timestep="0.25" file="shell_001.vtu"' in as_pvd(tmp_path / "shell.pvd", TIMES)


@pytest.mark.usefixtures("toys")
def test_a_garment_is_the_same_at_any_resolution(recorded: Store) -> None:
    stored = stored_run(recorded, "strip", "toy", None)
    coarse, fine = (sample(recorded, stored, n) for n in (5, 17))
    for name, values in coarse.point_data.items():
        np.testing.assert_allclose(fine.point_data[name][::4, ::4], values, rtol=1e-12, atol=1e-15)


@pytest.mark.long
def test_a_film_moves_and_stops() -> None:
    from PIL import Image

    shells = [
        Shell("strip", "Strip", "toy", one.position, 1e6 * one.displacement, 1.0, Camera(15, -60)) for one in motion()
    ]
    shown = Image.open(io.BytesIO(film([shells], ["a", "b", "c"], ["toy"], 2)))
    assert (shown.n_frames, shown.info["loop"]) == (3, 1)  # shown once more, then it stands still
    frames = []
    for number in range(3):
        shown.seek(number)
        frames.append(np.asarray(shown.convert("L"), dtype=int))
    assert min(np.abs(one - frames[0]).max() for one in frames[1:]) > 60


def test_a_series_needs_several_states(recorded: Store, toys: None) -> None:
    from shellbench.bench.store.export import marks_of

    with pytest.raises(InputError, match="strip has one state only"):
        marks_of(stored_run(recorded, "strip", "toy", None), 5)
    with pytest.raises(InputError, match="--at"):
        list(samples(recorded, stored_run(recorded, "strip", "toy", None), 5, (0.5,)))
