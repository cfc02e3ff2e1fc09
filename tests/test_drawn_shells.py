"""Drawn shells: the load of each is that of its answer, supports included, and its stated uncertainties suffice."""

import tomllib
from functools import cache

import numpy as np
import pytest

from derivations.drawn_shells import COUNT, FAMILIES, RIMS, SURE, as_toml, drawn, response, with_load
from derivations.manufactured_splines import residuals
from shellbench.problems.shell.case import Case, read_case

SEEDS = (1, 5, 8, 11, 14)  # each surface and each kind of rim once or more
SOME = [*SEEDS[:2], *(pytest.param(seed, marks=pytest.mark.long) for seed in SEEDS[2:])]
ALLOWED = {
    "clamped": "(1 - {x}**2)**2",
    "hinged": "(1 - {x}**2)",
    "free": "1",
}  # what a virtual displacement has at ends


@cache
def made(seed):
    return with_load(drawn(seed), f"drawn_{seed}")


def virtual(seed):
    """Displacements that the supports allow: those of hinged edges turn there, those of free edges move."""
    rim = RIMS[seed // len(FAMILIES) % len(RIMS)]
    ends = ("clamped", "free") if rim == "two free" else (rim, rim)
    factor = "*".join(ALLOWED[end].format(x=f"xi{k + 1}") for k, end in enumerate(ends))
    return [
        (f"{factor}*exp(xi1)", f"{factor}*xi1*cos(2*xi2)", f"{factor}*sin(3*xi1 + xi2)"),
        (f"{factor}*xi2", f"{factor}*(1 + xi1)", f"{factor}*exp(xi2 - xi1)"),
    ]


def test_surfaces_and_rims_are_all_drawn():
    shells = [drawn(seed) for seed in range(COUNT)]
    assert COUNT >= 40
    assert {(seed % len(FAMILIES), seed // len(FAMILIES) % len(RIMS)) for seed in range(COUNT)} == {
        (family, rim) for family in range(len(FAMILIES)) for rim in range(len(RIMS))
    }
    assert len({one["surface"]["z"] for one in shells}) > COUNT / 2
    assert drawn(7) == shells[7]
    thin = [one["material"]["thickness"] for one in shells]
    assert min(thin) < 0.015 < 0.07 < max(thin)


@pytest.mark.parametrize("seed", SOME)
def test_the_answer_is_in_balance_with_the_load_at_edges_too(seed):
    """By the weak form: no clamp, hinge or free edge asks for a force or a moment that is not there."""
    case, data = made(seed)
    assert np.abs(residuals(case, virtual(seed))).max() < 1e-10
    vector = data["loads"][0]["vector"]
    more = data | {"loads": [{"kind": "area", "vector": [*vector[:2], f"1.001*({vector[2]})"]}]}
    changed = Case.model_validate(more | {"name": case.name})
    assert np.abs(residuals(changed, virtual(seed))).max() > 1e-6


@pytest.mark.parametrize("seed", SOME)
def test_what_the_load_misses_is_covered(seed):
    """A load that is a millionth too large has an answer that is: the bound is no less."""
    case, data = made(seed)
    assert response(case) < 1e-8
    more = [f"{1 + 1e-6!r}*({component})" for component in data["loads"][0]["vector"]]
    larger = data | {"loads": [{"kind": "area", "vector": more}]}
    assert response(Case.model_validate(larger | {"name": case.name})) > 1e-6
    known = {one["quantity"]: one for one in data["known"]}
    largest = known["largest_displacement"]
    assert largest["uncertainty"] >= SURE * response(case) * largest["value"] * (1 - 1e-12)
    assert known["field_error"]["value"] == 0.0


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", SEEDS)
def test_the_file_is_the_case(tmp_path, seed):
    case, data = made(seed)
    path = tmp_path / f"drawn_{seed}.toml"
    path.write_text(as_toml(data), encoding="utf-8")
    assert tomllib.loads(path.read_text(encoding="utf-8")) == data
    read = read_case(path)
    assert read.digest() == case.digest()
    assert {one.quantity for one in read.known} == {quantity.name for quantity in read.quantities}


@pytest.mark.parametrize("seed", SEEDS)
def test_both_parts_of_the_energy_count(seed):
    known = {one["quantity"]: one["value"] for one in made(seed)[1]["known"]}
    assert 0.01 < known["bending_energy"] / known["strain_energy"] < 0.9
    assert known["membrane_energy"] + known["bending_energy"] == pytest.approx(known["strain_energy"], rel=1e-12)
