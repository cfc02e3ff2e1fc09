"""The common part of solutions and solvers: files, marks, rounding and refusals of a made solver."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from shellbench.bench.catalogue.catalog import named_case
from shellbench.bench.plugins.registry import load_solver, solver_entries
from shellbench.errors import InputError, SolveFailure
from shellbench.problem import Capabilities, Progress, Settings, Step
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.records.history import failing_with, settled
from shellbench.problems.shell.solution import ShellSolution, ShellSolver, read_solution, state_number, time_reached

CASE = named_case("square_plate")
GRID = np.asarray(CASE.surface.domain.grid(3, 4))


@dataclass(frozen=True)
class Wave(ShellSolution):
    """u = c xi, and c beside it that nothing needs."""

    formats: ClassVar = ("wave, format 2", "wave, format 1", 1)
    numbers: ClassVar = ("c",)

    case: Case
    c: np.ndarray
    parameters: int = 6

    def displacement_at(self, xi, at):
        assert xi.ndim == 2
        return xi @ self.c

    def field_at(self, name, xi, at):
        return np.ones((len(xi), 3)) if name.endswith("strain") else np.ones(len(xi))

    def energies(self, at=None):
        return 0.0, float(np.abs(self.c).sum())

    def reaction_at(self, number, centre, at):
        return np.full(3, float(number)), centre

    @classmethod
    def restored(cls, case, words, arrays):
        if arrays["c"].shape != (2, 3):
            raise ValueError("c has another shape")
        return cls(case, arrays["c"], int(words["parameters"]))


class WaveSettings(Settings):
    height: float = 1.0


class WaveSolver(ShellSolver):
    name = "wave"
    capabilities = Capabilities(theories=("kirchhoff-love-linear",), label="waves")
    settings_type = WaveSettings

    def declines_with(self, case, settings):
        return "it is too high" if settings.height > 9 else self.declines(case)

    def answer(self, case, settings, start, progress):
        progress(Progress(0, None, "up"))
        return wave(settings.height)


def wave(height=1.0, **facts):
    return Wave(CASE, np.asfortranarray(height * np.arange(6.0).reshape(2, 3) / 7), **facts)


WAVE = wave(
    history=(Step(0, 0.1, -1.0, 6, quantities={"down": 0.5}), Step(1, 0.2, -2.0, 6, phase="path", iterations=3)),
    diagnostics={"cells": [3, 4], "why": None},
    uncertainty={"down": 0.1},
    unsettled="down still moves by 0.2",
    extrapolated={"down": 0.51},
)


@pytest.mark.parametrize("shape", [(2,), (0, 2), (5, 2), (3, 4, 2)])
def test_points_of_any_shape_are_answered(shape):
    points = np.linspace(0, 1, int(np.prod(shape))).reshape(shape)
    assert np.array_equal(WAVE.displacement(points), points @ WAVE.c)
    assert not WAVE.velocity(points).any()
    assert WAVE.velocity(points).shape == (*shape[:-1], 3)
    assert WAVE.evaluate("bending_strain", points).shape == (*shape[:-1], 3)
    assert WAVE.evaluate("membrane_energy_density", points).shape == shape[:-1]


def test_wrong_questions_are_refused_in_one_sentence():
    with pytest.raises(InputError, match=r"^square_plate: this field is of the case's own material"):
        WAVE.displacement(GRID, material={"youngs_modulus": 1.0})
    with pytest.raises(KeyError):
        WAVE.evaluate("stress", GRID)
    with pytest.raises(InputError, match=r"no support is called 'nail'; known are \w+"):
        WAVE.reaction("nail")
    force, centre = WAVE.reaction(CASE.supports[0].name, [1, 2, 3])
    assert not force.any()
    assert np.array_equal(centre, [1.0, 2.0, 3.0])


def test_a_file_gives_back_all_bit_for_bit(tmp_path):
    path = WAVE.save(tmp_path / "a.b")
    assert path.name == "a.b.npz"
    assert WAVE.save(path) == path
    back = Wave.load(path)
    assert back.c.tobytes("A") == WAVE.c.tobytes("A")
    assert back.c.flags.f_contiguous  # products of another layout round otherwise
    for name in ("case", "parameters", "history", "diagnostics", "uncertainty", "extrapolated", "unsettled"):
        assert getattr(back, name) == getattr(WAVE, name)


def written(path, arrays, **changes):
    words = {"parameters": 6, **WAVE.facts(), **changes}
    kept = {k: v for k, v in words.items() if v is not None}
    np.savez(path, words=np.asarray(json.dumps(kept, default=asdict)), c=WAVE.c, **arrays)
    return path


EARLIER = {
    "a number": ({}, {"format": 1}),
    "a mark among the words": ({}, {"mark": "wave, format 1"}),
    "a mark beside the words": ({"mark": np.asarray("wave, format 1")}, {}),
    "a name, and no uncertainty": (
        {},
        {"format": "wave, format 1", "case_name": None, "name": CASE.name, "uncertainty": None, "extrapolated": None},
    ),
}


@pytest.mark.parametrize("how", EARLIER)
def test_files_of_earlier_formats_are_read(tmp_path, how):
    arrays, words = EARLIER[how]
    back = Wave.load(written(tmp_path / "old.npz", arrays, **words))
    assert np.array_equal(back.c, WAVE.c)
    assert (back.case, back.history) == (CASE, WAVE.history)


@pytest.mark.parametrize(
    "words",
    [{}, {"format": 3}, {"format": "other, format 1"}, {"format": 1, "case": {}}, {"format": 1, "history": [{"x": 1}]}],
)
def test_other_files_are_refused_in_one_sentence(tmp_path, words):
    with pytest.raises(InputError, match=r"old.npz: is damaged, or not a solution of wave$"):
        Wave.load(written(tmp_path / "old.npz", {}, **words))


def test_no_file_and_a_kind_that_does_not_fit(tmp_path):
    with pytest.raises(InputError, match="can't be read as a solution of wave"):
        Wave.load(tmp_path / "none.npz")

    class Other(Wave):
        @classmethod
        def restored(cls, case, words, arrays):
            return cls(case, arrays["d"])

    assert isinstance(read_solution(WAVE.save(tmp_path / "w"), Wave.formats, lambda case: Wave), Wave)
    with pytest.raises(InputError, match="not a solution of wave"):
        read_solution(tmp_path / "w.npz", Wave.formats, lambda case: Other)


def test_rounding_takes_the_numbers_and_says_what_they_take():
    short, taken = WAVE.rounded("float16")
    assert taken == WAVE.storage_bytes / 4 + 2  # with the exponent of the scale
    assert 0 < np.abs(short.c - WAVE.c).max() <= 2**-11 * np.abs(WAVE.c).max()
    assert short.history == WAVE.history
    assert WAVE.rounded("float64") == (WAVE, WAVE.storage_bytes)


def test_a_state_is_found_by_its_mark():
    assert [state_number(CASE, (0.5, 1.0, 20.0), at) for at in (None, 0.5, 20.0 + 1e-9)] == [2, 0, 2]
    with pytest.raises(InputError, match=r"^square_plate: solved at 0\.5, 1, 20, not at 0\.7$"):
        state_number(CASE, (0.5, 1.0, 20.0), 0.7)
    with pytest.raises(InputError, match="not at nan"):
        state_number(CASE, (0.5, 1.0), float("nan"))


def test_a_time_is_one_that_was_reached():
    assert [time_reached(CASE, 2.0, at) for at in (None, 0.0, -1e-10, 1.5, 2.0 + 1e-10)] == [2.0, 0.0, 0.0, 1.5, 2.0]
    for at in (-0.1, 2.1, float("nan")):
        with pytest.raises(InputError, match="solved from 0 to 2 s, not at"):
            time_reached(CASE, 2.0, at)


def test_a_solver_asks_before_it_solves(tmp_path):
    said = []
    solver = WaveSolver()
    assert np.array_equal(solver.solve(CASE, {"height": 2.0}, progress=said.append).c, wave(2.0).c)
    assert np.array_equal(solver.solve(CASE).c, wave().c)
    assert [p.message for p in said] == ["up"]
    with pytest.raises(ValueError, match="colour"):
        solver.solve(CASE, {"colour": "red"})
    with pytest.raises(InputError, match="wave can't take square_plate: it is too high"):
        solver.solve(CASE, WaveSettings(height=10))
    with pytest.raises(InputError, match="wave can't take square_plate_nonlinear: it does not solve the theory"):
        solver.solve(named_case("square_plate_nonlinear"))
    for start in (WAVE, tmp_path / "wave.npz"):
        with pytest.raises(InputError, match="wave can't go on from an earlier solution"):
            solver.solve(CASE, start=start)


@pytest.mark.parametrize("name", ["ndf-ritz", "cst-hinge"])
def test_a_start_is_never_ignored(name):
    solver = load_solver(solver_entries()[name])
    with pytest.raises(InputError, match=f"^{name} can't go on from an earlier solution"):
        solver.solve(CASE, solver.settings_type(), start=Path("earlier.npz"))


def test_a_failure_takes_what_was_reached_with_it():
    with pytest.raises(SolveFailure, match=r"^it broke$") as caught, failing_with(lambda: WAVE, "the wave"):
        raise SolveFailure("it broke")
    assert caught.value.partial is WAVE
    with pytest.raises(SolveFailure, match="the wave does not fit into memory"), failing_with(lambda: None, "the wave"):
        raise MemoryError


def test_the_last_change_of_ever_finer_solutions_is_their_uncertainty():
    told = []
    levels = [(wave(height), -height) for height in (1.0, 1.5, 1.75)]
    found = settled(levels, 3, told.append)
    assert np.array_equal(found.c, levels[-1][0].c)
    assert [step.energy for step in found.history] == [-1.0, -1.5, -1.75]
    down = [step.quantities["centre_deflection"] for step in found.history]
    assert found.uncertainty["centre_deflection"] == abs(down[2] - down[1])
    assert [(progress.step, progress.total) for progress in told] == [(1, 3), (2, 3), (3, 3)]
    assert settled(levels[:1], 1, told.append).uncertainty == {}
    with pytest.raises(SolveFailure, match=r"^the answer with 6 unknowns is not finite$"):
        settled([(WAVE, float("nan"))], 1, told.append)
