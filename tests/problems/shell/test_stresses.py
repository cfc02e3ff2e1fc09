"""Stresses at the faces of shells: from resultants, by side, component and direction."""

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError
from shellbench.problem import declined_quantities
from shellbench.solvers.cst.solver import CstSolver
from shellbench.solvers.fem.settings import FemSettings
from shellbench.solvers.fem.solver import FemSolver
from tests.families import altered

H = 0.05


def asked(name="bent_plate", on="one", **more):
    """The case with one stress beside its energy."""
    stress = {"name": "stress", "kind": "stress", "component": "11", "side": "top", "on": [on], **more}

    def change(data):
        data["quantities"] = [{"name": "energy", "kind": "strain_energy", "primary": True}, stress]

    return altered(catalog.named_case(name).data(), change)


class Uniform:
    """A solution with the same resultants everywhere, by components 11, 22, 12."""

    def __init__(self, case, forces=(0.0, 0.0, 0.0), moments=(0.0, 0.0, 0.0)):
        self.case, self.known = case, {"membrane_force": forces, "moment": moments}

    def evaluate(self, name, points, at=None):
        return np.tile(self.known[name], (len(points), 1))


def stress(case, **resultants):
    return case.quantity("stress").measure(Uniform(case, **resultants))


@pytest.mark.parametrize(("side", "sign"), [("top", 1), ("middle", 0), ("bottom", -1)])
def test_pure_bending_and_uniform_tension(side, sign):
    case = asked(side=side)
    assert stress(case, moments=(2.0, 5.0, 1.0)) == pytest.approx(sign * 6 * 2.0 / H**2)
    assert stress(case, forces=(3.0, 5.0, 1.0)) == pytest.approx(3.0 / H)


def test_the_equivalent_stress_of_tension_and_of_shear():
    case = asked(component="von_mises")
    for forces in ((3.0, 0.0, 0.0), (0.0, -3.0, 0.0), (0.0, 0.0, 3.0 / np.sqrt(3))):
        assert stress(case, forces=forces) == pytest.approx(3.0 / H)
    assert stress(asked(component="von_mises", side="bottom"), moments=(2.0, 0.0, 0.0)) == pytest.approx(12.0 / H**2)


def test_a_direction_turns_the_component():
    tensor = np.array([[3.0, 1.0], [1.0, -2.0]])
    forces = (3.0, -2.0, 1.0)
    along, across = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    expected = {"11": along @ tensor @ along, "22": across @ tensor @ across, "12": along @ tensor @ across}
    for component, value in expected.items():
        case = asked(component=component, direction=[1.2, 1.6, 7.0])  # its part along the normal does not count
        assert stress(case, forces=forces) == pytest.approx(value / H)
    for component in ("principal_1", "von_mises"):
        turned, plain = asked(component=component, direction=[1, 2, 0]), asked(component=component)
        assert stress(turned, forces=forces) == pytest.approx(stress(plain, forces=forces))


def test_the_thickness_is_that_of_the_point():
    def change(data):
        data["material"]["thickness_factor"] = "xi1"

    case = altered(asked().data(), change)
    assert stress(case, forces=(3.0, 0.0, 0.0)) == pytest.approx(3.0 / (1.1 * H))


def test_slips_are_refused():
    with pytest.raises(InputError, match="direction along the normal"):
        asked(direction=[0, 0, 1])
    with pytest.raises(InputError, match="has no value at the corner"):
        asked(on="xi1_max,xi2_max")
    assert "stress resultants" in declined_quantities(CstSolver(), asked())["stress"]


def test_coordinates_that_turn_the_normal_exchange_the_sides():
    case = asked("resultants_plate", "aside", component="principal_1")
    assert catalog.variant_of(case, "flipped").quantity("stress").side == "bottom"
    assert catalog.variant_of(case, "oblique").quantity("stress").side == "top"
    with pytest.raises(InputError, match="changes its sign with the normal"):
        catalog.variant_of(asked("resultants_plate", "aside", component="12", direction=[1, 1, 0]), "flipped")
    assert catalog.variant_of(case, "units").quantity("stress").factor == pytest.approx(1e6)  # N/mm^2 to Pa


@pytest.mark.long
def test_a_solver_has_the_stresses_of_moments_and_of_forces_at_edges():
    """Moments of 12 N at the ends of xi1 lift them: the top is pressed. Those at xi2 pull it."""
    bent = FemSolver().solve(asked(), FemSettings())
    assert bent.case.quantity("stress").measure(bent) == pytest.approx(-6 * 12.0 / H**2, rel=1e-4)
    other = asked(component="22", side="bottom").quantity("stress")
    assert other.measure(bent) == pytest.approx(-6 * 5.0 / H**2, rel=1e-4)
    pulled = FemSolver().solve(asked("twisted_parallelogram"), FemSettings())
    top, middle, bottom = (
        asked("twisted_parallelogram", side=side).quantity("stress").measure(pulled)
        for side in ("top", "middle", "bottom")
    )
    assert middle == pytest.approx(20000.0 / H, rel=1e-4)
    assert (top + bottom) / 2 == pytest.approx(middle, rel=1e-9)
