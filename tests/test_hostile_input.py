"""Invalid files, and numbers and names that are too long, give one sentence in every command."""

import os
import sys
import tomllib

import pytest

from shellbench import cli
from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.reference import read_known_values
from shellbench.bench.judge.baseline import read_baseline
from shellbench.bench.plugins import kinds, registry
from shellbench.bench.plugins.settings import make_settings, parse_setting
from shellbench.bench.store.pack import read_pack
from shellbench.bench.store.store import Store
from shellbench.errors import InputError
from shellbench.files import read_file
from shellbench.problem import Problem
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.mesh.surface import with_fit
from shellbench.protocol.schema import Model, parse_toml, read_toml


def pipe(path):
    os.mkfifo(path)


def sparse(path):
    with path.open("wb") as file:
        file.truncate(20_000_000_000)


FILES = {
    "a pipe": (pipe, "it is no regular file, but a pipe"),
    "a device": (lambda path: path.symlink_to("/dev/zero"), "it is no regular file, but a device"),
    "a folder": (lambda path: path.mkdir(), "it is no regular file, but a folder"),
    "20 GB of nothing": (sparse, "it has 20000000000 bytes, and may have at most "),
    "nothing": (lambda path: None, "it can't be read (No such file or directory)"),
    "a circle": (lambda path: path.symlink_to(path.name), "it can't be read ("),
}
READERS = {
    "a case": (".toml", kinds.read_problem),
    "a mesh": (".obj", lambda path: with_fit({"surface": {"kind": "mesh", "mesh": path.name}}, path.parent)),
    "a mesh to begin with": (".vtu", lambda path: kinds.find_kind("shell").from_file(path, path)),
    "a pack": (".zip", read_pack),
    "known values": (".toml", read_known_values),
    "a baseline": (".json", lambda path: read_baseline(path) or read_file(path, 1)),
}


@pytest.mark.parametrize(("suffix", "read"), READERS.values(), ids=READERS)
@pytest.mark.parametrize(("make", "words"), FILES.values(), ids=FILES)
def test_what_is_no_file_is_not_read(make, words, suffix, read, tmp_path):
    make(tmp_path / f"this{suffix}")
    with pytest.raises(InputError, match=r"^[^\n]*$") as caught:
        read(tmp_path / f"this{suffix}")
    assert words in str(caught.value)


def test_what_is_no_file_is_no_record(tmp_path):
    for number, (make, _) in enumerate(FILES.values()):
        make(tmp_path / f"n{number}.json")
    assert len(Store(tmp_path).read().damaged) == len(FILES) - 1


DEEP = [
    "a." * 100_000 + "b = 1",
    "x = { " + "a." * 500 + "b = 1 }",
    "[" + "a." * 100_000 + "b]",
    "a = " + "[" * 5000,
    '"".' * 200 + "a = 1",
    '"\\"".' + "a." * 100_000 + "b = 1",
]


@pytest.mark.parametrize("text", DEEP, ids=range(len(DEEP)))
def test_a_key_of_too_many_parts_is_refused_before_it_is_read(text, tmp_path):
    (tmp_path / "x.toml").write_text(text)
    with pytest.raises(InputError, match=r"x\.toml: .*nested too deeply$"):
        read_toml(tmp_path / "x.toml")


@pytest.mark.parametrize("text", ['title = "a\\u001b[2Jb"', 'a = [{ b = "\\u0000" }]', '"k\\u009b" = 1'])
def test_a_text_that_commands_a_terminal_is_refused(text, tmp_path):
    (tmp_path / "x.toml").write_text(text)
    with pytest.raises(InputError, match=r"x\.toml: a text has the control character U\+00(1B|00|9B)$"):
        read_toml(tmp_path / "x.toml")
    assert parse_toml(r'x = "a\tb\nc\u00e9"') == {"x": "a\tb\ncé"}


@pytest.mark.parametrize("value", ["no", "yes", "0", "'false'"])
def test_a_setting_that_is_neither_true_nor_false_is_refused(value):
    solver = registry.load_solver(registry.find_solver("fem"))

    def setting(value):
        return dict([parse_setting(f"fem.symmetry={value}")[1:]])

    with pytest.raises(InputError, match=r"field 'symmetry': found .*, but it must be true or false"):
        make_settings(solver, setting(value), 0, "cpu")
    assert not make_settings(solver, setting("false"), 0, "cpu").symmetry


def test_texts_and_lists_with_many_points_are_read():
    text = "x = " + repr([0.5] * 5000) + '\ny = "' + "a." * 5000 + '"\n# ' + "a." * 5000
    assert parse_toml(text) == tomllib.loads(text)


@pytest.mark.parametrize("value", ["9" * 5000, "0x" + "f" * 5000, "[1, " + "9" * 5000 + "]", str(2**63), "[" * 5000])
def test_a_setting_of_many_digits_is_one_sentence(value):
    with pytest.raises(InputError, match=r"^--set fem\.tolerance: .{1,100}$"):
        parse_setting(f"fem.tolerance={value}")


LONG = "d/" * 2500
NAME = "n" * 300  # no file has a name as long
COMMANDS = [
    ("compare", "{}", "{}"), ("compare", "./{}", "{}.zip"), ("compare", "fem", "fem", "--case", "{}.toml"), ("history", "{}", "{}"),
    ("board", "{}"), ("board", ".", "--out", "{}"), ("new-solver", "{}"), ("new-case", "{}"), ("new-case", "mine", "--mesh", "{}.obj"),
    ("list", "{}"), ("list", "{}.toml"), ("run", "{}.toml"), ("run", "square_plate", "--scheduler", "{}"), ("run", "--device", "{}"),
    ("run", "square_plate", "--start", "{}"), ("run", "square_plate", "--solver", "fem", "--set", "fem.{}=1"), ("table", "--store", "{}"),
    ("gate", "--suite", "{}"), ("pack", "{}"), ("report", "--store", "{}"), ("check-solver", "{}"), ("passport", "{}"), ("{}",),
    ("export", "square_plate", "--solver", "fem", "--out", "x.{}"),
]  # fmt: skip


@pytest.mark.parametrize("name", [LONG, NAME], ids=["path", "name"])
@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_a_name_that_is_too_long_is_one_sentence(command, name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["shellbench", *(part.format(name) for part in command)])
    with pytest.raises(SystemExit) as end:
        cli.main()
    out, err = capsys.readouterr()
    assert (end.value.code, out) == (2, "")
    assert len(err) < 2000
    assert "Usage" in err or (err.startswith("shellbench: ") and err.count("\n") == 1)
    assert name not in err


def case_with(*edits):
    """The square plate with some fields changed; a place is a dotted name."""
    data = read_toml(catalog.data_folder("cases") / "square_plate.toml")
    for place, value in edits:
        *path, last = place.split(".")
        inner = data
        for key in path:
            inner = inner[int(key)] if isinstance(inner, list) else inner[key]
        if value is None:
            del inner[last]
        else:
            inner[int(last) if isinstance(inner, list) else last] = value
    return build_case(data, "plate", "plate.toml")


WITHOUT = "under forces, moments and moved supports, without plasticity or temperatures"
TOLD = {
    "a laminate": ([("material.youngs_modulus", None), ("material.layers", [{"angle": 0}])], ("material.layers", WITHOUT)),
    "an orthotropic shell": ([("material.youngs_modulus", None), ("material.youngs_modulus_1", 1.0)], ("material.youngs_modulus_1", WITHOUT)),
    "a warm shell": ([("loads.0.kind", "thermal")], ("loads.0.kind", "'thermal'", WITHOUT)),
    "a temperature": ([("temperature", 20.0)], ("field 'temperature' is not known here", WITHOUT)),
    "a wrong key before a missing one": ([("material.youngs_modulus", None), ("material.young_modulus", 1.0)], ("field 'material.young_modulus' is not known here (did you mean youngs_modulus?)",)),
    "a wrong key elsewhere": ([("material.thickness", None), ("supports.0.clampd", True)], ("field 'supports.0.clampd' is not known here (did you mean clamped?)",)),
    "a wrong key of a quantity": ([("quantities.0.point", ["centre"])], ("(did you mean points?)",)),
    "yes": ([("supports.0.clamped", "yes")], ("field 'supports.0.clamped': found 'yes', but it must be true or false",)),
    "one": ([("quantities.0.primary", 1)], ("quantities.0.primary': found 1, but it must be true or false",)),
    "a long formula": ([("loads.0.vector", [0.0, 0.0, "foo(xi1) + " * 8000 + "1"])], ("...",)),
    "a long formula that is none": ([("material.thickness_factor", "1 + " * 20000)], ("...",)),
    "a long name": ([("supports.0.on", ["x" * 90_000])], ("...",)),
    "a long key": ([("k" * 90_000, 1)], ("...",)),
    "a thick shell": ([("material.thickness", 1e300)], ("material.thickness': found 1e+300, but it must be at most 1e+100 in size",)),
    "a thick shell, still": ([("material.thickness", 1e90)], ("its bending stiffness is", "from 1e-100 to 1e+100")),
    "a thin shell": ([("material.thickness", 1e-300)], ("found 1e-300, but it must be at least 1e-100",)),
    "a heavy load": ([("loads.0.vector", [0.0, 0.0, -1e300])], ("loads.0.vector.2': found -1e+300, but it must be at most 1e+100 in size",)),
    "a heavy formula": ([("loads.0.vector", [0.0, 0.0, "1e300*xi1"])], ("a load of kind 'area' is not finite, or above 1e+100",)),
    "a large surface": ([("surface.xi1", [0.0, 1e300])], ("surface.xi1.1': found 1e+300",)),
    "a small surface": ([("surface.xi1", [0.0, 1e-300])], ("xi1 has a side of 1e-300",)),
    "a small axis": ([("supports.0.motion", {"kind": "rotation", "axis": [0.0, 1e-300, 0.0], "angle": 1.0})], ("the axis of a rotation can't be zero",)),
}  # fmt: skip


@pytest.mark.parametrize(("edits", "words"), TOLD.values(), ids=TOLD)
def test_a_wrong_case_is_told_in_a_short_sentence(edits, words):
    with pytest.raises(InputError, match=r"^plate\.toml: [^\n]{1,700}$") as caught:
        case_with(*edits)
    for part in words:
        assert part in str(caught.value)


def models(model):
    for one in model.__subclasses__():
        yield one
        yield from models(one)


def test_what_is_true_or_false_in_a_file_takes_nothing_else():
    for name in kinds.kind_entries():
        kinds.find_kind(name)
    for model in [*models(Problem), *(m for m in models(Model) if m.__module__.startswith("shellbench.problems"))]:
        for name, field in model.model_fields.items():
            if field.annotation is bool:
                assert any(getattr(part, "strict", False) for part in field.metadata), (model, name)
