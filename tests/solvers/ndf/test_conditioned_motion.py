"""One field for the motions of a range of materials: its law, its polynomials, its file, and mistakes made on purpose."""

import numpy as np
import pytest
import torch

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError
from shellbench.problems.series.conditioned_answer import stepped
from shellbench.solvers.ndf.conditioned import conditioned_motion
from shellbench.solvers.ndf.conditioned import plane_motion as mechanics
from shellbench.solvers.ndf.conditioned.conditioned_motion import (
    ConditionedMotion,
    Polynomials,
    asked_values,
    relative_uncertainty,
    why_unsettled,
)
from shellbench.solvers.ndf.conditioned.plane_motion import PlaneMotion, coordinates, features_of, plane_motion
from shellbench.solvers.ndf.conditioned_solver import ConditionedFieldSolver, ConditionedSettings
from shellbench.solvers.ndf.strains.smooth import width_for
from tests.solvers.ndf.conditioned import missed

NAME = "conditioned_napkin"
SMALL, FAIR = 4, 10  # degrees


@pytest.fixture(scope="module")
def case():
    return catalog.named_case(NAME)


@pytest.fixture(scope="module")
def small(case):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(conditioned_motion, "COUNTS", (9, 5, 3))
        neurons = width_for(case.shell_of(case.middle), SMALL)
        return ConditionedFieldSolver().solve(case, ConditionedSettings(neurons=neurons))


def law_of(case, degree):
    """Newton's law of some features, with the shell mechanics of other motions on the same ones."""
    with torch.no_grad():
        motion, features = features_of(case.shell_of(case.materials[0]), degree, ConditionedSettings())
        return motion, features, plane_motion(motion, features)


def test_forces_are_the_slope_of_the_energy_and_it_is_that_of_a_shell(case):
    motion, features, law = law_of(case, SMALL)
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


def test_polynomials_hold_what_they_can_and_doubt_tells_what_they_can_not(case):
    polynomials, counts = Polynomials.of_case(case), (4, 6, 5)
    time, first, second = (polynomials.points(axis, count) for axis, count in enumerate(counts))
    values = (1 + time[:, None, None]) * first[:, None] ** 3 * second**2
    coefficients = polynomials.coefficients(values)
    at, place = 0.3, (1.7, 0.22)
    found = polynomials.evaluate(coefficients, at, place, (0, 1, 0))
    assert found == pytest.approx((1 + at) * 3 * place[0] ** 2 * place[1] ** 2, rel=1e-9)
    for by in (None, "thickness", "poissons_ratio"):
        assert relative_uncertainty(polynomials, (coefficients, coefficients), case.materials, by) < 1e-9
        # A share of what is asked: as large for values, and nothing for derivatives of their logarithm.
        share = relative_uncertainty(polynomials, (coefficients, 1.001 * coefficients), case.materials, by)
        assert share == pytest.approx(0.001 if by is None else 0.0, abs=1e-8)
    # A product that only the last polynomials hold is as uncertain as it is large.
    last = np.zeros(counts)
    last[0, 0, 0], last[0, -1, 0] = 1.0, 0.01
    assert relative_uncertainty(polynomials, (last, last), case.materials, None) == pytest.approx(0.01, rel=0.2)


def test_the_field_is_followed_at_its_points_and_derived_between_them(case, small):
    end, law = case.ranges.material((1.0, 1.0, 0.0)), law_of(case, SMALL)[2]
    points, until = np.array([[0.5, 0.5], [0.9, 0.1]]), case.shell_of(case.middle).states[-1]
    assert -small.displacement(points, material=end)[0, 1] == pytest.approx(small.asked(end), rel=1e-12)
    assert small.displacement(points, 0.0, end) == pytest.approx(np.zeros((2, 3)), abs=1e-12)
    weights = law.follow(np.array([coordinates(end)]), np.array([until]))[0]
    assert small.asked(end) == pytest.approx(float(asked_values(case, small.features, weights)[0, 0]), abs=1e-5)
    material, step = case.materials[2], 1e-4
    for by in material._fields:
        ahead, behind = (small.asked(stepped(material, by, way * step)) for way in (1, -1))
        assert small.derivative(material, by) == pytest.approx(np.log(ahead / behind) / (2 * step), abs=1e-5)
    # In its plane the cloth knows the product of both alone.
    assert small.derivative(material, "thickness") == small.derivative(material, "youngs_modulus")


def test_the_file_and_what_is_refused(case, small, tmp_path):
    again = ConditionedFieldSolver().load(small.save(tmp_path / "field"))
    assert isinstance(again, ConditionedMotion)
    assert again.value(3) == small.value(3)
    assert again.uncertainty == small.uncertainty
    with pytest.raises(InputError, match=r"the time is 0\.5 s, but the motion goes from 0 to 0\.4 s"):
        small.asked(case.middle, 0.5)
    with pytest.raises(InputError, match=r"thickness is 5, but the range goes from"):
        small.asked(case.middle._replace(thickness=5.0))
    with pytest.raises(InputError, match=r"at 0 s the displacement is zero"):
        small.derivative(case.middle, "thickness", at=0)
    data = {key: value for key, value in case.data().items() if key != "name"}
    moved = {**data["shell"], "loads": [{"kind": "gravity", "acceleration": [0, "-9.8*t", 0]}]}
    other = type(case).build({**data, "shell": moved}, "mine", "mine")
    assert ConditionedFieldSolver().declines(other) == "it follows motions under steady gravity alone"
    for changed in (
        {"shell": {key: value for key, value in data["shell"].items() if key != "loads"}},
        {"shell": {**data["shell"], "loads": [{"kind": "gravity", "acceleration": [0, 0, -9.8]}]}},
        {"asked": {**data["asked"], "direction": [0, 0, -1]}},
    ):
        other = type(case).build({**data, **changed}, "mine", "mine")
        assert ConditionedFieldSolver().declines(other) == "nothing moves along what is asked"
    still = {key: value for key, value in data["shell"].items() if key != "dynamics"}
    with pytest.raises(InputError, match="stands still in the linear theory, or moves in the non-linear one"):
        type(case).build({**data, "shell": still}, "mine", "mine")


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"neurons": 8}, "field 'neurons': found 8, but a motion needs"),
        ({"snapshots": 32}, "no use for the setting 'snapshots'"),
        ({"tolerance": 1e-4}, "no use for the setting 'tolerance'"),
    ],
)
def test_settings_that_say_nothing_of_a_motion_are_refused(case, settings, words):
    with pytest.raises(InputError, match=words):
        ConditionedFieldSolver().solve(case, ConditionedSettings(**settings))


def test_one_uncertain_derivative_is_enough_to_be_unsettled():
    shares = {None: 1e-4, "thickness": 1e-3, "poissons_ratio": 1e-3}
    assert why_unsettled(shares) is None
    assert why_unsettled({**shares, "poissons_ratio": 0.02}) == "derivatives by poissons_ratio may be off by 2.0e-02"


def off(case):
    """The relative error of what is asked of material 0."""
    _, features, law = law_of(case, FAIR)
    until = case.shell_of(case.middle).states[-1]
    weights = law.follow(np.array([coordinates(case.materials[0])]), np.array([until]))[0]
    known = catalog.known_values(NAME).judge("value_00", case.theory).value
    return abs(float(asked_values(case, features, weights)[0, 0]) / known - 1)


def density_ignored(monkeypatch):
    """Each weight has the mass of one square metre of water, a millimetre deep."""
    usual = PlaneMotion.accelerations
    monkeypatch.setattr(PlaneMotion, "accelerations", lambda self, w, p: usual(self, w, p) * self.density)


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


@pytest.mark.parametrize("fault", [None, density_ignored, ratio_left_out, no_shear])
def test_a_fault_is_found(case, monkeypatch, fault):
    if fault is not None:
        fault(monkeypatch)
    assert (off(case) > 1e-3) == (fault is not None)


@pytest.mark.long
def test_the_field_is_as_good_as_it_says(case):
    field = ConditionedFieldSolver().solve(case, ConditionedSettings())
    assert missed(field) == []
    assert field.unsettled is None
    for quantity in case.quantities:
        known = catalog.known_values(NAME).judge(quantity.name, case.theory)
        assert abs(quantity.measure(field) - known.value) <= field.uncertainty[quantity.name] + known.uncertainty
