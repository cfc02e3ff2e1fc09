"""Properties of the series that do not depend on shellbench."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from shellbench.errors import InputError
from shellbench.problems.shell.case import Case, build_case
from shellbench.problems.shell.quantities.measure import measure_all

from plate_series.solver import PlateSeriesSolver, PlateSettings

A, B, H, E, NU, Q = 3.0, 2.0, 0.01, 2e11, 0.3, 1500.0
STIFFNESS = E * H**3 / (12 * (1 - NU**2))
RIM = ["xi1_min", "xi1_max", "xi2_min", "xi2_max"]
DATA = {
    "title": "Rectangular plate",
    "theory": "kirchhoff-love-linear",
    "surface": {"kind": "plane", "xi1": [-1.0, A - 1.0], "xi2": [5.0, 5.0 + B]},
    "material": {"youngs_modulus": E, "poissons_ratio": NU, "thickness": H},
    "points": {"centre": [A / 2 - 1.0, 5.0 + B / 2]},
    "supports": [{"name": "rim", "on": RIM}],
    "loads": [{"kind": "area", "vector": [0.0, 0.0, -Q]}],
    "quantities": [
        {"name": "down", "kind": "displacement", "primary": True, "points": ["centre"], "direction": [0.0, 0.0, -1.0]},
        {"name": "energy", "kind": "strain_energy"},
        {"name": "force", "kind": "reaction", "support": "rim", "direction": [0.0, 0.0, 1.0]},
        {"name": "moment", "kind": "torque", "support": "rim", "axis": [0.0, 1.0, 0.0]},
    ],
}


def case(**changes: object) -> Case:
    return build_case({**DATA, **changes}, name="plate", where="test")


def solved(terms: int = 40, **changes: object):
    return PlateSeriesSolver().solve(case(**changes), PlateSettings(terms=terms))


def levy() -> float:
    """Deflection of the centre by Levy's single series (Timoshenko & Woinowsky-Krieger, art. 30)."""
    m = np.arange(1, 400, 2)
    alpha = m * np.pi * B / (2 * A)
    bracket = 1 - (alpha * np.tanh(alpha) + 2) / (2 * np.cosh(alpha))
    return float(4 * Q * A**4 / (np.pi**5 * STIFFNESS) * np.sum((-1.0) ** ((m - 1) // 2) / m**5 * bracket))


def test_the_centre_deflects_as_levys_series_says() -> None:
    assert measure_all(solved())["down"] == pytest.approx(levy(), rel=1e-8)


def test_half_the_work_of_the_load_is_the_strain_energy() -> None:
    solution = solved()
    x, w = np.polynomial.legendre.leggauss(100)
    points = np.stack(np.meshgrid(-1 + A * (x + 1) / 2, 5 + B * (x + 1) / 2, indexing="ij"), axis=-1)
    weights = np.outer(w, w) * A * B / 4
    work = Q * np.sum(weights * -solution.displacement(points)[..., 2])
    assert solution.energies()[1] == pytest.approx(work / 2, rel=1e-9)
    density = np.sum(weights * solution.evaluate("bending_energy_density", points))
    assert density == pytest.approx(solution.energies()[1], rel=1e-6)


def test_the_bending_strain_is_minus_the_second_derivative_of_the_displacement() -> None:
    solution, d = solved(), 1e-3
    xi = np.array([0.3, 5.7])
    e1, e2 = np.array([d, 0.0]), np.array([0.0, d])

    def w(point: np.ndarray) -> float:
        return float(solution.displacement(point)[2])

    k11 = (w(xi + e1) - 2 * w(xi) + w(xi - e1)) / d**2
    k22 = (w(xi + e2) - 2 * w(xi) + w(xi - e2)) / d**2
    k12 = (w(xi + e1 + e2) - w(xi + e1 - e2) - w(xi - e1 + e2) + w(xi - e1 - e2)) / (4 * d**2)
    assert solution.evaluate("bending_strain", xi) == pytest.approx(-np.array([k11, k22, k12]), rel=1e-4)


def test_the_rim_holds_the_load() -> None:
    values = measure_all(solved())
    assert values["force"] == pytest.approx(Q * A * B)
    assert values["moment"] == pytest.approx(-Q * A * B * (A / 2 - 1.0))  # about the origin: -x F


def test_energies_converge_at_the_rate_of_the_tail() -> None:
    """The largest terms that are left out fall like 1/m^6 (n = 1), so their sum like 1/terms^5."""
    exact = solved(400).energies()[1]
    terms = np.array([4, 8, 16, 32])
    errors = [exact - solved(int(n)).energies()[1] for n in terms]
    assert np.polyfit(np.log(terms), np.log(errors), 1)[0] == pytest.approx(-5, abs=0.2)


def test_a_saved_solution_answers_the_same(tmp_path: Path) -> None:
    solution = solved()
    again = PlateSeriesSolver().load(solution.save(tmp_path / "plate"))
    points = np.array([[0.1, 5.2], [1.0, 6.0]])
    assert np.array_equal(again.displacement(points), solution.displacement(points))
    assert again.case == solution.case
    assert again.history == solution.history
    (tmp_path / "plate.npz").write_bytes(b"no solution")
    with pytest.raises(InputError, match="damaged"):
        PlateSeriesSolver().load(tmp_path / "plate.npz")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"supports": [{"name": "rim", "on": RIM, "clamped": True}]}, "free to turn"),
        ({"supports": [{"name": "rim", "on": RIM[:2]}]}, "all four edges"),
        ({"loads": [{"kind": "area", "vector": [1.0, 0.0, -1.0]}]}, "along the normal"),
        ({"loads": [{"kind": "area", "vector": [0.0, 0.0, "xi1"]}]}, "uniform"),
        ({"loads": [{"kind": "point", "on": ["centre"], "force": [0.0, 0.0, -1.0]}]}, "'point'"),
        ({"surface": {"kind": "cylinder", "radius": 9.0, "xi1": [0.0, 20.0], "xi2": [0.0, 7.0]}, "points": {"centre": [10.0, 3.0]}}, "flat"),
    ],
)  # fmt: skip
def test_what_it_has_not_is_declined(changes: dict[str, object], words: str) -> None:
    reason = PlateSeriesSolver().declines(case(**changes))
    assert reason is not None
    assert words in reason
