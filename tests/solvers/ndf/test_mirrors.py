"""Planes of symmetry: which ones a case has, and a field that has them built in."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from shellbench.bench.catalogue import catalog
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.solvers.ndf.field import build
from shellbench.solvers.ndf.field.build import build_ansatz, build_features, build_inputs, field_mirrors, focal_points
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.field import Field
from shellbench.solvers.ndf.field.jets import D1, D2, D11, D12, D22, VALUE, Placement
from shellbench.solvers.ndf.field.mirrors import mirrors_of
from shellbench.solvers.ndf.field.network import random_features
from shellbench.solvers.ndf.field.quadrature import NOWHERE, ROUNDING, Rule, RuleSpec, area_rule
from shellbench.solvers.ndf.linear import static
from shellbench.solvers.ndf.linear.ritz_settings import RitzSettings
from shellbench.solvers.ndf.linear.solution import NdfSolution
from shellbench.solvers.ndf.ritz_solver import RitzSolver
from shellbench.solvers.ndf.strains.energy import certify, concentrated, normal_equations
from shellbench.solvers.ndf.trainer_solver import NdfSolver, TrainerSettings
from shellbench.solvers.ndf.training.training import default_plan_widths

SPEC = FieldSpec(mirrors=True)
LOOKING = SPEC.model_copy(update={"edge_stretched": True, "detail": 1})  # as challengers do: edges map to each other
CYLINDER = "pinched_cylinder_diaphragm"
ROOF = "roof_thinness_1e_2"
MIRRORED = ["pinched_cylinder_free", CYLINDER, "hemisphere_hole", "hyperboloid_clamped_1e_2", "scordelis_lo"]


def edited(name, **changes):
    data = {key: value for key, value in catalog.named_case(name).data().items() if key != "name"}
    return build_case({**data, **changes}, name, "edited.toml")


def planes(case):
    return {(mirror.axis, round(mirror.at, 9), "xyz"[mirror.normal]) for mirror in mirrors_of(case).each}


def field_of(case, spec=SPEC, width=7):
    inputs, placement = build_inputs(case, spec), Placement()
    network = random_features(torch.ones(inputs.count, dtype=torch.float64), width, 3)
    features = build_features(case, spec, network, placement, inputs)
    generator = torch.Generator().manual_seed(4)
    output = torch.randn((3, features.count), generator=generator, dtype=torch.float64)
    return Field(build_ansatz(case, spec), features, output, torch.zeros(6, dtype=torch.float64))


def test_a_pinched_cylinder_has_three_planes():
    assert planes(catalog.named_case(CYLINDER)) == {(0, 0.0, "z"), (0, round(np.pi / 2, 9), "x"), (1, 300.0, "y")}


LARGEST = [{"name": "largest", "kind": "largest_displacement", "primary": True}]
FORCES = catalog.named_case(CYLINDER).data()["loads"]


@pytest.mark.parametrize(
    ("changes", "left"),
    [
        ({"points": {"top": [90, 200], "bottom": [270, 200]}}, {"x", "z"}),
        ({"points": {"top": [80, 300], "bottom": [280, 300]}}, {"y", "z"}),
        ({"loads": [{**FORCES[0], "force": [0, 0, -2]}, FORCES[1]]}, {"x", "y"}),
        ({"loads": [{**FORCES[0], "force": [0, 0.1, -1]}, {**FORCES[1], "force": [0, -0.1, 1]}]}, {"x"}),
        ({"loads": [*FORCES, {"kind": "area", "vector": [0, "xi2", 0]}]}, {"x", "z"}),
        (
            {"supports": [{"name": "d", "on": ["xi2_min"], "components": ["x", "y", "z"]}], "remove_rigid_motions": []},
            {"x", "z"},
        ),
        (
            {"springs": [{"name": "s", "stiffness": 1.0, "components": ["x", "y", "z"]}], "remove_rigid_motions": []},
            set(),
        ),
        ({"theory": "kirchhoff-love-nonlinear", "loads": [], "quantities": LARGEST}, set()),
    ],
)
def test_what_breaks_a_symmetry_takes_its_plane_away(changes, left):
    assert {component for _, _, component in planes(edited(CYLINDER, **changes))} == left


def test_a_stiffness_that_varies_is_looked_at():
    material = catalog.named_case(CYLINDER).data()["material"]
    uneven = edited(CYLINDER, material={**material, "thickness_factor": "1 + xi2 / 1000"})
    even = edited(CYLINDER, material={**material, "thickness_factor": "1 + (xi2 - 300)**2 / 1e6"})
    assert {c for _, _, c in planes(uneven)} == {"x", "z"}
    assert {c for _, _, c in planes(even)} == {"x", "y", "z"}


@pytest.mark.sampled(5)
@pytest.mark.parametrize("spec", [SPEC, LOOKING], ids=["usual", "challengers"])
@pytest.mark.parametrize("name", MIRRORED)
def test_a_field_is_its_own_image(name, spec):
    case = catalog.named_case(name)
    field, domain = field_of(case, spec), case.surface.domain
    share = np.random.default_rng(5).uniform(0.02, 0.98, (40, 2))
    points = np.asarray(domain.lower) + share * np.asarray(domain.size)
    here = field.displacement(points).numpy()
    mirrors = field_mirrors(case, spec)
    assert len(mirrors.each) == len(mirrors_of(case).each) > 1
    for mirror in mirrors.each:
        there = field.displacement(domain.wrap(mirror.image(points))).numpy()
        np.testing.assert_allclose(there * mirror.signs, here, rtol=0, atol=1e-9 * np.abs(here).max())


def test_without_a_plane_nothing_is_built_in():
    crooked = edited(CYLINDER, points={"top": [80, 200], "bottom": [280, 210]})
    assert field_mirrors(crooked, SPEC) is None
    assert build_inputs(catalog.named_case(CYLINDER), FieldSpec()).mirrors is None
    covariant = SPEC.model_copy(update={"components": "covariant"})
    assert field_mirrors(catalog.named_case(CYLINDER), covariant) is None


@pytest.mark.parametrize("name", [CYLINDER, "hemisphere_hole"])
def test_jets_are_derivatives_across_the_planes_too(name):
    case = catalog.named_case(name)
    field, domain = field_of(case, LOOKING), case.surface.domain
    size = np.asarray(domain.size)
    points = np.asarray(domain.lower) + size * np.array([[0.25, 0.41], [0.1, 0.5], [0.5, 0.499], [0.37, 0.22]])
    jet = field.jet(points).numpy()
    scale = np.abs(jet).max(axis=(1, 2))

    def value(first, second):
        return field.displacement(points + size * [first, second]).numpy()

    h = 1e-4
    for plane, difference in {
        D1: (value(h, 0) - value(-h, 0)) / (2 * h * size[0]),
        D2: (value(0, h) - value(0, -h)) / (2 * h * size[1]),
        D11: (value(h, 0) - 2 * value(0, 0) + value(-h, 0)) / (h * size[0]) ** 2,
        D22: (value(0, h) - 2 * value(0, 0) + value(0, -h)) / (h * size[1]) ** 2,
        D12: (value(h, h) - value(h, -h) - value(-h, h) + value(-h, -h)) / (4 * h * h * size[0] * size[1]),
    }.items():
        np.testing.assert_allclose(jet[plane], difference, rtol=0, atol=1e-4 * scale[plane])
    np.testing.assert_allclose(jet[VALUE], value(0, 0), rtol=1e-12)


def unfolded(mirrors, rule):
    """The same rule on all parts."""
    images = [points for points, _ in mirrors.images(rule.points, (True,) * len(mirrors.each))]
    return Rule(np.concatenate(images), np.tile(rule.weights / mirrors.parts, mirrors.parts))


@pytest.mark.parametrize("name", [CYLINDER, "pinched_cylinder_free", "hemisphere_hole"])
def test_one_part_stands_for_the_whole(name):
    # The free cylinder and the hemisphere have rigid motions left, whose means must be those over the whole shell.
    case, spec = catalog.named_case(name), RuleSpec((8, 6), 4)
    field, focal = field_of(case), focal_points(case)
    ansatz, features = field.ansatz, field.features
    forces = concentrated(ansatz, spec, focal, features.placement)
    part = ansatz.rule(focal, spec)
    whole, plain = unfolded(ansatz.mirrors, part), replace(ansatz, mirrors=None)
    one, all_parts = normal_equations(ansatz, features, part, forces), normal_equations(plain, features, whole, forces)
    for which in ("stiffness", "load", "anchor"):
        expected = getattr(all_parts, which)
        torch.testing.assert_close(
            getattr(one, which), expected, rtol=0, atol=1e-9 * max(float(expected.abs().max()), 1.0)
        )
    (energies,), (expected,) = (
        certify(a, features, [field.output], rule, forces) for a, rule in ((ansatz, part), (plain, whole))
    )
    for which in ("membrane", "bending", "work"):
        np.testing.assert_allclose(getattr(energies, which), getattr(expected, which), rtol=1e-9)


def test_the_part_is_as_large_as_it_should_be():
    case = catalog.named_case(CYLINDER)
    mirrors = mirrors_of(case)
    rule = mirrors.rule(focal_points(case), RuleSpec((8, 4), 6, 3.0))
    area = rule.areas(case.surface).sum()
    np.testing.assert_allclose(area, 2 * np.pi * 300 * 600, rtol=1e-12)
    assert mirrors.parts == 8
    assert np.ptp(rule.points[:, 0]) < np.pi / 2
    assert np.ptp(rule.points[:, 1]) < 300


def trained(case, width, start=None, **settings):
    return NdfSolver().solve(
        case, TrainerSettings(widths=(width,), iterations=1, largest_gap=1e-2, **settings), start, lambda progress: None
    )


@pytest.mark.long
def test_a_mirrored_field_finds_what_a_wider_plain_one_misses_and_is_kept(tmp_path):
    case = catalog.named_case("pinched_cylinder_free")
    plain, mirrored = trained(case, 90), trained(case, 50, mirrors=True)
    lower, upper = (s.diagnostics["certified_energy"] for s in (mirrored, plain))
    assert lower < upper
    known, unsure = plain.uncertainty["load_deflection"], mirrored.uncertainty["load_deflection"]
    point = [case.places["top"].xi]
    apart = abs(float(mirrored.displacement(point)[0, 2] - plain.displacement(point)[0, 2]))
    assert apart <= known + unsure
    assert unsure < known / 4
    again = NdfSolver().load(mirrored.save(tmp_path / "field"))
    assert isinstance(again, NdfSolution)
    assert again.spec.mirrors
    np.testing.assert_allclose(again.displacement(point)[0, 2], mirrored.displacement(point)[0, 2], rtol=1e-12)
    # A start keeps its planes, as far as the edited shell has them.
    on = trained(edited(case.name, material={**case.data()["material"], "thickness": 3.1}), 50, start=mirrored)
    assert on.spec.mirrors
    np.testing.assert_allclose(on.displacement(point) * 3.1**3, mirrored.displacement(point) * 27, rtol=0.02, atol=1e-6)
    assert not trained(case, 90, start=plain).spec.mirrors


def test_widths_follow_the_number_of_parts():
    case = catalog.named_case(CYLINDER)
    assert [default_plan_widths(case, True, parts)[0] for parts in (1, 4)] == [(500,), (250,)]


def solved(name, **settings):
    return RitzSolver().solve(catalog.named_case(name), RitzSettings(**settings))


@pytest.fixture(scope="module")
def roof():
    """By ndf-ritz, with planes of symmetry and without."""
    return solved(ROOF), solved(ROOF, mirrors=False)


def test_planes_change_an_answer_by_less_than_it_is_sure_of(roof):
    mirrored, plain = roof
    assert mirrored.spec.mirrors
    assert not plain.spec.mirrors
    assert mirrored.parameters < plain.parameters / 1.5
    assert mirrored.unsettled is plain.unsettled is None
    first, second = measure_all(mirrored), measure_all(plain)
    for name, value in first.items():
        assert abs(value - second[name]) <= mirrored.uncertainty[name] + plain.uncertainty[name]
    energies = [s.diagnostics["certified_energy"] for s in roof]
    np.testing.assert_allclose(*energies, rtol=plain.diagnostics["challenge_gain"] + ROUNDING)


@pytest.mark.long
def test_a_mirror_of_the_wrong_sign_is_another_shell(roof, monkeypatch):
    def energy():
        return solved(ROOF, neurons=60, largest_gap=1.0, mirrors=True).diagnostics["certified_energy"]

    def wrong(case, spec):
        found = field_mirrors(case, spec)
        return found and replace(found, each=tuple(replace(mirror, normal=2) for mirror in found.each[:1]))

    np.testing.assert_allclose(energy(), roof[1].diagnostics["certified_energy"], rtol=1e-5)
    for module in (build, static):
        monkeypatch.setattr(module, "field_mirrors", wrong)
    assert abs(energy() / roof[1].diagnostics["certified_energy"] - 1) > 0.1


@pytest.mark.parametrize("settings", [{"neurons": 30}, {"panels": (4, 4)}])
def test_a_width_or_a_rule_that_is_given_is_one_of_the_whole_shell(settings):
    assert not solved("square_plate", largest_gap=1.0, **settings).spec.mirrors


def test_without_a_plane_nothing_changes():
    few = {"neurons": 12, "panels": (3, 3), "largest_gap": 1.0}
    one, other = (solved("rhombic_plate_60", **few, mirrors=m) for m in (True, False))
    assert one.spec == other.spec
    assert torch.equal(one.field.output, other.field.output)


def test_a_part_has_the_points_of_the_rule_of_the_whole_shell():
    # Layers and corners are those of the shell: no panel narrows toward a plane.
    mirrors, spec = mirrors_of(catalog.named_case(ROOF)), RuleSpec((8, 6), 4, layers=(0.1, 2.0), corner_cuts=2)
    whole, rule = area_rule(mirrors.domain, NOWHERE, spec), mirrors.rule(NOWHERE, spec)
    assert len(whole.points) == mirrors.parts * len(rule.points)
    both = (np.sort(np.ravel(w)) for w in (whole.weights, np.tile(rule.weights / mirrors.parts, mirrors.parts)))
    np.testing.assert_allclose(*both, rtol=1e-9)
