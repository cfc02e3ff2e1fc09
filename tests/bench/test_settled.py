"""An answer has settled if what its solver states of its headline is small enough."""

from importlib import import_module
from io import StringIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from shellbench.bench.judge.expected import Scope
from shellbench.bench.judge.gate import gate
from shellbench.bench.run.display import Lines
from shellbench.bench.store.record import Measured
from shellbench.bench.store.settled import why_uncertain, with_drifts
from shellbench.bench.store.store import Store
from tests.bench.running import run
from tests.bench.strip import CENTRE
from tests.bench.test_known_in_files import known


def quantity(name: str = "u", unit: str = "m", **more: Any) -> SimpleNamespace:
    plain = {"absolute": False, "is_an_error": False, "tolerance": {}, "factor": 1.0}
    return SimpleNamespace(**{"name": name, "unit": unit, **plain, **more})


def asked(*quantities: SimpleNamespace, **more: Any) -> Any:
    by_name = {one.name: one for one in quantities}
    whole = {"primary": quantities[0], "quantities": quantities, "known": (), "quantity": by_name.__getitem__}
    return SimpleNamespace(**{**whole, "remark": "it drifts", **more})


def said(case: Any, **values: tuple[float, float | None]) -> str | None:
    measured = {name: Measured(value=value, uncertainty=sure) for name, (value, sure) in values.items()}
    return why_uncertain(case, "toy", True, measured)


@pytest.mark.parametrize("stated", [0.0099, 0.0101, 0.12, None])
def test_a_hundredth_of_the_headline_is_the_most(stated: float | None) -> None:
    why = said(asked(quantity()), u=(-2.0, None if stated is None else 2 * stated))
    assert (why is None) == (stated is None or stated < 0.01)
    assert why is None or (stated and why.startswith(f"u is uncertain by {2 * stated:.2g} m"))


@pytest.mark.parametrize(
    ("headline", "sure", "settled"),
    [
        (quantity(), 0.09, True),  # near zero beside 10 m
        (quantity(), 0.11, False),
        (quantity(unit="J"), 0.09, False),  # no other has its unit
        (quantity(absolute=True), 0.09, True),
        (quantity(is_an_error=True), 5.0, True),
        (quantity(tolerance={"toy": 95.0}), 0.09, True),
        (quantity(tolerance={"other": 95.0}, unit="J"), 0.09, False),
        (quantity(tolerance={"toy": 0.1}, absolute=True, unit="J"), 0.09, True),
    ],
)
def test_a_headline_near_zero_is_compared_with_its_unit(headline: Any, sure: float, settled: bool) -> None:
    case = asked(headline, quantity("v"), quantity("w", "N"))
    assert (said(case, u=(1e-3, sure), v=(-10.0, None), w=(1e6, None)) is None) == settled


def test_a_drift_joins_the_uncertainty_and_unsettles_beyond_a_hundredth() -> None:
    case = asked(quantity(), quantity("v", factor=1000.0), drifts=lambda _: {"u": 0.02, "v": 0.009, "gone": 1.0})
    measured = {name: Measured(value=value, uncertainty=0.001) for name, value in (("u", 1.0), ("v", 1000.0))}
    values, why = with_drifts(case, SimpleNamespace(), measured)
    assert values["u"].uncertainty == pytest.approx(0.021)
    assert values["v"].uncertainty == pytest.approx(9.001)
    assert why == "the drift is more than 1% of the value (u by 0.02): it drifts"


@pytest.mark.usefixtures("toys")
@pytest.mark.parametrize(("tolerance", "settled"), [(0.05, False), (0.25, True)])
def test_a_run_that_is_unsure_is_not_ok_and_holds_no_gate(
    tolerance: float, settled: bool, store: Store, own_case: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """12 % of uncertainty, and a value that is right: neither ok nor green, unless the case asks for no more."""
    solution = import_module("toy_shells.solver").StripSolution
    plain = solution.__init__

    def unsure(self: Any, case: Any, factor: float) -> None:
        plain(self, case, factor)
        self.uncertainty = {"centre": 0.12 * CENTRE}
        self.diagnostics |= {"not_converged": ["energy"]}

    monkeypatch.setattr(solution, "__init__", unsure)
    path = known(own_case, more=f"tolerance = {tolerance}")
    (outcome,) = run(store, path, solvers=("toy",))
    assert outcome.record is not None
    assert (outcome.record.status == "ok") == settled
    assert gate(store, None, Scope(cases=(path,))).good() == settled
    Lines(printed := StringIO()).ended(outcome)
    assert "not converged: energy" in printed.getvalue()
    assert settled or outcome.record.reason.startswith("centre is uncertain by")
