"""The gate is tested at finite strain too: mistakes in the exact strains, moments and paths must turn it red."""

from dataclasses import replace

import numpy as np
import pytest

from shellbench.problems.shell.posed.shell import Shell
from shellbench.solvers.fem.mechanics import kinematics, loads
from shellbench.solvers.fem.path import following as fem_following
from shellbench.solvers.fem.path import problem
from shellbench.solvers.ndf.path import equilibrium
from shellbench.solvers.ndf.strains import reaction, strain_measures
from tests.test_faults import (
    Fault,
    leaking_factor,
    more_poisson,
    must_be_green,
    must_be_red,
    only_three_edges,
    stiffness,
)

PLATE, ROOF, SHEAR, MOMENT = "square_plate_nonlinear", "scordelis_lo_nonlinear", "cantilever_shear", "cantilever_moment"
PRESSED = "cantilever_pressure"
ROLLED, TURNED = "rolled_plate", "rigid_rotation"


def linear_normal(patch):
    """The fem normal turns as in linear theory."""
    original = kinematics.Deformation.from_gradients.__func__

    def linear(cls, reference, gradients):
        found = original(cls, reference, gradients)
        rise = (found.normal_change @ gradients[:, :2].reshape(-1, 6, 1))[..., 0]
        return replace(found, rise=rise)

    patch.setattr(kinematics.Deformation, "from_gradients", classmethod(linear))


def fem_strain(change):
    """Change the fem strains (n, 6)."""

    def inject(patch):
        original = kinematics.Deformation.strains.fget
        patch.setattr(kinematics.Deformation, "strains", property(lambda self: change(original(self), self)))

    return inject


def without_product(strains, found):
    """Leave u,a . u,b / 2 out of the membrane strains."""
    u = found.gradients
    for row, (a, b) in enumerate(((0, 0), (1, 1), (0, 1))):
        strains[:, row] -= (u[:, a] * u[:, b]).sum(-1) / 2
    return strains


def unbent(strains, found):
    """Leave the term of the surface's own curvature out of the bending strains."""
    strains[:, 3:] += (found.reference.second * found.rise[:, None]).sum(-1)
    return strains


def ndf_strain(name):
    """Let the neural field take another measure for the exact one."""
    return lambda patch: patch.setitem(strain_measures.MEASURES, "exact", strain_measures.MEASURES[name])


def never_lowered(patch):
    """Leave bbar (1 - a3 . n) out of the bending strains of the field."""
    original = strain_measures.DeformedNormal.from_slopes.__func__

    def level(cls, *args):
        found = original(cls, *args)
        return replace(found, lowered=0 * found.lowered)

    patch.setattr(strain_measures.DeformedNormal, "from_slopes", classmethod(level))


def halved_moments(module):
    """Halve the moments of a solver."""

    def inject(patch):
        original = module.EdgeMoment.moments
        patch.setattr(module.EdgeMoment, "moments", lambda self, t: original(self, t) / 2)

    return inject


def quadratic_loads(patch):
    """Let the dead loads of fem grow with the square of the load factor."""
    original = problem.Loading.on_mesh.__func__
    patch.setattr(
        problem.Loading,
        "on_mesh",
        classmethod(lambda cls, case, mesh, rule, t: original(cls, case, mesh, rule, (t[0] ** 2,))),
    )


def too_early(patch):
    """Take each state of equilibrium of the field for the one at one percent more load."""
    original = equilibrium.PathProblem._forces
    patch.setattr(equilibrium.PathProblem, "_forces", lambda self, t: original(self, 1.01 * t))


def dead_pressure(patch):
    """Let pressures that follow act along the reference normal."""
    patch.setattr(Shell, "following", property(lambda case: ()))


def on_reference_area(patch):
    """Let the fem pressure follow the normal alone, and act per reference area."""
    original = fem_following.FollowingPressure._base_vectors

    def unstretched(self, portion, q):
        a1, a2 = original(self, portion, q)
        area = np.linalg.norm(np.cross(a1, a2), axis=-1)
        return a1 * (portion.reference.area / area)[:, None], a2

    patch.setattr(fem_following.FollowingPressure, "_base_vectors", unstretched)


FAULTS = [
    Fault("a dead pressure", "fem", PRESSED, dead_pressure),
    Fault("a pressure per reference area", "fem", PRESSED, on_reference_area),
    Fault("a dead pressure", "ndf-ritz", PRESSED, dead_pressure),
    Fault("a linear normal", "fem", TURNED, linear_normal),
    Fault("linear membrane strains", "fem", PLATE, fem_strain(without_product)),
    Fault("no curvature of its own", "fem", TURNED, fem_strain(unbent)),
    Fault("wrong Poisson ratio", "fem", ROOF, lambda p: more_poisson(p, kinematics, "elasticity")),
    Fault("bending stiffness 0.1 % off", "fem", ROLLED, stiffness("bending_stiffness", 1.001)),
    Fault("an edge forgotten", "fem", PLATE, only_three_edges),
    Fault("halved moments", "fem", MOMENT, halved_moments(loads)),
    Fault("loads that grow otherwise", "fem", SHEAR, quadratic_loads),
    Fault("published strains", "ndf-ritz", SHEAR, ndf_strain("published")),
    Fault("published strains, turned", "ndf-ritz", TURNED, ndf_strain("published")),
    Fault("linear strains", "ndf-ritz", PLATE, ndf_strain("linear")),
    Fault("no curvature of its own", "ndf-ritz", TURNED, never_lowered),
    Fault("wrong Poisson ratio", "ndf-ritz", ROOF, lambda p: more_poisson(p, strain_measures, "elasticity_tensor")),
    Fault("bending stiffness 0.1 % off", "ndf-ritz", ROLLED, stiffness("bending_stiffness", 1.001)),
    Fault("halved moments", "ndf-ritz", MOMENT, halved_moments(reaction)),
    Fault("one percent more load", "ndf-ritz", SHEAR, too_early),
    Fault("a leaking support", "ndf-ritz", PLATE, leaking_factor),
    Fault("published strains", "ndf", ROLLED, ndf_strain("published")),
]


LONG_GREEN = {
    ("fem", ROLLED),
    ("fem", PRESSED),
    ("ndf-ritz", PRESSED),
    ("fem", PLATE),
    ("fem", ROOF),
    ("fem", SHEAR),
    ("ndf-ritz", PLATE),
    ("ndf-ritz", ROOF),
    ("ndf-ritz", SHEAR),
}
LONG_FAULTS = {
    ("fem", "a dead pressure"),
    ("fem", "a pressure per reference area"),
    ("ndf-ritz", "a dead pressure"),
    ("fem", "an edge forgotten"),  # as in the linear theory, where it is quick
    ("fem", "wrong Poisson ratio"),  # so is this
    ("fem", "bending stiffness 0.1 % off"),  # and this
    ("fem", "halved moments"),
    ("fem", "linear membrane strains"),
    ("fem", "loads that grow otherwise"),
    ("ndf-ritz", "halved moments"),
    ("ndf-ritz", "published strains"),
    ("ndf-ritz", "wrong Poisson ratio"),
    ("ndf-ritz", "one percent more load"),
}


def marked(found, long):
    """Leave what takes the longest to the session of the long tests; each fault of these has a quicker sister."""
    return [pytest.param(*one, marks=[pytest.mark.long] if long(*one) else []) for one in found]


CASES_SOLVED = [
    (solver, case) for solver in ("fem", "ndf-ritz") for case in (PLATE, ROOF, SHEAR, PRESSED, ROLLED, TURNED)
]


@pytest.mark.parametrize(("solver", "case"), marked(CASES_SOLVED, lambda *pair: pair in LONG_GREEN))
def test_without_a_fault_the_gate_is_green(solver, case, tmp_path):
    must_be_green(solver, case, tmp_path)


@pytest.mark.sampled(6)
@pytest.mark.parametrize(
    "fault",
    marked([(fault,) for fault in FAULTS], lambda fault: (fault.solver, fault.name) in LONG_FAULTS),
    ids=lambda f: f"{f.solver}: {f.name}",
)
def test_a_fault_at_finite_strain_turns_the_gate_red(fault, tmp_path, monkeypatch):
    must_be_red(fault, tmp_path, monkeypatch)
