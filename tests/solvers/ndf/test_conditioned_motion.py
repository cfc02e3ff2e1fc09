"""One field for the motions of a range of materials: its law, its polynomials, its file, and mistakes made on purpose."""

import numpy as np
import pytest
import torch

from shellbench.bench import catalog
from shellbench.errors import InputError
from shellbench.problems.conditioned.solving import stepped
from shellbench.solvers.ndf import chebyshev_box, conditioned_motion
from shellbench.solvers.ndf import plane_motion as mechanics
from shellbench.solvers.ndf.chebyshev_box import Box
from shellbench.solvers.ndf.conditioned_motion import ConditionedMotion, asked_of, residual
from shellbench.solvers.ndf.conditioned_solver import ConditionedFieldSolver, ConditionedSettings
from shellbench.solvers.ndf.plane_motion import PlaneMotion, coordinates, features_of, plane_motion
from shellbench.solvers.ndf.sampled import widest
from tests.solvers.ndf.conditioned import missed

NAME = "conditioned_napkin"
SMALL, FAIR = 3, 10  # degrees


@pytest.fixture(scope="module")
def case():
    return catalog.named_case(NAME)


@pytest.fixture(scope="module")
def laws(case):
    """Newton's law of some features, with the shell mechanics of other motions on the same ones."""
    found = {}
    with torch.no_grad():
        for degree in (SMALL, FAIR):
            motion, features, _ = features_of(case.shell_of(case.materials[0]), degree, ConditionedSettings())
            found[degree] = motion, features, plane_motion(motion, features)
    return found


@pytest.fixture(scope="module")
def small(case):
    shell = case.shell_of(case.middle)
    return ConditionedFieldSolver().solve(case, ConditionedSettings(neurons=widest(shell, SMALL), snapshots=20))


def test_forces_are_the_slope_of_the_energy_and_it_is_that_of_a_shell(case, laws):
    motion, features, law = laws[SMALL]
    rng, place = np.random.default_rng(1), np.array([coordinates(case.materials[0])])
    weights, way = (0.1 * rng.standard_normal((1, 2, law.count)) for _ in range(2))
    step = 1e-5
    ahead, behind = (law.energies(weights + side * step * way, place)[0] for side in (1, -1))
    inner = law.gravity - law.density * law.accelerations(weights, place)[0]
    assert float(np.sum(inner * way)) == pytest.approx((ahead - behind) / (2 * step), rel=1e-6)
    # The same field in the basis of `motion_problem`, whose shells bend and move in three components.
    change = torch.linalg.lstsq(motion.features.combine, features.combine).solution.numpy()
    whole = torch.zeros((3, law.count), dtype=torch.float64)
    whole[:2] = torch.as_tensor(weights[0] @ change.T)
    with torch.no_grad():
        found = motion.energies(whole.reshape(-1), torch.zeros(3 * law.count, dtype=torch.float64), 0.0)
    assert found.bending == pytest.approx(0.0, abs=1e-12)
    assert law.energies(weights, place)[0] == pytest.approx(found.strain, rel=1e-8)


def test_polynomials_take_in_what_they_can_hold(case):
    box = Box.of_case(case)
    time, first, second = (box.nodes(axis, count) for axis, count in enumerate((4, 5, 3)))
    values = time[:, None, None] ** 3 * first[:, None] ** 4 * second**2
    coefficients = box.coefficients(values)
    at, place = 0.3, (1.7, 0.22)
    found = box.evaluated(coefficients, at, place, (2, 1, 0))
    assert found == pytest.approx(6 * at * 4 * place[0] ** 3 * place[1] ** 2, rel=1e-9)


def test_the_field_is_followed_at_its_nodes_and_derived_between_them(case, small, laws):
    end, law = case.ranges.material((1.0, 1.0, 0.0)), laws[SMALL][2]
    points, until = np.array([[0.5, 0.5], [0.9, 0.1]]), case.states[-1]
    assert -small.displacement(points, material=end)[0, 1] == pytest.approx(small.asked(end), rel=1e-12)
    assert small.displacement(points, 0.0, end) == pytest.approx(np.zeros((2, 3)), abs=1e-12)
    at_node = law.follow(np.array([coordinates(end)]), np.array([until]))[0][0, 0]
    assert small.weights(end, until) == pytest.approx(at_node, abs=1e-5)
    material, step = case.materials[2], 1e-4
    for by in material._fields:
        ahead, behind = (small.asked(stepped(material, by, way * step), until) for way in (1, -1))
        assert small.derivative(material, by, until) == pytest.approx(np.log(ahead / behind) / (2 * step), abs=1e-5)
    # In its plane the cloth knows the product of both alone.
    assert small.derivative(material, "thickness", until) == small.derivative(material, "youngs_modulus", until)


def test_the_residual_tells_a_material_from_another(case, small, laws):
    law, material = laws[SMALL][2], case.middle
    wrong = material._replace(youngs_modulus=case.ranges.youngs_modulus[1])

    class Mistaken:
        case = small.case

        def weights(self, _, at, order):
            return small.weights(wrong, at, order)

    assert residual(Mistaken(), law, material) > 2 * residual(small, law, material)


def test_the_file_and_what_is_refused(case, small, tmp_path):
    again = ConditionedFieldSolver().load(small.save(tmp_path / "field"))
    assert isinstance(again, ConditionedMotion)
    assert again.value(3, 0.2) == small.value(3, 0.2)
    assert again.uncertainty == small.uncertainty
    with pytest.raises(InputError, match=r"the time is 0\.5 s, but the motion goes from 0 to 0\.4 s"):
        small.asked(case.middle, 0.5)
    with pytest.raises(InputError, match=r"thickness is 5, but the range goes from"):
        small.asked(case.middle._replace(thickness=5.0))
    data = case.data()
    moved = {**data["shell"], "loads": [{"kind": "gravity", "acceleration": [0, "-9.8*t", 0]}]}
    other = type(case).build({**{k: v for k, v in data.items() if k != "name"}, "shell": moved}, "mine", "mine")
    assert ConditionedFieldSolver().declines(other) == "it follows motions under steady gravity alone"
    still = {key: value for key, value in data["shell"].items() if key != "dynamics"}
    with pytest.raises(InputError, match="stands still in the linear theory, or moves in the non-linear one"):
        type(case).build({**{k: v for k, v in data.items() if k != "name"}, "shell": still}, "m", "m")


def off(case, laws):
    """The largest relative error of what is asked of material 0."""
    motion, features, _ = laws[FAIR]
    with torch.no_grad():
        law = plane_motion(motion, features)
    place = np.array([coordinates(case.materials[0])])
    weights = law.follow(place, np.array(case.states))[0][0]
    known = [catalog.known_values(NAME).judge(f"value_00_{1000 * at:.0f}ms", case.theory).value for at in case.states]
    return float(np.abs(asked_of(case, features, weights) / known - 1).max())


def density_ignored(monkeypatch):
    """Each weight has the mass of one square metre of water, a millimetre deep."""
    usual = PlaneMotion.accelerations
    monkeypatch.setattr(PlaneMotion, "accelerations", lambda self, w, p: usual(self, w, p) * self.density)


def wrong_power(monkeypatch):
    """The membrane is as stiff as the square of the thickness, in millimetres."""

    def wrong(material):
        return float(np.log(material.youngs_modulus * material.thickness**2 / 1e-3)), material.poissons_ratio

    for place in (mechanics, chebyshev_box, conditioned_motion):
        monkeypatch.setattr(place, "coordinates", wrong)
    monkeypatch.setitem(globals(), "coordinates", wrong)


def ratio_left_out(monkeypatch):
    """D = E h."""
    monkeypatch.setattr(mechanics, "membrane_stiffness", lambda place: np.exp(place[..., 0]))


def no_shear(monkeypatch):
    """Shear stress has the factor 1 - nu twice."""
    usual = PlaneMotion._stresses

    def wrong(self, weights, places):
        a1, a2, strain, stress = usual(self, weights, places)
        return a1, a2, strain, stress * np.array([1.0, 1.0, 1 - places[0, 1]])[:, None, None]

    monkeypatch.setattr(PlaneMotion, "_stresses", wrong)


def test_a_material_is_followed_as_its_known_value_says(case, laws):
    assert off(case, laws) <= 1e-3


@pytest.mark.parametrize("fault", [density_ignored, wrong_power, ratio_left_out, no_shear])
def test_a_fault_is_found(case, laws, monkeypatch, fault):
    fault(monkeypatch)
    assert off(case, laws) > 1e-3
    assert fault.__doc__


@pytest.mark.long
@pytest.mark.parametrize("fault", [None, density_ignored, wrong_power])
def test_the_gate_of_a_field_is_red_for_a_fault(case, monkeypatch, fault):
    if fault is not None:
        fault(monkeypatch)
    neurons = widest(case.shell_of(case.middle), FAIR)
    field = ConditionedFieldSolver().solve(case, ConditionedSettings(neurons=neurons, snapshots=20))
    wrong = missed(field)
    assert {"value_00_200ms", "value_00_400ms"} <= set(wrong) if fault is not None else wrong == []


@pytest.mark.long
def test_the_field_is_as_good_as_it_says(case):
    field = ConditionedFieldSolver().solve(case, ConditionedSettings())
    assert missed(field) == []
    assert field.unsettled is None
    for quantity in case.quantities:
        known = catalog.known_values(NAME).judge(quantity.name, case.theory)
        assert abs(quantity.measure(field) - known.value) <= field.uncertainty[quantity.name] + known.uncertainty
