import os
import subprocess
import sys
from importlib.metadata import version

import pytest
from pydantic import ValidationError

from shellbench.bench.plugins import registry
from shellbench.errors import InputError

pytest.importorskip("KratosMultiphysics", reason="needs Kratos: python -m pip install ./plugins/kratos")

from shellbench_kratos.engine import fresh_model, kratos
from shellbench_kratos.iga_solver import KratosIgaSolver
from shellbench_kratos.settings import KratosSettings

from tests.patience import GUARD

WITHOUT = """
import importlib.metadata as metadata
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "KratosMultiphysics":
            raise ImportError(name)

sys.meta_path.insert(0, Blocked())
there = metadata.version
def version(name):
    if name in {missing!r}:
        raise metadata.PackageNotFoundError(name)
    return there(name)
metadata.version = version

from shellbench.bench.plugins import registry
try:
    registry.load_solver(registry.find_solver("kratos-iga"))
except Exception as error:
    print(type(error).__name__, error)
"""
SOLVE = """
from shellbench_kratos.iga_solver import KratosIgaSolver
from tests.problems.shell.stated_shells import known, plate
KratosIgaSolver().solve(plate(), {"cells": (2, 2)})
KratosIgaSolver().solve(plate(theory="kirchhoff-love-nonlinear", loads=[
    {"kind": "area", "vector": [0, 0, "t"]}]), {"cells": (2, 2), "load_steps": 1})
KratosIgaSolver().solve(plate(loads=[]), {"cells": (2, 2)})  # of which Kratos would warn
"""


def run(code):
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=GUARD, check=False, env={**os.environ}
    )


def test_it_is_found_like_any_solver():
    assert isinstance(registry.load_solver(registry.find_solver("kratos-iga")), KratosIgaSolver)


@pytest.mark.parametrize("missing", [("KratosMultiphysics",), ("KratosMultiphysics", "KratosIgaApplication")])
def test_without_the_engine_one_sentence_names_the_plugin(missing):
    done = run(WITHOUT.replace("{missing!r}", repr(missing)))
    assert done.stderr == ""
    assert done.stdout.count("\n") == 1
    for word in ("kratos-iga", *missing, "python -m pip install './plugins/kratos'"):
        assert word in done.stdout


def test_kratos_says_nothing():
    done = run(SOLVE)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_the_setting_is_the_installed_version_and_no_other():
    assert KratosSettings().engine == f"KratosMultiphysics {version('KratosMultiphysics')}"
    with pytest.raises(ValidationError, match="installed"):
        KratosSettings(engine="KratosMultiphysics 9.0")
    with pytest.raises((ValidationError, InputError), match="installed"):
        KratosIgaSolver().solve(None, {"engine": "KratosMultiphysics 9.0"})


def test_threads_are_those_that_are_asked_for_now(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    fresh_model()
    assert kratos.ParallelUtilities.GetNumThreads() == 2
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    fresh_model()
    assert kratos.ParallelUtilities.GetNumThreads() == 1
