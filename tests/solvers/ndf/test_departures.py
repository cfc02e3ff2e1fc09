"""Departures from the published training: each does what it says, alone; together they survive an interruption."""

import numpy as np
import pytest
import torch

from shellbench.bench.catalogue.catalog import named_case
from shellbench.errors import InputError, SolveFailure
from shellbench.solvers.ndf.field.jets import D1, D11, VALUE, Placement
from shellbench.solvers.ndf.published.published_network import PublishedFactors, initial_siren
from shellbench.solvers.ndf.published.published_samples import expected_displacement
from shellbench.solvers.ndf.published.published_settings import training_key
from shellbench.solvers.ndf.published.published_training import CERTIFIED, RECORD, Plan
from shellbench.solvers.ndf.published_solver import PublishedSolver
from tests.solvers.ndf.shells import differences, inner_points
from tests.solvers.ndf.test_published import Interrupted, interrupt_at, jolt_after, numbers, same
from tests.solvers.ndf.trainings import sampler_of, small, trained

PLATE, PINCHED = named_case("square_plate"), named_case("pinched_cylinder_free")
NAPKIN = named_case("napkin_corner")
LOAD = np.array([[np.pi / 2, 300.0]])
ALL = {
    "pins": "none", "unit": "load", "schedule": "cosine", "averaging": 0.9, "keep": "best", "resample_every": 2,
    "activation": "tanh", "certify_every": 50,
}  # fmt: skip
STILL = {"iterations": 1, "learning_rate": 1e-90}


def test_pins_that_samples_see_hold_the_same_and_are_as_wide_as_a_cell():
    seen = PublishedFactors(PINCHED, kind="cells")
    aside = LOAD + np.array([[np.radians(9.0), 0.0], [0.0, 15.0]])  # half a cell of 20 x 20
    held = seen.matrix(LOAD, Placement())[VALUE].numpy()
    np.testing.assert_allclose(held, [np.diag([0.0, 0.0, 1.0])], atol=1e-15)
    factors = seen.matrix(aside, Placement())[VALUE].numpy()
    np.testing.assert_allclose(factors, [np.diag([1 - np.exp(-0.25)] * 2 + [1.0])] * 2, atol=1e-12)
    printed = PublishedFactors(PINCHED).matrix(aside, Placement())[VALUE].numpy()
    np.testing.assert_allclose(printed, [np.eye(3)] * 2, atol=1e-12)


def test_without_pins_nothing_is_held():
    matrix = PublishedFactors(PINCHED, kind="none").matrix(LOAD, Placement())
    assert torch.equal(matrix[VALUE], torch.eye(3, dtype=torch.float64)[None])
    assert not matrix[1:].any()


def test_the_unit_is_the_deflection_of_a_plate_of_the_load_and_stiffness():
    ansatz = sampler_of(PLATE)[1].ansatz
    stiffness = 1e7 / 12  # E h^3 / 12, h = 1 m, nu = 0
    assert expected_displacement(ansatz) == pytest.approx(0.00406 * 1.0 * 100.0**4 / stiffness, rel=1e-12)
    still = [trained(PLATE, small(**STILL, **extra)) for extra in ({}, {"unit": "load"})]
    ratio = still[1].displacement(inner_points(PLATE)) / still[0].displacement(inner_points(PLATE))
    np.testing.assert_allclose(ratio, expected_displacement(ansatz), rtol=1e-3)  # the same network, in another unit


def test_the_learning_rate_falls_as_half_a_cosine():
    plan = Plan(100, 1e-3, cosine=True)
    assert [plan.rate(k) for k in (1, 51, 101)] == pytest.approx([1e-3, 5e-4, 0.0])
    assert {Plan(100, 1e-3).rate(k) for k in (1, 50, 100)} == {1e-3}


def test_a_training_of_another_length_goes_on_only_where_its_steps_were_the_same():
    keys = {
        schedule: {training_key(PLATE, small(schedule=schedule, iterations=n)) for n in (50, 100)}
        for schedule in ("constant", "cosine")
    }
    assert [len(keys[schedule]) for schedule in ("constant", "cosine")] == [1, 2]


def test_the_average_is_that_of_the_weights():
    start, after = (trained(PLATE, small(iterations=1, learning_rate=rate)) for rate in (1e-90, 1e-2))
    averaged = trained(PLATE, small(iterations=1, averaging=0.9))
    for mean, first, last in zip(numbers(averaged), numbers(start), numbers(after), strict=True):
        torch.testing.assert_close(mean, 0.1 * first + 0.9 * last, rtol=1e-4, atol=1e-6)  # of 2 iterates: 1 / (1 + 9)


def test_the_best_weights_are_kept_when_a_training_is_thrown_off(monkeypatch):
    calls = jolt_after(monkeypatch, 2 * RECORD)
    kept = PublishedSolver().solve(PLATE, small(iterations=3 * RECORD, keep="best", certify_every=RECORD))
    calls.clear()
    with pytest.raises(SolveFailure):
        PublishedSolver().solve(PLATE, small(iterations=3 * RECORD))
    course = [step.quantities[CERTIFIED] for step in kept.history]
    assert min(course) == course[1] < 0 < course[2]
    assert kept.diagnostics[CERTIFIED] == pytest.approx(course[1], rel=1e-3)  # on another rule


def test_the_course_tells_certified_energies_and_gaps():
    solution = trained(PLATE, small(iterations=3 * RECORD, certify_every=RECORD))
    for step in solution.history:
        told = step.quantities
        work = told["membrane_energy"] + told["bending_energy"] - told[CERTIFIED]
        assert work > 0  # f . u, as the plate goes down
        assert step.gap is not None
    *early, last = solution.history
    assert [s.gap for s in early] == pytest.approx([abs(s.energy / s.quantities[CERTIFIED] - 1) for s in early])
    assert last.quantities[CERTIFIED] == solution.diagnostics[CERTIFIED]
    bare = trained(PLATE, small(iterations=2 * RECORD, certify_every=0))
    assert [CERTIFIED in step.quantities for step in bare.history] == [False, True]  # the end is always certified


def test_samples_are_redrawn_as_often_as_asked():
    _, sampler = sampler_of(PLATE)
    often, seldom = list(sampler.samples(0, 4)), list(type(sampler)(**{**vars(sampler), "every": 2}).samples(0, 4))
    first = [sample.inputs for sample in often]
    assert torch.equal(seldom[0].inputs, first[0])
    assert torch.equal(seldom[1].inputs, first[0])
    assert torch.equal(seldom[2].inputs, first[1])
    assert not torch.equal(first[0], first[1])


@pytest.mark.parametrize("name", ["tanh", "gelu"])
def test_networks_of_other_activations(name):
    siren = initial_siren(2, 2, 6, 15.0, 0, Placement(), name)
    assert siren.omega0 == 1.0
    assert siren.weights[1].abs().max().item() == pytest.approx(1 / np.sqrt(6), rel=0.1)
    function = {"tanh": torch.tanh, "gelu": torch.nn.functional.gelu}[name]

    def plain(points):
        h = torch.tensor(points)
        for weight, bias in zip(siren.weights[:-1], siren.biases[:-1], strict=True):
            h = function(h @ weight.T + bias)
        return (h @ siren.weights[-1].T + siren.biases[-1])[:, 0].numpy()

    points = np.random.default_rng(0).random((5, 2))
    inputs = torch.zeros((6, 5, 2), dtype=torch.float64)
    inputs[VALUE], inputs[D1, :, 0], inputs[2, :, 1] = torch.tensor(points), 1.0, 1.0
    jet = siren.jets(inputs)[..., 0]
    np.testing.assert_allclose(jet.numpy(), differences(plain, points), atol=1e-5)
    weight = siren.weights[0].clone().requires_grad_()
    rest = siren.tensors[1:]
    assert torch.autograd.gradcheck(lambda w: siren.with_tensors([w, *rest]).jets(inputs)[D11].sum(), weight)


@pytest.mark.parametrize(
    ("case", "settings", "said"),
    [
        (PLATE, {"keep": "best", "certify_every": 0}, "certify_every must not be 0"),
        (PLATE, {"unit": "load", "modulus_factor": 0.1}, "modulus_factor must be left out"),
        (NAPKIN, {"pins": "none"}, "setting pins belongs to cases at rest"),
        (NAPKIN, {"activation": "gelu"}, "setting activation belongs to cases at rest"),
    ],
)
def test_settings_that_do_not_fit_are_refused_in_a_sentence(case, settings, said):
    with pytest.raises(InputError, match=said) as caught:
        trained(case, small(**settings))
    assert "\n" not in str(caught.value)


@pytest.mark.long
def test_all_departures_survive_an_interruption_and_a_file(tmp_path):
    settings = small(
        **ALL, iterations=4 * RECORD, learning_rate=1e-3, checkpoint=str(tmp_path), checkpoint_every=RECORD
    )
    whole = trained(PINCHED, settings)
    with pytest.raises(Interrupted):
        trained(PINCHED, settings, progress=interrupt_at(3 * RECORD + 2))
    assert len(list(tmp_path.iterdir())) == 1
    resumed = trained(PINCHED, settings)
    assert resumed.diagnostics["resumed_at"] == 3 * RECORD
    assert same(whole, resumed)
    courses = [[s.quantities.get(CERTIFIED, 0.0) for s in one.history] for one in (resumed, whole)]
    assert courses[0] == pytest.approx(courses[1], rel=1e-3)
    assert np.count_nonzero(courses[1]) == 2
    again = PublishedSolver().load(whole.save(tmp_path / "field"))
    points = inner_points(PINCHED)
    np.testing.assert_allclose(again.displacement(points), whole.displacement(points), rtol=1e-5)
    assert again.field.ansatz.factors.kind == "none"
