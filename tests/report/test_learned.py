"""Section on fields of the unit square: courses of what trains, epochs to errors, and where samples go."""

from types import SimpleNamespace

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.row import Row
from shellbench.bench.plugins.kinds import portrait_of_named
from shellbench.report.studies import learned
from shellbench.report.studies.learned import Learned, table

COURSE = ((10, 2e-2), (20, 3e-3), (30, 4e-3), (40, 8e-4))


def run(name="field_sine", label="", reference=0.0, course=COURSE, value=7e-4, **settings):
    row = Row(
        case=name, suite=None, solver="one", settings=settings, seed=0, quantity="q", primary=True, at=1.0, value=value,
        status="ok", reference=reference, seconds=2.0, label=label, overrides=settings, default_settings=not settings,
        unit="m", run_id=f"{name} {label}",
    )  # fmt: skip
    record = SimpleNamespace(
        parameters=12, run_id=row.run_id, fields_file="kept.npz", case=catalog.named_case(name).data()
    )
    return Learned(row, record, tuple(epoch for epoch, _ in course), tuple(error for _, error in course))


def test_an_error_is_reached_at_the_first_epoch_that_has_it():
    assert [run().reaches(error) for error in (5e-3, 2e-3, 1e-3, 5e-4)] == [20, 40, 40, None]
    (line,) = table([run()]).data.to_dict("records")
    assert (line["to_0.005"], line["to_0.001"], line["epochs"], line["parameters"]) == (20, 40, 40, 12)
    assert line["error"] == pytest.approx(7e-4)
    (line,) = table([run(reference=8e-3, value=6e-3, course=())]).data.to_dict("records")
    assert line["relative"] == pytest.approx(25.0)


def test_a_family_is_a_name_without_the_value_that_is_swept():
    assert learned._family(run(label="cubic, resolution 16")) == "one, cubic"
    assert learned._family(run(label="plain, ReLU")) == "one, plain, ReLU"


def test_only_fields_learn_and_only_adaptive_samples_are_kept(tmp_path):
    assert portrait_of_named(catalog.named_case("field_hang")).learns
    assert not portrait_of_named(catalog.named_case("field_sampler")).learns
    assert not portrait_of_named(catalog.named_case("square_plate")).learns
    found = SimpleNamespace(folder=tmp_path)
    np.savez(tmp_path / "kept.npz", density=np.ones((2, 3)), points=np.zeros((5, 2)), grid_0=np.zeros(3))
    density, points = learned.kept_samples(run("field_hang"), found)
    assert (density.shape, points.shape) == ((2, 3), (5, 2))
    np.savez(tmp_path / "kept.npz", grid_0=np.zeros(3))
    assert learned.kept_samples(run("field_hang"), found) is None
