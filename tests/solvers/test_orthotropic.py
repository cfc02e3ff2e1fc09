"""Orthotropic shells: the tensors of both mechanics, what carries a case into itself, and what is refused."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.posed.mirrors import ComparisonPoints, mirror_of
from shellbench.problems.shell.quantities.resultant_quantities import material_axis, turned_tensor
from shellbench.problems.shell.variants.edit import why_no_edit
from shellbench.solvers.cst.elastic import Elastic
from shellbench.solvers.cst.settings import CstSettings
from shellbench.solvers.cst.solving import mesh_of_settings
from shellbench.solvers.fem.mechanics.kinematics import Midsurface, elasticities, stiffness_moduli
from shellbench.solvers.fem.solver import FemSolver
from shellbench.solvers.ndf.field.jets import Placement
from shellbench.solvers.ndf.published_solver import PublishedSolver
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


@pytest.mark.parametrize("along", ["xi1", "xi2"])
def test_triangles_have_the_membrane_of_the_material_and_hinges_its_cylinders(along):
    """Any uniform strain has its energy; a cylinder across one of 4 x 3 cells' interior lines folds 3/4 or 2/3 of them."""
    case = shell(LAMINATE | {"angle": 33.0, "along": along})
    elastic = Elastic.from_case(case, mesh_of_settings(case, CstSettings(cells=(4, 3))))
    strain = np.random.default_rng(2).normal(size=3)
    tensor = np.array([[strain[0], strain[2], 0], [strain[2], strain[1], 0], [0, 0, 0]])
    expected = 2.0 * energy_densities(case, np.zeros((1, 2)), strain[None], strain[None])[0][0]
    assert elastic.energies(elastic.rest @ tensor)[0] == pytest.approx(expected, rel=1e-12)
    for axis, share in ((0, 3 / 4), (1, 2 / 3)):
        bent = np.zeros_like(elastic.rest)
        bent[:, 2] = elastic.rest[:, axis] ** 2 / 2
        curvature = np.eye(3)[axis][None]
        expected = 2.0 * share * energy_densities(case, np.zeros((1, 2)), curvature, curvature)[1][0]
        assert elastic.energies(bent)[1] == pytest.approx(expected, rel=1e-9)


MIRRORED = ((CLOTH, 0.0, True), (CLOTH, 90.0, True), (CLOTH, 30.0, False), (LAMINATE, 0.0, False), (LAYER, 30.0, False))


@pytest.mark.parametrize(("material", "angle", "mirrored"), MIRRORED)
def test_a_mirror_carries_the_material_into_itself_only_along_its_axes(material, angle, mirrored):
    case = shell(material | {"angle": angle})
    sight = ComparisonPoints.spread_over(case)
    for axis, at in ((0, 1.0), (1, 0.5)):
        assert (mirror_of(case, axis, at, sight) is not None) == mirrored


REFUSED = {
    "field 'material.kind': found 'woven', but it must be 'isotropic' or 'orthotropic'": LAYER | {"kind": "woven"},
    "'shear_modulus' is missing": {k: v for k, v in LAYER.items() if k != "shear_modulus"},
    "not both": LAYER | {"bending": CLOTH["bending"]},
    "both membrane and bending": {k: v for k, v in CLOTH.items() if k != "bending"},
    "must be below E1/E2": LAYER | {"poissons_ratio": 2.5},
    "not positive definite": CLOTH | {"bending": [1.0, 2.0, 1.0, 1.0]},
    "rows of a symmetric matrix": CLOTH | {"membrane": [[9e3, 1e3, 1.0], [1e3, 4e3, 0.0], [0.0, 0.0, 90.0]]},
    "'coupling' must be zero": CLOTH | {"coupling": [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]},
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
    assert "orthotropic" in (PublishedSolver().declines(shell(LAYER)) or "")


@pytest.mark.parametrize(("parameter", "unit"), [("loads.1", "J"), ("surface.xi1_max", "J/m")])
def test_fem_gives_no_derivatives_of_orthotropic_shells(parameter, unit):
    """The adjoint's own strain energy is isotropic: a silent answer would be that of another shell."""
    asked = {"name": "slope", "kind": "derivative", "derivative_of": "strain_energy", "with_respect_to": parameter}
    asked["unit"] = unit
    energy = {"name": "strain_energy", "kind": "strain_energy", "primary": True}
    case = shell(LAYER, quantities=[energy, asked])
    assert "orthotropic" in FemSolver().declines_quantity(case, case.quantity("slope"))
