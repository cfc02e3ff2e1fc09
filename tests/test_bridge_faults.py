"""Faults of splines, and of a bending Poisson's ratio of its own: each turns the gate red.

As in tests/test_faults.py: the fault is injected, the case is solved and judged as a user would have it.
"""

import numpy as np

from shellbench.problems.shell.question.conditions import Material
from shellbench.solvers.fem.mechanics import kinematics
from shellbench.solvers.ndf.bspline import bspline, bspline_solution, splines
from shellbench.solvers.ndf.strains import energy
from tests.test_faults import Fault, gate_tests, stop_early, wrapped

BRIDGE, PLATE, ROOF = "bridge_plate", "square_plate", "scordelis_lo"


def half_a_slope(patch):
    """Halve the slopes of one spline of each line."""
    original = splines.Line.nonzero_at

    def local(self, x):
        numbers, values = original(self, x)
        return numbers, values * np.where(np.arange(3)[:, None, None] == 1, np.where(numbers == 3, 0.5, 1.0), 1.0)

    patch.setattr(splines.Line, "nonzero_at", local)


def one_ratio(patch):
    """Let bending have the Poisson's ratio of stretching."""
    patch.setattr(Material, "poissons_ratios", property(lambda self: (self.poissons_ratio,) * 2))


def exchanged(patch):
    """Exchange both ratios."""
    original = Material.poissons_ratios.fget
    patch.setattr(Material, "poissons_ratios", property(lambda self: original(self)[::-1]))


def an_edge_forgotten(patch):
    """Build no support in at the last of the plate's edges."""
    original = bspline.build_ansatz

    def leaking(case, spec):
        rim, *others = case.supports
        held = rim.model_copy(update={"on": rim.on[:-1]})
        return original(case.model_copy(update={"supports": (held, *others)}), spec)

    for module in (bspline, bspline_solution):
        patch.setattr(module, "build_ansatz", leaking)


def slopes_left_free(patch):
    """Hold no slope at planes of symmetry."""
    patch.setattr(bspline, "slope_constraints", lambda *args: iter(()))


def conditions_of_one_edge(patch):
    original = bspline.slope_constraints
    patch.setattr(bspline, "slope_constraints", lambda *args: iter(list(original(*args))[:1]))


def knots_apart(patch):
    """Widen the first cell in the recurrence of the slopes alone."""
    original = splines.raise_slopes

    def slopes(values, knots, span):
        moved = knots.copy()
        moved[4] += 0.01 * (knots[5] - knots[4])
        return original(values, moved, span)

    patch.setattr(splines, "raise_slopes", slopes)


def one_ratio_in_elements(patch):
    """Let the stiffness of `fem` alone take the membrane's ratio for both."""
    original = kinematics.elasticity
    patch.setattr(kinematics, "elasticities", lambda surface, material: np.stack(
        [original(surface, material.poissons_ratio)] * 2, axis=1))  # fmt: skip


def one_ratio_in_fields(patch):
    """Let the energy of fields alone do so."""
    original = energy.energy_rows
    patch.setattr(
        energy, "energy_rows", lambda geometry, ratios, rigidity: original(geometry, ratios[:1] * 2, rigidity)
    )


FAULTS = [
    Fault("a spline's slope halved", "bspline-ritz", PLATE, half_a_slope),
    Fault("a knot of slopes moved", "bspline-ritz", PLATE, knots_apart),
    Fault("a leaking support", "bspline-ritz", PLATE, an_edge_forgotten),
    Fault("slopes left free at planes of symmetry", "bspline-ritz", PLATE, slopes_left_free),
    Fault("one plane of symmetry alone", "bspline-ritz", ROOF, conditions_of_one_edge),
    Fault("halved load", "bspline-ritz", PLATE, wrapped(energy, "force_density", lambda f: f / 2)),
    Fault("one Poisson's ratio", "bspline-ritz", BRIDGE, one_ratio),
    Fault("one Poisson's ratio", "fem", BRIDGE, one_ratio),
    Fault("ratios exchanged", "fem", BRIDGE, exchanged),
    Fault("one Poisson's ratio", "ndf-ritz", BRIDGE, one_ratio),
    Fault("bending by the membrane's ratio, in its own stiffness", "fem", BRIDGE, one_ratio_in_elements),
    Fault("bending by the membrane's ratio, in its own energy", "ndf-ritz", BRIDGE, one_ratio_in_fields),
]
test_a_fault_is_red, test_without_a_fault_it_is_green = gate_tests(FAULTS, stop_early)
