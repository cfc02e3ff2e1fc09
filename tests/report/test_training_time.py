import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.protocol.history import HistoryStep
from shellbench.report.studies.paper_studies import training, training_stops, training_table
from tests.report.conftest import GRID, TRUTH, field
from tests.report.studied import evidence, studied

COURSE = {1: -0.9, 10: -0.2, 100: -1e-2, 1000: 3e-3}  # error by iterations
QUANTITY = "centre_deflection"


def history(iterations):
    """Entries at each of the stops before, a tenth of a second an iteration."""
    return tuple(
        HistoryStep(
            iteration=n,
            seconds=0.1 * n,
            energy=-1.0,
            unknowns=50,
            quantities={QUANTITY: TRUTH["square_plate"] * (1 + error)},
        )
        for n, error in COURSE.items()
        if n <= iterations
    )


def stopped(folder, solver, iterations, error, status="ok", energy=-5.0):
    return studied(
        folder,
        "training",
        solver,
        {"iterations": iterations},
        error,
        history=history(iterations),
        status=status,
        diagnostics={"certified_energy": energy},
    )


@pytest.fixture
def runs(tmp_path):
    made = {n: stopped(tmp_path, "adam", n, error) for n, error in COURSE.items()}
    return [made[n] for n in (100, 1, 1000, 10)]


def stops(folder, runs):
    return training_stops(evidence(folder, runs))


def test_the_table_follows_the_iterations_with_the_seconds_of_training_alone(tmp_path, runs):
    data = training_table(stops(tmp_path, runs)).data
    assert data["iterations"].tolist() == list(COURSE)
    assert data["seconds"].tolist() == pytest.approx([0.1 * n for n in COURSE])  # not those of the whole solve
    assert data["relative_error"].tolist() == pytest.approx(list(COURSE.values()))
    assert data["energy"].tolist() == [-5.0] * 4


def test_the_mean_displacement_is_that_of_the_stored_field(tmp_path, runs):
    case = catalog.named_case("square_plate")
    for line in training_table(stops(tmp_path, runs)).data.to_dict("records"):
        u = field(case, GRID, 1 + COURSE[line["iterations"]])["displacement"]
        assert line["mean_displacement"] == pytest.approx(np.mean(np.sqrt((u**2).sum(-1))), rel=1e-6)


def test_a_single_stop_is_no_course(tmp_path, runs):
    assert stops(tmp_path, runs[:1]).empty
    assert training(evidence(tmp_path, runs[:1])) is None


def test_runs_of_other_suites_are_no_stops(tmp_path, runs):
    for change in ({"suites": ("ablations",)}, {"declared": False}):  # a run of no suite has those of its case
        other = [(made, of.model_copy(update=change)) for made, of in runs]
        assert training(evidence(tmp_path, other)) is None


def test_each_state_stands_under_its_iterations_and_seconds(tmp_path, runs):
    runs = [*runs, stopped(tmp_path, "newton", 0, 1e-3), stopped(tmp_path, "newton", 1, 1e-5)]
    (exhibit,) = training(evidence(tmp_path, runs)).exhibits
    assert exhibit.name == "training_square_plate"
    assert set(exhibit.run_ids) == {made.run_id for made, _ in runs}
    above, below = exhibit.figure.subfigs
    titles = [axes.get_title() for axes in above.axes if axes.get_title()]
    assert titles == [
        "1 iteration\n0.10 s",
        "10 iterations\n1.0 s",
        "100 iterations\n10 s",
        "1000 iterations\n100 s",
        "0 iterations\n0.10 s",  # without a history: the seconds of the solve
        "1 iteration\n0.10 s",
    ]
    marks = [line for line in below.axes[0].get_lines() if line.get_linestyle() == "None"]
    drawn = {float(y): float(x) for line in marks for x, y in zip(line.get_xdata(), line.get_ydata(), strict=True)}
    assert sorted(drawn) == pytest.approx(sorted(100 * abs(error) for error in [*COURSE.values(), 1e-3, 1e-5]))
    assert drawn[max(drawn)] == pytest.approx(0.1)  # the error of 90 % after one iteration


def test_a_failed_state_is_marked(tmp_path, runs):
    runs = [*runs, stopped(tmp_path, "adam", 3000, 0.5, status="failed")]
    found = training(evidence(tmp_path, runs))
    assert "adam failed" in found.tables[0].write("text")
    above, below = found.exhibits[0].figure.subfigs
    assert sum("failed" in axes.get_title() for axes in above.axes) == 1
    hollow = [line for line in below.axes[0].get_lines() if line.get_markerfacecolor() == "white"]
    assert [float(line.get_ydata()[0]) for line in hollow] == [pytest.approx(50.0)]


@pytest.mark.parametrize("odd", [None, "low", [1.0]])
def test_an_energy_that_is_no_number_is_none(tmp_path, odd):
    runs = [stopped(tmp_path, "adam", n, 0.1, energy=odd) for n in (1, 2)]
    assert stops(tmp_path, runs)["energy"].isna().tolist() == [True, True]
