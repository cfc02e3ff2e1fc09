"""The package outside of the repository: what is shipped, and that all that a user is promised works from it."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.patience import GUARD

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
SHIPPED = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]


def test_data_that_the_code_asks_for_is_shipped() -> None:
    asked = {
        name
        for path in (ROOT / "shellbench").rglob("*.py")
        for name in re.findall(r'data_folder\("(\w+)"\)', path.read_text(encoding="utf-8"))
    }
    folders = {target.removeprefix("shellbench/data/").partition("/")[0] for target in SHIPPED.values()}
    assert asked
    assert asked <= folders
    assert [source for source in SHIPPED if not (ROOT / source).exists()] == []
    assert all(target == f"shellbench/data/{source}" for source, target in SHIPPED.items())


def test_the_kept_summary_is_shipped_where_there_is_one() -> None:
    source = "reports/resolution.json"
    assert (source in SHIPPED) == (ROOT / source).is_file()


def test_the_version_stands_in_one_way() -> None:
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(r"^version: (.*)$", citation, re.MULTILINE)[1] == PROJECT["project"]["version"]
    assert PROJECT["project"]["authors"][0]["name"] in citation
    assert "date-released" not in citation  # nothing is released,
    assert "urls" not in PROJECT["project"]  # so no address exists that a user could follow


def test_supported_versions_are_those_that_are_tested() -> None:
    matrix = (ROOT / ".github/workflows/tests.yml").read_text(encoding="utf-8")
    tested = re.findall(r'"(3\.\d+)"', re.search(r"python: (\[.*\])", matrix)[1])
    said = [one.rpartition(" ")[2] for one in PROJECT["project"]["classifiers"] if re.search(r":: 3\.\d+$", one)]
    assert said == tested
    assert PROJECT["project"]["requires-python"] == f">={tested[0]}"
    page = (ROOT / "docs/install.md").read_text(encoding="utf-8")
    assert f"Python {tested[0]} to {tested[-1]}" in page


def built(what: str, source: Path, out: Path) -> Path:
    build = [sys.executable, "-m", "hatchling", "build", "-t", what, "-d", str(out)]
    subprocess.run(build, cwd=source, check=True, capture_output=True, timeout=GUARD)
    return next(out.glob("*.whl" if what == "wheel" else "*.tar.gz"))


@pytest.mark.long
def test_a_wheel_from_the_sdist_does_all_that_is_promised(tmp_path: Path) -> None:
    """No file of the repository is there: templates, cases, known values, baseline and page come with the wheel."""
    ignored = shutil.ignore_patterns(".git", "runs", "latest", "__pycache__", ".nox", "site")
    source = shutil.copytree(ROOT, tmp_path / "source", ignore=ignored)
    shutil.unpack_archive(built("sdist", source, tmp_path / "dist"), tmp_path / "unpacked")
    shutil.rmtree(source)
    (unpacked,) = (tmp_path / "unpacked").iterdir()
    site = tmp_path / "site"
    shutil.unpack_archive(built("wheel", unpacked, tmp_path / "dist"), site, "zip")
    shutil.rmtree(unpacked)
    said: dict[str, str] = {}
    for command in (
        "new-case mine",
        "new-solver my-plate",
        "list mine.toml",
        "run square_plate --solver fem",
        "table",
        "gate --regression",
        "compare reports/runs reports/runs",
        "pack fem --out packs/fem.zip",
        "board packs",
        "report --no-print",
    ):
        (tmp_path / "packs").mkdir(exist_ok=True)
        done = subprocess.run(
            [sys.executable, "-m", "shellbench", *command.split()],
            cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": str(site)},
            capture_output=True,
            text=True,
            timeout=GUARD,
            check=False,
        )
        assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
        said[command] = done.stdout
    assert re.search(r"^regression: \d+ ok$", said["gate --regression"], re.MULTILINE)  # not "not compared"
    template = ROOT / "examples/solver_template"
    there = {str(path.relative_to(template)) for path in template.rglob("*")}
    wanted = {name for name in there if not re.search(r"cache|\.shellbench(/|$)", name)}
    written = {str(path.relative_to(tmp_path / "my-plate")) for path in (tmp_path / "my-plate").rglob("*")}
    assert written == {name.replace("plate_series", "my_plate") for name in wanted}
