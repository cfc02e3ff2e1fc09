"""The kept summary of resolution: what it says of synthetic runs, turned waves, and the committed file."""

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from docs.kept_resolution import as_text, summary, turned_states
from shellbench.bench.catalogue import catalog
from tests.report.resolutions import LENGTH, PLATE, evidence, only_suites, plate_runs, unknowns

ROOT = Path(__file__).parents[2]
COURSE = catalog.find_suite("obstacle_course").order
FILE = ROOT / "reports" / "resolution.json"


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    only_suites(monkeypatch, ("resolution", "obstacle_course"))
    return json.loads(as_text(summary(evidence(tmp_path, plate_runs(tmp_path)))))


def test_it_has_a_line_for_each_run_with_its_cost_and_its_error(made) -> None:
    lines = [run for run in made["runs"] if run["swept"] == "cells" and run["label"].startswith("cells 16")]
    assert [line["unknowns"] for line in lines] == [unknowns(16), 12 * 16 * 17]
    assert lines[0]["error"] == pytest.approx(1 / 16**2)
    assert lines[0]["storage"] == 8 * unknowns(16)
    (failed,) = [run for run in made["runs"] if run["status"] == "failed"]
    assert (failed["value"], failed["error"], failed["displacement"]) == (None, None, None)


def test_runs_are_held_against_the_next_coarser_one_and_the_common_one(made) -> None:
    by_id = {run["run_id"]: run for run in made["runs"]}
    (fine,) = [run for run in made["runs"] if run["label"] == "cells 64×64"]
    coarse = by_id[fine["coarser_run"]]
    change = LENGTH * (coarse["error"] - fine["error"])
    assert fine["from_coarser"]["largest"] == pytest.approx(change, rel=1e-9)
    common = made["cases"][PLATE]["common_run"]
    assert by_id[common]["from_common"] is None
    expected = LENGTH * abs(fine["error"] - by_id[common]["error"])
    assert fine["from_common"]["largest"] == pytest.approx(expected, rel=1e-9)


def test_one_solution_is_asked_through_grids_and_at_common_points(made) -> None:
    (fine,) = [run for run in made["runs"] if run["label"] == "cells 64×64"]
    assert [step["points"] for step in fine["grids"]] == [10]
    assert np.shape(fine["displacement"]) == (1, 3, 3)
    assert np.shape(made["cases"][PLATE]["points"]) == (3, 2)


@pytest.mark.parametrize("angle", [0.0, 0.3, -1.1])
def test_waves_that_stand_at_another_angle_are_the_same_state(angle: float) -> None:
    """A sleeve with four dents, in the position and displacement of a grid that closes."""

    def grid(turn: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        theta, y = np.meshgrid(np.linspace(0, 2 * np.pi, 61), np.linspace(0, 1, 61), indexing="ij")
        position = np.stack([np.cos(theta), y, np.sin(theta)], axis=-1)
        wave = 4 * (theta - turn) + 6 * (y - 0.5)
        out = -(0.1 * np.cos(wave) + 0.02 * np.cos(2 * wave)) * np.sin(np.pi * y)
        radial = np.stack([np.cos(theta), 0 * y, np.sin(theta)], axis=-1)
        return np.stack([theta, y], axis=-1), position, (out[..., None] * radial)[None]

    xi, position, states = grid(angle)
    turned = turned_states(position, states)
    assert turned == pytest.approx(turned_states(grid(0.0)[1], grid(0.0)[2]), abs=1e-12)
    assert turned[0, 0, 30, 0] == pytest.approx(-0.12)
    assert np.allclose(turned[..., 1:], 0.0, atol=1e-12)
    assert xi.shape[:2] == position.shape[:2]


@pytest.fixture
def kept():
    if not FILE.is_file():
        pytest.skip("no summary is committed: `python -m nox -s evidence` makes one")
    return json.loads(FILE.read_text(encoding="utf-8"))


def test_the_committed_summary_has_the_course_with_four_points_a_line(kept) -> None:
    assert list(kept["cases"]) == list(COURSE)
    assert len(kept["made"]["commit"]) == 40
    points = Counter(
        (run["case"], run["solver"]) for run in kept["runs"] if run["error"] is not None and run["swept"] != "time_step"
    )
    for case in COURSE:
        for solver in ("fem", "ndf-ritz", "ndf"):
            assert points[case, solver] >= 4, (case, solver)
        if case != "sleeve_course":  # whose rims turn, which cst-hinge does not take
            assert points[case, "cst-hinge"] >= 4, case


def test_the_committed_summary_is_small_and_its_errors_are_of_todays_known_values(kept) -> None:
    assert FILE.stat().st_size < 500_000
    for name, case in kept["cases"].items():
        judge = catalog.known_values(name).judge(case["quantity"], catalog.named_case(name).theory)
        assert case["reference"] == judge.value
        for run in kept["runs"]:
            if run["case"] == name and run["error"] is not None:
                expected = abs(run["value"] - judge.value) / case["error_scale"]
                assert run["error"] == pytest.approx(expected, rel=1e-6, abs=1e-15)
