"""Orthotropic shells: the tensors of both mechanics, what carries a case into itself, and what is refused."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from derivations.stiffening import FABRICS, curve
from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.registry import find_solver, load_solver, solver_entries
from shellbench.errors import InputError
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.posed.mirrors import ComparisonPoints, mirror_of
from shellbench.problems.shell.quantities.resultant_quantities import material_axis, turned_tensor
from shellbench.problems.shell.variants.edit import why_no_edit
from shellbench.solvers.cst.solver import CstSolver
from shellbench.solvers.fem.mechanics.kinematics import Midsurface, elasticities, stiffness_moduli
from shellbench.solvers.fem.mechanics.strain_energy import stiffening_membrane
from shellbench.solvers.fem.solver import FemSolver
from shellbench.solvers.ndf.field.jets import Placement
from shellbench.solvers.ndf.strains.stiffening import stiffening_membrane as by_differentiation
from shellbench.solvers.ndf.strains.strain_measures import Undeformed
from shellbench.testing.mechanics import energy_densities

LAYER = {
    "kind": "orthotropic",
    "youngs_modulus": [8e6, 2e6],
    "poissons_ratio": 0.4,
    "shear_modulus": 9e5,
    "thickness": 0.1,
}
CLOTH = {
    "kind": "orthotropic",
    "membrane": [9e3, 1e3, 4e3, 300.0],
    "bending": [3e-4, 2e-5, 1e-4, 4e-5],
    "thickness": 1e-3,
}
LAMINATE = CLOTH | {
    "membrane": [[9e3, 1e3, 700.0], [1e3, 4e3, -200.0], [700.0, -200.0, 900.0]],
    "bending": [[3e-4, 2e-5, 5e-5], [2e-5, 1e-4, -1e-5], [5e-5, -1e-5, 4e-5]],
}
OBLIQUE = {"kind": "expression", "x": "xi1 + 0.3*xi2", "y": "xi2 + 0.2*xi1*xi2", "z": "0.2*xi1**2 - 0.3*xi1*xi2", "xi1": [0, 1], "xi2": [0, 1.5]}  # fmt: skip
PLATE = {"kind": "plane", "xi1": [0, 2], "xi2": [0, 1]}


def shell(material, surface=PLATE, **more):
    data = {
        "title": "Cloth",
        "theory": "kirchhoff-love-linear",
        "surface": surface,
        "material": material,
        "supports": [{"name": "rim", "on": ["xi1_min", "xi2_min", "xi1_max", "xi2_max"]}],
        "loads": [{"kind": "area", "vector": [0, 0, -1]}],
        "quantities": [{"name": "strain_energy", "kind": "strain_energy", "primary": True}],
    }
    return build_case(data | more, "cloth", "cloth")


def tensors(case, points):
    """A and D (n, 2, 3, 3) on covariant 11, 22, 12, by the mechanics of `fem` and of `ndf`."""
    surface = Midsurface.from_position(case.surface.derivatives(points, 2))
    moduli = stiffness_moduli(case.surface, case.material, points)
    of_fem = elasticities(surface, case.material) * moduli[..., None, None]
    of_ndf = Undeformed.at_points(case.surface, points, Placement()).elasticity(case.material)
    twice = np.diag([1.0, 1.0, 2.0])  # that of `ndf` acts on 11, 22 and twice 12
    return {"fem": of_fem, "ndf": twice @ of_ndf.numpy() @ twice}


@pytest.mark.parametrize("along", ["xi1", "xi2"])
@pytest.mark.parametrize("material", [LAYER, CLOTH, LAMINATE], ids=["layer", "cloth", "laminate"])
def test_both_mechanics_have_the_energy_of_the_turned_stiffnesses(material, along):
    case = shell(material | {"angle": 33.0, "along": along}, OBLIQUE)
    rng = np.random.default_rng(5)
    points, strains = rng.uniform(size=(20, 2)), rng.normal(size=(2, 20, 3))
    expected = energy_densities(case, points, *strains)
    for name, tensor in tensors(case, points).items():
        energies = np.einsum("pni,npij,pnj->pn", strains, tensor, strains) / 2
        np.testing.assert_allclose(energies, expected, rtol=1e-11, err_msg=name)


@pytest.mark.parametrize("along", ["xi1", "xi2"])
def test_resultants_along_the_axes_of_the_material_are_those_of_its_directions(along):
    """n_ij = d_i . N . d_j, with N = n_ab e_a e_b of the shell's frame and d_2 = a3 x d_1."""
    case, points = (
        shell(LAYER | {"angle": 33.0, "along": along}, OBLIQUE),
        np.random.default_rng(3).uniform(size=(6, 2)),
    )
    x, values = case.surface.derivatives(points, 1), np.random.default_rng(4).normal(size=(6, 3))
    for a1, a2, (n11, n22, n12), found in zip(
        x[1, 0], x[0, 1], values, turned_tensor(values, *material_axis(case, points)), strict=True
    ):
        normal, line = np.cross(a1, a2) / np.linalg.norm(np.cross(a1, a2)), a1 if along == "xi1" else a2
        e1 = a1 / np.linalg.norm(a1)
        e2, d1 = (
            np.cross(normal, e1),
            Rotation.from_rotvec(np.radians(33.0) * normal).apply(line / np.linalg.norm(line)),
        )
        d2 = np.cross(normal, d1)
        tensor = n11 * np.outer(e1, e1) + n22 * np.outer(e2, e2) + n12 * (np.outer(e1, e2) + np.outer(e2, e1))
        np.testing.assert_allclose(found, [d1 @ tensor @ d1, d2 @ tensor @ d2, d1 @ tensor @ d2], atol=1e-13)


@pytest.mark.parametrize("chart", ["flipped", "swapped", "stretched", "units"])
def test_a_variant_has_the_same_tensors(chart):
    """A vector's components change by the chart, and covariant ones with them: the energy of a strain stays."""
    case = shell(LAMINATE | {"angle": 33.0}, OBLIQUE)
    variant = catalog.variant_of(case, chart)
    points = np.random.default_rng(7).uniform(size=(9, 2))
    images, change = {
        "flipped": (points * [-1, 1], np.diag([1.0, 1.0, -1.0])),
        "swapped": (points[:, ::-1], np.eye(3)[[1, 0, 2]]),
        "stretched": ((points + np.array([1.3, -0.7])) / [4e-4, 2500.0], np.diag([4e-4**-2, 2500.0**-2, 1.0])),
        "units": (points * 1000, np.eye(3)),  # A is in N/mm, D in N mm
    }[chart]
    factors = [1e3, 1e-3] if chart == "units" else [1.0, 1.0]
    for name, expected in tensors(case, points).items():
        found = tensors(variant, images)[name] * np.reshape(factors, (2, 1, 1))
        np.testing.assert_allclose(found, change @ expected @ change, rtol=1e-8, err_msg=name)


@pytest.mark.parametrize("fabric", FABRICS)
def test_both_mechanics_stiffen_as_measured(fabric):
    """The energies are those of the printed curves, continued beyond their range; stresses and moduli are derivatives."""
    own = FABRICS[fabric]
    a11, a12, a22, shear = own.stiffnesses
    stiffening = {name: getattr(own, name)._asdict() for name in ("warp", "weft", "shear")}
    material = CLOTH | {"membrane": [a11, a12, a22, shear / 2], "stiffening": stiffening, "angle": 33.0}
    case = shell(material, OBLIQUE, theory="kirchhoff-love-nonlinear", loads=[])
    rng = np.random.default_rng(5)
    points, strains = rng.uniform(size=(20, 2)), rng.uniform(-0.5, 0.8, size=(20, 3))
    x, twice = case.surface.derivatives(points, 2), np.array([1.0, 1.0, 2.0])
    expected = []
    for a1, a2, e in zip(x[1, 0], x[0, 1], strains, strict=True):
        normal, dual = np.cross(a1, a2) / np.linalg.norm(np.cross(a1, a2)), np.linalg.pinv(np.stack([a1, a2]))
        d1 = Rotation.from_rotvec(np.radians(33.0) * normal).apply(a1 / np.linalg.norm(a1))
        d = np.stack([d1, np.cross(normal, d1)]) @ dual
        (e11, e12), (_, e22) = d @ e[[[0, 2], [2, 1]]] @ d.T
        both = [
            a / 2 * e**2 if e < 0 else a * curve(c, e)[0] for a, c, e in ((a11, own.warp, e11), (a22, own.weft, e22))
        ]
        expected.append(sum(both) + a12 * e11 * e22 + 2 * shear * curve(own.shear, abs(e12))[0])
    fem = stiffening_membrane(Midsurface.from_position(x), case.material).respond(strains)
    geometry = Undeformed.at_points(case.surface, points, Placement()).geometry
    ndf = by_differentiation(geometry, case.material).respond(torch.from_numpy(strains * twice))
    for mine, found, factor in zip(fem, ndf, (1.0, twice, np.outer(twice, twice)), strict=True):
        np.testing.assert_allclose(mine, found.numpy() * factor, rtol=1e-8, atol=1e-8 * np.abs(mine).max())
    np.testing.assert_allclose(fem[0], expected, rtol=1e-9)
    # at rest the moduli are the stiffnesses that a linear material has
    linear = tensors(shell(material | {"stiffening": None}, OBLIQUE), points)["fem"][:, 0]
    at_rest = stiffening_membrane(Midsurface.from_position(x), case.material).respond(0 * strains)[2]
    np.testing.assert_allclose(at_rest, linear, rtol=1e-9, atol=1e-9 * np.abs(linear).max())


MIRRORED = ((CLOTH, 0.0, True), (CLOTH, 90.0, True), (CLOTH, 30.0, False), (LAMINATE, 0.0, False), (LAYER, 30.0, False))


@pytest.mark.parametrize(("material", "angle", "mirrored"), MIRRORED)
def test_a_mirror_carries_the_material_into_itself_only_along_its_axes(material, angle, mirrored):
    case = shell(material | {"angle": angle})
    sight = ComparisonPoints.spread_over(case)
    for axis, at in ((0, 1.0), (1, 0.5)):
        assert (mirror_of(case, axis, at, sight) is not None) == mirrored


def silk(**curve):
    """A material whose three curves are the same, up to a strain of 0.5."""
    own = {"mu": [1.0], "alpha": [1.0], "until": 0.5} | curve
    return CLOTH | {"stiffening": dict.fromkeys(("warp", "weft", "shear"), own)}


def test_only_two_solvers_take_a_membrane_that_stiffens():
    case = shell(silk(), theory="kirchhoff-love-nonlinear", loads=[])
    taken = {name for name in solver_entries() if load_solver(find_solver(name)).declines(case) is None}
    assert taken == {"fem", "ndf-ritz"}


REFUSED = {
    "field 'material.kind': found 'woven', but it must be 'isotropic' or 'orthotropic'": LAYER | {"kind": "woven"},
    "'shear_modulus' is missing": {k: v for k, v in LAYER.items() if k != "shear_modulus"},
    "not both": LAYER | {"bending": CLOTH["bending"]},
    "both membrane and bending": {k: v for k, v in CLOTH.items() if k != "bending"},
    "must be below E1/E2": LAYER | {"poissons_ratio": 2.5},
    "not positive definite": CLOTH | {"bending": [1.0, 2.0, 1.0, 1.0]},
    "rows of a symmetric matrix": CLOTH | {"membrane": [[9e3, 1e3, 1.0], [1e3, 4e3, 0.0], [0.0, 0.0, 90.0]]},
    "'coupling' must be zero": CLOTH | {"coupling": [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]},
    "mu add up to 2": silk(mu=[1.0, 1.0], alpha=[1.0, 2.0]),
    "one alpha": silk(mu=[1.0], alpha=[1.0, 2.0]),
    "stiffness at the strain .* is not positive": silk(mu=[2.0, -1.0], alpha=[1.0, 9.0]),
    "the four membrane stiffnesses": silk() | {"membrane": LAMINATE["membrane"]},
    "theory 'kirchhoff-love-nonlinear' alone": silk(),
    "modulus_factor' is not known here": LAYER | {"modulus_factor": 2.0},
}


@pytest.mark.parametrize("words", REFUSED)
def test_a_material_that_is_none_is_refused_in_one_sentence(words):
    with pytest.raises(InputError, match=words) as refused:
        shell(REFUSED[words])
    assert "\n" not in str(refused.value)


def test_what_has_no_meaning_for_given_stiffnesses_is_refused():
    stress = {"name": "s", "kind": "stress", "side": "top", "component": "11", "on": ["middle"], "primary": True}
    more = {"points": {"middle": [0.5, 0.5]}, "quantities": [stress]}
    shell(LAYER, **more)
    with pytest.raises(InputError, match="a shell of given stiffnesses has none"):
        shell(CLOTH, **more)
    assert why_no_edit(shell(LAYER), shell(LAYER)) is None
    assert "orthotropic" in (why_no_edit(shell(LAYER), shell(LAYER | {"angle": 3.0})) or "")
    with pytest.raises(InputError, match="orthotropic"):
        catalog.variant_of(shell(LAYER), "naghdi")
    assert "orthotropic" in (CstSolver().declines(shell(LAYER)) or "")


@pytest.mark.parametrize(("parameter", "unit"), [("loads.1", "J"), ("surface.xi1_max", "J/m")])
def test_fem_gives_no_derivatives_of_orthotropic_shells(parameter, unit):
    """The adjoint's own strain energy is isotropic: a silent answer would be that of another shell."""
    asked = {"name": "slope", "kind": "derivative", "derivative_of": "strain_energy", "with_respect_to": parameter}
    asked["unit"] = unit
    energy = {"name": "strain_energy", "kind": "strain_energy", "primary": True}
    case = shell(LAYER, quantities=[energy, asked])
    assert "orthotropic" in FemSolver().declines_quantity(case, case.quantity("slope"))
