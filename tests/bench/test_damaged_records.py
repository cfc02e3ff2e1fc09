"""One bad record costs that record only: each kind of damage is named, and the rest is shown, in every command."""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from shellbench.bench.judge.compare import rows
from shellbench.bench.store import record as records
from shellbench.bench.store.current import current_runs
from shellbench.bench.store.record import SEAL, Record, document, leaves, read_document
from shellbench.bench.store.store import Store
from shellbench.errors import InputError
from shellbench.report.page import sections
from tests.bench import strip
from tests.bench.conftest import with_plugin, with_toys
from tests.bench.running import run_here
from tests.test_cli import shellbench  # noqa: F401 - a fixture

Damage = Callable[[Path], None]
FORMATS = ("text", "markdown", "latex", "csv", "json")


def edited(change: Callable[[dict[str, Any]], object]) -> Damage:
    """Change a record as an editor would, and its seal stays."""

    def damage(path: Path) -> None:
        data = json.loads(path.read_bytes())
        change(data)
        path.write_text(json.dumps(data), encoding="utf-8")

    return damage


def older(change: Callable[[dict[str, Any]], object]) -> Damage:
    """Change a record from before, which has neither number nor seal."""

    def changed(data: dict[str, Any]) -> None:
        for name in (SEAL, "sequence"):
            data.pop(name, None)
        change(data)

    return edited(changed)


def put(*path: str, value: Any) -> Callable[[dict[str, Any]], None]:
    def change(data: dict[str, Any]) -> None:
        for name in path[:-1]:
            data = data[name]
        data[path[-1]] = value

    return change


def replaced(make: Callable[[Path], object]) -> Damage:
    def damage(path: Path) -> None:
        path.unlink()
        make(path)

    return damage


def larger_than_any(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(records.LARGEST_RECORD + 1)  # no block of the disk is taken


CENTRE = ("values", "centre")
DAMAGES: dict[str, tuple[Damage, str]] = {
    "value is NaN": (older(put(*CENTRE, "value", value=float("nan"))), "values.centre.value"),
    "value is infinite": (older(put(*CENTRE, "value", value=float("inf"))), "values.centre.value"),
    "value is huge": (older(put(*CENTRE, "value", value=1e200)), "values.centre.value"),
    "value is text": (older(put(*CENTRE, "value", value="0.5")), "values.centre.value"),
    "value is a boolean": (older(put(*CENTRE, "value", value=True)), "values.centre.value"),
    "value has 400 digits": (older(put(*CENTRE, "value", value=10**400)), "values.centre.value"),
    "uncertainty is NaN": (older(put(*CENTRE, "uncertainty", value=float("nan"))), "values.centre.uncertainty"),
    "seconds are infinite": (older(put("seconds", value=float("inf"))), "'seconds'"),
    "seconds are negative": (older(put("seconds", value=-1.0)), "'seconds'"),
    "seconds are text": (older(put("seconds", value="1.0")), "'seconds'"),
    "memory has 31 digits": (older(put("peak_memory_bytes", value=10**30)), "'peak_memory_bytes'"),
    "threads are a boolean": (older(put("environment", "threads", value=True)), "environment.threads"),
    "a diagnostic is NaN": (older(put("diagnostics", "residual", value=float("nan"))), "residual"),
    "the case is no case": (older(put("case_name", value="nowhere")), "'nowhere'"),
    "the case is another one": (older(put("case", "name", value="other")), "'other'"),
    "created is no time": (older(put("created", value="yesterday")), "'yesterday'"),
    "created is before all time": (older(put("created", value="0001-01-01T00:00:00+23:00")), "'created'"),
    "the reason is a book": (older(put("reason", value="x" * 1_000_000)), "'reason'"),
    "the seed is text": (older(put("identity", "seed", value="0")), "identity.seed"),
    "the fields lie elsewhere": (older(put("fields_file", value="../x.npz")), "'fields_file'"),
    "the value was edited": (edited(put(*CENTRE, "value", value=strip.CENTRE)), "damaged"),
    "the status was edited": (edited(put("status", value="failed")), "damaged"),
    "a setting was edited": (edited(put("identity", "settings", "noise", value=0.25)), "damaged"),
    "the seal was taken off": (edited(lambda data: data.pop(SEAL)), "damaged"),
    "the number was taken off": (edited(lambda data: data.pop("sequence")), "damaged"),
    "its end is missing": (replaced(lambda path: path.write_text("{")), "no whole record"),
    "a pipe": (replaced(os.mkfifo), "regular file"),
    "a folder": (replaced(Path.mkdir), "regular file"),
    "a link to nowhere": (replaced(lambda path: path.symlink_to("nowhere")), "can't be read"),
    "a device": (replaced(lambda path: path.symlink_to("/dev/zero")), "regular file"),
    "too large": (replaced(larger_than_any), "20000001 bytes"),
}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Record, Record]:
    """A store with a good record, and one to be damaged: solving once serves all tests."""
    folder = tmp_path_factory.mktemp("damaged")
    store = Store(folder / "runs")
    with with_plugin(folder / "plugin"), with_toys(folder / "catalog"):
        good, *_ = run_here(store, "strip", solver="toy")
        other, *_ = run_here(store, "strip", solver="toy-noisy", seeds=(0,))
    return store.folder, good, other


@pytest.fixture
def stored(made: tuple[Path, Record, Record], toys: Path, store: Store) -> tuple[Record, Record]:
    """A copy of that store for this test; the good record, and the one to be damaged."""
    folder, good, other = made
    shutil.copytree(folder, store.folder)
    return good, other


@pytest.mark.parametrize("kind", DAMAGES)
def test_a_damaged_record_is_named_in_a_sentence(stored: tuple[Record, Record], store: Store, kind: str) -> None:
    good, other = stored
    damage, word = DAMAGES[kind]
    path = store.folder / f"{other.run_id}.json"
    damage(path)
    contents = store.read()
    assert contents.records == (good,)
    (sentence,) = contents.damaged
    assert sentence.startswith(f"{path}: is left out, for ")
    assert word in sentence
    assert "\n" not in sentence
    assert len(sentence) < len(str(path)) + 250


@pytest.fixture
def among_all_damages(stored: tuple[Record, Record], store: Store) -> Store:
    """A store with a good record, and one of each kind of damage."""
    _, other = stored
    path = store.folder / f"{other.run_id}.json"
    content = path.read_bytes()
    path.unlink()
    for i, (damage, _) in enumerate(DAMAGES.values()):
        broken = path.with_name(f"damage{i}.json")
        broken.write_bytes(content)
        damage(broken)
    return store


COMMANDS = {
    **{f"table {name}": ("table", "--format", name) for name in FORMATS},
    "gate": ("gate", "--suite", "toys", "--solver", "toy"),
    "export": ("export", "strip", "--solver", "toy", "--out", "strip.npz"),
    "report": ("report", "--no-print", "--out", "page"),
    "paper": ("report", "--paper", "paper"),
    "run": ("run", "strip", "--solver", "toy"),
    "baseline": ("baseline", "--solver", "toy"),
}


@pytest.mark.sampled(6)
@pytest.mark.parametrize("command", COMMANDS)
def test_each_command_names_all_damage_and_shows_the_rest(
    shellbench,  # noqa: F811
    among_all_damages: Store,
    command: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sections, "exhibits", lambda evidence: [])
    code, out, err = shellbench(*COMMANDS[command], "--store", among_all_damages.folder)
    assert code == 0
    lines = err.splitlines()
    for i in range(len(DAMAGES)):
        assert len([line for line in lines if f"damage{i}.json: is left out" in line]) == 1
    others = [line for line in lines if "is left out" not in line]
    assert len(others) <= 1, "beside the damage, one line at most says what else there is"
    assert max(map(len, lines)) < 600
    shown = {"export": "strip.npz", "report": "page/index.html", "paper": "paper", "run": "1 kept", "baseline": "strip"}
    assert shown.get(command, "every gate holds" if command == "gate" else "toy") in out
    if command == "table json":
        assert {row["run_id"] for row in json.loads(out)} == {r.run_id for r in among_all_damages.read().records}


def test_every_edit_of_a_sealed_record_is_seen(stored: tuple[Record, Record], store: Store) -> None:
    """Whichever leaf of the JSON is changed, and in whatever way."""
    good, _ = stored
    text = (store.folder / f"{good.run_id}.json").read_bytes()
    assert read_document(text) == good
    places = [place for place, _ in leaves(json.loads(text))]
    assert len(places) > 100
    assert {("seal",), ("sequence",), ("status",), (*CENTRE, "value"), ("identity", "settings", "factor")} < set(places)
    for *outer, last in places:
        data = json.loads(text)
        inner: Any = data
        for key in outer:
            inner = inner[key]
        inner[last] = another(inner[last])
        with pytest.raises(InputError):
            read_document(json.dumps(data).encode())


def another(value: Any) -> Any:
    """A value of the same kind, so that nothing but the seal can tell."""
    match value:
        case bool():
            return not value
        case int():
            return value + 1
        case float():
            return value * (1 + 1e-15) or 1e-300
        case str():
            return f"{value}0"
        case _:
            return 1.0


def test_layout_and_order_of_keys_are_no_content(stored: tuple[Record, Record], store: Store) -> None:
    good, _ = stored
    data = json.loads((store.folder / f"{good.run_id}.json").read_bytes())
    assert read_document(json.dumps(data, sort_keys=True, indent=4).encode()) == good
    assert read_document(document(good)) == good


def test_a_record_without_seal_and_number_does_not_count(stored: tuple[Record, Record], store: Store) -> None:
    good, other = stored
    assert current_runs(store.read()).notes == ()
    older(lambda data: data.pop("checksums"))(store.folder / f"{other.run_id}.json")
    current = current_runs(store.read())
    assert [run.record.run_id for run in current.runs] == [good.run_id]
    assert current.notes == ("1 stored run is left out: it has no checksum, so nothing tells whether it was edited",)
    assert {row.run_id for row in rows(store)} == {good.run_id}


def test_committed_records_can_be_read() -> None:
    published = Store(Path(__file__).parents[2] / "reports" / "published")
    contents = published.read()
    assert contents.damaged == ()
    assert len(contents.records) == len(list(published.folder.glob("*.json")))
    assert all(published.check(record, record.fields_file) is None for record in contents.records)


def spoil(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


def test_a_damaged_solution_is_not_exported(shellbench, stored: tuple[Record, Record], store: Store) -> None:  # noqa: F811
    """Another one of the same solver is, if there is one."""
    _, first = stored
    (second,) = run_here(store, "strip", solver="toy-noisy", seeds=(1,))
    command = ("export", "strip", "--solver", "toy-noisy", "--store", store.folder, "--out", "strip.npz")
    for record, code, lines in ((second, 0, 1), (first, 2, 3)):
        spoil(store.folder / str(record.solution_file))
        found, _, err = shellbench(*command)
        assert found == code
        assert f"{record.solution_file}: is left out, for it is damaged" in err
        assert err.count("\n") == lines


def test_damaged_fields_are_not_reported(shellbench, stored, store: Store, monkeypatch) -> None:  # noqa: F811
    monkeypatch.setattr(sections, "exhibits", lambda evidence: [])
    good, other = stored
    path = store.folder / str(other.fields_file)
    said: list[str] = []
    assert store.records_of({good.run_id, other.run_id}, said.append) == {r.run_id: r for r in stored}
    assert said == []
    for damage in (spoil, replaced(os.mkfifo)):
        damage(path)
        found = store.records_of({good.run_id, other.run_id}, said.append)
        assert found[good.run_id] == good
        assert found[other.run_id].fields_file is None
        assert said.pop().startswith(f"{path}: is left out")
    code, _, err = shellbench("report", "--no-print", "--out", "page", "--store", store.folder)
    assert code == 0
    assert err.count(str(path)) == 1


@pytest.mark.parametrize("command", ["table", "gate", "report", "run", "export"])
def test_a_store_that_can_not_be_is_bad_input(shellbench, command: str) -> None:  # noqa: F811
    more = {"run": ("strip",), "export": ("strip", "--solver", "toy", "--out", "x.npz")}.get(command, ())
    code, out, err = shellbench(command, *more, "--store", "x" * 300)
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert "File name too long" in err
