"""The action and the workflow that gate a solver elsewhere: what they call exists, and their steps do what they say."""

from __future__ import annotations

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
    for step in STEPS[:-1]:
        call = ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"]]
        environment = {**os.environ, "PATH": f"{tools}{os.pathsep}{os.environ['PATH']}", **given}
        done = subprocess.run(call, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{step['name']}: {done.stdout}{done.stderr}"
    assert "nothing lost" in (tmp_path / "summary.md").read_text(encoding="utf-8")
    assert "status=0" in (tmp_path / "outputs").read_text(encoding="utf-8")
    assert (tmp_path / "out/fem.zip").is_file()
    assert (tmp_path / "out/page/index.html").is_file()
