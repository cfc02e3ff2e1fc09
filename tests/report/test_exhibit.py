"""Figures are written by several processes, and are the files that one would write."""

import os
import signal
import sys

import pytest
from matplotlib.figure import Figure

from shellbench.errors import ShellbenchError
from shellbench.report.data import exhibit
from shellbench.report.data.exhibit import Exhibit, save_all


class Killed(Figure):
    """A figure whose drawing takes so much memory that the process is killed."""

    def draw(self, renderer):
        os.kill(os.getpid(), signal.SIGKILL)


def drawn(name, kind=Figure):
    figure = kind(figsize=(1.5, 1.0), layout="constrained")
    figure.add_subplot().plot([0, 1], [0, len(name)], label=lambda: "what can't be sent to another process")
    return Exhibit(name, name, "", "", figure, (), drawing=len(name) % 2 == 0)


@pytest.mark.parametrize("cores", [1, 3])
def test_each_figure_has_its_files_and_its_link(cores, tmp_path, monkeypatch):
    monkeypatch.setattr(exhibit, "cores", lambda: cores)
    names = ["a", "bb", "ccc", "dddd"]
    uris = save_all([drawn(name) for name in names], tmp_path)
    assert list(uris) == names
    for name in names:
        alone = drawn(name)
        (tmp_path / "alone").mkdir(exist_ok=True)
        assert uris[name] == alone.save(tmp_path / "alone")
        for suffix in ("pdf", "png", *(["svg"] if alone.drawing else [])):  # drawings as PNG too, for print
            file = f"{name}.{suffix}"
            assert (tmp_path / file).read_bytes() == (tmp_path / "alone" / file).read_bytes()


def test_the_error_of_a_process_is_that_of_the_report(tmp_path, monkeypatch):
    monkeypatch.setattr(exhibit, "cores", lambda: 2)
    with pytest.raises(FileNotFoundError):
        save_all([drawn("a"), drawn("bb")], tmp_path / "no folder")


@pytest.mark.skipif(sys.platform != "linux", reason="one process writes them all")
def test_a_process_that_is_killed_is_one_sentence(tmp_path, monkeypatch):
    monkeypatch.setattr(exhibit, "cores", lambda: 2)
    with pytest.raises(ShellbenchError, match="was killed"):
        save_all([drawn("a"), drawn("bb", Killed)], tmp_path)
