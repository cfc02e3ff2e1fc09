"""The template of a third-party package: installed, found, checked, gated; and faults in a copy of it are caught."""

import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.patience import GUARD

ROOT = Path(__file__).resolve().parent.parent
TEMPLATE = ROOT / "examples" / "solver_template"
GATE = ("-m", "pytest", "--shellbench=obstacle_course", "-m", "shellbench", "-p", "no:cacheprovider")
FOREIGN = ("scordelis_lo", "pinched_cylinder_diaphragm", "pinched_cylinder_free")  # the course beside the plate

NU_IGNORED = ("reading.py", "poissons_ratio=case.material.poissons_ratio", "poissons_ratio=0.0")
STIFFNESS_WITHOUT_NU = (
    "reading.py",
    "bending_stiffness=case.material.bending_stiffness",
    "bending_stiffness=case.material.youngs_modulus * case.material.thickness**3 / 12",
)
FAULTS = {
    "the load is halved": ("plate.py", "plate.load * work", "plate.load / 2 * work"),
    "the load points the other way": ("plate.py", "plate.load * work", "-plate.load * work"),
    "even harmonics stand for odd ones": ("plate.py", "np.arange(1, 2 * terms, 2,", "np.arange(1, terms + 1, 1,"),
    "the stiffness is that of one direction": (
        "plate.py",
        "(alpha[:, None] ** 2 + beta**2) ** 2  # N/m",
        "(alpha[:, None] ** 4 + beta**4)",
    ),
    "one term is all there is": ("solver.py", "series.solve(plate, terms)", "series.solve(plate, 1)"),
    "the energy is doubled": ("plate.py", "coefficients**2) / 2)", "coefficients**2))"),
}


def python(*arguments: str, site: Path, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run Python with a package of the folder `site` installed."""
    path = os.pathsep.join([str(site), str(ROOT)])
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path, "COLUMNS": "200"},
        capture_output=True,
        text=True,
        timeout=GUARD,
        check=False,
    )


def shellbench(*arguments: str, site: Path, folder: Path) -> subprocess.CompletedProcess[str]:
    return python("-m", "shellbench", *arguments, site=site, folder=folder)


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the template, as somebody would begin."""
    folder = tmp_path_factory.mktemp("template") / "mine"
    shutil.copytree(TEMPLATE, folder, ignore=shutil.ignore_patterns("__pycache__", ".pytest_cache", ".shellbench"))
    return folder


@pytest.fixture(scope="module")
def site(project: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The template, installed into a folder of its own."""
    target = tmp_path_factory.mktemp("site")
    if importlib.util.find_spec("pip") is None:
        pytest.skip("needs pip")
    here = ["--no-build-isolation"] if importlib.util.find_spec("hatchling") else []
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", *here, "--target", str(target)]
    subprocess.run([*install, str(project)], check=True, capture_output=True, timeout=GUARD)
    return target


@pytest.fixture
def broken(site: Path, tmp_path: Path) -> Path:
    """A copy of the installed template to spoil."""
    return Path(shutil.copytree(site, tmp_path / "broken", ignore=shutil.ignore_patterns("__pycache__")))


def spoil(site: Path, *faults: tuple[str, str, str]) -> None:
    for name, good, bad in faults:
        file = site / "plate_series" / name
        text = file.read_text()
        assert good in text
        file.write_text(text.replace(good, bad))


@pytest.mark.long
def test_the_plate_passes_the_gate_and_what_it_declines_is_skipped(site: Path, project: Path) -> None:
    done = python(*GATE, "--shellbench-store=.shellbench", site=site, folder=project)
    assert done.returncode == 0, done.stdout
    rows = re.findall(r"^square_plate +plate-series +(\w+) .* (pass|FAIL|skipped)$", done.stdout, re.MULTILINE)
    assert len(rows) == 5
    assert {verdict for _, verdict in rows} == {"pass"}
    for case in FOREIGN:
        assert f"{case} plate-series: not applicable: it solves flat plates only" in done.stdout
    assert re.search(r"\b5 passed, \d+ skipped", done.stdout)


@pytest.mark.long
@pytest.mark.parametrize("fault", FAULTS)
def test_the_gate_catches_a_fault(broken: Path, project: Path, tmp_path: Path, fault: str) -> None:
    spoil(broken, FAULTS[fault])
    done = python(*GATE, f"--shellbench-store={tmp_path / 'runs'}", site=broken, folder=project)
    assert done.returncode == 1, done.stdout
    assert re.search(r"^square_plate .* FAIL$", done.stdout, re.MULTILINE)
    assert "1e-06 allowed" in done.stdout
    assert "Traceback" not in done.stdout


@pytest.mark.long
def test_its_own_tests_pass_and_catch_what_no_plate_of_the_course_shows(
    site: Path, broken: Path, project: Path
) -> None:
    """Poisson's ratio is zero in the course's plate: a stiffness without it must be caught by the package's tests."""
    own = ("-m", "pytest", "-p", "no:cacheprovider")
    good = python(*own, site=site, folder=project)
    assert good.returncode == 0, good.stdout
    assert "shellbench::" not in good.stdout  # without a suite the settings of the gate do nothing
    spoil(broken, NU_IGNORED, STIFFNESS_WITHOUT_NU)
    assert python(*own, site=broken, folder=project).returncode == 1


@pytest.mark.long
def test_it_is_listed_checked_and_run_as_the_readme_says(site: Path, project: Path, tmp_path: Path) -> None:
    solvers = json.loads(shellbench("list", "--json", site=site, folder=tmp_path).stdout)["solvers"]
    found = next(solver for solver in solvers if solver["name"] == "plate-series")
    assert found["available"]
    assert (found["package"], found["version"]) == ("plate-series", "0.1.0")
    checked = shellbench("check-solver", "plate-series", site=site, folder=tmp_path)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    # its terms leave the end of the plate 1 : 50 half a percent off
    assert re.search(
        r"^grade 0\.01 \(suites obstacle_course, .*\): .* its worst is strip_plate_1_50", checked.stdout, re.MULTILINE
    )
    run = shellbench("run", "square_plate", "--solver", "plate-series", site=site, folder=tmp_path)
    assert run.returncode == 0, run.stderr
    rows = json.loads(shellbench("table", "--format", "json", site=site, folder=tmp_path).stdout)
    headline = next(row for row in rows if row["primary"])
    assert abs(headline["relative_error"]) < 1e-8  # 48 odd harmonics: the tail falls like 1 / 95**5 = 1e-10


def test_the_readme_the_workflow_and_the_page_say_the_same() -> None:
    package = tomllib.loads((TEMPLATE / "pyproject.toml").read_text())
    assert package["project"]["entry-points"]["shellbench.solvers"] == {
        "plate-series": "plate_series.solver:PlateSeriesSolver"
    }
    readme = (TEMPLATE / "README.md").read_text()
    for name in re.findall(r"^\| `([^`]+)`", readme, re.MULTILINE):
        assert (TEMPLATE / name).is_file(), name
    workflow = (TEMPLATE / ".github" / "workflows" / "shellbench.yml").read_text()
    page = (ROOT / "docs" / "pytest.md").read_text()
    steps = re.findall(r"^ +- (?:run|uses): .*$", workflow, re.MULTILINE)
    assert len(steps) > 4
    for line in [s for s in steps if "upload-artifact" not in s]:
        assert line in page, line
    for name in ("shellbench_solver", "shellbench_tolerance"):
        setting = f"{name} = {json.dumps(package['tool']['pytest']['ini_options'][name])}"
        assert setting in page, setting
    for command in ("shellbench check-solver plate-series", "python -m pytest --shellbench=obstacle_course"):
        assert command in workflow
        assert command in readme
