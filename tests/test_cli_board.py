"""``shellbench pack`` and ``board``: what is packed, which files are refused, and what counts as made again."""

import hashlib
import json
import shutil
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from shellbench.bench.judge.board import AGREES, read_board
from shellbench.bench.store import pack as packs
from shellbench.bench.store.pack import MANIFEST, read_pack
from shellbench.bench.store.store import Store
from shellbench.errors import InputError
from tests.bench.conftest import with_plugin, with_toys
from tests.bench.running import changed, run
from tests.test_cli import shellbench  # noqa: F401 - fixture


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Store]:
    """A store with all runs of the suite of toys, made once in this process; tests copy what they change."""
    folder = tmp_path_factory.mktemp("toys")
    with with_plugin(folder / "plugin"), with_toys(folder / "catalog"):
        made = Store(folder / "runs")
        run(made, suites=("toys",))
        yield made


@pytest.fixture
def toys(full: Store) -> Path:
    """The catalog of toys, as the command line's fixture asks for it."""
    return full.folder.parent / "catalog"


@pytest.fixture
def packed(full: Store, tmp_path: Path) -> Path:
    """A folder with the pack of a toy."""
    folder = tmp_path / "packs"
    folder.mkdir()
    packs.write_pack(full, "toy", folder / "toy.zip")
    return folder


def members(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def rewrite(path: Path, files: dict[str, bytes]) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)


def with_checksum(manifest: dict) -> bytes:
    """A manifest with a correct checksum, by any author."""
    del manifest["checksum"]
    return json.dumps(manifest | {"checksum": packs._checksum(manifest)}).encode()


def test_a_pack_has_settings_versions_checksum_and_how_to_install(packed: Path, full: Store) -> None:
    read = read_pack(packed / "toy.zip")
    about = read.manifest
    kept = {record.run_id: record for record in full.read().records}
    assert {record.run_id for record in read.records} == {
        name for name, record in kept.items() if record.identity.solver == "toy"
    }
    assert all(record == kept[record.run_id] for record in read.records)
    assert (about.solver, about.version) == ("toy", kept[read.records[0].run_id].environment.versions["toy-shells"])
    assert about.install == ""  # no package says where it came from, and none is made up
    assert sum(setting.runs for setting in about.settings) == len(read.records)
    assert {"factor": 0.5} in [setting.overrides for setting in about.settings]
    assert all(name.endswith(".json") for name in members(packed / "toy.zip"))


def edit_figure(files: dict[str, bytes]) -> None:
    """A figure typed in, the seal of the record left as it was."""
    name = next(name for name in files if name != MANIFEST)
    data = json.loads(files[name])
    data["values"]["centre"]["value"] *= 1 + 1e-12
    files[name] = json.dumps(data).encode()
    files[MANIFEST] = manifest_for(files)


def take_the_seal(files: dict[str, bytes]) -> None:
    """A record written by hand: no store gave it a number and a seal."""
    name = next(name for name in files if name != MANIFEST)
    data = json.loads(files[name])
    del data["seal"], data["sequence"]
    files[name] = json.dumps(data).encode()
    files[MANIFEST] = manifest_for(files)


def manifest_for(files: dict[str, bytes]) -> bytes:
    """The manifest with checksums of what the files are now."""
    manifest = json.loads(files[MANIFEST])
    for run_id in manifest["runs"]:
        manifest["runs"][run_id] = hashlib.sha256(files[f"records/{run_id}.json"]).hexdigest()
    return with_checksum(manifest)


def edit_record_alone(files: dict[str, bytes]) -> None:
    name = next(name for name in files if name != MANIFEST)
    files[name] = files[name].replace(b'"seconds"', b'"seconds" ', 1)


def edit_install(files: dict[str, bytes]) -> None:
    files[MANIFEST] = files[MANIFEST].replace(b'"install": ""', b'"install": "get other"', 1)


def claim_other_settings(files: dict[str, bytes]) -> None:
    manifest = json.loads(files[MANIFEST])
    manifest["settings"][0]["overrides"] = {"factor": 1.5}
    files[MANIFEST] = with_checksum(manifest)


def add_a_file(files: dict[str, bytes]) -> None:
    files["records/more.json"] = b"{}"


def take_a_record(files: dict[str, bytes]) -> None:
    del files[next(name for name in files if name != MANIFEST)]


def rename_the_solver(files: dict[str, bytes]) -> None:
    files[MANIFEST] = with_checksum(json.loads(files[MANIFEST]) | {"solver": "better"})


@pytest.mark.parametrize(
    ("how", "said"),
    [
        (edit_figure, "its content does not match its checksum"),
        (take_the_seal, "no store has sealed it"),
        (edit_record_alone, "does not match its checksum"),
        (edit_install, "pack.json does not match its checksum"),
        (claim_other_settings, "'settings' of pack.json is not what its records say"),
        (add_a_file, "its files are not those that pack.json names"),
        (take_a_record, "its files are not those that pack.json names"),
        (rename_the_solver, "it is of solver 'toy'"),
        (lambda files: files.pop(MANIFEST), "it has no pack.json"),
    ],
)
def test_what_was_changed_is_refused_in_one_sentence(how, said, packed: Path) -> None:
    files = members(packed / "toy.zip")
    how(files)
    rewrite(packed / "toy.zip", files)
    with pytest.raises(InputError) as refused:
        read_pack(packed / "toy.zip")
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_board_of_a_changed_pack_is_not_built(shellbench, packed: Path, tmp_path: Path) -> None:  # noqa: F811
    files = members(packed / "toy.zip")
    edit_figure(files)
    rewrite(packed / "toy.zip", files)
    code, out, err = shellbench("board", packed, "--out", tmp_path / "board")
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert not (tmp_path / "board").exists()


def test_what_is_no_zip_and_an_empty_folder_are_refused(shellbench, tmp_path: Path) -> None:  # noqa: F811
    folder = tmp_path / "none"
    folder.mkdir()
    assert shellbench("board", folder)[0] == 2
    (folder / "mine.zip").write_bytes(b"my figures: 0.487")
    code, _, err = shellbench("board", folder)
    assert code == 2
    assert "is no pack" in err


def test_pack_and_board_by_the_command_line(shellbench, full: Store, tmp_path: Path) -> None:  # noqa: F811
    """Two solvers are packed, and both stand on the page with their checksums, errors by case and seconds."""
    folder = tmp_path / "packs"
    folder.mkdir()
    code, out, _ = shellbench("pack", "toy", "--store", full.folder, "--out", folder / "a.zip", "--install", "get toy")
    assert code == 0
    checksum = out.split()[-1]
    code, out, _ = shellbench("pack", "toy-noisy", "--store", full.folder, "--out", folder / "b.zip")
    assert (code, "install:  not stated; --install" in out) == (0, True)
    assert shellbench("board", folder, "--out", tmp_path / "board")[0] == 0
    page = (tmp_path / "board/index.html").read_text(encoding="utf-8")
    assert checksum in page
    assert "get toy" in page
    assert "Install: not stated" in page
    assert page.count(">1 of 1<") >= 2  # cases, of those of their suites
    for section in ('id="submissions"', 'id="cases"', 'id="cost"'):
        assert section in page
    data = json.loads((tmp_path / "board/board.json").read_text(encoding="utf-8"))
    assert [entry["pack"]["solver"] for entry in data] == ["toy", "toy-noisy"]
    assert {row["remeasured"] for entry in data for row in entry["rows"]} == {"no"}


def again(full: Store, tmp_path: Path, by: float = 0.0, code: str | None = None) -> Store:
    """Runs of the same code, made again by somebody else: other names, and figures that are off by a factor."""
    mine = Store(tmp_path / "mine")
    shutil.copytree(full.folder, mine.folder)
    for record in mine.read().records:
        (mine.folder / f"{record.run_id}.json").unlink()
        name = f"{record.run_id[:-8]}{hashlib.sha256(record.run_id.encode()).hexdigest()[:8]}"
        values = record.model_dump()["values"]
        for measured in values.values():
            measured["value"] *= 1 + by
        identity = record.identity.model_dump() | ({"source": code} if code else {})
        changed(mine, record, run_id=name, values=values, identity=identity)
    return mine


@pytest.mark.parametrize(
    ("by", "code", "mark"),
    [(0.0, None, "yes"), (0.5 * AGREES, None, "yes"), (-0.1, None, "differs"), (0.0, "0" * 64, "no")],
)
def test_a_figure_is_re_measured_if_the_same_code_is_no_worse(by, code, mark, packed, full, tmp_path) -> None:
    found = read_board(packed, again(full, tmp_path, by, code))[0]
    halved = [row for row in found.rows if row.overrides == {"factor": 0.5} and row.primary]
    assert [found.mark([row.run_id], row.quantity) for row in halved] == [mark]


def test_copied_records_are_no_second_measurement(packed: Path, full: Store) -> None:
    assert not read_board(packed, full)[0].marks
