"""The published recipe: its loss and gradients against the plainest implementation, its training, its checkpoints."""

import numpy as np
import pytest
import torch

from shellbench.bench.catalogue.catalog import named_case
from shellbench.errors import InputError, SolveFailure
from shellbench.problems.shell.quantities.measure import measure
from shellbench.solvers.ndf.field.jets import Placement
from shellbench.solvers.ndf.published.published_network import InputScale, initial_siren
from shellbench.solvers.ndf.published.published_samples import Sample, stratified_samples, usual_modulus_factor
from shellbench.solvers.ndf.published.published_training import RECORD, STRETCH, why_collapsed
from shellbench.solvers.ndf.published_solver import PublishedSettings, PublishedSolver
from tests.alike import SINGLE, alike, same_tensors
from tests.solvers.ndf.nested import diaphragm_factor, nested_loss, plate_factor
from tests.solvers.ndf.shells import inner_points, shell, support
from tests.solvers.ndf.trainings import sampler_of, small, trained

PLATE, ROOF = named_case("square_plate"), named_case("scordelis_lo")
DIAPHRAGM, PINCHED = named_case("pinched_cylinder_diaphragm"), named_case("pinched_cylinder_free")
TOP, BOTTOM = (np.pi / 2, 300.0), (3 * np.pi / 2, 300.0)
LOADS = [(TOP, (0, 0, -1)), (BOTTOM, (0, 0, 1))]
SOLVER = PublishedSolver()


class Interrupted(Exception):
    pass


def interrupt_at(iteration):
    def progress(told):
        if told.step == iteration:
            raise Interrupted

    return progress


def numbers(solution):
    network = solution.field.features.network
    return [*network.weights, *network.biases, solution.field.output]


def same(one, other):
    """Tell whether two trainings in single precision were the same but for rounding, some 3e-6 after 100 iterations."""
    pairs = zip(numbers(one), numbers(other), strict=True)
    return all(torch.allclose(a, b, rtol=0, atol=1e-4 * float(b.abs().max())) for a, b in pairs)


@pytest.mark.parametrize(
    ("case", "factor", "loads"),
    [(PLATE, plate_factor, []), (DIAPHRAGM, diaphragm_factor, LOADS)],
    ids=["plate", "diaphragm"],
)
def test_loss_and_gradient_are_those_of_nested_differentiation(case, factor, loads):
    siren, sampler = sampler_of(case, layers=3, width=12, cells=(4, 5), dtype=torch.float64)
    s = sampler.modulus_factor
    for iteration, sample in enumerate(sampler.samples(3, 5), 3):
        tensors = [t.requires_grad_() for t in siren.tensors]
        ours = sample.loss(siren)
        points = stratified_samples(case, (4, 5), sampler.seed, iteration)
        plain = nested_loss(case, points, siren.weights, siren.biases, siren.omega0, factor, loads, s)
        assert ours.item() == pytest.approx(plain.item(), rel=1e-10)
        pairs = zip(torch.autograd.grad(ours, tensors), torch.autograd.grad(plain, tensors), strict=True)
        for mine, theirs in pairs:
            assert (mine - theirs).abs().max() <= 1e-10 * theirs.abs().max()


def test_one_sample_in_each_cell_and_new_ones_each_time():
    points = stratified_samples(ROOF, (20, 20), seed=4, iteration=7)
    domain = ROOF.surface.domain
    cells = np.floor((points - domain.lower) / domain.size * 20).astype(int)
    assert len({tuple(cell) for cell in cells}) == 400
    assert np.array_equal(points, stratified_samples(ROOF, (20, 20), seed=4, iteration=7))
    for other in (stratified_samples(ROOF, (20, 20), 4, 8), stratified_samples(ROOF, (20, 20), 5, 7)):
        assert np.all(np.any(points != other, axis=-1))


def test_samples_do_not_depend_on_where_a_training_starts():
    _, sampler = sampler_of(DIAPHRAGM, layers=1, width=2, cells=(20, 20), dtype=torch.float32)
    whole, late = list(sampler.samples(0, 60)), list(sampler.samples(37, 40))
    assert (len(whole), len(late)) == (60, 3)
    for a, b in zip(whole[37:40], late, strict=True):
        alike(a.inputs, b.inputs, SINGLE)
        alike(a.rows, b.rows, SINGLE)


def test_the_mean_of_many_losses_is_the_energy():
    siren, sampler = sampler_of(PLATE, layers=1, width=4, cells=(20, 20), dtype=torch.float64)
    losses = [sample.loss(siren).item() for sample in sampler.samples(0, 400)]
    solution = trained(PLATE, small(layers=1, width=4, dtype="float64", learning_rate=1e-90, iterations=25))
    energy = solution.diagnostics["certified_energy"]
    assert np.mean(losses) == pytest.approx(energy, abs=4 * np.std(losses) / 20)


def test_a_siren_is_initialised_as_published():
    siren = initial_siren(2, layers=5, width=512, omega0=15.0, seed=0, placement=Placement())
    assert siren.parameters == 3 * 512 + 4 * 513 * 512 + 3 * 513
    assert siren.weights[0].abs().max().item() == pytest.approx(1 / 2, rel=1e-2)
    for weight in siren.weights[1:]:
        assert weight.abs().max().item() == pytest.approx(np.sqrt(6 / 512) / 15, rel=1e-2)
    # what the initialisation is for: every layer's sines are spread alike (Sitzmann et al., theorem 1.8)
    h = torch.rand(2000, 2, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    for weight, bias in zip(siren.weights[:-1], siren.biases[:-1], strict=True):
        h = torch.sin(15 * (h @ weight.T + bias))
        assert 0.6 < h.std().item() < 0.8


@pytest.mark.parametrize("case", [PLATE, DIAPHRAGM], ids=["plain", "periodic"])
def test_the_frequency_is_absorbed_without_a_change_of_the_field(case):
    siren, sampler = sampler_of(case, layers=2, width=8, cells=(4, 4), dtype=torch.float64)
    points = inner_points(case)
    inputs = sampler.inputs.jets(points, sampler.placement)
    network, output = siren.as_field(sampler.scale, unit=0.1)
    features = torch.cat([network.features(inputs.clone())[0], torch.ones(len(points), 1)], dim=1)
    expected = 0.1 * siren.jets(sampler.scale.apply(inputs))[0]
    torch.testing.assert_close(features @ output.T, expected, rtol=1e-12, atol=1e-14)
    back = type(siren).from_field(network, output, siren.omega0, sampler.scale, unit=0.1)
    for a, b in zip(back.tensors, siren.tensors, strict=True):
        torch.testing.assert_close(a, b, rtol=1e-12, atol=1e-14)


def test_inputs_lie_between_zero_and_one():
    for case, lowest in ((PLATE, [0, 0]), (DIAPHRAGM, [-1, -1, 0])):
        _, sampler = sampler_of(case, layers=1, width=2, cells=(2, 2), dtype=torch.float64)
        corners = sampler.inputs.jets(case.surface.domain.grid(9, 9).reshape(-1, 2), sampler.placement)
        seen = InputScale.from_inputs(sampler.inputs, sampler.placement).apply(corners)[0].numpy()
        np.testing.assert_allclose(seen.min(0), lowest, atol=1e-12)
        np.testing.assert_allclose(seen.max(0), 1, atol=1e-12)


def test_the_modulus_is_scaled_as_published():
    factors = [sampler_of(case)[1].modulus_factor for case in (PLATE, ROOF, DIAPHRAGM, PINCHED)]
    assert factors == [1.0, 1.0, 1e-5, 1e-5]  # E = 30 instead of 3e6: Kairanda et al. 2023, section 5.1


def test_the_scaled_modulus_is_a_matter_of_the_training_only():
    """A field of the same displacements has the same energy, whatever the modulus it was trained with."""
    case = shell("plane", supports=[support("rim", "xi1_min", "xi1_max", "xi2_min", "xi2_max")],
                 loads=[{"kind": "area", "vector": [0, 0, -5.0]}])  # fmt: skip
    assert usual_modulus_factor(sampler_of(case)[1].ansatz) != 1.0
    energies = []
    for factor in (1.0, 0.25):
        siren, sampler = sampler_of(case, cells=(4, 4), dtype=torch.float64, modulus_factor=factor)
        network = siren.with_tensors([*siren.tensors])
        network = type(siren)(
            (*siren.weights[:-1], siren.weights[-1] / factor), (*siren.biases[:-1], siren.biases[-1] / factor), 15.0
        )
        energies.append(factor * next(iter(sampler.samples(0, 1))).loss(network).item())
    assert energies[0] == pytest.approx(energies[1], rel=1e-10)


def test_training_lowers_the_energy_and_is_reproduced_by_its_seed():
    settings = small(iterations=4 * RECORD)
    one, again = trained(PLATE, settings), trained(PLATE, settings)
    other = trained(PLATE, settings.model_copy(update={"seed": 1}))
    energies = [step.energy for step in one.history]
    assert energies == sorted(energies, reverse=True)
    assert energies[-1] < 0.1 * energies[0]
    assert same(one, again)
    assert not same(one, other)
    assert [step.iteration for step in one.history] == [RECORD * k for k in (1, 2, 3, 4)]
    assert one.history[-1].quantities["centre_deflection"] == pytest.approx(measure(one, PLATE.primary), rel=1e-5)


@pytest.mark.parametrize(
    "by_start", [pytest.param(False, marks=pytest.mark.long, id="by its folder"), pytest.param(True, id="by a file")]
)
def test_an_interrupted_training_goes_on_as_if_nothing_had_been(tmp_path, by_start):
    settings = small(iterations=3 * RECORD + 5, checkpoint=str(tmp_path), checkpoint_every=RECORD)
    whole = trained(DIAPHRAGM, settings)
    assert not list(tmp_path.iterdir())
    with pytest.raises(Interrupted):
        trained(DIAPHRAGM, settings, progress=interrupt_at(2 * RECORD + 7))
    (left,) = tmp_path.iterdir()
    if by_start:
        resumed = trained(DIAPHRAGM, settings.model_copy(update={"checkpoint": None}), start=left)
    else:
        resumed = trained(DIAPHRAGM, settings)
        assert not list(tmp_path.iterdir())
    assert resumed.diagnostics["resumed_at"] == 2 * RECORD
    assert same(whole, resumed)
    assert [s.iteration for s in resumed.history] == [s.iteration for s in whole.history]
    assert [s.energy for s in resumed.history] == pytest.approx([s.energy for s in whole.history], rel=1e-4)


def test_a_training_killed_while_writing_leaves_the_older_checkpoint(tmp_path, monkeypatch):
    settings = small(iterations=3 * RECORD, checkpoint=str(tmp_path), checkpoint_every=RECORD)
    with pytest.raises(Interrupted):
        trained(PLATE, settings, progress=interrupt_at(RECORD + 1))
    (left,) = tmp_path.iterdir()
    before = left.read_bytes()

    def half_written(tensors, path, metadata):
        path.write_bytes(before[: len(before) // 2])
        raise Interrupted

    monkeypatch.setattr("shellbench.solvers.ndf.field.weights.save_file", half_written)
    with pytest.raises(Interrupted):
        trained(PLATE, settings)
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [before]


def test_checkpoints_of_another_training_or_none_are_refused(tmp_path):
    settings = small(iterations=2 * RECORD, checkpoint=str(tmp_path), checkpoint_every=RECORD)
    with pytest.raises(Interrupted):
        trained(PLATE, settings, progress=interrupt_at(RECORD + 1))
    (left,) = tmp_path.iterdir()
    free = settings.model_copy(update={"checkpoint": None})
    for case, other, said in [
        (ROOF, free, "of another case, seed or settings"),
        (PLATE, free.model_copy(update={"seed": 1}), "of another case, seed or settings"),
        (PLATE, free.model_copy(update={"iterations": 5}), "more than the 5 asked for"),
    ]:
        with pytest.raises(InputError, match=said):
            trained(case, other, start=left)
    left.write_bytes(left.read_bytes()[:-8])
    with pytest.raises(InputError, match="is damaged"):
        trained(PLATE, free, start=left)


def test_a_solution_lends_its_weights(tmp_path):
    first = trained(PLATE, small(iterations=RECORD))
    path = first.save(tmp_path / "plate")
    frozen = small(iterations=1, learning_rate=1e-90)
    for start in (first, path):
        points = inner_points(PLATE)
        warm = trained(PLATE, frozen, start=start)
        np.testing.assert_allclose(warm.displacement(points), first.displacement(points), rtol=1e-3, atol=1e-6)
    with pytest.raises(InputError, match="the settings ask for"):
        trained(PLATE, small(width=16), start=first)


def test_a_diverging_training_keeps_its_last_finite_field():
    with pytest.raises(SolveFailure, match="the loss is not finite") as early:
        SOLVER.solve(PLATE, small(iterations=2 * RECORD, learning_rate=1e30))
    assert early.value.partial is None
    good = trained(PLATE, small(iterations=RECORD))

    whole, calls = Sample.loss, []

    def poisoned(self, siren):
        calls.append(1)
        return whole(self, siren) * (float("nan") if len(calls) > RECORD + 3 else 1.0)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Sample, "loss", poisoned)
        with pytest.raises(SolveFailure, match=f"within iterations {RECORD + 1} to {2 * RECORD}") as late:
            SOLVER.solve(PLATE, small(iterations=2 * RECORD))
    assert same(late.value.partial, good)


def jolt_after(monkeypatch, good):
    """Let weights jump after so many losses have been seen; return the list that counts them."""
    whole, calls = Sample.loss, []

    def jolted(self, siren):
        calls.append(1)
        if len(calls) == good + 1:
            with torch.no_grad():
                siren.weights[-1].mul_(-10.0)
        return whole(self, siren)

    monkeypatch.setattr(Sample, "loss", jolted)
    return calls


def test_a_training_that_is_thrown_off_has_failed_and_keeps_its_course(monkeypatch):
    """Repeat the failure on the free cylinder: a jump of the weights, after which the energy stays above rest."""
    every, good = 5, 150
    jolt_after(monkeypatch, good)
    monkeypatch.setattr("shellbench.solvers.ndf.published.published_training.RECORD", every)
    with pytest.raises(
        SolveFailure, match=r"^the training collapsed: .* is not below rest, but was at least"
    ) as failed:
        SOLVER.solve(PLATE, small(iterations=good + every))
    course, diagnostics = failed.value.partial.history, failed.value.partial.diagnostics
    assert [step.iteration for step in course] == list(range(every, good + every + 1, every))
    assert course[-2].energy < 0 < course[-1].energy
    assert f"{diagnostics['certified_energy']:.3g} J" in str(failed.value)


def course_of(*energies):
    return [(RECORD * k, energy) for k, energy in enumerate(energies, 1)]


@pytest.mark.parametrize(
    ("certified", "course", "rest", "loaded", "said"),
    [
        (-10.0, [-10.0] * STRETCH, 0.0, True, None),
        (-5.1, [-10.0] * STRETCH, 0.0, True, None),
        (-4.9, [-10.0] * STRETCH, 0.0, True, "is 4.9 J below rest, but was at least 10 J below over iterations 25 to 250"),
        (0.0, [1.0] * 3, 0.0, True, "0 J, is not below rest after 75 iterations"),
        (1.0, [-10.0] * (STRETCH - 1), 0.0, True, "is not below rest after 225 iterations"),
        (-1.0, [100.0, -200.0] * STRETCH, 0.0, True, None),  # noise: no stretch is below rest for certain
        (4.0, [3.0] * STRETCH, 3.0, False, None),  # the motion of the supports may be the answer
        (2.0, [1.0] * STRETCH, 5.0, False, None),
        (4.0, [1.0] * STRETCH, 5.0, False, "is 1 J below rest, but was at least 4 J below"),
    ],
)  # fmt: skip
def test_a_training_fails_above_rest_or_with_less_than_half_of_its_best_gain(certified, course, rest, loaded, said):
    reason = why_collapsed(certified, course_of(*course), rest, loaded)
    assert reason is None if said is None else said in reason


def test_rest_is_the_field_of_the_supports_alone():
    """Nothing moves: no energy. Where rims are moved: that of the strains which the prescribed motion alone makes."""
    still, moved = trained(PLATE, small(iterations=1)), trained(named_case("sleeve_torque"), small(iterations=1))
    assert still.diagnostics["rest_energy"] == 0
    assert 0 < moved.diagnostics["rest_energy"] < moved.diagnostics["certified_energy"]


def test_a_saved_solution_is_the_same_field(tmp_path):
    solution = trained(PINCHED, small(iterations=RECORD))
    loaded = SOLVER.load(solution.save(tmp_path / "free"))
    points = inner_points(PINCHED)
    same_tensors(loaded.tensors(), solution.tensors())
    alike(loaded.displacement(points), solution.displacement(points), SINGLE)
    assert loaded.energies() == pytest.approx(solution.energies(), rel=1e-12)
    assert loaded.parameters == 3 * 12 + 12 * 13 + 12 + 39  # 3 inputs, two layers of 12, 3 components


def test_the_answer_is_free_of_the_rigid_motions_that_nothing_holds():
    solution = trained(DIAPHRAGM, small(iterations=RECORD, cells=(4, 4)))
    mean = solution.displacement(DIAPHRAGM.surface.domain.grid(65, 65)[:-1, :-1]).mean(axis=(0, 1))
    largest = np.abs(solution.displacement(DIAPHRAGM.surface.domain.grid(33, 33))[..., 1]).max()
    assert abs(mean[1]) < 0.02 * largest


def test_a_shell_held_at_a_point_is_declined():
    case = shell("plane", supports=[support("edge", "xi1_min"), support("corner", "xi1_max,xi2_max")])
    assert "not single points" in SOLVER.declines(case)
    with pytest.raises(InputError, match="not single points"):
        trained(case, PublishedSettings(iterations=1))


def test_a_moved_support_is_moved_exactly():
    sleeve = named_case("sleeve_torque")
    solution = trained(sleeve, small(iterations=RECORD, cells=(4, 4), dtype="float64"))
    for support_, place in sleeve.supported_places():
        points = place.points(sleeve.surface.domain, np.linspace(0, 2 * np.pi, 9))
        wanted = sleeve.motion(support_, place, points)[0, 0]
        np.testing.assert_allclose(solution.displacement(points), wanted, atol=1e-16)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_a_training_on_a_gpu_follows_that_on_the_cpu():
    here, there = (trained(PLATE, small(iterations=RECORD, device=d, dtype="float64")) for d in ("cpu", "cuda"))
    points = inner_points(PLATE)
    np.testing.assert_allclose(there.displacement(points), here.displacement(points), rtol=1e-8, atol=1e-10)


@pytest.mark.long
def test_the_plate_is_within_one_per_cent_after_400_iterations():
    """The course of the paper's training; the known value is Navier's series (numerics: 0.4874823 m)."""
    solution = trained(PLATE, PublishedSettings(iterations=400))
    assert measure(solution, PLATE.primary) == pytest.approx(navier(), rel=0.01)
    energies = [step.energy for step in solution.history]
    assert min(energies) < 0 < energies[0]


def navier(terms=99):
    """Centre deflection of the simply supported plate (Timoshenko & Woinowsky-Krieger, eq. (131))."""
    m = np.arange(1, terms + 1, 2)
    sign = np.where((m[:, None] + m[None, :]) // 2 % 2 == 1, 1.0, -1.0)
    series = sign / (m[:, None] * m[None, :] * (m[:, None] ** 2.0 + m[None, :] ** 2) ** 2)
    return 16 * 1.0 * 100.0**4 / (np.pi**6 * PLATE.material.bending_stiffness) * series.sum()
