import pytest

from shellbench.report.data.evidence import Evidence
from shellbench.report.sections.resolution import resolution_table
from tests.report.conftest import COURSE, Store


@pytest.fixture(scope="module")
def by_id(store: Store):
    return {record.run_id: record for record in store.records}


@pytest.fixture(scope="module")
def evidence(store: Store, by_id):
    return Evidence(by_id, store.rows, store.folder)


def test_bytes_and_differences_are_the_records(by_id, evidence):
    table = resolution_table(evidence)
    assert table.data["case"].drop_duplicates().tolist() == list(COURSE)
    for line in table.data.to_dict("records"):
        record = by_id[line["run_id"]]
        assert line["storage_bytes"] == record.storage_bytes
        assert line["probe_difference"] == max(step.probe_difference for step in record.resolution)
        for step in record.resolution:
            assert line[f"interpolation_difference_{step.points}"] == step.interpolation_difference


def test_differences_are_printed_relative_to_the_largest_displacement(evidence):
    text = resolution_table(evidence).write("text")
    plate = next(line for line in text.splitlines() if line.strip().startswith("fem"))
    assert plate.split()[-8:] == ["2.0", "%", "0.50", "%", "0.080", "%", "0.020", "%"]  # 2 / n**2 of the largest
    assert "393 kB" in plate  # 8 bytes for each of 49152 unknowns
    assert "Mesh 200×200" not in text  # the grid at whose points all others are held against the field
    assert "200×200 points: 960 kB" in text  # 3 doubles a point


def test_one_line_for_each_solver_whatever_the_seeds(evidence):
    data = resolution_table(evidence).data
    for case in COURSE:
        assert data.loc[data["case"] == case, "solution"].tolist() == ["fem", "ndf-ritz", "ndf", "ndf-ritz, GELU"]


def test_nothing_reported_is_no_table(store, by_id):
    silent = {name: record.model_copy(update={"diagnostics": {}, "resolution": ()}) for name, record in by_id.items()}
    assert resolution_table(Evidence(silent, store.rows, store.folder)).data.empty
