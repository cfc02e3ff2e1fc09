"""Faults that an earlier exam let pass, and that this exam finds.

As in tests/test_faults.py, the fault is injected, and the case is solved and judged as for a user. If the old exam's
case stays green with the fault, a test states it: the case that turns red was missing in that exam.
"""

from dataclasses import replace

import numpy as np
import pytest

from shellbench.bench.store.store import Store
from shellbench.problems.shell.posed.shell import Shell
from shellbench.problems.shell.quantities.quantities import DisplacementQuantity, PointQuantity
from shellbench.problems.shell.question.conditions import Rotation
from shellbench.problems.shell.question.loads import PressureLoad
from shellbench.solvers.fem.mechanics import constraints, kinematics
from shellbench.solvers.fem.mechanics import loads as fem_loads
from shellbench.solvers.fem.mechanics.solution import FemSolution
from shellbench.solvers.ndf.field import geometry
from shellbench.solvers.ndf.linear.solution import NdfSolution
from shellbench.solvers.ndf.strains import energy
from tests.test_faults import Fault, findings, must_be_red, wrapped

ROOF, OBLIQUE, SWAPPED = "scordelis_lo", "scordelis_lo@oblique", "scordelis_lo@swapped"
CROSSED, TWISTED, DOMED = "manufactured_oblique_cylinder", "manufactured_hypar", "manufactured_paraboloid"
# A clamp without the turning normal converges all the same, more slowly: energies of the thinner one are not sure enough.
CLAMPED, PRESSED = "hyperboloid_clamped_1e_3", "hyperboloid_clamped_1e_2"


def diagonal(matrix):
    """Return matrices (..., 2, 2) without what is off their diagonal."""
    return matrix * np.eye(2)


def metric_without_shear(patch):
    """Take a^12 for zero."""
    metric = kinematics.Midsurface.contravariant_metric.fget
    patch.setattr(kinematics.Midsurface, "contravariant_metric", property(lambda self: diagonal(metric(self))))


def inverted_one_by_one(patch):
    """Invert the metric's diagonal entries alone."""

    def inverse(self):
        return np.linalg.inv(diagonal(self.base @ np.swapaxes(self.base, -1, -2)))

    patch.setattr(kinematics.Midsurface, "contravariant_metric", property(inverse))


def field_metric_without_shear(patch):
    wrapped(
        energy,
        "geometry",
        lambda g: replace(g, inverse_metric=g.inverse_metric * g.inverse_metric.new_tensor([[1.0, 0.0], [0.0, 1.0]])),
    )(patch)


def normal_part_left(row):
    """Leave the part of x,ab along the normal in one bending strain."""

    def inject(patch):
        original = kinematics.strain_operator

        def wrong(surface):
            operator = original(surface)
            part = surface.second[:, row] / surface.area[:, None]
            operator[:, 3 + row, :, 0] = -np.cross(surface.base[:, 1], part)
            operator[:, 3 + row, :, 1] = -np.cross(part, surface.base[:, 0])
            return operator

        patch.setattr(kinematics, "strain_operator", wrong)

    return inject


def half_of_the_twists_christoffel_terms(rows):
    rows[:, geometry.K12, :, geometry.D1 : geometry.D2 + 1] /= 2
    return rows


def suction(patch):
    """Let `fem` take pressures the other way round."""
    original = fem_loads._Builder._density

    def wrong(self, loads, *args):
        pressures = [load for load in loads if isinstance(load, PressureLoad)]
        return original(self, loads, *args) - 2 * original(self, pressures, *args)

    patch.setattr(fem_loads._Builder, "_density", wrong)


def suction_on_fields(patch):
    original = energy.force_density

    def wrong(case, *args):
        pressures = tuple(load for load in case.loads if isinstance(load, PressureLoad))
        return original(case, *args) - 2 * original(case.model_copy(update={"loads": pressures}), *args)

    patch.setattr(energy, "force_density", wrong)


def energies_changed(solution, change):
    def inject(patch):
        original = solution.energies
        patch.setattr(solution, "energies", lambda self, *args, **more: change(*original(self, *args, **more)))

    return inject


def no_turning_normal(patch):
    """Drop the derivative of the normal along a clamped edge."""
    slope = constraints._slope_conditions

    def wrong(edge, x, *args):
        flat = {key: value if sum(key) < 2 else np.zeros_like(value) for key, value in x.items()}
        rows, values = slope(edge, x, *args)
        rows[:, 1] = slope(edge, flat, *args)[0][:, 1]
        return rows, values

    patch.setattr(constraints, "_slope_conditions", wrong)


def about_the_origin(patch):
    """Ignore the centre of a rotation."""
    original = Shell.motion

    def wrong(self, support, *args, **more):
        if isinstance(support.motion, Rotation):
            motion = support.motion.model_copy(update={"centre": (0.0, 0.0, 0.0)})
            support = support.model_copy(update={"motion": motion})
        return original(self, support, *args, **more)

    patch.setattr(Shell, "motion", wrong)


def frozen_loads(patch):
    """Take loads as they are at t = 0 at all times."""
    original = fem_loads._Builder._density
    patch.setattr(
        fem_loads._Builder, "_density", lambda self, loads, x, surface, t: original(self, loads, x, surface, 0.0)
    )


def only_the_first_point(patch):
    original = PointQuantity.coordinates
    patch.setattr(PointQuantity, "coordinates", lambda self, solution: original(self, solution)[:1])


def directions_as_given(patch):
    """Forget that a direction is a direction, whatever its length."""

    def measure(self, solution):
        displacement = solution.displacement(self.coordinates(solution), at=self.at)
        return float(np.mean(np.sum(displacement * np.array(self.directions), axis=-1)))

    patch.setattr(DisplacementQuantity, "measure", measure)


def halved(membrane, bending):
    return membrane / 2, bending / 2


def exchanged(membrane, bending):
    return bending, membrane


FAULTS = [
    Fault("a^12 forgotten", "fem", OBLIQUE, metric_without_shear),
    Fault("a metric inverted entry by entry", "fem", OBLIQUE, inverted_one_by_one),
    Fault("a^12 forgotten", "ndf-ritz", OBLIQUE, field_metric_without_shear),
    Fault("b_12 left in", "fem", OBLIQUE, normal_part_left(2)),
    Fault("b_22 left in", "fem", SWAPPED, normal_part_left(1)),
    Fault("a pressure's sign", "fem", PRESSED, suction),
    Fault("a pressure's sign", "ndf-ritz", PRESSED, suction_on_fields),
    Fault("energies halved", "fem", ROOF, energies_changed(FemSolution, halved)),
    Fault("energies exchanged", "fem", ROOF, energies_changed(FemSolution, exchanged)),
    Fault("energies exchanged", "ndf-ritz", ROOF, energies_changed(NdfSolution, exchanged)),
    Fault(
        "the twist's Christoffel terms once",
        "ndf-ritz",
        OBLIQUE,
        wrapped(geometry, "strain_rows", half_of_the_twists_christoffel_terms),
    ),
    Fault("a clamp without the turning normal", "fem", CLAMPED, no_turning_normal),
    Fault("a^12 forgotten", "fem", CROSSED, metric_without_shear),
    Fault("a^12 forgotten", "ndf-ritz", CROSSED, field_metric_without_shear),
    Fault("b_12 left in", "fem", TWISTED, normal_part_left(2)),
    Fault("b_22 left in", "fem", DOMED, normal_part_left(1)),
    Fault(
        "the twist's Christoffel terms once",
        "ndf-ritz",
        TWISTED,
        wrapped(geometry, "strain_rows", half_of_the_twists_christoffel_terms),
    ),
    Fault("a rotation's centre ignored", "fem", "rigid_turn_about_point", about_the_origin),
    Fault("a load frozen at t = 0", "fem", "pressed_motion", frozen_loads),
    Fault("a mean that takes the first point", "fem", "plate_2_1_point", only_the_first_point),
    Fault("directions that are not normalised", "fem", "plate_2_1_point", directions_as_given),
]


@pytest.mark.long
@pytest.mark.parametrize("fault", FAULTS, ids=lambda f: f"{f.solver}, {f.case}: {f.name}")
def test_a_fault_that_an_earlier_exam_let_through_turns_the_gate_red(fault, tmp_path, monkeypatch):
    must_be_red(fault, tmp_path, monkeypatch)


@pytest.mark.long
@pytest.mark.parametrize(
    ("solver", "inject"),
    [("fem", metric_without_shear), ("fem", normal_part_left(1)), ("ndf-ritz", field_metric_without_shear)],
)
def test_right_angled_lines_hide_it(solver, inject, tmp_path, monkeypatch):
    """On the roof as declared these faults are green: its lines are lines of curvature, and xi1 is the angle."""
    inject(monkeypatch)
    displaced = [f for f in findings(Store(tmp_path), solver, ROOF) if f.row.unit == "m"]
    assert {finding.colour for finding in displaced} == {"green"}
