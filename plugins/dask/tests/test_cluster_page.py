"""The commands of docs/cluster.md work."""

import ast
import os
import re
import shutil
import stat
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from shellbench_dask.cluster import LOSSES
from shellbench_dask.remote import reason_unfit

from shellbench.bench.run.plan import Request, make_plan
from shellbench.bench.store.environment import THREADS
from shellbench.bench.store.store import Contents, Store
from tests.bench.conftest import PLUGIN
from tests.patience import GUARD

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "cluster.md").read_text(encoding="utf-8")
SBATCH = """#!/bin/bash
# The first job starts at once; the others wait in the queue for ever.
job=1
until mkdir "$QUEUE/$job" 2> /dev/null; do job=$((job + 1)); done
cp "${@: -1}" "$QUEUE/$job/job.sh"
if [ $job = 1 ]; then setsid bash "$QUEUE/1/job.sh" > "$QUEUE/1/log" 2>&1 < /dev/null & fi
echo "Submitted batch job $job"
"""
SCANCEL = """#!/bin/bash
echo "$@" >> "$QUEUE/cancelled"
"""


def block(language: str) -> str:
    (found,) = re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)
    return found


def sweep() -> dict[str, Any]:
    """Names that the script of the page defines."""
    names: dict[str, Any] = {"__name__": "sweep"}
    exec(compile(block("python"), "sweep.py", "exec"), names)
    return names


def test_the_script_of_the_page_renders_a_job_of_slurm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("dask_jobqueue", reason="the page needs it, shellbench does not")
    monkeypatch.chdir(tmp_path)
    with sweep()["cluster"]() as workers:
        script = workers.job_script()
        address = workers.scheduler_address
    lines = script.splitlines()
    assert "#SBATCH -p cpu" in lines
    assert "#SBATCH --cpus-per-task=16" in lines
    assert "#SBATCH --mem=64G" in lines
    assert "#SBATCH -t 08:00:00" in lines
    assert "source $HOME/shells/bin/activate" in lines
    (worker,) = [line for line in lines if "dask_worker" in line]
    assert worker.startswith(f"python -m distributed.cli.dask_worker {address} ")
    for option in ("--nthreads 4", "--nworkers 4", "--death-timeout 120", "--nanny"):
        assert option in worker


def test_the_gpu_directives_of_the_page_reach_the_job(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    jobqueue = pytest.importorskip("dask_jobqueue", reason="the page needs it, shellbench does not")
    monkeypatch.chdir(tmp_path)
    given = re.search(r"`processes=1`, `cores=8`, `(job_extra_directives=\[.*?\])`", PAGE)
    assert given is not None
    call = ast.parse(f"f({given[1]})", mode="eval").body
    more = {word.arg: ast.literal_eval(word.value) for word in call.keywords}
    with jobqueue.SLURMCluster(processes=1, cores=8, memory="16GiB", **more) as workers:
        script = workers.job_script()
    assert "#SBATCH --gres=gpu:1" in script.splitlines()
    assert "--nthreads 8" in script


def test_numbers_of_the_page_are_those_of_the_code() -> None:
    said = {1: "one", 2: "two", 3: "three", 4: "four"}
    assert f"has lost {said[LOSSES]} workers is a failed record" in PAGE
    assert f"the worker was lost {LOSSES} times: out of memory or of walltime, perhaps" in PAGE
    assert f"`--threads` is {said[THREADS]} by default" in PAGE


def test_the_batch_script_of_the_page_is_shell() -> None:
    subprocess.run(["bash", "-n"], input=block("bash"), text=True, check=True)


def environment(home: Path, tools: Path, queue: Path) -> dict[str, str]:
    """A login node: sbatch, scancel, and an environment to activate."""
    for folder in (home / "shells" / "bin", tools, queue):
        folder.mkdir(parents=True)
    (home / "shells" / "bin" / "activate").write_text("", encoding="utf-8")
    tool = f'#!/bin/bash\nexec {sys.executable} -m shellbench "$@"\n'
    programs = {"sbatch": SBATCH, "scancel": SCANCEL, "srun": '#!/bin/bash\nexec "$@"\n', "shellbench": tool}
    for name, text in programs.items():
        (tools / name).write_text(text, encoding="utf-8")
        (tools / name).chmod(stat.S_IRWXU)
    path = os.pathsep.join([str(tools), str(Path(sys.executable).parent), os.environ["PATH"]])
    python = os.pathsep.join([str(PLUGIN), str(ROOT)])
    return {
        **os.environ,
        "HOME": str(home),
        "PATH": path,
        "PYTHONPATH": python,
        "QUEUE": str(queue),
        "SLURM_JOB_ID": "1",
    }


@pytest.mark.long
@pytest.mark.skipif(shutil.which("setsid") is None, reason="needs setsid")
def test_the_script_of_the_page_makes_a_sweep(tmp_path: Path, own_case: Path, store: Store) -> None:
    """With an sbatch that starts the first job on this machine and leaves the others in the queue."""
    pytest.importorskip("dask_jobqueue", reason="the page needs it, shellbench does not")
    place = environment(tmp_path / "home", tmp_path / "tools", tmp_path / "queue")
    (tmp_path / "sweep.py").write_text(block("python"), encoding="utf-8")
    command = [sys.executable, "sweep.py", str(own_case), "--solver", "toy", "--solver", "toy-noisy", "--seed", "0", "--seed", "1"]  # fmt: skip
    done = subprocess.run(
        [*command, "--store", str(store.folder)], cwd=tmp_path, env=place, capture_output=True, text=True, timeout=GUARD
    )
    assert (done.returncode, done.stdout.splitlines()[-1]) == (0, "3 solved"), done.stderr
    said = [line for line in done.stderr.splitlines() if line.startswith("shellbench: ")]
    assert all(line.endswith(": waiting for one") for line in said), done.stderr  # unless the job was there first
    assert len(store.read().records) == 3
    cancelled = (tmp_path / "queue" / "cancelled").read_text(encoding="utf-8")
    assert all(str(job) in cancelled.split() for job in (1, 2, 3, 4))


@pytest.mark.long
def test_the_batch_script_of_the_page_makes_a_sweep(tmp_path: Path, own_case: Path, store: Store) -> None:
    """With an srun that starts one worker on this machine; a job ends with all that it has started."""
    place = environment(tmp_path / "home", tmp_path / "tools", tmp_path / "queue")
    line = f"shellbench run {own_case} --solver toy --store {store.folder}"
    script = block("bash").replace("shellbench run --suite resolution", line) + "code=$?; kill $(jobs -p); exit $code\n"
    assert line in script
    done = subprocess.run(
        ["bash", "-c", script], cwd=tmp_path, env=place, capture_output=True, text=True, timeout=GUARD
    )
    assert (done.returncode, done.stdout.splitlines()[-1]) == (0, "1 solved"), done.stderr
    assert len(store.read().records) == 1


@pytest.mark.parametrize(("case", "solver"), [("hanging_chain", "chain"), ("square_plate", "fem")])
def test_a_worker_with_the_same_source_fits_whatever_the_kind_of_problem(case: str, solver: str) -> None:
    (task,) = make_plan(Request(cases=(case,), solvers=(solver,)), Contents(())).tasks
    assert reason_unfit(task) is None
