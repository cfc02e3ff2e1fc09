"""The network of five fields: slopes, supports, files, resumed trainings, and who takes which theory."""

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.registry import load_solver, solver_entries
from shellbench.errors import InputError
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.solvers.naghdi.network import ACTIVATIONS, Fields, Shape
from shellbench.solvers.naghdi.settings import NaghdiSettings
from shellbench.solvers.naghdi.solution import Check, NaghdiSolution, gauss_points
from shellbench.solvers.naghdi.solver import NaghdiSolver
from tests.solvers.naghdi.test_strains import dome, jets

PLATE, ROOF = "thick_plate_naghdi", "scordelis_lo_naghdi"
COARSE = 8  # Gauss points a side of the fine rule, here
TINY = {"layers": 2, "width": 6, "points": 36, "iterations": 6, "certify_every": 2}


@pytest.fixture(autouse=True)
def coarse(monkeypatch):
    """Certified energies on a coarse rule: nothing here depends on their accuracy."""
    usual = Check.of
    monkeypatch.setattr(Check, "of", lambda case, shape: usual(case, shape, COARSE))


@pytest.mark.parametrize("activation", list(ACTIVATIONS))
def test_slopes_are_those_of_the_fields(activation):
    case, shape = catalog.named_case(ROOF), Shape(2, 7, activation)
    weights, xi = shape.initial(3), np.array([[1.0, 10.0], [2.0, 31.0]])

    def fields(points):
        return Fields.at(case, shape, points).jets(weights).numpy()[:, :5]

    found = Fields.at(case, shape, xi).jets(weights).numpy()
    np.testing.assert_allclose(found, jets(fields, xi), atol=1e-8 * np.abs(found).max())


def test_a_diaphragm_holds_its_section_and_the_normal_in_it():
    case, shape = catalog.named_case(ROOF), Shape(1, 5, "gelu")
    for z in (0.0, 50.0):
        q = Fields.at(case, shape, np.array([[1.2, z]])).jets(shape.initial(0)).numpy()[0, :5]
        assert not q[[0, 1, 3]].any()
        assert q[[2, 4]].all()


def test_a_clamp_holds_the_normal():
    case = dome().model_copy(update={"surface": catalog.named_case(PLATE).surface})
    shape = Shape(1, 5, "gelu")
    held, free = Fields.at(case, shape, np.array([[0.0, 3.0], [10.0, 3.0]])).jets(shape.initial(0)).numpy()[:, :5]
    assert not held.any()
    assert free.all()


def test_an_edge_of_skew_coordinates_is_refused_in_a_sentence():
    with pytest.raises(InputError, match="support 'rim' is on an edge of skew coordinates"):
        NaghdiSolver().solve(dome(clamped=False), TINY)


def test_an_interrupted_training_goes_on_as_if_it_had_not_been(tmp_path):
    case, solver = catalog.named_case(PLATE), NaghdiSolver()
    whole = solver.solve(case, TINY)

    def interrupt(progress):
        if progress.step == 4:
            raise KeyboardInterrupt

    settings = {**TINY, "checkpoint": str(tmp_path)}
    with pytest.raises(KeyboardInterrupt):
        solver.solve(case, settings, progress=interrupt)
    assert len(list(tmp_path.iterdir())) == 1
    resumed = solver.solve(case, settings)
    assert resumed.diagnostics["resumed_at"] == 4
    np.testing.assert_allclose(resumed.weights, whole.weights, rtol=1e-9, atol=1e-12)
    assert not list(tmp_path.iterdir())


def test_a_damaged_checkpoint_is_one_sentence(tmp_path):
    case, settings = catalog.named_case(PLATE), NaghdiSettings(**TINY, checkpoint=str(tmp_path))
    from shellbench.solvers.naghdi.training import _file

    _file(case, settings).write_bytes(b"PK no")
    with pytest.raises(InputError, match="is damaged, or no checkpoint of pinn-naghdi"):
        NaghdiSolver().solve(case, settings)


def test_a_file_gives_the_same_answer(tmp_path):
    solution = NaghdiSolver().solve(
        catalog.named_case(ROOF), {**TINY, "iterations": 40, "adam_iterations": 2, "sampling": "sobol"}
    )
    again = NaghdiSolver().load(solution.save(tmp_path / "roof"))
    assert isinstance(again, NaghdiSolution)
    assert measure_all(again) == measure_all(solution)
    assert again.history == solution.history
    assert abs(solution.mean[2]) > 0  # nothing holds the roof along its axis
    assert solution.certified.potential == pytest.approx(min(step.energy for step in solution.history), rel=1e-12)


def test_densities_integrate_to_the_energies():
    shape = Shape(1, 4, "gelu")
    solution = NaghdiSolution(catalog.named_case(ROOF), shape, shape.initial(0).numpy(), np.zeros(3))
    points, weights = gauss_points(solution.case, COARSE)
    areas = weights * solution.case.surface.radius
    parts = [areas @ solution.evaluate(f"{name}_energy_density", points) for name in ("membrane", "bending")]
    np.testing.assert_allclose(parts, solution.energies(), rtol=1e-9)


def test_who_takes_which_theory():
    names = "pinn-naghdi", "fem", "cst-hinge", "bspline-ritz", "ndf-ritz", "ndf", "ndf-published"
    for solver in (load_solver(solver_entries()[name]) for name in names):
        takes = solver.declines(catalog.named_case(ROOF)) is None
        assert takes == (solver.name == "pinn-naghdi"), solver.name
    assert "kirchhoff-love-linear" in NaghdiSolver().declines(catalog.named_case("scordelis_lo"))


@pytest.mark.long
def test_a_short_training_comes_near_the_thick_plate():
    values = measure_all(NaghdiSolver().solve(catalog.named_case(PLATE), {"iterations": 300, "points": 256}))
    known = catalog.known_values(PLATE).judge("centre_deflection", "naghdi-linear").value
    assert values["centre_deflection"] == pytest.approx(known, rel=5e-3)
