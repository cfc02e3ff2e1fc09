"""Files of fields: what is wrong with them is one sentence; what solutions measure, and what survives a file."""

from types import SimpleNamespace

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.registry import load_solver, solver_entries
from shellbench.errors import InputError
from shellbench.problems.field.case import FieldCase
from shellbench.problems.field.quantities import Folds
from shellbench.problems.field.structure import bend, corners, lattice, strain


def data(name, **changes):
    return {key: value for key, value in catalog.named_case(name).data().items() if key != "name"} | changes


def asked(**fields):
    return [{"name": "asked", "primary": True, **fields}]


HANG, SINE, DRAWS = "field_hang", "field_sine", "field_sampler"
CLOTH = data(HANG)["cloth"]


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (data(SINE, match={"function": [0, 0, "__import__('os')"]}), "field 'match.function.2'"),
        (data(SINE, match={"function": [0, 0, "log(u - 0.5)"]}), "field 'match.function' is not finite at u = 0.01, v = 0.01"),
        (data(SINE, match={"function": [0, 0, "x"]}), "uses the unknown name 'x'"),
        (data(SINE, match={"function": [0, 0]}), "field 'match.function.2' is missing"),
        (data(SINE, pins=[{"on": ["u_min"]}]), "only a field of local structures has pins"),
        (data(SINE, density=data(DRAWS)["density"]), "theory 'fit' has no table 'density'"),
        (data(SINE, theory="local-structures"), "theory 'local-structures' needs the table 'cloth'"),
        (data(SINE, quantities=asked(kind="strain")), "quantity 'asked' needs the table 'cloth'"),
        (data(SINE, quantities=asked(kind="mean", axis="u")), "quantity 'asked' can't be asked with theory 'fit'"),
        (data(SINE, quantities=asked(kind="value", point=[0.5, 1.5], axis="z")), "found 1.5, but it must be less than or equal to 1"),
        (data(HANG, cloth=CLOTH | {"side": 0.5}), "found 0.5, but it must be less than 0.5"),
        (data(HANG, cloth=CLOTH | {"strain": -1.0}), "found -1.0, but it must be greater than or equal to 0"),
        (data(HANG, cloth=CLOTH | {"collision": 2.0}), "a body and a positive 'cloth.collision' go together"),
        (data(HANG, body={"radius": 0.2}), "a body and a positive 'cloth.collision' go together"),
        (data(HANG, quantities=asked(kind="penetration")), "quantity 'asked' needs the table 'body'"),
        (data(HANG, pins=[{}]), "a pin needs edges ('on') or points ('at')"),
        (data("field_ball", body={"radius": 0.2}), "theory 'nearest-vertex' needs 'body.vertices'"),
        (data(HANG, pins=[{"on": ["top"]}]), "found 'top'"),
        (data(HANG, pins=[{"on": ["rim"]}]), "only a disc has a rim: the table 'disc' is missing"),
        (data("field_disc", pins=[{"on": ["rim"], "displacement": [0, 0, 0.1]}]), "its only pin holds the 'rim' where it is"),
        (data("field_torus", body={"kind": "torus", "ring": 0.1, "tube": 0.1}), "'body.tube' is 0.1, but it must be smaller than"),
        (data("field_prism", body={"kind": "cube", "radius": 0.1}), "found 'cube', but it must be 'ball', 'torus' or 'prism'"),
        (data(DRAWS, density={"cells": [[1, 2], [3]]}), "the rows of 'cells' differ in length"),
        (data(DRAWS, density={"cells": [[0.0]]}), "the sum of 'cells' must be positive"),
        (data(DRAWS, density={"cells": [[-1.0]]}), "found -1.0, but it must be greater than or equal to 0"),
        (data(DRAWS, density={"cells": [[1, 1]], "points": "quantiles"}), "quantiles need one column in 'cells', but there are 2"),
        (data(DRAWS, quantities=asked(kind="cumulative", row=3, column=1)), "is of a cell beyond 2 rows and 2 columns"),
        (data("field_ball", body={"radius": 0.2, "vertices": 3}), "found 3, but it must be greater than or equal to 4"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_one_sentence(wrong, words):
    with pytest.raises(InputError) as caught:
        FieldCase.build(wrong, "wrong", "wrong.toml")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


RANDOM = np.random.default_rng(5)
POINTS, ANGLES = RANDOM.random((50, 2)), RANDOM.random(50)


def test_structures_are_equilateral_and_fit():
    for count in (3, 6):
        at = corners(POINTS, ANGLES, 0.1, count)
        assert at.min() >= 0
        assert at.max() <= 1
        faces = ((0, 1, 2), (2, 1, 3), (0, 2, 4), (1, 0, 5))
        for face in faces if count == 6 else faces[:1]:
            for one, other in ((0, 1), (1, 2), (2, 0)):
                assert np.linalg.norm(at[:, face[one]] - at[:, face[other]], axis=1) == pytest.approx(0.1, abs=1e-12)
    inside = np.array([[0.5, 0.5]])
    assert corners(inside, np.zeros(1), 0.1).mean(axis=1) == pytest.approx(inside, abs=1e-15)


def rotation():
    found, _ = np.linalg.qr(RANDOM.normal(size=(3, 3)))
    return found * np.sign(np.linalg.det(found))


def test_rigid_motions_neither_strain_nor_bend():
    at = corners(POINTS, ANGLES, 0.1)
    rest = np.concatenate([at, np.zeros((*at.shape[:2], 1))], axis=2)
    turn, shift = rotation(), RANDOM.normal(size=3)
    assert strain(rest @ turn.T + shift, rest) == pytest.approx(0, abs=1e-24)
    assert bend(rest @ turn.T + shift) == pytest.approx(0, abs=1e-24)
    curved = rest + np.stack([0 * at[..., 0], 0 * at[..., 0], np.sin(3 * at[..., 0]) * at[..., 1]], axis=-1)
    assert strain(curved @ turn.T + shift, rest) == pytest.approx(strain(curved, rest), rel=1e-10)
    assert bend(curved @ turn.T + shift) == pytest.approx(bend(curved), rel=1e-10)


@pytest.mark.parametrize(("name", "solver"), [("field_curvature", "grid"), ("field_sampler", "inverse-transform")])
def test_an_answer_survives_its_file(name, solver, tmp_path):
    case, own = catalog.named_case(name), load_solver(solver_entries()[solver])
    answer = own.solve(case, {"resolution": 4} if solver == "grid" else {})
    again = own.load(answer.save(tmp_path / "answer"))
    assert again.case.digest() == case.digest()
    for quantity in case.quantities:
        assert quantity.measure(again) == quantity.measure(answer)
    (tmp_path / "none.safetensors").write_bytes(b"nothing")
    with pytest.raises(InputError, match="holds no answer about a field"):
        own.load(tmp_path / "none.safetensors")


@pytest.mark.parametrize(
    ("solver", "case", "words"),
    [
        ("grid", "square_plate", "it solves problems of kind 'field'"),
        ("grid", "field_count_plain", "asks for the network 'plain'"),
        ("mlp", "field_count_grid", "asks for the network 'grid'"),
        ("grid-printed", "field_stretch", "here pins move"),
        ("grid-adaptive", "field_sine", "theory local-structures only"),
    ],
)
def test_what_a_solver_cant_take_it_declines(solver, case, words):
    assert words in load_solver(solver_entries()[solver]).declines(catalog.named_case(case))


def test_a_lattice_has_midpoints():
    assert lattice(2) == pytest.approx(np.array([[0.25, 0.25], [0.25, 0.75], [0.75, 0.25], [0.75, 0.75]]))


def test_the_depth_in_a_body_is_exact():
    """All points are moved to one place, so deep below the ball's surface."""
    case = catalog.named_case("field_drape")
    for depth, known in ((0.05, 0.05), (0.0, 0.0), (-0.1, 0.0)):
        place = np.add(case.body.centre, [0.0, 0.0, case.body.radius - depth])
        sunk = SimpleNamespace(case=case, displacement=lambda p, place=place: place - case.rest(p))
        assert next(q for q in case.quantities if q.kind == "penetration").measure(sunk) == pytest.approx(
            known, abs=1e-12
        )


@pytest.mark.parametrize("along", [0.0, 30.0, 75.0])
@pytest.mark.parametrize("down", [1.0, -1.0])
def test_folds_are_lines_of_no_curvature(along, down):
    """Parallel folds have all their harmonics along themselves, whether they are ridges or valleys."""
    angle = np.radians(along)
    across = [-np.sin(angle), np.cos(angle)]
    case = SimpleNamespace(rest=lambda p: np.column_stack([p, np.zeros(len(p))]))
    folded = SimpleNamespace(
        case=case, displacement=lambda p: down * np.outer(0.01 * np.cos(20 * p @ across), [0.0, 0.0, 1.0])
    )
    for order in (2, 6):
        wave = Folds(name="a", kind="folds", primary=True, order=order, along=along, lattice=40)
        assert wave.measure(folded) == pytest.approx(1, abs=1e-2)
        turned = wave.model_copy(update={"along": along + 180 / order})
        assert turned.measure(folded) == pytest.approx(-1, abs=1e-2)
