"""Small trainings of the published recipe."""

import torch

from shellbench.errors import SolveFailure
from shellbench.solvers.ndf.field.build import build_inputs
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.jets import Placement
from shellbench.solvers.ndf.field.quadrature import RuleSpec
from shellbench.solvers.ndf.published.published_network import InputScale, initial_siren, published_ansatz
from shellbench.solvers.ndf.published.published_samples import Sampler, usual_modulus_factor
from shellbench.solvers.ndf.published_solver import PublishedSettings, PublishedSolver

PUBLISHED = FieldSpec(stretched=False, multipliers=0)


def small(**settings):
    """Settings of a training of seconds."""
    return PublishedSettings(**{"layers": 2, "width": 12, "cells": (8, 8), "learning_rate": 1e-2, **settings})


def trained(case, settings, **options):
    """The field at the end of a training, also of one that came to no answer: few iterations seldom do."""
    try:
        return PublishedSolver().solve(case, settings, **options)
    except SolveFailure as failure:
        if failure.partial is None:
            raise
        return failure.partial


def sampler_of(case, layers=2, width=8, cells=(4, 4), dtype=torch.float64, modulus_factor=None, seed=0):
    """A network at its start, and the samples that it would be trained on."""
    placement = Placement(dtype=dtype)
    ansatz, inputs = published_ansatz(case, PUBLISHED), build_inputs(case, PUBLISHED)
    scale = InputScale.from_inputs(inputs, placement)
    siren = initial_siren(inputs.count, layers, width, 15.0, seed, placement)
    factor = modulus_factor or usual_modulus_factor(ansatz)
    return siren, Sampler(ansatz, inputs, scale, cells, seed, factor, RuleSpec((4, 4), 4), placement)
