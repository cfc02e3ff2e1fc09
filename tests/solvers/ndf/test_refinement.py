"""Refinement of linear shells at rest by `ndf-ritz`, and the validity of its stated uncertainty."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from shellbench.bench.catalogue.catalog import known_values, named_case
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.problems.shell.question.surface import Domain
from shellbench.solvers.ndf.field.build import build_ansatz, build_features, build_inputs, unevenness
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.corners import EXPONENTS, CornerPowers, held_corners
from shellbench.solvers.ndf.field.jets import D1, D2, D11, D12, D22, VALUE, Placement
from shellbench.solvers.ndf.field.network import random_features
from shellbench.solvers.ndf.field.quadrature import ROUNDING, RuleSpec, area_rule, line_rule, panel_ends
from shellbench.solvers.ndf.linear import answer, static
from shellbench.solvers.ndf.linear.answer import Candidate, SolvedLevel
from shellbench.solvers.ndf.linear.refinement import (
    CORNER_CUTS,
    LEAST_TAIL,
    SAFETY,
    SETTLED,
    SLOWEST,
    ErrorBounds,
    gain_left,
    quantity_changes,
    remaining_error,
    uncertainties,
    why_unsettled,
)
from shellbench.solvers.ndf.linear.regularised import JITTER
from shellbench.solvers.ndf.ritz_solver import RitzSettings, RitzSolver
from shellbench.solvers.ndf.strains.energy import concentrated, normal_equations
from tests.solvers.ndf.shells import shell, support

ALL = ("xi1_min", "xi1_max", "xi2_min", "xi2_max")
SQUARE = Domain((0.0, 0.0), (1.0, 1.0), (False, False), (False, False))


def solve(name, **choices):
    return RitzSolver().solve(named_case(name), RitzSettings(**choices))


@pytest.fixture(scope="module")
def roof():
    return [solve("scordelis_lo", seed=seed) for seed in (0, 1)]


@pytest.mark.long
def test_energies_fall_as_features_join_and_never_below_the_minimum(roof):
    for solution in roof:
        energies = [step.energy for step in solution.history]
        unknowns = [step.unknowns for step in solution.history]
        assert len(energies) == 4  # three widths, then the challengers
        assert unknowns == sorted(unknowns)
        assert energies == sorted(energies, reverse=True)
        least = -known_values("scordelis_lo").judge("strain_energy", solution.case.theory).value
        assert solution.diagnostics["certified_energy"] >= least * (1 + 1e-9)


@pytest.mark.long
def test_seeds_agree_within_their_stated_uncertainties(roof):
    first, second = roof
    values = [measure_all(solution) for solution in roof]
    assert first.unsettled is None
    assert second.unsettled is None
    for name in values[0]:
        allowed = first.uncertainty[name] + second.uncertainty[name]
        assert 0 < abs(values[0][name] - values[1][name]) <= allowed


@pytest.mark.parametrize(("name", "neurons"), [("square_plate", 6), ("scordelis_lo", 20)])
def test_too_few_neurons_are_not_settled_and_say_how_wrong_they_are(name, neurons):
    solution = solve(name, neurons=neurons, largest_gap=1.0)
    assert solution.field.features.network.width == neurons
    assert solution.unsettled is not None
    primary = solution.case.primary
    known = known_values(name).judge(primary.name, solution.case.theory).value
    error = abs(measure_all(solution)[primary.name] - known)
    assert error > SETTLED * abs(known)  # it is wrong indeed
    assert error <= SAFETY * solution.uncertainty[primary.name]


@pytest.mark.long
def test_a_rigid_turn_by_an_edge_is_its_own_exact_answer():
    solution = solve("rigid_turn_by_edge")
    assert solution.unsettled is None
    known = known_values("rigid_turn_by_edge").judge("turn", solution.case.theory).value
    value = measure_all(solution)["turn"]
    assert value == pytest.approx(known, rel=1e-9)
    assert abs(value - known) <= solution.uncertainty["turn"]


@pytest.mark.long
def test_challengers_find_nothing_beside_moved_points_where_nothing_is_missed():
    """The stress of the parallelogram is the same everywhere: its field is smooth, and its first answer right."""
    solution = solve("twisted_parallelogram", neurons=150)
    assert solution.unsettled is None
    assert solution.diagnostics["challenge_gain"] < 1e-5
    assert solution.history[-1].gap < 1e-5  # of the challengers: what they join is an answer, too
    for name, value in measure_all(solution).items():
        known = known_values("twisted_parallelogram").judge(name, solution.case.theory).value
        assert abs(value - known) <= SAFETY * solution.uncertainty[name]


@pytest.mark.long
def test_infinite_moments_at_corners_are_met():
    solution = solve("rhombic_plate_60")
    assert solution.unsettled is None
    values = measure_all(solution)
    for name in ("centre_deflection", "off_centre_deflection", "strain_energy"):
        known = known_values("rhombic_plate_60").judge(name, solution.case.theory).value
        assert values[name] == pytest.approx(known, rel=1e-4)


@pytest.mark.long
def test_uncertainties_tell_what_regularisation_takes(monkeypatch):
    """A level of 1e-6 takes more than features of other kinds, as regularised, tell of."""
    usual, steps = static.solve_part, answer.STEPS_LEFT
    monkeypatch.setattr(static, "solve_part", lambda *given, level=JITTER: usual(*given, level=1e6 * level))
    known = known_values("scordelis_lo").judge("strain_energy", "kirchhoff-love-linear").value
    for left, told in ((steps + 6, True), (0.0, False)):  # without steps, only challengers tell
        monkeypatch.setattr(answer, "STEPS_LEFT", left)
        solution = solve("scordelis_lo")
        missed = abs(measure_all(solution)["strain_energy"] / known - 1)
        assert (missed <= SAFETY * solution.diagnostics["challenge_gain"]) == told
        assert missed <= solution.uncertainty["strain_energy"] / known  # what it leaves unbalanced tells, too


def test_tails_follow_the_last_gains():
    assert remaining_error(3e-6, 4e-6) == pytest.approx(3)  # 3/4 + 9/16 + ...
    assert remaining_error(1e-9, 1e-3) == LEAST_TAIL
    assert remaining_error(1.0, 1e-3) == pytest.approx(SLOWEST / (1 - SLOWEST))
    assert remaining_error(0.0, 0.0) == LEAST_TAIL
    assert gain_left((8.0, 4.0, 2.0), 3) == pytest.approx(1 / 2 + 1 / 4 + 1 / 8)
    assert gain_left((3.0, 2.0, 1.0), 3.7) == 3.7  # as much again in each step
    assert gain_left((3.0, 2.0, 0.0), 3.7) == 3.7  # more and more: not believed
    assert gain_left((1.0, 2.0, 1.0), 3.7) == 3.7


@pytest.mark.parametrize(
    ("energies", "best", "told"),
    [((3, 2, 1), 2, 3.7), ((3, 1, 2), 1, 1.0), ((1, 2, 3), 0, 1.0), ((2, 1, 1 + 1e-10), 2, 3.7)],
)
def test_the_answer_is_the_regularisation_of_least_certified_energy(monkeypatch, energies, best, told):
    """Planted: each step of regularisation changes a value by 1e-3, and energy as said."""
    monkeypatch.setattr(answer, "STEPS_LEFT", 3.7)
    solution, still = SimpleNamespace(case=named_case("square_plate")), np.zeros((4, 3))
    answers = tuple(
        planted(solution, energy, {"centre_deflection": 1e-3 * k}, still) for k, energy in enumerate(energies)
    )
    solved = SolvedLevel(None, (), answers[best], answers, dict)
    assert solved.with_challengers is answers[best]
    assert solved.error_bounds().changes["centre_deflection"] == pytest.approx(told * 1e-3)


def planted(solution, energy, values, probed):
    """An answer of which these values are measured."""
    answer = Candidate(solution, energy, 1.0, None, None)
    vars(answer).update(values=values, probes=probed)
    return answer


@pytest.mark.parametrize("lost", [1e-6, -1e-6, 1e-10])
def test_challengers_that_lose_certified_energy_are_no_part_of_the_answer(lost):
    """Planted: challengers change the certified energy by so much of what is stored."""
    first, challenged = (Candidate(None, energy, 1.0, None, None) for energy in (-1.0, -1.0 + lost))
    assert SolvedLevel(None, (), first, (challenged,) * 3, dict).best is (first if lost == 1e-6 else challenged)


@pytest.mark.long
def test_challengers_that_exploit_their_rule_do_not_make_the_field_worse():
    """Lame's solution is smooth: 120 neurons have it to 1e-12 in energy, and challengers at the edges are beside it."""
    solution = solve("pulled_ring")
    assert solution.unsettled is None
    assert solution.diagnostics["certified_energy"] <= min(step.energy for step in solution.history) * (1 - ROUNDING)
    for name, value in measure_all(solution).items():
        known = known_values("pulled_ring").judge(name, solution.case.theory).value
        assert abs(value - known) <= solution.uncertainty[name] <= SETTLED * abs(known)


@pytest.mark.parametrize(("energies", "answering"), [((-1.0, -1.1), 1), ((-1.0, -0.9), 0)])
def test_the_level_of_least_certified_energy_answers(monkeypatch, energies, answering):
    """Planted: nothing settles, and a wider level has more energy or less on the same rule."""
    levels = []

    def solved(case, spec, settings, level, *others):
        answer = usual(case, spec, settings, level, *others)
        planted = replace(answer.with_challengers, potential=energies[min(level.number, 1)])
        levels.append(replace(answer, first=planted, regularised=(planted,) * 3))
        return levels[-1]

    usual = static._solve_level
    monkeypatch.setattr(static, "_solve_level", solved)
    monkeypatch.setattr(static, "_energy_on_rule", lambda answer, *others: answer.potential)
    monkeypatch.setattr(static, "why_unsettled", lambda *others: "planted")
    solution = solve("square_plate", most_neurons=120)
    assert len(levels) == 2
    assert solution.diagnostics["level"] == answering
    disagreement = abs(np.subtract(*(level.best.values["centre_deflection"] for level in levels)))
    assert solution.uncertainty["centre_deflection"] >= SAFETY * disagreement * LEAST_TAIL


def test_a_displacement_that_hardly_changes_by_accident_is_no_surer_than_the_field():
    """Planted: two answers of one level have the same values, and fields that differ."""
    values, field = {"centre_deflection": 0.5, "strain_energy": 2.0}, np.zeros((4, 3))
    shell = SimpleNamespace(case=named_case("square_plate"))
    first, other = (planted(shell, -1.0, values, each) for each in (field, field + 1e-3))
    missed = first.error_bounds(other)
    scales = {"centre_deflection": 0.5, "strain_energy": 2.0}
    stated = uncertainties(missed, 0.0, values, scales)
    assert stated["centre_deflection"] == pytest.approx(SAFETY * 1e-3)
    assert stated["strain_energy"] < 1e-8


def test_displacements_change_by_what_the_field_does_in_the_mean_square():
    case, moved = named_case("square_plate"), np.array([[3e-4, 0.0, 0.0], [0.0, 0.0, -4e-4]])
    before = {"centre_deflection": 0.5, "largest_displacement": 0.5, "strain_energy": 2.0}
    after = {"centre_deflection": 0.5, "largest_displacement": 0.4, "strain_energy": 2.0}
    found = quantity_changes(case, before, after, (0 * moved, moved))
    assert found["centre_deflection"] == pytest.approx(4e-4 / math.sqrt(2))  # it is along z
    assert found["largest_displacement"] == pytest.approx(0.1)
    assert found["strain_energy"] == 0.0


def test_a_largest_displacement_that_is_prescribed_is_as_sure_as_the_rest_stays_below_it():
    case, first = named_case("square_plate"), np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.9], [0.0, 0.0, 0.1]])

    def change(moved):
        second = first + np.array([[0.0, 0.0, m] for m in moved])
        largest = float(np.linalg.norm(second, axis=-1).max())
        values = {"centre_deflection": 0.5, "strain_energy": 1.0}
        return quantity_changes(
            case, values | {"largest_displacement": 1.0}, values | {"largest_displacement": largest}, (first, second)
        )["largest_displacement"]

    assert change([0.0, 1e-3, 1e-2]) == 0.0
    assert change([0.0, 6e-2, 0.0]) == pytest.approx(2e-2)  # 0.96, and as much again is 1.02
    assert change([0.0, 9e-2, 0.2]) == pytest.approx(math.sqrt((0.09**2 + 0.2**2) / 9))  # no more than elsewhere
    assert change([1e-5, 0.0, 3e-2]) == pytest.approx(math.sqrt((1e-10 + 9e-4) / 9))  # it is not prescribed


def test_uncertainties_grow_with_what_was_missed():
    values, scales = {"w": 2.0}, {"w": 2.0}
    small = uncertainties(ErrorBounds({"w": 1e-4}, 1e-6), 0.0, values, scales)["w"]
    assert small == pytest.approx(SAFETY * 1e-4)
    by_chance = uncertainties(ErrorBounds({"w": 0.0}, 1e-3), 0.0, values, scales)["w"]
    assert by_chance == pytest.approx(SAFETY * 2e-3, rel=1e-4)
    gaping = uncertainties(ErrorBounds({"w": 0.0}, 0.0), 1e-3, values, scales)["w"]
    assert gaping == pytest.approx(SAFETY * 2e-3, rel=1e-4)
    twice = ErrorBounds({"w": 1e-4}, 1e-6).times(2).or_larger(ErrorBounds({"w": 1e-5}, 1.0))
    assert twice == ErrorBounds({"w": 2e-4}, 1.0)
    assert why_unsettled({"w": 1.9e-3}, scales) is None
    assert "w may be off" in str(why_unsettled({"w": 2.1e-3}, scales))
    assert why_unsettled({"w": math.nan}, scales) is not None


# --- powers about corners ---


def clamped_saddle():
    surface = {"kind": "expression", "x": "xi1", "y": "xi2", "z": "xi1**2-xi2**2", "xi1": [0, 1], "xi2": [0, 1]}
    return shell(surface, supports=[support("wall", "xi1_min", clamped=True)],
                 loads=[{"kind": "area", "vector": [0, 0, -1]}])  # fmt: skip


def test_powers_stand_at_corners_that_are_held():
    assert [c.xi for c in held_corners(clamped_saddle())] == [(0.0, 0.0), (0.0, 1.0)]
    assert all(c.components == (True, True, True) and c.shift == -1 for c in held_corners(clamped_saddle()))
    rhombus = held_corners(named_case("rhombic_plate_60"))
    assert len(rhombus) == 4
    assert all(c.components == (False, False, True) and c.shift == -1 for c in rhombus)
    assert held_corners(named_case("pinched_cylinder_diaphragm")) == ()


def test_tangential_powers_stand_where_an_edge_holds_something_tangential():
    """The parallelogram is hinged across itself: its membrane ends freely, and its stresses are finite."""
    hinged = held_corners(named_case("twisted_parallelogram"))
    assert [c.components for c in hinged] == [(False, False, True)] * 2


def quarter_plate():
    supports = [
        support("rim", "xi1_min", "xi2_min", components=["z"]),
        support("x", "xi1_max", symmetry="x"),
        support("y", "xi2_max", symmetry="y"),
    ]
    surface = {"kind": "plane", "xi1": [0, 1], "xi2": [-1, 0]}
    return shell(surface, supports=supports, loads=[{"kind": "area", "vector": [0, 0, -1]}])


CORNERED = [named_case(name) for name in ("twisted_parallelogram", "rhombic_plate_60", "square_plate")]


@pytest.mark.parametrize("case", [*CORNERED, clamped_saddle(), quarter_plate()], ids=lambda case: case.name)
def test_powers_have_finite_energies_that_rules_agree_on(case):
    """An infinite energy grows with each cut of the cells, by a half and more."""
    spec = FieldSpec(detail=2, edge_stretched=True, slopes="rows")
    inputs, ansatz = build_inputs(case, spec), build_ansatz(case, spec)
    network = random_features(torch.ones(inputs.count, dtype=torch.float64), 1, 0)
    features = build_features(case, spec, network, Placement(), inputs)
    powers = features.pairs(np.arange(features.count - features.fixed.corners.count, features.count))
    energies, nowhere = [], np.zeros((0, 2))
    for rule in (RuleSpec((5, 5), 6, corner_cuts=CORNER_CUTS), RuleSpec((6, 6), 7, corner_cuts=CORNER_CUTS + 1)):
        forces = concentrated(ansatz, rule, nowhere, Placement())
        equations = normal_equations(ansatz, features, area_rule(case.surface.domain, nowhere, rule), forces)
        energies.append(equations.stiffness.diagonal()[powers])
    assert len(powers) > 0
    assert bool((energies[0] > 0).all())
    torch.testing.assert_close(*energies, rtol=1e-2, atol=0.0)


def test_jets_of_powers_are_their_derivatives():
    powers = CornerPowers.from_case(clamped_saddle(), 2)
    point, steps, h = np.array([[0.13, 0.22]]), np.eye(2), 1e-4

    def values(xi):
        return torch.stack(powers.columns(xi, Placement()), dim=-1)

    jet = values(point)[:, 0]
    assert jet.shape == (6, powers.count)
    for axis, first, second in ((0, D1, D11), (1, D2, D22)):
        up, down = values(point + h * steps[axis])[:, 0], values(point - h * steps[axis])[:, 0]
        torch.testing.assert_close((up - down)[VALUE] / (2 * h), jet[first], rtol=1e-4, atol=1e-4)
        torch.testing.assert_close((up - down)[first] / (2 * h), jet[second], rtol=1e-3, atol=1e-3)
    up, down = values(point + h * steps[1])[:, 0], values(point - h * steps[1])[:, 0]
    torch.testing.assert_close((up - down)[D1] / (2 * h), jet[D12], rtol=1e-3, atol=1e-3)


def test_former_powers_are_among_the_later_ones():
    few, many = (CornerPowers.from_case(clamped_saddle(), detail) for detail in (1, 2))
    point = np.array([[0.3, 0.4]])
    before, after = (torch.stack(p.columns(point, Placement()), dim=-1)[VALUE, 0] for p in (few, many))
    torch.testing.assert_close(after[torch.as_tensor(many.coarser_mask())], before)


def test_supports_hold_at_corners_where_features_are_infinite():
    case = clamped_saddle()
    spec = FieldSpec(detail=2, edge_stretched=True)
    inputs, ansatz = build_inputs(case, spec), build_ansatz(case, spec)
    network = random_features(torch.ones(inputs.count, dtype=torch.float64), 3, 0)
    values = build_features(case, spec, network, Placement(), inputs).values(np.array([[0.0, 0.0]]))
    held = ansatz.factors.matrix(np.array([[0.0, 0.0]]), Placement())[VALUE, 0]
    assert float(values.abs().max()) > 1e3
    assert float(held.abs().sum() * values.abs().max()) == 0.0


@pytest.mark.parametrize("mu", [0.15, 0.3, 0.544, 0.8])
def test_few_exponents_span_those_between(mu):
    """The distance of exp(-mu s) from the span of exp(-mu_j s) on the half line, by Gram determinants; Muentz 1914."""
    among = np.array(EXPONENTS[2])
    gram = 1 / (among[:, None] + among)
    cross = 1 / (mu + among)
    rest = 1 / (2 * mu) - cross @ np.linalg.solve(gram, cross)
    bound = np.prod(np.abs(mu - among) / (mu + among))
    assert math.sqrt(max(rest, 0) * 2 * mu) == pytest.approx(bound, rel=1e-3)
    assert bound < 2e-2


# --- rules ---


@pytest.mark.parametrize("cuts", [1, 2, 3])
@pytest.mark.parametrize("mu", [0.1, 0.25, 0.5])
def test_cells_at_corners_integrate_powers(mu, cuts):
    """The integral of r**a over the unit square is 2 / (a + 2) times that of cos**-(a + 2) from 0 to 45 degrees."""
    power = 2 * mu - 2
    angles, weights = line_rule(np.array([0.0, math.pi / 4]), 20)
    exact = 2 / (power + 2) * (weights @ np.cos(angles) ** -(power + 2))
    rule = area_rule(SQUARE, np.zeros((0, 2)), RuleSpec((2, 2), 6, corner_cuts=cuts))
    assert rule.weights.sum() == pytest.approx(1, rel=1e-12)
    assert np.all((rule.points > 0) & (rule.points < 1))
    assert rule.weights @ np.hypot(*rule.points.T) ** power == pytest.approx(exact, rel=1e-4)


@pytest.mark.parametrize("panels", [1, 2, 5, 8])
def test_layers_have_half_of_the_panels(panels):
    ends = panel_ends(0.0, 2.0, [], RuleSpec((panels, panels), 4, layers=(0.01, 0.0)), 0, periodic=False)
    assert len(ends) == panels + 1
    assert np.all(np.diff(ends) > 0)
    assert (ends[0], ends[-1]) == (0.0, 2.0)
    np.testing.assert_allclose(ends + ends[::-1], 2.0, rtol=1e-9)
    if panels == 8:
        assert ends[1] < 2.0 / 8 / 3


@pytest.mark.parametrize(
    ("variant", "most"), [("stretched", (1.0, 1.0)), ("warped", (1.4, 1.4)), ("oblique", (1.0, 1.6))]
)
def test_stretched_coordinates_ask_for_more_panels(variant, most):
    """The slopes of the charts: 1 + a, a = .4, where graded; 1 + 2 a, a = .3, at the ends of sheared lines."""
    found = unevenness(named_case(f"pinched_cylinder_diaphragm@{variant}"))
    assert found == pytest.approx(most, rel=0.03)  # on the grid, and lines around the oblique cylinder are no circles
