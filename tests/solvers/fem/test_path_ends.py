"""Cases that the non-linear theory declines, and ends of paths: limit points, unstable states, marks."""

import json
import re

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.store.measuring import measured
from shellbench.errors import InputError, SolveFailure
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.solvers.fem.mesh.grading import graded_mesh
from shellbench.solvers.fem.path import large_displacement
from shellbench.solvers.fem.solver import FemSolver
from tests.solvers.fem.shells import SURFACES, shell
from tests.solvers.fem.test_large_displacement import DEFLECTION, NONLINEAR, WALL, data_of, on_mesh, path_of, solve


def under_load(name, until, marks=()):
    """Return a case whose path is controlled by its load, and which is asked for its displacements at the end."""
    data = data_of(name)
    quantities = [q | {"at": until} for q in data["quantities"] if q["kind"] == "displacement"]
    quantities[0]["primary"] = True
    return build_case(
        data | {"path": {"until": until, "states": list(marks)}, "quantities": quantities}, "roof", "test"
    )


def free_strip(marks=(0.5, 0.75)):
    """Return the strip of `cantilever_moment` in its whole width, without its plane of symmetry."""
    data = data_of("cantilever_moment")
    surface = data["surface"] | {"xi2": [0, 1]}
    quantities = [
        {"name": "shortening", "kind": "displacement", "primary": True, "points": ["tip"], "direction": [-1, 0, 0]}
    ]
    supports = [support for support in data["supports"] if "symmetry" not in support]
    changes = {"surface": surface, "supports": supports, "quantities": quantities, "path": {"states": list(marks)}}
    return build_case(data | changes, "strip", "test")


# what is declined


def nonlinear(surface="plane", **fields):
    return shell(surface, theory=NONLINEAR, loads=[{"kind": "area", "vector": [0, 0, "t"]}], **fields)


@pytest.mark.parametrize(
    ("case", "reason"),
    [
        (
            nonlinear(supports=[WALL | {"motion": {"kind": "value", "z": "t*xi2"}}]),
            "it can't move the clamped support 'wall' by a formula at finite strain",
        ),
        (
            nonlinear(supports=[WALL | {"clamped": False}], remove_rigid_motions=["rotation_y", "translation_z"]),
            "it needs supports against rotation_y at finite strain",
        ),
        (
            nonlinear(supports=[{"name": "p", "on": ["xi1_min,xi2_min"]}], remove_rigid_motions=[
                "translation_x", "translation_y", "translation_z", "rotation_x", "rotation_y", "rotation_z"]),
            "it needs supports against rotation_",
        ),
    ],
)  # fmt: skip
def test_what_it_can_not_do_is_declined_in_a_clause(case, reason):
    clause = FemSolver().declines(case)
    assert clause.startswith(reason)
    assert "\n" not in clause
    assert not clause.endswith(".")
    with pytest.raises(InputError, match=re.escape(reason)):
        solve(case)
    linear = case.model_copy(update={"theory": "kirchhoff-love-linear"})
    assert FemSolver().declines(linear) is None


@pytest.mark.parametrize(
    "case",
    [
        nonlinear(supports=[WALL]),
        nonlinear(supports=[WALL | {"motion": {"kind": "translation", "vector": ["t", 0, "t**2"]}}]),
        nonlinear(supports=[WALL | {"clamped": False, "on": ["xi1_min", "xi2_min"]}]),
        nonlinear(SURFACES["cylinder"] | {"closed": False, "xi1": [0, 90]}, supports=[WALL]),
        nonlinear("cylinder", supports=[WALL | {"clamped": False, "on": ["xi2_min", "xi2_max"], "components": ["x", "z"]}],
                  remove_rigid_motions=["translation_y"]),
    ],
)  # fmt: skip
def test_what_it_can_do_is_not_declined(case):
    assert FemSolver().declines(case) is None


@pytest.mark.long
def test_no_shell_of_the_suite_is_declined_but_for_its_theory():
    for case in (case for case in map(catalog.named_case, catalog.case_names()) if case.kind == "shell"):
        of_its_theory = case.theory in FemSolver.capabilities.theories
        expected = None if of_its_theory else f"it does not solve the theory {case.theory}"
        assert FemSolver().declines(case) == expected, case.name


# how paths end


@pytest.mark.long
def test_a_load_beyond_a_limit_point_ends_in_one_sentence_with_the_states_so_far():
    case = under_load("hinged_roof_thick", 5.0, marks=(1.0, 2.0))
    with pytest.raises(SolveFailure) as caught:
        on_mesh(case, (4, 4))
    message, partial = str(caught.value), caught.value.partial
    assert "\n" not in message
    found = re.fullmatch(
        r"no equilibrium was found at load factor [\d.]+; the last converged load factor is ([\d.]+)", message
    )
    last = float(found[1])
    assert partial.states[:2] == (1.0, 2.0)
    assert partial.states[-1] == path_of(partial)[-1].at == pytest.approx(last, rel=1e-5)
    # the limit load of the same mesh, by displacement control
    limit = solve(catalog.named_case("hinged_roof_thick"), cells=(4, 4)).history[0].quantities["limit_load"] / 1000
    assert limit * 0.998 < last < limit * (1 + 1e-6)
    point = case.places["centre"].xi
    deflections = [-partial.displacement(point, at=t)[2] for t in partial.states]
    assert np.all(np.diff([0, *deflections]) > 0)
    assert sum(partial.energies(2.0)) > sum(partial.energies(1.0)) > 0
    assert path_of(partial)[-1].quantities["deflection"] == pytest.approx(deflections[-1], rel=1e-12)


@pytest.mark.long
def test_a_load_beyond_a_limit_point_ends_a_whole_solve():
    case = under_load("hinged_roof_thick", 5.0, marks=(1.0, 2.0))
    with pytest.raises(SolveFailure, match=r"^[^\n]*; the last converged load factor is 2\.2\d*$") as caught:
        solve(case, max_unknowns=1000)
    partial = caught.value.partial
    assert partial.case == case
    assert partial.states[:2] == (1.0, 2.0)
    assert 2.2 < partial.states[-1] < 2.3
    assert path_of(partial)[-1].quantities.keys() == {"deflection", "free_edge_deflection"}
    deflections = [-partial.displacement(case.places["centre"].xi, at=t)[2] for t in partial.states]
    assert np.all(np.diff([0, *deflections]) > 0)
    json.dumps(dict(partial.diagnostics), allow_nan=False)


def test_a_load_beyond_a_limit_point_ends_a_solve_on_a_fixed_mesh():
    with pytest.raises(SolveFailure, match=r"the last converged load factor is 2\.2"):
        solve(under_load("hinged_roof_thick", 5.0), cells=(3, 3))


@pytest.mark.long
def test_an_unstable_state_ends_the_path():
    """A strip with two free edges sways out of its plane before it is rolled up."""
    case = free_strip()
    with pytest.raises(SolveFailure) as caught:
        on_mesh(case, (6, 2))
    found = re.fullmatch(
        r"the state at load factor [\d.]+ is not stable; the last converged load factor is ([\d.]+)", str(caught.value)
    )
    assert 0.75 < float(found[1]) < 0.85
    partial = caught.value.partial
    assert partial.states[:2] == (0.5, 0.75)
    # up to there it is a circular arc: half a circle at half of the moment
    assert partial.displacement(case.places["tip"].xi, at=0.5)[0] == pytest.approx(-12, rel=1e-3)
    assert np.abs(partial.coefficients[:, 1]).max() < 1e-6  # the plane arc, with no sway yet


@pytest.mark.long
def test_an_unstable_state_ends_a_whole_solve():
    with pytest.raises(SolveFailure, match=r"^the state at load factor 0\.8\d* is not stable; [^\n]*") as caught:
        solve(free_strip(), max_unknowns=1000)
    assert 0.75 < caught.value.partial.states[-1] < 0.85


def test_a_column_ends_at_eulers_load():
    """Pressed along its axis, a strip stays straight: what ends its path is that the straight state is no minimum."""
    data = data_of("cantilever_shear")
    push = {"kind": "edge", "on": ["xi1_max"], "vector": ["-t", 0, 0]}
    quantities = [DEFLECTION | {"at": 4.0}]
    case = build_case(data | {"loads": [push], "quantities": quantities, "path": {"until": 4.0}}, "column", "test")
    with pytest.raises(SolveFailure, match="is not stable; the last converged load factor is") as caught:
        on_mesh(case, (4, 1))
    stiffness = case.material.youngs_modulus * case.material.thickness**3 / 12
    euler = np.pi**2 * stiffness / (4 * 10.0**2)
    # the column shortens by P / E h, 2e-5, before it buckles; the last step is cut to 1e-4 of the path
    assert caught.value.partial.states[-1] == pytest.approx(euler, abs=2 * 1e-4 * 4.0)


@pytest.mark.parametrize("control", ["displacement", "arc_length"])
def test_a_motion_grows_with_the_load_factor_under_every_control(control):
    data = data_of("cantilever_shear")
    lift = {
        "name": "lift", "on": ["xi1_max"], "components": ["z"],
        "motion": {"kind": "translation", "vector": [0, 0, "t"]},
    }  # fmt: skip
    case = build_case(
        data | {
            "points": data["points"] | {"middle": [5, 0.5]}, "supports": [*data["supports"], lift],
            "loads": [{"kind": "area", "vector": [0, 0, "0.1*t"]}], "quantities": [DEFLECTION | {"points": ["middle"]}],
            "path": {"control": control, "quantity": "w"},
        },
        "lifted", "test",
    )  # fmt: skip
    if FemSolver().declines(case) is None:
        solution = on_mesh(case, (3, 1))[0].solution
        assert solution.displacement(case.places["tip"].xi)[2] == pytest.approx(solution.history[-1].at, rel=1e-6)


def test_a_path_of_loads_goes_on_to_its_end():
    data = data_of("cantilever_shear")
    case = build_case(data | {"path": {"until": 1.5}}, "beyond", "test")
    found, _ = on_mesh(case, (3, 1))
    assert found.solution.history[-1].at == 1.5


def test_a_path_that_does_not_start_says_so():
    case = under_load("hinged_roof_thick", 5.0)
    tiny = case.model_copy(update={"loads": (case.loads[0].model_copy(update={"force": (0, 0, "-1e9*t")}),)})
    with pytest.raises(
        SolveFailure, match=r"^no equilibrium was found at load factor [^;]*: no state beyond rest converged$"
    ):
        on_mesh(tiny, (3, 3))


def test_loads_that_push_along_a_free_motion_are_refused():
    supports = [{"name": "ends", "on": ["xi1_min", "xi1_max"], "components": ["y", "z"]}]
    push = {"kind": "area", "vector": ["t", 0, 0]}
    case = shell(theory=NONLINEAR, supports=supports, remove_rigid_motions=["translation_x"], loads=[push])
    assert FemSolver().declines(case) is None
    with pytest.raises(SolveFailure, match="the loads are not in balance"):
        solve(case, max_unknowns=1000)


@pytest.mark.long
def test_under_a_point_load_the_pulled_cylinder_loses_its_equilibrium_the_earlier_the_finer_the_mesh():
    """Show why `cylinder_pull_out` spreads its loads: a quarter of 40000 at one point has no equilibrium in this theory."""
    data = data_of("cylinder_pull_out")
    load = {"kind": "point", "on": ["A"], "force": [0, 0, "10000*t"]}
    case = build_case(data | {"loads": [load]}, "pulled", "test")
    ends = []
    for cells, grading in ((12, 2.0), (16, 2.0), (16, 2.5)):
        mesh = graded_mesh(case, (cells, cells), grading)
        with pytest.raises(SolveFailure, match="no equilibrium was found") as caught:
            large_displacement.solve(case, mesh, 7, (1 / 8, 1e-3))
        ends.append(caught.value.partial.history[-1].at)
    assert ends == sorted(ends, reverse=True)
    assert ends[-1] < 0.6


@pytest.mark.long
def test_the_path_of_the_pulled_cylinder_has_a_loop():
    """Load steps jump over it; under displacement control both limit points are seen (`derivations`: .51664, .51520)."""
    data = data_of("cylinder_pull_out")
    inward = next(q for q in data["quantities"] if q["name"] == "U_B") | {"at": 4.2, "primary": False}
    turning = [
        {"name": "maximum", "kind": "limit_point", "number": 1, "primary": True},
        {"name": "minimum", "kind": "limit_point", "number": 2},
    ]
    changes = {"quantities": [inward, *turning], "path": {"control": "displacement", "quantity": "U_B", "until": 4.2}}
    case = build_case(data | changes, "pulled", "test")
    found, _ = large_displacement.solve(case, graded_mesh(case, (16, 12), 2.0), 7, (1 / 8, 1e-3))
    values = measure_all(found.solution)
    assert values["maximum"] == pytest.approx(0.5166, rel=2e-3)
    assert values["minimum"] == pytest.approx(0.5152, rel=2e-3)
    assert values["maximum"] > values["minimum"]


@pytest.mark.parametrize("control", ["displacement", "arc_length"])
def test_a_path_that_passes_a_branch_ends_there(control, tmp_path):
    """A pressed strip whose tip is followed along its axis stays straight beyond Euler's load, and says so."""
    data = data_of("cantilever_shear")
    push = {"kind": "edge", "on": ["xi1_max"], "vector": ["-t", 0, 0]}
    shortening = {"name": "u", "kind": "displacement", "primary": True, "points": ["tip"], "direction": [-1, 0, 0]}
    euler, stretch = np.pi**2 * 100 / 400, 1.2e6 * 0.1 / 10
    until = 4 * euler / stretch
    case = build_case(
        data | {
            "loads": [push], "quantities": [shortening | {"at": until}],
            "path": {"control": control, "quantity": "u", "until": until},
        },
        "column", "test",
    )  # fmt: skip
    with pytest.raises(SolveFailure, match=r"^a branch of other equilibria was passed before load factor") as caught:
        on_mesh(case, (4, 1))
    assert caught.value.partial.history[-1].at == pytest.approx(euler, rel=0.15)
    # What was asked before the branch has its value, in a record too, and what was not reached is named.
    early = case.quantities[0].model_copy(update={"at": until / 8})
    later = case.quantities[0].model_copy(update={"name": "later", "primary": False})
    asked = case.model_copy(update={"quantities": (early, later)})
    found = FemSolver().solve(asked, FemSolver.settings_type(cells=(4, 1)))
    result, why_not_whole = measured(found, asked, tmp_path)
    assert why_not_whole is None
    assert result["values"].keys() == {"u"}
    assert result["values"]["u"].value == pytest.approx(until / 8)
    assert re.search(r"a support of symmetry at y = 0\.5, answers the rest .*; not reached: later$", found.unsettled)


@pytest.mark.parametrize("control", ["displacement", "arc_length"])
def test_a_displacement_that_no_load_moves_can_not_be_followed(control):
    data = data_of("cantilever_shear")
    aside = {"name": "v", "kind": "displacement", "primary": True, "points": ["tip"], "direction": [0, 1, 0], "at": 1}
    case = build_case(
        data | {"quantities": [aside], "path": {"control": control, "quantity": "v", "until": 1}}, "aside", "test"
    )
    with pytest.raises(SolveFailure, match="the loads do not move the displacement that the path is followed to"):
        on_mesh(case, (4, 1))


def test_a_load_that_goes_back_to_zero_leaves_the_shell_at_rest():
    data = data_of("cantilever_shear")
    load = data["loads"][0] | {"vector": [0, 0, "4*t*(1-t)"]}
    case = build_case(data | {"loads": [load], "quantities": [DEFLECTION], "path": {"states": [0.5]}}, "back", "test")
    solution = on_mesh(case, (6, 1))[0].solution
    assert abs(solution.displacement(case.places["tip"].xi)[2]) < 1e-6
    assert solution.displacement(case.places["tip"].xi, at=0.5)[2] > 2
