"""The passport of a solver: stiffnesses from displacements."""

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest

from derivations import vibrating_strip
from derivations.heavy_strip import heavy, hung
from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.passport import PROPERTIES
from shellbench.report.studies.stiffnesses import FALL, gamma_of, passport, peirce_excess


def rows(case, values, run_id="one", overrides=None, unknowns=100, doubts=None):
    judges = catalog.known_values(case)
    theory = catalog.named_case(case).theory
    return [
        SimpleNamespace(
            case=case,
            run_id=run_id,
            quantity=name,
            value=value,
            reference=judges.judge(name, theory).value,
            uncertainty=(doubts or {}).get(name),
            overrides=overrides or {},
            parameters=unknowns,
            reason=None,
        )
        for name, value in values.items()
    ]


CASES = ("swatch", "heavy_cantilever", "woven_swatch", "woven_cantilever_warp", "woven_cantilever_weft", "woven_bias_strip",
         "strip_on_edge_1_20", "vibrating_strip", "free_fall")  # fmt: skip


def known(case):
    return {v.quantity: v.value for v in catalog.known_values(case).values if v.role == "judge"}


def by_name(entries):
    return {entry.of.name: entry for entry in entries}


@pytest.mark.parametrize(("gamma", "shape"), [(1, 0.12456177), (10, 1.06680232), (100, 5.88810462), (1000, 21.3354405)])
def test_the_master_curve_goes_through_figures_of_another_integration(gamma, shape):
    assert gamma_of(shape) == pytest.approx(gamma, rel=3e-7)


def test_peirces_formula_reads_too_much():
    """c = .4999 L where the chord falls by 41.5 degrees, and .5093 L by the formula."""
    assert gamma_of(math.tan(FALL)) ** (-1 / 3) == pytest.approx(0.4999, abs=5e-5)
    assert peirce_excess() == pytest.approx((0.5093 / 0.4999) ** 3, rel=5e-4)


def test_known_values_are_the_material_itself():
    for case in CASES:
        found = by_name(passport(rows(case, known(case))))
        mine = [one.name for one in PROPERTIES if one.case == case]
        expected = [peirce_excess() if "peirce" in name else 1.0 for name in mine]
        assert [found[name].ratio for name in mine] == pytest.approx(expected, abs=1e-12)
        assert all(found[one.name].ratio is None for one in PROPERTIES if one.case != case)


def test_a_strip_of_another_stiffness_is_found_out_at_each_weight():
    """The strip keeps its weight, so that its own Gamma is less; the values are from derivations, not from a solver.

    The effect of its stretch on H / W, 1e-5, is that of another Gamma, and cancels in part.
    """
    strip, stiffer = heavy(), 1.3
    values = {}
    for gamma in (10, 100):
        bent = hung(replace(strip, young=stiffer * strip.young), gamma / stiffer, 1e-9)
        values |= {f"drop_{gamma}": bent.drop, f"shortening_{gamma}": 1 - bent.reach}
    found = by_name(passport(rows("heavy_cantilever", values)))
    assert [found[f"bending_{gamma}"].ratio for gamma in (10, 100)] == pytest.approx([stiffer] * 2, rel=1e-4)
    assert found["bending_1"].ratio is None


def test_a_strip_that_vibrates_tells_its_stiffness(monkeypatch):
    monkeypatch.setattr(vibrating_strip, "BENDING", 1.3 * vibrating_strip.BENDING)
    values = {name: estimate.value for name, estimate in vibrating_strip.vibrating_strip().items()}
    found = by_name(passport(rows("vibrating_strip", values)))["bending_in_motion"]
    assert found.ratio == pytest.approx(1.3, rel=1e-6)


def test_a_swatch_tells_its_stiffnesses_apart():
    values = known("swatch")
    values = values | {"twist": values["twist"] / 3, "stretch": values["stretch"] * 2}
    found = by_name(passport(rows("swatch", values)))
    assert found["twist"].ratio == pytest.approx(3)
    assert found["stretch"].ratio == pytest.approx(0.5)
    assert found["poisson"].ratio == pytest.approx(0.5)
    assert found["shear"].ratio == pytest.approx(1)


def test_the_finest_mesh_counts_and_tells_its_doubt_and_other_settings_stand_beside():
    exact = known("swatch")
    coarse = rows("swatch", exact | {"twist": exact["twist"] / 1.5}, "coarse", {"cells": [4, 4]}, 10)
    fine = rows("swatch", exact | {"twist": exact["twist"] / 1.4}, "fine", {"cells": [8, 8]}, 40)
    cut = rows("swatch", exact | {"twist": exact["twist"] / 2}, "cut", {"cells": [8, 8], "diagonal": "left"}, 40)
    found = by_name(passport([*fine, *cut, *coarse]))["twist"]
    assert found.ratio == pytest.approx(1.4)
    assert found.doubt == pytest.approx(0.1)
    assert found.others == {"diagonal=left": pytest.approx(2)}
    stated = rows("swatch", exact, doubts={"twist": 1e-3 * exact["twist"]})
    assert by_name(passport(stated))["twist"].doubt == pytest.approx(1e-3, rel=1e-2)


def test_a_shape_that_no_strip_has_is_no_stiffness():
    values = known("heavy_cantilever") | {"drop_10": -0.1}
    assert by_name(passport(rows("heavy_cantilever", values)))["bending_10"].ratio is None
