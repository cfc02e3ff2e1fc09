"""The gate of fields is tested: mistakes that solvers really make are injected, and each must turn a figure red.

A fault is put into the mechanics, a case is solved, and its values are judged as the gate does: by the known value and
the frozen tolerance. The same path without a fault is green.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.sparse import diags

from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.registry import load_solver, solver_entries
from shellbench.problems.field import body, solution, structure
from shellbench.problems.field.body import Ball, Prism, Torus
from shellbench.problems.field.case import Disc
from shellbench.solvers.field import basis, direct, energy, field, mesh, sampling, solver, training
from tests.injecting import exceeded, given, wrapped

SMALLER = {  # as right, and cheaper
    ("field_stretch", "grid"): {"resolution": 8},
    ("field_hang", "grid"): {"resolution": 8},
    ("field_hang", "grid-adaptive"): {"resolution": 8},
    ("field_drape", "grid"): {"resolution": 36},
    ("field_torus", "grid"): {"resolution": 36},
    ("field_prism", "grid"): {"resolution": 36},
    ("field_stretch", "vertex-mesh"): {"resolution": 8},
    ("field_hang", "vertex-mesh"): {"resolution": 24},
}
LONG = {
    "field_sine",
    "field_stretch",
    "field_hang",
    "field_ball",
    "field_drape",
    "field_torus",
    "field_prism",
    "field_disc",
} | {f"field_order_{name}" for name in ("grid", "positional", "plain")}
RUNS = sorted((case, name) for name, held in catalog.tolerances().items() for case in held if case.startswith("field_"))


def red(case: str, name: str) -> set[str]:
    return exceeded(case, load_solver(solver_entries()[name]), SMALLER.get((case, name), {}))


def expected(case: str, solver_name: str) -> set[str]:
    """Return the open findings: what is red without a fault, and red if it is not."""
    return {name for name, allowed in catalog.tolerances()[solver_name][case].items() if allowed.open_finding}


def marked(runs):
    return [pytest.param(*run, marks=[pytest.mark.long] if run[0] in LONG else []) for run in runs]


@pytest.mark.sampled(5)
@pytest.mark.parametrize(("case", "name"), marked(RUNS))
def test_without_a_fault_only_open_findings_are_red(case, name):
    assert red(case, name) == expected(case, name)


class Fault(NamedTuple):
    """A fault, the place where it must show, and the solver."""

    name: str
    case: str
    solver: str
    inject: Callable[[pytest.MonkeyPatch], None]


def instead(owner: Any, name: str, other: Any) -> Callable[[pytest.MonkeyPatch], None]:
    return lambda patch: patch.setattr(owner, name, other)


def unnormalised(cells: sampling.Cells) -> np.ndarray:
    return np.cumsum(cells.shares.sum(axis=1) / cells.shares.max())


def of_rows_alone(cells: sampling.Cells, row: int) -> np.ndarray:
    """The whole density's columns in the place of the row's."""
    return np.cumsum(cells.shares.sum(axis=0) / cells.shares.sum())


def not_above_zero(cells: sampling.Cells, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    rows = np.searchsorted(cells.marginal(), u)
    return rows, np.array([np.searchsorted(np.cumsum(cells.shares[r]), x) for r, x in zip(rows, v, strict=True)])


def leaking(case: Any, cells: int, degree: int) -> tuple[np.ndarray, np.ndarray]:
    """A pin whose last spline is free."""
    known, values = HELD(case, cells, degree)
    return known & (np.arange(len(known)) % (cells + degree) < cells + degree - 1)[:, None], values


def first_order(points: np.ndarray, cells: int, degree: int, orders: Any = (0, 0)) -> tuple[np.ndarray, np.ndarray]:
    """Features of the nearest node alone."""
    numbers, values = LOCAL(points, cells, degree, orders)
    return numbers, np.eye(values.shape[1])[values.argmax(axis=1)]


def short(self: mesh.Mesh, *given: Any, **named: Any) -> None:
    MESHED(self, *given, **named)
    self.lengths = 0.99 * self.lengths


HELD, LOCAL, MESHED = direct.pinned_coefficients, basis.local, mesh.Mesh.__init__
slower = given(training.Adam, "__init__", lambda self, tensors, rate: (self, tensors, rate / 20))
SINE, HANG, STRETCH, BEND = (
    ("field_sine", "grid"),
    ("field_hang", "grid"),
    ("field_stretch", "grid"),
    ("field_curvature", "grid"),
)
DRAWS, EMPTY = ("field_sampler", "inverse-transform"), ("field_empty_row", "inverse-transform")
DRAPE, MESH = ("field_drape", "grid"), ("field_hang", "vertex-mesh")
TORUS, PRISM, DISC = ("field_torus", "grid"), ("field_prism", "grid"), ("field_disc", "grid")
EIGHTH = np.array([[1, 1, 0], [-1, 1, 0], [0, 0, np.sqrt(2)]]) / np.sqrt(2)
LLOYD, BALL = ("field_lloyd", "inverse-transform"), ("field_ball", "nearest-vertex")
CELLS = sampling.Cells
FAULTS = (
    Fault("the second coordinate's splines are the first's", *SINE, given(direct, "evaluated", lambda f, p: (f, p[:, ::-1] ** 1.001))),
    Fault("a level weighs one percent more in the answer", *SINE, wrapped(field, "matrix", lambda m: 1.01 * m)),
    Fault("nearest node instead of interpolation", *SINE, instead(basis, "local", first_order)),
    Fault("derivatives lack the degree's factor", *BEND, wrapped(basis, "along", lambda m: m / 1.01)),
    Fault("a layer is missing", "field_count_positional", "mlp", instead(solver, "HIDDEN", 2)),
    Fault("the strain counts two edges", *STRETCH, instead(solution, "strain", lambda x, r: structure.strain(x, r) * 2 / 3)),
    Fault("the strain is not relative", *STRETCH, instead(solution, "strain", lambda x, r: structure.strain(x, r) * 1e-6)),
    Fault("bending counts the faces' edges twice", *BEND, instead(solution, "bend", lambda x: 2 * structure.bend(x))),
    Fault("bending leaves out a pair of faces", *BEND, instead(structure, "OUTER", structure.OUTER[:2])),
    Fault("outer corners are too near", *BEND, wrapped(solution, "corners", lambda at: np.concatenate(
        [at[:, :3], 0.95 * at[:, 3:] + 0.05 * at[:, :3].mean(axis=1, keepdims=True)], axis=1))),
    Fault("the side is halved", *BEND, given(solution, "corners", lambda p, a, side, n, past: (p, a, side / 2, n, past))),
    Fault("edges of minimised structures are twice as soft", *HANG, wrapped(
        energy, "stretch_loss", lambda found: tuple(part / 2 for part in found))),
    Fault("rest lengths are 1 % short", *HANG, given(energy, "stretch_loss", lambda edge, rest, convex: (edge, 0.99 * rest, convex))),
    Fault("gravity is taken at half the places", *HANG, wrapped(direct, "gauss", lambda found: (found[0] ** 1.05, found[1]))),
    Fault("samples near an edge weigh less than their area", *HANG, wrapped(direct, "gauss", lambda found: (
        found[0], found[1] * (1 - 0.1 * found[0][:, 1])))),
    Fault("a pin leaks", *HANG, instead(direct, "pinned_coefficients", leaking)),
    Fault("pins are a hundredth off", *STRETCH, wrapped(direct, "pinned_coefficients", lambda found: (found[0], 1.01 * found[1]))),
    Fault("samples follow the density though they are weighed", *HANG, instead(direct, "PLAYS", 3)),
    Fault("the marginal is not normalised", *DRAWS, instead(CELLS, "marginal", unnormalised)),
    Fault("columns are drawn from the whole density", *DRAWS, instead(CELLS, "conditional", of_rows_alone)),
    Fault("rows and columns change places", *DRAWS, given(CELLS, "__init__", lambda self, shares: (self, shares.T))),
    Fault("all points lie in the cells' corners above", *DRAWS, wrapped(CELLS, "draw", lambda found: np.minimum(found + 0.01, 0.999))),
    Fault("zero picks an empty row", *EMPTY, instead(CELLS, "pick", not_above_zero)),
    Fault("the search goes past equal numbers", *DRAWS, given(CELLS, "pick", lambda self, u, v: (self, u + 1e-12 + 0.01 * (u == 0.3), v))),
    Fault("relaxation moves points half the way too far", *LLOYD, instead(
        sampling, "relaxed_on_a_line", lambda places, steps: RELAXED(places, int(1.01 * steps)))),
    Fault("regions at the ends reach to the first point only", *LLOYD, instead(
        sampling, "relaxed_on_a_line", lambda places, steps: RELAXED(places, steps) + 1e-9)),
    Fault("the ball's push has the wrong sign", *DRAPE, wrapped(energy, "depth_loss", lambda found: (found[0], -found[1], found[2]))),
    Fault("the mean of corners collides, not their sum", *DRAPE, wrapped(
        energy, "depth_loss", lambda found: tuple(part / 6 for part in found))),
    Fault("penetration is measured on the wrong side", *DRAPE, wrapped(Ball, "distance", lambda found: -found)),
    Fault("the torus has no hole", *TORUS, given(body, "upright_axes", lambda angles: (0 * angles,))),
    Fault("the tube of the torus is a tenth thinner", *TORUS, wrapped(Torus, "from_core", lambda f: f._replace(distance=f.distance + 0.008))),
    Fault("the torus's normals point to its axis", *TORUS, wrapped(Torus, "contact", lambda f: (f[0], -f[1]))),
    Fault("the prism has sharp edges inside its rounded ones", *PRISM, wrapped(Prism, "from_core", lambda f: f._replace(distance=f.distance + 0.03))),
    Fault("the prism is turned by an eighth", *PRISM, given(Prism, "from_core", lambda self, x: (self, x @ EIGHTH))),
    Fault("the prism's sides end at a corner's distance", *PRISM, wrapped(body, "length", lambda far: 0.9 * far)),
    Fault("the rim is free", *DISC, wrapped(Disc, "level", np.ones_like)),
    Fault("the rim is a hundredth farther out", *DISC, given(Disc, "level", lambda self, p: (self, 0.5 + (p - 0.5) / 1.01))),
    Fault("samples of the disc weigh as if they were even", *DISC, wrapped(direct, "gauss_of_disc", lambda f: (f[0], 0 * f[1] + 1 / len(f[1])))),
    Fault("splines count without the disc's level in gravity", *DISC, instead(energy, "diags", lambda level: diags(np.ones_like(level)))),
    Fault("the disc's mesh has a square's rim", "field_disc", "vertex-mesh", given(
        mesh.Triangulation, "of", lambda columns, turn, disc: (columns, turn, None))),
    Fault("rest lengths of the mesh are 1 % short", *MESH, instead(mesh.Mesh, "__init__", short)),
    Fault("the mesh slips at its pins", *MESH, wrapped(mesh.Mesh, "span", lambda found: (found[0], found[1] + 1e-4))),
    Fault("the grid learns at a twentieth of its rate", "field_order_grid", "grid-printed", slower),
    Fault("the network learns at a twentieth of its rate", "field_order_positional", "mlp", slower),
    Fault("the plain network is encoded", "field_order_plain", "mlp", given(
        solver, "train_field", lambda case, own, form, *rest: (case, own, form | {"frequencies": 4}, *rest))),
    Fault("normals are turned", *BALL, instead(
        type(catalog.named_case("field_ball").body), "normals", property(lambda self: NORMALS(self)[:, [1, 2, 0]] * 0.999))),
)  # fmt: skip
RELAXED = sampling.relaxed_on_a_line
NORMALS = type(catalog.named_case("field_ball").body).normals.fget


def weighed_yet_biased(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(direct.SampleWeights, "__init__", lambda self, share, weighted, cells: self.__dict__.update(
        share=0.5, weighted=False, cells=cells))  # fmt: skip


FAULTS = tuple(f if "though they are weighed" not in f.name else f._replace(inject=weighed_yet_biased) for f in FAULTS)


@pytest.mark.parametrize(
    "fault",
    [pytest.param(f, id=f"{f.case}: {f.name}", marks=[pytest.mark.long] if f.case in LONG else []) for f in FAULTS],
)
def test_a_fault_is_red(fault, monkeypatch):
    fault.inject(monkeypatch)
    with np.errstate(all="ignore"):
        assert red(fault.case, fault.solver) != expected(fault.case, fault.solver)


def test_every_case_of_the_suite_has_a_fault():
    counts = {"field_count_plain", "field_count_grid", "field_count_vertices"}  # of which the fourth stands for all
    bridge = {case.name for case in catalog.cases_of("bridge")}  # of tests/test_bridge_faults.py
    assert {fault.case for fault in FAULTS} == {case for case, _ in RUNS} - counts - bridge
