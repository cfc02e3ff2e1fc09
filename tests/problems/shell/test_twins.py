"""Twins: the same shell with normals that shear, on hard or soft supports; and the key `shear` of a support."""

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError
from shellbench.problems.shell.case import build_case

NAGHDI = "naghdi-linear"


def supported(theory, **more):
    data = catalog.named_case("square_plate").data()
    del data["name"]
    return build_case({**data, "theory": theory, "supports": [{**data["supports"][0], **more}]}, "plate", "plate.toml")


def test_a_hard_support_is_what_a_file_without_the_key_means():
    plain, hard, soft = (supported(NAGHDI, **more) for more in ({}, {"shear": "hard"}, {"shear": "soft"}))
    assert plain.digest() == hard.digest() != soft.digest()


def test_other_theories_refuse_the_key_in_a_sentence():
    with pytest.raises(InputError, match="support 'rim' says that its shear is soft, but normals shear in the theory"):
        supported("kirchhoff-love-linear", shear="soft")
    with pytest.raises(InputError, match="takes no components, clamp, motion or shear"):
        supported(NAGHDI, symmetry="x", shear="hard")


def test_a_twin_is_the_same_shell_in_the_other_theory():
    case, hard, soft = (catalog.named_case(f"scordelis_lo{end}") for end in ("", "@naghdi", "@naghdi_soft"))
    assert (hard.theory, hard.title) == (NAGHDI, "Scordelis-Lo roof, normals that shear")
    assert hard.digest() == hard.model_copy(update={"name": "other"}).digest()
    for name in ("surface", "material", "loads", "quantities", "remove_rigid_motions"):
        assert getattr(hard, name) == getattr(soft, name) == getattr(case, name)
    assert hard.supports == case.supports
    assert [support.shear for support in soft.supports] == ["soft"]
    assert (
        hard.digest()
        == catalog.named_case("scordelis_lo_naghdi")
        .without([])
        .model_copy(update={"quantities": hard.quantities})
        .digest()
    )


@pytest.mark.parametrize(
    ("name", "why"),
    [("pinched_cylinder_free@naghdi", "force at a point"), ("hemisphere_hole@naghdi", "force at a point"),
     ("square_plate_nonlinear@naghdi", "is linear here"), ("flag@naghdi", "it moves"),
     ("plate_modes@naghdi", "modes or buckling"), ("contact_plate@naghdi", "obstacles"),
     ("thick_plate_naghdi@naghdi", "shear already"), ("hypar_clamped_1e_2@naghdi_soft", "made soft")],
)  # fmt: skip
def test_cases_without_a_limit_have_no_twin(name, why):
    with pytest.raises(InputError, match=why):
        catalog.named_case(name)


def test_a_twin_has_known_values_and_tolerances_of_its_own():
    hard, soft = (catalog.known_values(f"scordelis_lo@{end}").judge("edge_deflection", NAGHDI)
                  for end in ("naghdi", "naghdi_soft"))  # fmt: skip
    assert soft.value - hard.value == pytest.approx(5.7065e-4, rel=1e-4)
    of_case = catalog.known_values("scordelis_lo")
    assert of_case.judge("edge_deflection", NAGHDI) is None
    assert catalog.known_values("scordelis_lo@oblique") == of_case
    assert catalog.known_values("annular_plate@naghdi").judge("rim_deflection", NAGHDI) is None
    assert catalog.tolerance("scordelis_lo@naghdi", "edge_deflection", "p-naghdi").relative == 1e-6
    assert catalog.tolerance("scordelis_lo", "edge_deflection", "p-naghdi") is None
    assert catalog.tolerance("scordelis_lo@naghdi", "edge_deflection", "fem") is None
    assert catalog.tolerance("scordelis_lo@oblique", "edge_deflection", "fem") is not None


def test_twins_are_never_drawn_as_variants():
    assert not any("@naghdi" in name for suite in ("variants", "shapes", "shape_variants")
                   for name in catalog.variants_asked(suite))  # fmt: skip
    assert "naghdi_limits" in catalog.suites_named_by("square_plate@naghdi_soft")


def test_files_of_twins_belong_to_twins():
    assert catalog.own_twins()
    for name in catalog.own_twins():
        assert catalog.named_case(name).theory == NAGHDI, name
