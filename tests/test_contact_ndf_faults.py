"""Contact by a Ritz field: faults of its mechanics turn the gate red; parts of it have the properties they claim."""

import numpy as np
import pytest
import torch

from shellbench.bench.catalogue import catalog
from shellbench.errors import SolveFailure
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.solvers.ndf.field.build import usual_resolution
from shellbench.solvers.ndf.field.jets import D1, D11, VALUE, Placement
from shellbench.solvers.ndf.field.lines import Creases
from shellbench.solvers.ndf.linear import contact, solution
from shellbench.solvers.ndf.linear.refinement import first_level
from shellbench.solvers.ndf.linear.ritz_field import field_spec
from shellbench.solvers.ndf.ritz_solver import RitzSettings, RitzSolver
from tests.injecting import shares_of_tolerances

STRIP = "contact_strip_hinged"


def thick(case):
    """Return the same question of a face: the floor is half a thickness lower."""
    (floor,) = case.obstacles
    lower = floor.model_copy(update={"centre": (0, 0, floor.centre[2] - case.material.thickness / 2)})
    touching = case.contact.model_copy(update={"thickness": True})
    return case.model_copy(update={"obstacles": (lower,), "contact": touching})


def one_answer(case):
    """Solve a case on its first resolution alone."""
    settings = RitzSettings()
    level = first_level(case, usual_resolution(case)).resolution
    spec = field_spec(case, settings).model_copy(update={"detail": 1})
    with torch.no_grad():
        found, _ = contact._fit_creases(case, spec, settings, level, (), 0, 1.0, contact._at_rest)
    return found.solution


def pulled(patch):
    """Multipliers of the wrong sign."""
    forces = contact.least_forces
    patch.setattr(contact, "least_forces", lambda *a: -forces(*a))


def glued(patch, module=contact):
    """Obstacles that pull as well, at all points that the load alone would push in."""

    def stuck(compliance, gap, give):
        forces, held = np.zeros(len(gap)), gap < 0
        forces[held] = np.linalg.solve((compliance + np.diag(give))[np.ix_(held, held)], -gap[held])
        return forces

    patch.setattr(module, "least_forces", stuck)


def turned_normal(patch):
    """A normal of the wrong side."""
    asked = contact.gaps
    patch.setattr(contact, "gaps", lambda *a: (asked(*a)[0], -asked(*a)[1]))


def without_thickness(patch):
    """The midsurface touches, where a face should."""
    asked = contact.gaps
    thin = {"contact": catalog.named_case(STRIP).contact}
    patch.setattr(contact, "gaps", lambda case, *a: asked(case.model_copy(update=thin), *a))


def without_offset(patch):
    """A gap that is zero at rest."""
    asked = contact.gaps
    patch.setattr(
        contact,
        "gaps",
        lambda case, x, u, t: (asked(case, x, u, t)[0] - asked(case, x, 0 * u, t)[0], asked(case, x, u, t)[1]),
    )


def halved(patch):
    """Report half of the forces."""
    settled = contact._solve_touch

    def half(*a):
        layer, touch = settled(*a)
        return layer, contact.replace(touch, forces=touch.forces / 2)

    patch.setattr(contact, "_solve_touch", half)


def left_out_of_reactions(patch):
    """Supports that know nothing of what obstacles carry."""
    asked = solution.edge_reaction
    patch.setattr(solution, "edge_reaction", lambda *a: asked(*a[:-1]))


def without_creases(patch):
    """Features that are smooth where contact begins."""
    patch.setattr(contact, "edges_of_contact", lambda solution: ())


@pytest.mark.long
@pytest.mark.parametrize("change", [lambda case: case, thick], ids=["midsurface", "face"])
def test_one_answer_is_green_and_kept_in_its_file(change, tmp_path):
    answer = one_answer(change(catalog.named_case(STRIP)))
    assert max(shares_of_tolerances(answer, "ndf-ritz").values()) < 1
    again = RitzSolver().load(answer.save(tmp_path / "answer"))
    assert measure_all(again) == pytest.approx(measure_all(answer), rel=1e-9, abs=1e-12)


@pytest.mark.long
@pytest.mark.parametrize(
    "fault",
    [pulled, glued, turned_normal, without_thickness, without_offset, halved, left_out_of_reactions, without_creases],
)
def test_a_fault_is_red(fault, monkeypatch):
    case = catalog.named_case(STRIP)
    monkeypatch.setattr(contact, "ROUNDS", 2)
    fault(monkeypatch)
    try:
        found = shares_of_tolerances(one_answer(thick(case) if fault is without_thickness else case), "ndf-ritz")
    except (SolveFailure, ValueError):
        return  # no answer is red as well
    assert not max(found.values()) < 1


def test_forces_push_where_gaps_are_closed_and_nowhere_else():
    rng = np.random.default_rng(0)
    root, gap, give = rng.normal(size=(12, 8)), rng.normal(size=12), np.full(12, 1e-3)
    compliance = root @ root.T
    forces = contact.least_forces(compliance, gap, give)
    left = gap + compliance @ forces + give * forces
    assert forces.min() >= 0
    assert left.min() > -1e-9
    assert np.abs(forces * left).max() < 1e-9 * np.abs(forces).max()
    assert 0 < np.count_nonzero(forces) < 12


def test_an_edge_of_contact_is_where_the_cube_root_of_the_gap_is_zero():
    x = np.linspace(0, 1, 2001)
    s = np.maximum(0.3 - x, 0)
    assert contact._root_of_gap(x, s**3 * (0.075 + 0.125 * s)) == pytest.approx(0.3, abs=1e-3)
    assert contact._root_of_gap(x, np.full(len(x), 1e-3)) is None


def test_creases_have_two_continuous_derivatives_and_bend_on_one_side_alone():
    domain = catalog.named_case(STRIP).surface.domain
    creases = Creases(domain, ((0, 0.3, -1),))
    points = np.array([[0.3 - 1e-4, 0.05], [0.3 + 1e-4, 0.05], [0.1, 0.05]])
    jets = torch.stack(creases.columns(points, Placement()), dim=-1)
    assert jets.shape[-1] == creases.count
    assert float(jets[:, 1].abs().max()) == 0
    assert all(float(jets[plane, 0].abs().max()) < 1e-2 for plane in (VALUE, D1, D11))
    assert float(jets[D11, 2].abs().max()) > 1
