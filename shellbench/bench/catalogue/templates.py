"""New cases and new solvers from templates: copied, renamed, and ready to run. The templates come with the package."""

from __future__ import annotations

import keyword
import re
import shutil
from importlib.util import find_spec
from pathlib import Path

from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.kinds import DEFAULT, find_kind
from shellbench.bench.plugins.registry import solver_entries
from shellbench.disk import said_plainly
from shellbench.errors import InputError
from shellbench.protocol.spelling import did_you_mean

CASE = "hyperbolic_paraboloid.toml"
SOLVER = "solver_template"
NAME, PACKAGE, CLASS = "plate-series", "plate_series", "PlateSeriesSolver"  # names in the template
COMMAND, COMMAND_NAME = "command_template", "my-command"  # folder and name of the template of a command
CASE_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,79}")
SOLVER_NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")
SUITES = re.compile(r"^suites\s*=\s*\[.*?\][^\n]*\n", re.MULTILINE | re.DOTALL)
OPENING = re.compile(r"\A(#[^\n]*\n)+")
LINK = re.compile(r"\[([^\]]*)\]\(\.\./[^)]*\)")  # links to files beside the template, which a copy does not have
MESH = re.compile(r'^mesh\s*=\s*"(.*?)"', re.MULTILINE)
UNWANTED = shutil.ignore_patterns("__pycache__", "*.pyc", ".pytest_cache", ".ruff_cache", ".shellbench", "dist")


def write_case(name: str, like: str | None, folder: Path, mesh: Path | None = None) -> Path:
    """Write a case file into a folder, from the template or from one of the suite's cases; return its path.

    A `-` in the name becomes `_`. With a mesh the surface is that, held on one edge; the mesh's path stands in the file
    as it is given.

    Raises
    ------
    InputError
        If the name can't be one, is taken, or the file is there already.
    """
    name = name.replace("-", "_")
    if not CASE_NAME.fullmatch(name):
        raise InputError(
            f"'{name}' can't be the name of a case: it takes letters, digits, _ and -, and begins with a letter"
        )
    if name in catalog.case_names():
        raise InputError(f"'{name}' is a case of the suite: choose another name")
    path = folder / f"{name}.toml"
    if mesh is not None:
        _write(path, _text_from(mesh, path))
        catalog.find_case(str(path))
        return path
    if like is None:
        source = catalog.data_folder("examples") / CASE
        words = "A hyperbolic paraboloid to begin with"
    else:
        if like not in catalog.case_names():
            raise InputError(f"--like {like}: there is no such case{did_you_mean(like, catalog.case_names())}")
        source = catalog.case_file(like)
        words = f"Begun as the suite's case {like}"
    text = OPENING.sub("", SUITES.sub("", source.read_text(encoding="utf-8")))
    for file in MESH.findall(text):  # it stands beside its case
        if (folder / file).exists():
            raise InputError(f"{folder / file} is there already")
        shutil.copyfile(source.with_name(file), folder / file)
    _write(path, f"# {words}. `shellbench run {path.name} --quick` solves it by two solvers.\n{text}")
    catalog.find_case(str(path))
    return path


def _text_from(mesh: Path, path: Path) -> str:
    make = find_kind(DEFAULT).from_file
    assert make is not None
    try:
        return make(mesh, path)
    except InputError as error:
        raise InputError(f"--mesh {mesh}: {error}") from None


def _write(path: Path, text: str) -> None:
    with said_plainly(path.parent, "folder"):
        try:
            with path.open("x", encoding="utf-8") as file:
                file.write(text)
        except FileExistsError:
            raise InputError(f"{path} is there already: nothing is overwritten") from None


def write_solver(name: str, folder: Path) -> Path:
    """Write a package with a solver of this name into a folder of that name; return that folder.

    A `_` in the name becomes `-`, except in the name of the Python package.

    Raises
    ------
    InputError
        If the name can't be one, is taken, or the folder is there already.
    """
    target = _new_folder(name, folder)
    name, package = target.name, target.name.replace("-", "_")
    if find_spec(package) is not None:
        raise InputError(f"a Python package '{package}' is installed already: choose another name")
    title = "".join(part.capitalize() for part in name.split("-"))
    names = {CLASS: f"{title}Solver", PACKAGE: package, NAME: name}
    with said_plainly(folder, "folder"):
        shutil.copytree(catalog.data_folder("examples") / SOLVER, target, ignore=UNWANTED)
        (target / "src" / PACKAGE).rename(target / "src" / package)
        for path in [path for path in target.rglob("*") if path.is_file()]:
            path.write_text(_renamed(path.read_text(encoding="utf-8"), names), encoding="utf-8")
    return target


def write_command(name: str, folder: Path) -> Path:
    """Write a file that describes a command as a solver, with an example, into a folder of this name; return the file.

    Raises
    ------
    InputError
        As `write_solver`.
    """
    target = _new_folder(name, folder)
    with said_plainly(folder, "folder"):
        shutil.copytree(catalog.data_folder("examples") / COMMAND, target, ignore=UNWANTED)
        path = (target / "command.toml").rename(target / f"{target.name}.toml")
        path.write_text(_renamed(path.read_text(encoding="utf-8"), {COMMAND_NAME: target.name}), encoding="utf-8")
    return path


def _new_folder(name: str, folder: Path) -> Path:
    """Return the folder, not made yet, of a new solver; InputError if the name can't be one or is taken."""
    name = name.replace("_", "-")
    if not SOLVER_NAME.fullmatch(name) or keyword.iskeyword(name.replace("-", "_")):
        raise InputError(
            f"'{name}' can't be the name of a solver: it takes small letters, digits, - and _, as my-solver"
        )
    if name in solver_entries():
        raise InputError(f"a solver '{name}' is installed already: choose another name")
    if (folder / name).exists():
        raise InputError(f"{folder / name} is there already: nothing is overwritten")
    return folder / name


def _renamed(text: str, names: dict[str, str]) -> str:
    for old, new in names.items():
        text = text.replace(old, new)
    return LINK.sub(r"\1", text)
