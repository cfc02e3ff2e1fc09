"""Section "Replication": certified energies of a training on its way."""

from types import SimpleNamespace

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.row import Row
from shellbench.protocol.history import HistoryStep
from shellbench.report.sections import replication

KNOWN = catalog.known_values("scordelis_lo")
VALUE, ENERGY = (KNOWN.judge(name, "kirchhoff-love-linear").value for name in ("edge_deflection", "strain_energy"))


def step(number, energy, certified=True, gap=0.5):
    stated = {"certified_energy": energy} if certified else {}
    quantities = {"edge_deflection": VALUE * number / 400, **stated}
    return HistoryStep(
        iteration=number, seconds=number / 10, energy=energy, unknowns=5, gap=gap, quantities=quantities
    )  # fmt: skip


def lines(*steps, diagnostics=None, theory="kirchhoff-love-linear"):
    row = Row(
        case="scordelis_lo", case_title="Roof", suite="replication", solver="ndf-published", seed=1, settings={}, quantity="edge_deflection",
        primary=True, at=1.0, status="ok", value=VALUE, uncertainty=None, run_id="a", reference=VALUE, reference_theory=theory,
    )  # fmt: skip
    record = SimpleNamespace(history=steps, diagnostics=diagnostics or {})
    found = replication.section(SimpleNamespace(rows=[row], records={"a": record}, known=catalog.known_values))
    return found.tables[0].data.to_dict("records") if found else []


def test_a_training_is_shown_at_a_quarter_half_and_its_end():
    steps = [step(25, 0.0, certified=False), *(step(n, -ENERGY * n / 400) for n in (100, 150, 200, 300, 400))]
    found = lines(*steps)
    figures, found = found[:-3], found[-3:]
    published = KNOWN.of("edge_deflection", "published")
    assert [line["error"] for line in figures] == pytest.approx([v.value / VALUE - 1 for v in published])
    assert len(figures) >= 2
    assert [line["iteration"] for line in found] == [100, 200, 400]
    assert [line["above"] for line in found] == pytest.approx([0.75, 0.5, 0.0])
    assert [line["error"] for line in found] == pytest.approx([-0.75, -0.5, 0.0])
    assert found[0]["gap"] == 0.5


def test_a_training_without_certified_energies_is_not_shown():
    assert not lines(*(step(n, -float(n), certified=False) for n in (10, 20, 40)))
    assert not lines()


def test_a_training_that_certified_its_end_alone_has_one_line():
    found = lines(
        *(step(n, -float(n), certified=False) for n in (10, 20, 40)), diagnostics={"certified_energy": -ENERGY / 4}
    )
    assert [line["iteration"] for line in found if line["seed"] == 1] == [40]
    assert found[-1]["above"] == pytest.approx(0.75)


def test_no_least_energy_is_told_where_it_is_not_the_strain_energy():
    steps, theory = [step(n, -float(n)) for n in (100, 400)], "kirchhoff-love-nonlinear"
    assert [line["above"] for line in lines(*steps, theory=theory) if line["seed"] == 1] == [None, None]
    assert not lines(step(1, -1.0, certified=False), diagnostics={"certified_energy": -1.0}, theory=theory)
