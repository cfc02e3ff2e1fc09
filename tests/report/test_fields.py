import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.fields import Fields, areas, differences
from shellbench.report.sections.whole_fields import field_table
from tests.report.conftest import Store


def test_areas_sum_to_the_cylinders_area():
    case = catalog.named_case("pinched_cylinder_free")
    xi = case.surface.domain.grid(121, 61)
    assert areas(case.surface.position(xi)).sum() == pytest.approx(2 * np.pi * 300 * 600, rel=1e-3)


def test_a_scaled_field_differs_by_its_factor():
    xi = catalog.named_case("square_plate").surface.domain.grid(21, 21)
    position = np.concatenate([xi, 0 * xi[..., :1]], axis=-1)
    field = np.sin(position / 20)
    truth = Fields(xi, position, field)
    assert differences(Fields(xi, position, 1.02 * field), truth) == pytest.approx((0.02, 0.02))
    assert differences(truth, truth) == (0.0, 0.0)


def test_the_table_holds_each_solver_against_the_certain_one(store: Store):
    by_id = {record.run_id: record for record in store.records}
    table = field_table(Evidence(by_id, store.rows, store.folder))
    plate = table.data[table.data["case"] == "square_plate"].set_index("solution")
    assert set(plate.index) == {"ndf", "ndf-ritz"}
    assert set(plate["against"]) == {"fem"}
    assert plate.loc["ndf-ritz", "largest"] == pytest.approx(7.2e-5 - 1e-8, rel=1e-6)  # the worst synthetic seed
    assert plate.loc["ndf", "mean_square"] == pytest.approx(4.9e-4 - 1e-8, rel=1e-6)


def test_without_a_certain_solver_nothing_is_compared(store: Store):
    by_id = {record.run_id: record for record in store.records}
    fields_only = [row for row in store.rows if row.solver != "fem"]
    assert field_table(Evidence(by_id, fields_only, store.folder)).data.empty
