"""The kept records of the published training: their verdicts, and when they may be taken over."""

import shutil

import pytest

from shellbench.bench.catalogue.catalog import named_case
from shellbench.bench.plugins.registry import find_solver
from shellbench.bench.store.identity import current_source
from shellbench.bench.store.measuring import history_of
from shellbench.bench.store.store import Store
from tests.solvers.ndf.kept_trainings import ALIKE, BEGINNING, FOLDER, departure, judged, take_over, taken_over
from tests.solvers.ndf.trainings import small, trained

RECORDS = {record.case_name: record for record in Store(FOLDER).read().records}
COLLAPSED = "pinched_cylinder_free"


def test_the_training_that_collapsed_is_no_ok():
    """It jumped to a positive loss after 550 of 2000 iterations; the three others kept what they had gained."""
    assert {name: record.status for name, record in RECORDS.items()} == {
        name: "failed" if name == COLLAPSED else "ok" for name in RECORDS
    }
    assert len(RECORDS) == 4
    failed = RECORDS[COLLAPSED]
    assert failed.reason.startswith("the training collapsed: its certified energy, 1.82e-05 J, is not below rest")
    assert "over iterations 325 to 550" in failed.reason
    assert [step.iteration for step in failed.history] == list(range(25, 2001, 25))
    assert failed.fields_file
    assert failed.values


@pytest.mark.parametrize("name", RECORDS)
def test_the_verdict_follows_from_what_the_record_keeps(name):
    again = judged(RECORDS[name])
    assert (again.status, again.reason) == (RECORDS[name].status, RECORDS[name].reason)


@pytest.fixture(scope="module")
def brief():
    """A record of a training of seconds, made by another source."""
    record, settings = RECORDS["square_plate"], small(iterations=BEGINNING)
    changed = settings.model_dump(mode="json", exclude={"seed", "device"})
    identity = record.identity.model_copy(update={"settings": changed, "source": "another"})
    history = history_of(trained(named_case("square_plate"), settings))
    return record.model_copy(update={"identity": identity, "history": history})


def test_a_record_is_taken_over_if_todays_training_begins_as_it_did(brief):
    found = taken_over(brief)
    assert found.identity.source == current_source(find_solver("ndf-published"))
    assert found.history == brief.history
    assert found.values == brief.values


def test_a_record_of_another_training_is_not_taken_over(brief):
    other = brief.identity.model_copy(update={"seed": 1})
    with pytest.raises(ValueError, match="its first iterations differ"):
        taken_over(brief.model_copy(update={"identity": other}))
    case = brief.identity.model_copy(update={"case": "another"})
    with pytest.raises(ValueError, match="its case has changed"):
        taken_over(brief.model_copy(update={"identity": case}))


def test_taking_over_keeps_files_and_names(tmp_path, monkeypatch):
    monkeypatch.setattr("tests.solvers.ndf.kept_trainings.departure", lambda record: 0.0)
    folder = tmp_path / "kept"
    shutil.copytree(FOLDER, folder)
    before = {path.name: path.read_bytes() for path in folder.glob("*.npz")}
    names = {path.name for path in folder.iterdir()}
    take_over(folder)
    assert {path.name for path in folder.iterdir() if not path.name.startswith(".")} == names
    assert {path.name: path.read_bytes() for path in folder.glob("*.npz")} == before
    records = Store(folder).read()
    assert not records.damaged
    assert {record.case_name: record.status for record in records.records} == {n: r.status for n, r in RECORDS.items()}


@pytest.mark.long
@pytest.mark.parametrize("name", RECORDS)
def test_todays_training_begins_as_the_kept_one(name):
    assert departure(RECORDS[name]) <= ALIKE
