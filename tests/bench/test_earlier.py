"""`run --start`: a run continues an earlier solution, has its own identity, and is refused with a reason."""

import json

import pytest
from typer.testing import CliRunner

from shellbench.bench.catalogue import catalog
from shellbench.bench.store.current import question
from shellbench.bench.store.store import Store
from shellbench.cli import app
from shellbench.errors import InputError

SMALL = ("--set", "ndf.inner=[4]", "--set", "ndf.widths=[60]", "--set", "ndf.iterations=1", "--threads", "1")
CASE = "square_plate"


def shellbench(*arguments):
    return CliRunner().invoke(app, [*map(str, arguments)])


def ends(store):
    return {record.run_id: record for record in Store(store).read().records}


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    store = tmp_path_factory.mktemp("store")
    shellbench("run", CASE, "--solver", "ndf", *SMALL, "--store", store)
    (run_id,) = ends(store)
    return store, run_id


@pytest.fixture
def thicker(tmp_path):
    text = (catalog.data_folder("cases") / f"{CASE}.toml").read_text()
    lines = [line for line in text.splitlines() if not line.startswith("suites")]
    path = tmp_path / "thicker.toml"
    path.write_text("\n".join(lines).replace("thickness = 1.0", "thickness = 1.25"))
    return path


@pytest.mark.long
def test_an_edited_shell_goes_on_from_an_earlier_one(first, thicker):
    store, run_id = first
    shellbench("run", thicker, "--start", run_id, *SMALL, "--store", store)
    shellbench("run", thicker, "--solver", "ndf", *SMALL, "--store", store)
    edited, fresh = [record for record in ends(store).values() if record.case_name == "thicker"]
    if "start" not in edited.identity.settings:
        edited, fresh = fresh, edited
    assert edited.identity.settings["start"] == run_id
    assert question(edited) != question(fresh)  # the one does not answer for the other
    known = catalog.known_values(CASE).judge("centre_deflection", "kirchhoff-love-linear").value / 1.25**3
    for record in (edited, fresh):
        measured = record.values["centre_deflection"]
        assert abs(measured.value - known) <= max(1e-4 * known, measured.uncertainty or 0.0)
    again = shellbench("run", thicker, "--start", run_id, *SMALL, "--store", store)
    assert "kept from before" in again.output
    rows = json.loads(shellbench("table", "--store", store, "--format", "json").output)
    assert run_id in {row["settings"].get("start") for row in rows if row["case"] == "thicker"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--start", "nobody"), "no run in"),
        (("--start", "{run}", "--solver", "fem"), "this run is by solver 'ndf', not by 'fem'"),
    ],
)
@pytest.mark.long
def test_a_start_of_no_use_is_refused_in_one_sentence(first, arguments, words):
    store, run_id = first
    done = shellbench("run", CASE, *(text.format(run=run_id) for text in arguments), "--store", store)
    assert isinstance(done.exception, InputError)
    assert words in str(done.exception)
