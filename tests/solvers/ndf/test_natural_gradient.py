"""The natural gradient: its matrix is that of the strains, its step is Newton's where a network is linear."""

import pytest
import torch

from shellbench.bench.catalogue.catalog import known_values, named_case
from shellbench.errors import InputError
from shellbench.solvers.ndf.field.field import FixedFeatures
from shellbench.solvers.ndf.field.inputs import foci
from shellbench.solvers.ndf.published import natural_gradient
from shellbench.solvers.ndf.published.natural_gradient import NaturalGradient, chosen_points, flatten, strain_jacobian
from shellbench.solvers.ndf.published.published_network import initial_siren
from shellbench.solvers.ndf.published.published_training import CERTIFIED, RECORD, first_checkpoint
from shellbench.solvers.ndf.published_solver import PublishedSolver
from tests.solvers.ndf.test_published import Interrupted, interrupt_at, numbers
from tests.solvers.ndf.trainings import sampler_of, small, trained

PLATE, DIAPHRAGM = named_case("square_plate"), named_case("pinched_cylinder_diaphragm")
NATURAL = {"optimiser": "natural", "dtype": "float64", "learning_rate": 1.0, "schedule": "cosine"}


def of_a_draw(case, singular=0, layers=2, width=5, cells=(6, 6)):
    """A network at its start with gradients, and two draws of samples."""
    _, sampler = sampler_of(case, cells=cells)
    features = FixedFeatures.from_case(case, foci(case), singular)
    sampler = type(sampler)(**{**vars(sampler), "singular": features})
    siren = initial_siren(sampler.inputs.count, layers, width, 15.0, 0, sampler.placement, beside=features.count - 1)
    first, second = sampler.samples(0, 2)
    return siren.with_tensors([t.requires_grad_() for t in siren.tensors]), first, second


def slope_of(siren, sample):
    found = torch.autograd.grad(sample.loss(siren), siren.tensors)
    return flatten(found[: len(siren.weights)], found[len(siren.weights) :])


@pytest.mark.parametrize(("case", "singular"), [(PLATE, 0), (DIAPHRAGM, 3)], ids=["plate", "diaphragm"])
def test_the_jacobian_is_that_of_the_sampled_strains(case, singular):
    siren, sample, _ = of_a_draw(case, singular, cells=(2, 2))

    def strains(*tensors):
        jets = siren.with_tensors(list(tensors)).jets(sample.inputs)[:, : len(sample.rows)]
        return (sample.rows @ jets.permute(1, 2, 0).reshape(-1, 18, 1)).reshape(-1)

    plain = torch.autograd.functional.jacobian(strains, tuple(siren.tensors))
    layers = len(siren.weights)
    rows = [flatten([j[r] for j in plain[:layers]], [j[r] for j in plain[layers:]]) for r in range(len(plain[0]))]
    torch.testing.assert_close(strain_jacobian(siren, sample, torch.arange(4)), torch.stack(rows), rtol=1e-9, atol=1e-9)


def test_the_step_of_a_linear_network_is_newtons(monkeypatch):
    """Without output weights the field does not depend on hidden ones to first order, and is linear in the others."""
    siren, sample, _ = of_a_draw(PLATE, layers=1)
    hidden = [tensor.clone() for tensor in (siren.weights[0], siren.biases[0])]
    optimiser = NaturalGradient.begin(siren, first_checkpoint("", siren), iter([sample]))
    optimiser.iteration = 40 * RECORD  # where damping has fallen to its least level
    monkeypatch.setattr(natural_gradient, "DAMPING", 1e-13)
    monkeypatch.setattr(natural_gradient, "MEMORY", 0.0)
    before = slope_of(siren, sample)
    optimiser.step(sample, 1.0)
    assert all(torch.equal(now, then) for now, then in zip((siren.weights[0], siren.biases[0]), hidden, strict=True))
    last = siren.weights[-1].numel() + 3
    assert slope_of(siren, sample)[-last:].norm() <= 1e-6 * before.norm()


def fall(sign=1.0):
    """The fall of the energy below rest, J, by the first step of a network."""
    siren, first, second = of_a_draw(PLATE)
    with pytest.MonkeyPatch.context() as patch:
        whole = natural_gradient.flatten
        patch.setattr(natural_gradient, "flatten", lambda *layers: sign * whole(*layers))
        optimiser = NaturalGradient.begin(siren, first_checkpoint("", siren), iter([second]))
        optimiser.step(first, 1.0)
    return -second.loss(siren).item()


def test_a_step_lowers_the_energy_and_one_up_the_gradient_does_not():
    assert fall() > 100.0
    assert fall(sign=-1.0) == 0.0  # the fault: each trial is refused, and the weights stay


@pytest.mark.long
def test_a_training_of_a_second_is_close_and_goes_on_after_an_interruption(tmp_path):
    settings = small(
        **NATURAL, cells=(20, 20), iterations=2 * RECORD, checkpoint=str(tmp_path), checkpoint_every=RECORD
    )
    whole = trained(PLATE, settings)
    least = -known_values("square_plate").judge("strain_energy", PLATE.theory).value
    assert whole.diagnostics[CERTIFIED] == pytest.approx(least, rel=0.01)
    with pytest.raises(Interrupted):
        trained(PLATE, settings, progress=interrupt_at(RECORD + 3))
    resumed = trained(PLATE, settings)
    assert resumed.diagnostics["resumed_at"] == RECORD
    for one, other in zip(numbers(whole), numbers(resumed), strict=True):
        torch.testing.assert_close(one, other, rtol=1e-4, atol=1e-6)


def test_it_needs_a_shell_at_rest():
    with pytest.raises(InputError, match="setting optimiser belongs to cases at rest"):
        PublishedSolver().solve(named_case("napkin_corner"), small(**NATURAL))


def test_chosen_points_stand_for_all():
    energies = torch.rand(500, dtype=torch.float64, generator=torch.Generator().manual_seed(0)) ** 8
    points, roots = chosen_points(energies, 100)
    assert len(points) <= 100
    assert (roots**2).sum().item() == pytest.approx(500, rel=0.1)
    assert (roots**2 @ energies[points]).item() == pytest.approx(energies.sum().item(), rel=0.1)


def test_a_network_too_wide_for_a_natural_step_is_refused():
    with pytest.raises(InputError, match=r"at most 12,000 weights, and this network has 1,0\d\d,\d{3}: use a smaller"):
        trained(PLATE, small(optimiser="natural", layers=5, width=512, iterations=1))
