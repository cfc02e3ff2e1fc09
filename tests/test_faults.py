"""The gate itself is tested: mistakes that solvers really make are injected, and each must turn it red.

A fault is put into one solver's mechanics (or into what both are given), the case is solved as `shellbench run` would,
and the record is judged as `shellbench gate` would. The same path without a fault is green.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.expected import Scope
from shellbench.bench.judge.gate import Verdict, gate
from shellbench.bench.judge.lock import LockCheck
from shellbench.bench.plugins.kinds import find_kind, kind_name
from shellbench.bench.run import worker
from shellbench.bench.run.plan import Request, make_plan
from shellbench.bench.store import measuring
from shellbench.bench.store.store import Store
from shellbench.bench.store.task import Task
from shellbench.problems.shell.question.conditions import Material
from shellbench.solvers.fem import solving
from shellbench.solvers.fem.mechanics import constraints, kinematics
from shellbench.solvers.fem.mechanics import loads as fem_loads
from shellbench.solvers.fem.mesh import quadrature
from shellbench.solvers.ndf.field import factors, field, geometry, jets, network
from shellbench.solvers.ndf.linear import refinement, static
from shellbench.solvers.ndf.strains import energy
from tests.injecting import wrapped

PLATE, ROOF, PINCHED, RING = "square_plate", "scordelis_lo", "pinched_cylinder_diaphragm", "annular_plate"
WARPED = "square_plate@warped"  # curved coordinate lines, as the ring has them, at a third of its cost


def solve_and_keep(task: Task, store: Store) -> None:
    """Make a run as the bench does, and keep it, but for what stands beside its values: no gate looks at that."""
    bare = replace(find_kind(kind_name(task.case)), accounts={}, studies={})
    folder = store.begin(task.run_id)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(measuring, "find_kind", lambda name: bare)
        store.commit(folder, worker.run(task, folder, lambda _: None))


def accuracy_gate(store: Store, scope: Scope) -> Verdict:
    """Judge accuracy alone: the lock, for which all cases and variants are read, is tested elsewhere."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("shellbench.bench.judge.gate.check_lock", lambda *_: LockCheck(0, 0))
        return gate(store, None, scope)


def findings(store: Store, solver: str, case: str):
    """Solve, and return what the accuracy gate makes of the case."""
    tasks = make_plan(Request((case,), (), (solver,), {}, (0,)), store.read()).tasks
    declined = not tasks
    if declined:  # a gate of a suite then misses the row; it wants a store that is not empty
        assert solver != "fem"
        tasks = make_plan(Request((PLATE,), (), ("fem",), {}, (0,)), store.read()).tasks
    for task in tasks:
        solve_and_keep(task, store)
    suites = catalog.named_case(case).suites[:1] if declined else ()
    verdict = accuracy_gate(store, Scope(suites, (solver,), (0,)))
    found = [finding for finding in verdict.accuracy if finding.row.case == case]
    assert found
    return found


class Fault(NamedTuple):
    """A fault, its side, and the place where it must show."""

    name: str
    solver: str
    case: str
    inject: Callable[[pytest.MonkeyPatch], None]


def stiffness(name: str, factor: float) -> Callable[[pytest.MonkeyPatch], None]:
    """Scale one stiffness of the material."""

    def inject(patch: pytest.MonkeyPatch) -> None:
        value = getattr(Material, name).fget
        patch.setattr(Material, name, property(lambda self: factor * value(self)))

    return inject


def without(array, *rows: int):
    """Drop strain rows (axis 1)."""
    array[:, list(rows)] = 0.0
    return array


def scaled(array, factor: float, *rows: int):
    """Scale strain rows (axis 1)."""
    array[:, list(rows)] *= factor
    return array


def flipped_normal_turn(operator):
    """Flip the sign of delta a3 in the bending strains."""
    operator[:, 3:, :, :2] *= -1.0
    return operator


def flipped_christoffel(rows):
    """Flip the sign of the Christoffel terms in the bending strains."""
    rows[:, 3:, :, jets.D1 : jets.D2 + 1] *= -1.0
    return rows


def only_three_edges(patch: pytest.MonkeyPatch) -> None:
    original = constraints.support_conditions
    patch.setattr(constraints, "support_conditions", lambda *args: list(original(*args))[:-1])


def leaking_slope(patch: pytest.MonkeyPatch) -> None:
    original = constraints._slope_conditions

    def leaking(*args):
        rows, values = original(*args)
        return rows[:, 1:], values[:, 1:]

    patch.setattr(constraints, "_slope_conditions", leaking)


def clamped_too(patch: pytest.MonkeyPatch) -> None:
    original = constraints.support_conditions

    def stiffer(case, mesh, states):
        supports = tuple(s.model_copy(update={"clamped": True}) for s in case.supports)
        return original(case.model_copy(update={"supports": supports}), mesh, states)

    patch.setattr(constraints, "support_conditions", stiffer)


def reduced_integration(patch: pytest.MonkeyPatch) -> None:
    original = quadrature.Quadrature.of_order.__func__
    patch.setattr(quadrature.Quadrature, "of_order", classmethod(lambda cls, mesh, order: original(cls, mesh, 3)))


def halved_nodal_forces(patch: pytest.MonkeyPatch) -> None:
    original = fem_loads.Loading.on_mesh.__func__

    def halved(cls, *args):
        loading = original(cls, *args)
        return replace(loading, nodal=loading.nodal / 2)

    patch.setattr(fem_loads.Loading, "on_mesh", classmethod(halved))


def wrong_metric(patch: pytest.MonkeyPatch) -> None:
    original = kinematics.Midsurface.contravariant_metric.fget
    patch.setattr(kinematics.Midsurface, "contravariant_metric", property(lambda self: 1.01 * original(self)))


def leaking_factor(patch: pytest.MonkeyPatch) -> None:
    original = factors.edge_factor

    def leaking(domain, edges, even, points, placement):
        kept = {edge for edge in edges if edge.name != "xi2_max"}
        return original(domain, kept, even, points, placement)

    patch.setattr(factors, "edge_factor", leaking)


def clamping_factor(patch: pytest.MonkeyPatch) -> None:
    original = factors.edge_factor

    def clamping(*args):
        factor = original(*args)
        return jets.product(factor, factor)

    patch.setattr(factors, "edge_factor", clamping)


def three_points_a_side(patch: pytest.MonkeyPatch) -> None:
    original, coarse = static.part_resolution, {"panels": (1, 1), "order": 3}

    def exploited(case, mirrors):
        usual = original(case, mirrors)
        return replace(usual, rule=replace(usual.rule, **coarse))

    patch.setattr(static, "part_resolution", exploited)


def without_mixed_derivative(patch: pytest.MonkeyPatch) -> None:
    original = jets.compose

    def broken(derivatives, z):
        jet = original(derivatives, z).clone()
        jet[jets.D12] = 0.0
        return jet

    for module in (field, network):
        patch.setattr(module, "compose", broken)


def flat_christoffel(patch: pytest.MonkeyPatch) -> None:
    original = geometry.geometry

    def flat(*args):
        found = original(*args)
        return replace(found, christoffel=found.christoffel * 0.0)

    patch.setattr(energy, "geometry", flat)


def more_poisson(patch: pytest.MonkeyPatch, module, name: str) -> None:
    original = getattr(module, name)
    patch.setattr(module, name, lambda surface, nu: original(surface, nu + 0.05))


FAULTS = [
    Fault("wrong Poisson ratio", "fem", ROOF, lambda p: more_poisson(p, kinematics, "elasticity")),
    Fault("bending stiffness 0.1 % off", "fem", PLATE, stiffness("bending_stiffness", 1.001)),
    Fault("membrane stiffness 0.1 % off", "fem", ROOF, stiffness("membrane_stiffness", 1.001)),
    Fault("no twisting term", "fem", PLATE, wrapped(kinematics, "strain_operator", lambda b: without(b, 5))),
    Fault("no bending", "fem", ROOF, wrapped(kinematics, "strain_operator", lambda b: scaled(b, 1e-3, 3, 4, 5))),
    Fault("half the membrane shear", "fem", ROOF, wrapped(kinematics, "strain_operator", lambda b: scaled(b, 0.5, 2))),
    Fault("flipped turn of the normal", "fem", RING, wrapped(kinematics, "strain_operator", flipped_normal_turn)),
    Fault("wrong metric", "fem", ROOF, wrong_metric),
    Fault("halved load", "fem", PLATE, halved_nodal_forces),
    Fault("slopes held too", "fem", PLATE, clamped_too),
    Fault("clamps that leak", "fem", RING, leaking_slope),
    Fault("an edge forgotten", "fem", PLATE, only_three_edges),
    Fault("reduced integration", "fem", ROOF, reduced_integration),
    Fault("wrong Poisson ratio", "ndf-ritz", ROOF, lambda p: more_poisson(p, geometry, "elasticity_tensor")),
    Fault("bending stiffness 0.1 % off", "ndf-ritz", PLATE, stiffness("bending_stiffness", 1.001)),
    Fault("membrane stiffness 0.1 % off", "ndf-ritz", ROOF, stiffness("membrane_stiffness", 1.001)),
    Fault("no twisting term", "ndf-ritz", PLATE, wrapped(geometry, "strain_rows", lambda b: without(b, geometry.K12))),
    Fault(
        "half the membrane shear",
        "ndf-ritz",
        ROOF,
        wrapped(geometry, "strain_rows", lambda b: scaled(b, 0.5, geometry.E12)),
    ),
    Fault("flipped Christoffel symbols", "ndf-ritz", WARPED, wrapped(geometry, "strain_rows", flipped_christoffel)),
    Fault("halved load", "ndf-ritz", ROOF, wrapped(energy, "force_density", lambda f: f / 2)),
    Fault("load on a flat area", "ndf-ritz", ROOF, wrapped(energy, "force_density", lambda f: f / 25)),
    Fault("a leaking support", "ndf-ritz", PLATE, leaking_factor),
    Fault("a clamping factor", "ndf-ritz", PLATE, clamping_factor),
    Fault("an exploited quadrature", "ndf-ritz", ROOF, three_points_a_side),
    Fault("a missing mixed derivative", "ndf-ritz", PLATE, without_mixed_derivative),
    Fault("wrong Poisson ratio", "ndf", ROOF, lambda p: more_poisson(p, geometry, "elasticity_tensor")),
    Fault("halved load", "ndf", PLATE, wrapped(energy, "force_density", lambda f: f / 2)),
    Fault("a leaking support", "ndf", PLATE, leaking_factor),
]
LONG_FAULTS = [
    Fault("flipped Christoffel symbols", "ndf-ritz", RING, wrapped(geometry, "strain_rows", flipped_christoffel)),
    Fault("no Christoffel symbols", "ndf-ritz", RING, flat_christoffel),
    Fault("flipped Christoffel symbols", "ndf", RING, wrapped(geometry, "strain_rows", flipped_christoffel)),
    Fault("halved point loads", "fem", PINCHED, halved_nodal_forces),
    Fault("halved point loads", "ndf-ritz", PINCHED, wrapped(energy, "concentrated_forces", lambda f: (f[0], f[1] / 2))),
    Fault("wrong Poisson ratio", "fem", PINCHED, lambda p: more_poisson(p, kinematics, "elasticity")),
    Fault("one load forgotten", "ndf-ritz", PINCHED, wrapped(energy, "concentrated_forces", lambda f: (f[0][:1], f[1][:1]))),
]  # fmt: skip


LONG_EARLY = {  # fields take longest; each fault of these has a quicker sister
    ("ndf-ritz", "bending stiffness 0.1 % off"),  # of `fem`, and of `ndf-ritz` at finite strain
    ("ndf-ritz", "a missing mixed derivative"),  # no twisting term, and jets beside differences
    ("ndf-ritz", "an exploited quadrature"),  # tests/solvers/ndf/test_energy.py: the certificate detects it
    ("ndf-ritz", "a clamping factor"),  # a leaking support
    ("ndf-ritz", "wrong Poisson ratio"),
    ("ndf-ritz", "membrane stiffness 0.1 % off"),
    ("ndf-ritz", "halved load"),
    ("ndf-ritz", "half the membrane shear"),
    ("ndf-ritz", "load on a flat area"),
    ("ndf", "wrong Poisson ratio"),
}
LONG_GREEN = {("ndf", RING), ("ndf-ritz", RING), ("ndf", ROOF), ("ndf-ritz", ROOF), ("ndf-ritz", WARPED)}
FEW_UNKNOWNS = 20_000  # `fem` settles on fewer where nothing is wrong


def stop_early(patch: pytest.MonkeyPatch) -> None:
    """Let `ndf-ritz` answer by its first level, and `fem` by a mesh where right answers have long settled."""
    patch.setattr(refinement, "WIDTHS", refinement.WIDTHS[:1])
    patch.setattr(solving, "MOST_UNKNOWNS", FEW_UNKNOWNS)


def test_there_are_enough_faults_on_either_side():
    assert len(FAULTS) >= 20
    assert {fault.solver for fault in FAULTS} == {"fem", "ndf", "ndf-ritz"}
    assert len({(fault.name, fault.solver) for fault in FAULTS}) == len(FAULTS)


CASES_SOLVED = [(solver, case) for solver in ("fem", "ndf-ritz", "ndf") for case in (PLATE, ROOF, RING)]
CASES_SOLVED.append(("ndf-ritz", WARPED))


@pytest.mark.parametrize(
    ("solver", "case"),
    [pytest.param(*pair, marks=[pytest.mark.long] if pair in LONG_GREEN else []) for pair in CASES_SOLVED],
)
def test_without_a_fault_the_gate_is_green(solver, case, tmp_path, monkeypatch):
    stop_early(monkeypatch)
    must_be_green(solver, case, tmp_path)


def must_be_green(solver: str, case: str, folder) -> None:
    found = findings(Store(folder), solver, case)
    assert all(finding.colour == "green" for finding in found), [finding.sentence for finding in found]


def must_be_red(fault: Fault, folder, patch: pytest.MonkeyPatch) -> None:
    fault.inject(patch)
    found = findings(Store(folder), fault.solver, fault.case)
    assert any(finding.colour == "red" for finding in found), [finding.sentence for finding in found]
    for finding in found:
        if finding.row.status == "ok":
            assert np.isfinite(finding.row.value)


def gate_tests(faults: Iterable[Fault], patch_first: Callable[[pytest.MonkeyPatch], None] = lambda patch: None):
    """Return two long tests: each fault turns the gate red, and what is solved is green without one."""

    @pytest.mark.long
    @pytest.mark.parametrize("fault", faults, ids=lambda fault: f"{fault.solver}: {fault.name}")
    def test_a_fault_is_red(fault, tmp_path, monkeypatch):
        patch_first(monkeypatch)
        must_be_red(fault, tmp_path, monkeypatch)

    @pytest.mark.long
    @pytest.mark.parametrize(("solver", "case"), sorted({(fault.solver, fault.case) for fault in faults}))
    def test_without_a_fault_it_is_green(solver, case, tmp_path, monkeypatch):
        patch_first(monkeypatch)
        must_be_green(solver, case, tmp_path)

    return test_a_fault_is_red, test_without_a_fault_it_is_green


@pytest.mark.parametrize(
    "fault",
    [
        pytest.param(fault, marks=[pytest.mark.long] if (fault.solver, fault.name) in LONG_EARLY else [])
        for fault in FAULTS
    ],
    ids=lambda f: f"{f.solver}: {f.name}",
)
def test_a_fault_turns_the_gate_red(fault, tmp_path, monkeypatch):
    stop_early(monkeypatch)
    must_be_red(fault, tmp_path, monkeypatch)


@pytest.mark.long
@pytest.mark.parametrize("fault", [f for f in FAULTS if f.solver != "ndf"], ids=lambda f: f"{f.solver}: {f.name}")
def test_refinement_makes_no_fault_green(fault, tmp_path, monkeypatch):
    must_be_red(fault, tmp_path, monkeypatch)


@pytest.mark.long
@pytest.mark.parametrize("fault", LONG_FAULTS, ids=lambda f: f"{f.solver}: {f.name}")
def test_a_fault_that_takes_long_to_solve_turns_the_gate_red(fault, tmp_path, monkeypatch):
    must_be_red(fault, tmp_path, monkeypatch)
