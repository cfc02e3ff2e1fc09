"""Modes by both mechanics: coarse and quick, by properties."""

import math

import numpy as np
import pytest

from derivations import strip_on_edge
from shellbench.bench.catalogue import catalog
from shellbench.errors import SolveFailure
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.solvers.fem.solver import FemSolver
from shellbench.solvers.ndf.ritz_solver import RitzSolver


@pytest.mark.long
@pytest.mark.parametrize(("solver", "settings"), [(FemSolver(), {"cells": (4, 4)}), (RitzSolver(), {"neurons": 60})])
def test_a_file_keeps_modes_and_shapes(solver, settings, tmp_path):
    case = catalog.named_case("plate_modes")
    found = solver.solve(case, settings)
    kept = solver.load(found.save(tmp_path / "modes"))
    points = case.surface.domain.grid(5, 5)
    assert kept.mode_values == found.mode_values
    assert np.abs(kept.displacement(points, at=3.0) - found.displacement(points, at=3.0)).max() < 1e-12
    # the second mode has two half waves along the plate: odd about its middle
    one, other = found.displacement(np.array([[0.75, 1.0], [2.25, 1.0]]), at=2.0)[:, 2]
    assert one == pytest.approx(-other, rel=1e-3)
    assert found.mode_values[1] == pytest.approx(
        math.pi / 2 * (1 / 9 + 1 / 4) * math.sqrt(2e5 / 12 / 0.91 / 80), rel=1e-4
    )


def test_strips_on_edge_tend_to_the_narrow_limit():
    """The closed form of a beam, by strips that are half as wide each; .1 % is asked."""
    assert strip_on_edge.narrow_limit() == pytest.approx(12.853763, abs=1e-6)
    factors = [strip_on_edge.by_splines(number, 12, 2) for number in strip_on_edge.WIDTHS.values()]
    assert strip_on_edge.extrapolated(factors) == pytest.approx(1.0, abs=1e-3)
    assert abs(factors[-1] - 1) > 5e-3


@pytest.mark.long
def test_strips_on_edge_of_elements_tend_to_the_narrow_limit():
    cases = [catalog.named_case(name) for name in strip_on_edge.WIDTHS]
    factors = [FemSolver().solve(case, {"cells": (24, 6)}).mode_values[1] for case in cases]
    assert strip_on_edge.extrapolated(factors) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.long
def test_challengers_that_exploit_their_rule_are_no_part_of_the_answer():
    """With seed 2 the second level's challengers raise the quotients, which more features can only lower."""
    case = catalog.named_case("plate_shear")
    found = RitzSolver().solve(case, {"seed": 2})
    assert found.unsettled is None
    values = measure_all(found)
    for quantity in case.quantities:
        known = catalog.known_values(case.name).judge(quantity.name, case.theory).value
        assert abs(values[quantity.name] - known) < 2 * found.uncertainty[quantity.name]
        assert found.uncertainty[quantity.name] < 1e-4 * known


@pytest.mark.long
@pytest.mark.parametrize(("solver", "settings"), [(FemSolver(), {"cells": (4, 4)}), (RitzSolver(), {"neurons": 60})])
def test_a_load_that_only_stretches_can_not_buckle(solver, settings):
    """Turned round, the plate's load has its factors turned round."""
    data = catalog.named_case("plate_compression").model_dump(mode="json", exclude_unset=True, exclude={"name"})
    for load in data["loads"]:
        load["vector"] = [-float(part) for part in load["vector"]]
    known = catalog.known_values("plate_compression").judge("load_factor_1", data["theory"]).value
    with pytest.raises(SolveFailure, match=r"^the load cannot buckle the shell: all factors are negative") as found:
        solver.solve(build_case(data, "stretched", "test"), settings)
    assert float(str(found.value).split()[-1]) == pytest.approx(-known, rel=1e-2)
