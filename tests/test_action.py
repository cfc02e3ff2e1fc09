"""The action and the workflow that gate a solver elsewhere: what they call exists, and their steps do what they say."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.test_documented_commands import parse

yaml = pytest.importorskip("yaml", reason="the action is YAML: pip install pyyaml")
ROOT = Path(__file__).parents[1]
ACTION = yaml.safe_load((ROOT / "action.yml").read_text(encoding="utf-8"))
WORKFLOW = yaml.safe_load((ROOT / ".github/workflows/gate.yml").read_text(encoding="utf-8"))
STEPS = ACTION["runs"]["steps"]
VARIABLES = {"SOLVER": "mine", "SUITE": "quick", "CASES": "square_plate", "THRESHOLD": "1e-4", "OUT": "out"}


def commands(script: str) -> list[str]:
    """The lines of a step that call shellbench, with its variables filled in."""
    calls = [re.split(r" \|\||>", line.strip())[0] for line in script.splitlines() if "shellbench " in line]
    return [re.sub(r"\$(\w+)", lambda found: VARIABLES[found[1]], call) for call in calls]


@pytest.mark.parametrize("line", [line for step in STEPS for line in commands(step["run"]) if "echo" not in line])
def test_the_action_calls_what_there_is(line: str) -> None:
    parse(line)


def test_what_is_asked_of_the_action_is_declared() -> None:
    used = set(re.findall(r"inputs\.(\w+)", str(STEPS)))
    assert used == set(ACTION["inputs"])
    passed = next(step for step in WORKFLOW["jobs"]["gate"]["steps"] if step.get("uses") == "./shellbench-action")[
        "with"
    ]
    assert set(passed) <= set(ACTION["inputs"])
    declared = WORKFLOW[True]["workflow_call"]["inputs"]  # YAML takes `on` for true
    assert set(re.findall(r"inputs\.(\w+)", str(WORKFLOW["jobs"]))) == set(declared)


def shim(folder: Path, name: str, script: str) -> None:
    path = folder / name
    path.write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
    path.chmod(0o755)


def outcome(folder: Path, **codes: int) -> tuple[list[str], int]:
    """Go through the steps as GitHub does, where commands of shellbench end with such codes; what ran, and the job's code."""
    shim(folder, "python", "exit 0")
    shim(
        folder,
        "shellbench",
        "\n".join(f'test "$1" = {name} && exit {code}' for name, code in codes.items()) + "\nexit 0",
    )
    (folder / "out").mkdir()
    files = {"GITHUB_STEP_SUMMARY": str(folder / "summary.md"), "GITHUB_OUTPUT": str(folder / "outputs")}
    ran, failed = [], 0
    for step in STEPS:
        if failed and "cancelled()" not in step.get("if", ""):
            continue
        written = (folder / "outputs").read_text() if (folder / "outputs").exists() else ""
        status = re.search(r"status=(\d+)", written)
        given = (
            VARIABLES | files | {"FOLDER": ".", "BEFORE": ".", "INSTALL": ".", "STATUS": status[1] if status else ""}
        )
        call = ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"]]
        environment = {**os.environ, "PATH": f"{folder}{os.pathsep}{os.environ['PATH']}", **given}
        done = subprocess.run(call, cwd=folder, env=environment, capture_output=True, check=False)
        ran.append(step["name"])
        failed = failed or done.returncode
    return ran, failed


@pytest.mark.skipif(sys.platform == "win32", reason="steps are for bash")
@pytest.mark.parametrize(
    ("codes", "good"),
    [({}, True), ({"compare": 1}, False), ({"compare": 2}, False), ({"pack": 2}, False), ({"gate": 1}, False)],
)
def test_the_job_is_green_only_if_all_is_and_the_verdict_comes_before_the_pack(
    tmp_path: Path, codes: dict[str, int], good: bool
) -> None:
    ran, failed = outcome(tmp_path, **codes)
    assert (failed == 0) == good
    assert ran.index("Judge") < ran.index("Write the page and the pack")


USES = re.compile(r"uses: +([\w./-]+)@(\S+)(.*)")
GIVEN_TO_USERS = ("examples/solver_template/.github/workflows/shellbench.yml", "docs/pytest.md")


@pytest.mark.parametrize(
    "path", [*(str(p.relative_to(ROOT)) for p in ROOT.glob(".github/workflows/*")), *GIVEN_TO_USERS]
)
def test_actions_of_others_are_pinned_by_digest(path: str) -> None:
    found = USES.findall((ROOT / path).read_text(encoding="utf-8"))
    assert found
    for name, ref, comment in found:
        assert re.fullmatch(r"[0-9a-f]{40}", ref), name
        assert re.fullmatch(r" # v\d+\.\d+\.\d+", comment), name


@pytest.mark.parametrize("path", sorted(ROOT.glob(".github/workflows/*")), ids=lambda path: path.name)
def test_no_check_out_leaves_a_token(path: Path) -> None:
    jobs = yaml.safe_load(path.read_text(encoding="utf-8"))["jobs"].values()
    steps = [step for job in jobs for step in job["steps"] if "actions/checkout" in step.get("uses", "")]
    assert steps
    assert all(step["with"]["persist-credentials"] is False for step in steps)


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="steps are for bash")
def test_the_steps_solve_compare_pack_and_judge(tmp_path: Path) -> None:
    """Steps of the action, one after the other, as GitHub runs them: by bash that stops at the first error."""
    tools = tmp_path / "tools"
    tools.mkdir()
    shim(tools, "python", "exit 0")  # nothing is installed
    shim(tools, "shellbench", f'exec "{sys.executable}" -m shellbench "$@"')
    given = {"SOLVER": "fem", "SUITE": "obstacle_course", "CASES": "square_plate", "INSTALL": ".", "THRESHOLD": "1e-4"}
    given |= {"FOLDER": ".", "BEFORE": ".", "OUT": "out", "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    given |= {"GITHUB_STEP_SUMMARY": str(tmp_path / "summary.md"), "GITHUB_OUTPUT": str(tmp_path / "outputs")}
    for step in STEPS:
        if step["name"] == "Nothing may be lost":
            given["STATUS"] = "0"
        call = ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"]]
        environment = {**os.environ, "PATH": f"{tools}{os.pathsep}{os.environ['PATH']}", **given}
        done = subprocess.run(call, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{step['name']}: {done.stdout}{done.stderr}"
    assert "nothing lost" in (tmp_path / "summary.md").read_text(encoding="utf-8")
    assert "status=0" in (tmp_path / "outputs").read_text(encoding="utf-8")
    assert (tmp_path / "out/fem.zip").is_file()
    assert (tmp_path / "out/page/index.html").is_file()


def test_no_token_that_may_write_is_in_the_job_that_runs_a_pull_requests_code() -> None:
    assert WORKFLOW["permissions"] == {"contents": "read"}
    runs_code = [
        name for name, job in WORKFLOW["jobs"].items() if "checkout" in str(job) or "shellbench-action" in str(job)
    ]
    may_write = [name for name, job in WORKFLOW["jobs"].items() if "write" in job.get("permissions", {}).values()]
    assert runs_code == ["gate"]
    assert may_write == ["comment"]
