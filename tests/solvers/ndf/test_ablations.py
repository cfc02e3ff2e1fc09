"""The paper's ablations: what each one takes away is what is missing from the answer, and no run is wrong in silence."""

import numpy as np
import pytest
import torch
from pydantic import ValidationError

from shellbench.bench.catalogue.catalog import find_suite, known_values, named_case
from shellbench.errors import InputError, SolveFailure
from shellbench.problems.shell.quantities.measure import measure
from shellbench.solvers.ndf.field.build import build_ansatz, build_features, build_inputs
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.field import Field
from shellbench.solvers.ndf.field.jets import D11, D12, D22, VALUE, Placement
from shellbench.solvers.ndf.field.network import Network, random_features
from shellbench.solvers.ndf.field.quadrature import RuleSpec
from shellbench.solvers.ndf.linear.signs import Signs, refusal, unseen_turning
from shellbench.solvers.ndf.published_solver import PublishedSettings
from shellbench.solvers.ndf.ritz_solver import RitzSettings, RitzSolver
from shellbench.solvers.ndf.trainer_solver import NdfSolver, TrainerSettings
from tests.alike import alike, same_tensors
from tests.solvers.ndf.shells import inner_points, shell, support
from tests.solvers.ndf.trainings import trained

SOLVER = RitzSolver()
PLACEMENT = Placement()
NO_FOCUS = np.zeros((0, 2))


def solve(case, **choices):
    return SOLVER.solve(case, RitzSettings(**choices))


def slope(weights, errors):
    return np.polyfit(np.log(weights), np.log(errors), 1)[0]


def random_field(case, spec, width=12):
    inputs = build_inputs(case, spec)
    network = random_features(PLACEMENT.tensor(np.full(inputs.count, 2.0)), width, seed=3, name=spec.activation)
    features = build_features(case, spec, network, PLACEMENT, inputs)
    output = torch.randn((3, features.count), generator=torch.Generator().manual_seed(5), dtype=torch.float64)
    return Field(build_ansatz(case, spec), features, output, torch.zeros(6, dtype=torch.float64))


# --- periodic input ---

TUBES = {
    "plain": shell("tube"),
    "loaded": shell("tube", points={"p": [90, 1.5]}, loads=[{"kind": "point", "on": ["p"], "force": [0, 0, 1]}]),
    "torus": shell("torus", points={"p": [60, 200]}, loads=[{"kind": "point", "on": ["p"], "force": [0, 1, 0]}]),
}


@pytest.mark.parametrize("name", TUBES)
@pytest.mark.parametrize(("periodic", "closes", "even"), [("both", True, False), ("cosine", True, True)])
def test_a_cosine_alone_closes_the_shell_and_makes_its_fields_even(name, periodic, closes, even):
    case = TUBES[name]
    domain, points = case.surface.domain, inner_points(case)
    field = random_field(case, FieldSpec(periodic_input=periodic, edge_stretched=True))
    here = field.jet(points)
    size = field.displacement(points).abs().max()
    for axis in range(2):
        if domain.periodic[axis]:
            across = field.jet(points + np.eye(2)[axis] * domain.size[axis])
            torch.testing.assert_close(across, here, rtol=1e-8, atol=1e-8 * float(here.abs().max()))
            mirrored = points.copy()
            mirrored[:, axis] = 2 * domain.lower[axis] - points[:, axis]
            difference = (field.jet(mirrored)[VALUE] - here[VALUE]).abs().max()
            assert (difference < 1e-9 * size) == even


def test_without_periodic_inputs_the_two_sides_of_the_seam_are_apart():
    case = TUBES["plain"]
    domain = case.surface.domain
    seam = np.array([[domain.lower[0], 1.0], [domain.upper[0], 1.0]])
    for periodic, closed in (("none", False), ("cosine", True), ("both", True)):
        field = random_field(case, FieldSpec(periodic_input=periodic))
        low, high = field.displacement(seam)
        assert (float((low - high).abs().max()) < 1e-9) == closed


@pytest.mark.long
def test_a_cosine_alone_twists_a_sleeve_too_stiffly_and_a_slit_one_too_softly():
    """A subspace of the closed fields stores more energy at the same twist; the slit shell's fields contain them."""
    case = named_case("sleeve_torque")
    known = known_values(case.name).judge("torque", case.theory).value
    slit, both, cosine = (measure(solve(case, neurons=120, periodic_input=p), case.primary)
                          for p in ("none", "both", "cosine"))  # fmt: skip
    assert both == pytest.approx(known, rel=1e-3)
    assert slit < 0.9 * known
    assert cosine > 1.02 * known


def test_a_cosine_alone_that_can_not_follow_the_loads_says_so():
    """The loads pinch antisymmetrically about the seam: every even field leaves them without work."""
    with pytest.raises(SolveFailure, match=r"takes up the loads.*even about the seam") as caught:
        solve(named_case("pinched_cylinder_free"), neurons=60, periodic_input="cosine")
    assert "\n" not in str(caught.value)
    partial = caught.value.partial
    assert abs(measure(partial, partial.case.primary)) < 1e-12 * 4.6e-4


@pytest.mark.long
def test_cosines_are_known_to_every_recipe():
    tube = shell("tube", supports=[support("end", "xi2_min", "xi2_max")],
                 loads=[{"kind": "pressure", "value": -2}])  # fmt: skip
    points = inner_points(tube)
    mirrored = points * [-1, 1]
    deep = NdfSolver().solve(
        tube, TrainerSettings(widths=(40,), iterations=0, largest_gap=1.0, periodic_input="cosine")
    )
    published = trained(tube, PublishedSettings(iterations=1, layers=2, width=8, cells=(4, 4), periodic_input="cosine"))
    for solution in (deep, published):
        u = solution.displacement(points)
        np.testing.assert_allclose(solution.displacement(mirrored), u, atol=1e-5 * np.abs(u).max())
        assert solution.spec.periodic_input == "cosine"


def test_files_of_earlier_versions_say_it_by_a_boolean_and_settings_do_not():
    assert FieldSpec(periodic_input=True).periodic_input == "both"
    assert FieldSpec(periodic_input=False).periodic_input == "none"
    with pytest.raises(ValueError, match="cosine"):
        RitzSettings(periodic_input="sine")


# --- soft supports ---


def strip(**data):
    """A strip of nu = 0, 2 by 2 m, held at one end and pulled by a millimetre at the other."""
    pulled = {"kind": "value", "x": 1e-3, "y": 0.0, "z": 0.0}
    return shell("plane", {"poissons_ratio": 0.0},
                 supports=[support("wall", "xi1_min"), support("jaw", "xi1_max", motion=pulled)], **data)  # fmt: skip


@pytest.mark.parametrize("weight", [10.0, *(pytest.param(weight, marks=pytest.mark.long) for weight in (0.5, 1e3))])
def test_soft_supports_are_springs_in_series_with_a_strip(weight):
    """N = d / (a/D + 2/k) a metre, with k = weight D / L, and L = 2 m the root of the area: ends give by N / k."""
    case, stretched = strip(), 1e7 * 0.05
    solution = solve(case, supports="soft", penalty=weight)
    spring = weight * stretched / 2.0
    force = 1e-3 / (2.0 / stretched + 2 / spring)
    assert solution.diagnostics["support_error"] == pytest.approx(force / spring, rel=1e-6, abs=1e-6 * 1e-3)
    assert solution.diagnostics["spring_energy"] == pytest.approx(2 * 2.0 * force**2 / (2 * spring), rel=1e-6)
    membrane, bending = solution.energies()
    assert membrane == pytest.approx(2.0 * 2.0 * force**2 / (2 * stretched), rel=1e-6)
    assert bending == pytest.approx(0, abs=1e-9 * membrane)
    for name, sign in (("jaw", 1), ("wall", -1)):
        np.testing.assert_allclose(solution.reaction(name)[0], [sign * 2 * force, 0, 0], rtol=1e-5, atol=1e-5 * force)


@pytest.mark.long
def test_soft_supports_become_hard_ones_at_the_rate_of_their_weight():
    case, weights = strip(), np.array([1e1, 1e2, 1e3, 1e4])
    points = inner_points(case)
    hard = solve(case)
    assert hard.diagnostics["support_error"] < 1e-12
    soft = [solve(case, supports="soft", penalty=w) for w in weights]
    apart = [np.abs(s.displacement(points) - hard.displacement(points)).max() for s in soft]
    assert slope(weights, apart) == pytest.approx(-1, abs=0.05)
    assert slope(weights, [s.diagnostics["support_error"] for s in soft]) == pytest.approx(-1, abs=0.05)


@pytest.mark.long
def test_the_plate_gives_way_at_soft_supports():
    """Springs can only soften: the deflection is larger, ever less so, and their error falls with the weight."""
    case = named_case("square_plate")
    usual = 1e4  # the weight that a run has if none is asked for
    found = [solve(case, supports="soft", penalty=w) for w in (1e-2, 1.0, 1e2, usual)]
    values = [measure(s, case.primary) for s in found]
    assert values[0] > 1.1 * values[1] > 1.1 * values[2] > 1.1 * values[3]
    assert values[3] == pytest.approx(measure(solve(case), case.primary), rel=1e-4)
    errors = [s.diagnostics["support_error"] for s in found]
    assert errors[0] > 5 * errors[1] > 100 * errors[2] > 0


@pytest.mark.long
def test_the_gap_of_soft_supports_is_that_of_shell_and_springs_together():
    """At rest the work of the loads is twice what shell and springs store (Clapeyron)."""
    case = named_case("scordelis_lo")
    solution = solve(case, supports="soft", penalty=1e-2)
    stored = sum(solution.energies()) + solution.diagnostics["spring_energy"]
    assert solution.diagnostics["spring_energy"] > 0.1 * stored
    assert solution.diagnostics["certified_energy"] == pytest.approx(-stored, rel=1e-9)
    assert solution.diagnostics["energy_gap"] < 1e-5


@pytest.mark.long
def test_soft_feet_carry_the_load_and_a_saved_solution_comes_back(tmp_path):
    corners = [f"xi1_{a},xi2_{b}" for a in ("min", "max") for b in ("min", "max")]
    feet = [support("feet", *corners, components=["z"])]
    down = [{"kind": "area", "vector": [0, 0, -1]}]
    case = shell("plane", supports=feet, loads=down,
                 remove_rigid_motions=["translation_x", "translation_y", "rotation_z"])  # fmt: skip
    solution = solve(case, supports="soft", penalty=10.0)
    force, moment = solution.reaction("feet", centre=(1, 0, 0))
    np.testing.assert_allclose(force, [0, 0, 4], atol=1e-5)
    np.testing.assert_allclose(moment, 0, atol=1e-4)
    assert solution.diagnostics["support_error"] == pytest.approx(1 / (10 * case.material.membrane_stiffness), rel=1e-4)
    again = SOLVER.load(solution.save(tmp_path / "feet"))
    points = inner_points(case)
    same_tensors(again.tensors(), solution.tensors())
    alike(again.displacement(points), solution.displacement(points))
    assert again.reaction("feet")[0] == pytest.approx(force)


@pytest.mark.long
def test_soft_supports_hold_covariant_components_as_well():
    case = named_case("scordelis_lo")
    first, second = (measure(solve(case, supports="soft", components=c), case.primary)
                     for c in ("cartesian", "covariant"))  # fmt: skip
    assert first == pytest.approx(second, rel=1e-4)


def test_equations_that_a_penalty_makes_unsolvable_are_a_failed_run():
    with pytest.raises(SolveFailure, match=r"ill-conditioned.*smaller penalty") as caught:
        solve(named_case("square_plate"), supports="soft", penalty=1e10)
    assert caught.value.partial.diagnostics["jitter_share"] > 1e-3


@pytest.mark.parametrize(
    ("case", "reason"),
    [
        (named_case("sleeve_torque"), "holds no slopes, and support 'bottom_rim'"),
        (named_case("square_plate_nonlinear"), "linear theory"),
        (shell("plane", supports=[support("all", "surface", motion={"kind": "translation", "vector": [0, 0, 1]})]),
         "whole surface"),
    ],
)  # fmt: skip
def test_what_springs_can_not_hold_is_declined_in_a_sentence(case, reason):
    with pytest.raises(InputError, match=reason) as caught:
        solve(case, supports="soft")
    assert "\n" not in str(caught.value)


def test_a_penalty_without_springs_is_refused():
    with pytest.raises(InputError, match='supports = "soft"'):
        solve(strip(), penalty=1.0)


# --- activation ---


def test_rectified_networks_have_no_curvature():
    """Wherever the inputs are the coordinates themselves, a ReLU network of any depth is piecewise linear in them."""
    case = shell("plane")
    network = random_features(PLACEMENT.tensor(np.full(2, 3.0)), 30, seed=0, name="relu")
    deeper = torch.randn((20, 30), generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    deep = Network((*network.weights, deeper), (*network.biases, deeper[:, 0]), "relu")
    jets = deep.features(build_inputs(case, FieldSpec()).jets(inner_points(case, 200), PLACEMENT))
    assert jets[1:3].abs().max() > 0.1
    assert float(jets[[D11, D12, D22]].abs().max()) == 0.0


def test_curvature_sees_nothing_of_how_a_rectified_field_turns():
    """A free plate multiplies its network by nothing: all of a rectified field's turning is kinks."""
    field = random_field(shell("plane"), FieldSpec(activation="relu"), width=40)
    assert 0.9 <= unseen_turning(field, RuleSpec((6, 6), 7), NO_FOCUS) <= 1.0 + 1e-12


@pytest.mark.parametrize(
    "name", ["square_plate", *(pytest.param(n, marks=pytest.mark.long) for n in ("scordelis_lo", "sleeve_torque"))]
)
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.long)])
def test_a_rectified_field_is_a_failed_run_that_shows_its_value(name, seed):
    case = named_case(name)
    with pytest.raises(
        SolveFailure, match=r"kinks without curvature.*second derivatives of activation 'relu'"
    ) as caught:
        solve(case, activation="relu", seed=seed, neurons=40)
    assert "\n" not in str(caught.value)
    assert np.isfinite(measure(caught.value.partial, case.primary))
    assert caught.value.partial.diagnostics["unseen_turning"] > 0.1


def test_rectified_paths_are_refused_before_they_start():
    with pytest.raises(InputError, match="second derivatives vanish"):
        solve(named_case("square_plate_nonlinear"), activation="relu")


# --- all of them ---


@pytest.mark.parametrize(
    "name", ["square_plate", *(pytest.param(n, marks=pytest.mark.long) for n in ("scordelis_lo", "annular_plate"))]
)
def test_defaults_show_nothing_of_what_is_refused(name):
    found = solve(named_case(name)).diagnostics
    assert found["support_error"] < 1e-12
    assert found["jitter_share"] < 1e-6


@pytest.mark.parametrize("sign", ["gap", "taken_up", "unseen_turning", "jitter_share"])
def test_a_figure_that_is_no_number_is_refused(sign):
    good = {"gap": 0.0, "taken_up": 1.0, "unseen_turning": 0.0, "jitter_share": 0.0}
    assert refusal(Signs(**good), FieldSpec(), 5e-4) is None
    assert refusal(Signs(**{**good, sign: float("nan")}), FieldSpec(), 5e-4)


def test_the_suite_runs_each_ablation_under_the_paper_s_label():
    """Published figures are matched by label; a setting that is the default would be no ablation."""
    runs = find_suite("ablations").runs
    labels = {line.label: line.settings for line in runs}
    assert len(labels) == len(runs)
    assert labels["no periodicity"] == {"periodic_input": "none"}
    assert labels["GELU"] == {"activation": "gelu"}
    defaults = RitzSettings()
    for label, settings in labels.items():
        chosen = RitzSettings(**settings)
        assert (chosen == defaults) == (label == "full")


@pytest.mark.parametrize("penalty", [0.0, 1e-300, 1e300])
def test_a_penalty_that_no_double_can_weigh_is_refused(penalty):
    with pytest.raises(ValidationError, match="penalty"):
        RitzSettings(supports="soft", penalty=penalty)
