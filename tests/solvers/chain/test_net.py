"""Nets of masses and springs: derivatives, equilibrium, and the locking of a coarse cloth (figure 3 of Jin et al.)."""

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.errors import SolveFailure
from shellbench.solvers.chain import net
from shellbench.solvers.chain.net import NetSolver
from shellbench.solvers.chain.solver import ChainSolver
from tests.injecting import exceeded

CASES = ("net_soft", "net_middle", "net_stiff")
FAULTS = {
    "springs are a percent stiffer": ("springs_of", lambda ends, lengths, k: (ends, lengths, 1.01 * k)),
    "springs are a percent longer": ("springs_of", lambda ends, lengths, k: (ends, 1.01 * lengths, k)),
    "the last spring is left out": ("springs_of", lambda ends, lengths, k: (ends[:-1], lengths[:-1], k[:-1])),
    "masses are a percent lighter": ("energy_of", lambda e, s, m: (e, s - 0.01 * 9.81 * (np.arange(len(s)) % 2), m)),
}


def test_slope_and_matrix_are_derivatives_of_the_energy():
    of = catalog.named_case("net_middle").net
    springs, nodes = net.springs_of(of), net.start_of(of) + np.random.default_rng(0).normal(size=(50, 2), scale=0.01)
    step = 1e-6 * np.random.default_rng(1).normal(size=nodes.shape)
    _, slope, matrix = net.energy_of(of, nodes, springs)
    (up, up_slope, _), (down, down_slope, _) = (net.energy_of(of, nodes + s * step, springs) for s in (1, -1))
    assert (up - down) / 2 == pytest.approx(slope @ step.ravel(), rel=1e-6)
    assert (up_slope - down_slope) / 2 == pytest.approx(matrix @ step.ravel(), rel=1e-4, abs=1e-6)


def test_a_coarse_cloth_locks_or_stretches_and_a_chain_does_neither():
    """The stiffer, the less it sags; the softest one hangs lower than rigid links, the stiff one has a tenth of it."""
    chain = ChainSolver().solve(catalog.named_case("hanging_chain")).nodes[4, 1]
    sags = []
    for name in CASES:
        case = catalog.named_case(name)
        made = NetSolver().solve(case)
        sags.append(made.kept[0].nodes[4, 2])
    assert sags[0] < chain < sags[1] < sags[2]
    assert sags[2] > 0.1 * chain
    assert net.energy_of(case.net, made.kept[0].nodes[:, ::2], net.springs_of(case.net))[0] == made.history[-1].energy


def test_the_row_is_the_elastic_catenary_and_faults_are_red(monkeypatch):
    assert exceeded("rope_of_springs", NetSolver()) == set()
    for name, change in FAULTS.values():
        with monkeypatch.context() as patch:
            original = getattr(net, name)
            patch.setattr(net, name, lambda *given, o=original, c=change: c(*o(*given)))
            assert exceeded("rope_of_springs", NetSolver())


def test_a_net_that_does_not_converge_fails(monkeypatch):
    monkeypatch.setattr(net, "STEPS", 2)
    with pytest.raises(SolveFailure, match=r"the residual is .* N after 2 steps"):
        NetSolver().solve(catalog.named_case("net_soft"))
    assert "nets of springs only" in NetSolver().declines(catalog.named_case("hanging_chain"))
