"""Mistakes in derivatives: each must show against differences of the answers on the same mesh."""

import dataclasses

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.solvers.fem.derivatives import modal
from shellbench.solvers.fem.derivatives.adjoint import Adjoint
from shellbench.solvers.fem.derivatives.deviation import Deviation
from shellbench.solvers.fem.derivatives.finite import FiniteAdjoint
from shellbench.solvers.fem.derivatives.forms import Works
from shellbench.solvers.fem.derivatives.variations import Strained
from tests.injecting import given, wrapped
from tests.solvers.fem.test_derivatives import GROUPS, largest_error, shell

SEEN = 1e-6  # of Q/p: 30 times what passes without a fault
THICKNESS, POINTS = ("material.thickness",), ("points.a.xi1", "points.b.xi2")


def without_explicit(target):
    return dataclasses.replace(target, explicit=lambda offs: np.zeros(len(offs)))


def opposite(target):
    return dataclasses.replace(target, slope=-target.slope)


def shape_at_rest(patch):
    original = Deviation.position
    patch.setattr(
        Deviation,
        "position",
        lambda self, points, order=2: {k: v.real + 0j for k, v in original(self, points, order).items()},
    )


def unstretched(found):
    return found[0], (1.0 + 0j, 1.0 + 0j)


def bilinear_with_conjugate(patch):
    original = Strained.work
    patch.setattr(
        Strained,
        "work",
        lambda self, nu, part, one, two: (
            original(
                dataclasses.replace(self, strains=self.strains | {two: np.conj(self.strains[two])}), nu, part, one, two
            )
            if one != two and two in self.strains
            else original(self, nu, part, one, two)
        ),
    )


def fixed_state(patch):
    """Take the prestress of the loads as given: its own change with the parameter is forgotten."""
    patch.setattr(modal.Adjoint, "total", lambda self, target, u, deviations, t: target.explicit(deviations))


FAULTS = {
    "no explicit part of an energy": (wrapped(Adjoint, "target", without_explicit), THICKNESS, {"energy"}),
    "no explicit part of a moment": (wrapped(Adjoint, "target", without_explicit), THICKNESS, {"bent"}),
    "a resultant's point that does not slide": (wrapped(Deviation, "slide", lambda found: 0 * found), POINTS, {"bent"}),
    "adjoint load of the wrong sign": (wrapped(Adjoint, "target", opposite), THICKNESS, {"moved"}),
    "geometry's derivative dropped": (shape_at_rest, ("surface.H",), {"moved"}),
    "clamps' terms taken as constant": (wrapped(Works, "clamp_work", lambda found: 0.0), GROUPS["surface"], {"force"}),
    "supports that do not turn": (wrapped(Adjoint, "_turning", lambda found: 0.0), ("surface.H",), {"moved"}),
    "springs taken as constant": (wrapped(Works, "spring_work", lambda found: 0.0), ("springs.bed",), {"moved"}),
    "loads taken as constant": (wrapped(Works, "load_work", lambda found: 0.0), ("surface.q",), {"moved"}),
    "points that do not slide": (wrapped(Deviation, "slide", lambda found: 0 * found), POINTS, {"moved"}),
    "bounds that stretch no cell": (wrapped(Deviation, "sites", unstretched), ("surface.xi2_max",), {"moved"}),
    "strains conjugated": (bilinear_with_conjugate, ("surface.H",), {"moved"}),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_shows(name, monkeypatch):
    inject, parameters, quantities = FAULTS[name]
    inject(monkeypatch)
    assert largest_error(shell(), parameters, quantities) > SEEN


@pytest.mark.parametrize(
    ("case", "parameters", "inject"),
    [
        (
            "stretched_plate_modes",
            ("material.areal_density",),
            wrapped(Works, "products", lambda found: found.real + 0j),
        ),
        ("plate_compression", ("loads.1",), fixed_state),
        ("cylinder_modes", ("surface.radius",), shape_at_rest),
    ],
)
def test_a_fault_of_modes_shows(case, parameters, inject, monkeypatch):
    case = catalog.named_case(case)
    inject(monkeypatch)
    assert largest_error(case, parameters, {case.quantities[0].name}, cells=(4, 4)) > SEEN


def test_a_state_without_its_loads_stiffness_shows(monkeypatch):
    """The skew part of a following pressure's tangent has to be transposed."""
    given(FiniteAdjoint, "finite_opposed", lambda self, state, slope, by: (self, without_skew(state), slope, by))(
        monkeypatch
    )
    case = catalog.named_case("cantilever_pressure")
    assert largest_error(case, THICKNESS, {"deflection_100"}, cells=(6, 1), degree=3) > SEEN


def without_skew(state):
    return dataclasses.replace(state, factor=state.factor.symmetric)
