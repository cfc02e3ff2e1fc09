"""A synthetic store of large displacements: records made from formulas. No solver ran; no figure is a result."""

import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.reference import KnownCurve, KnownValue, KnownValues
from shellbench.bench.judge.compare import row_of
from shellbench.bench.judge.row import Row
from shellbench.bench.store.current import CurrentRun
from shellbench.bench.store.record import Measured, Record
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.quantities import DisplacementQuantity
from shellbench.protocol.history import HistoryStep, StateEnergies
from tests.report.conftest import Store, identity, keep, known_value

THEORY = "kirchhoff-love-nonlinear"
ELSEWHERE = "reissner-mindlin"
LOADS = (0.125, 0.25, 0.5, 0.75, 1.0)  # of the cantilever's states
REACHED = 0.5  # load factor up to which the failed run came
REASON = "no equilibrium was found at load factor 0.61; the last converged load factor is 0.5"
FIRST, SECOND = 10.0, 20.0  # deflections at which the roof's load turns, mm
STRAINS = ("exact", "published", "linear")
GRID = 9


def shortening(t: float) -> float:
    return 3.3 * t**1.5


def deflection(t: float) -> float:
    return 6.7 * math.sin(1.2 * t) / math.sin(1.2)


def roof_load(w: float) -> float:
    """A load factor whose slope vanishes at the two deflections: 2.2 at the first."""
    scale = 2.2 / (FIRST**3 / 3 - (FIRST + SECOND) / 2 * FIRST**2 + FIRST * SECOND * FIRST)
    return scale * (w**3 / 3 - (FIRST + SECOND) / 2 * w**2 + FIRST * SECOND * w)


def seen_curvature(strain: str, phi: float) -> float:
    """Curvature under a measure of strain where the normal of a rolled plate has turned by phi; 1 is the truth.

    Kairanda et al. 2023, eq. (30), term by term: u,1 = (cos - 1, 0, sin) has the parts phi_11 and phi_13, u,11 = d.
    """
    d = np.array([-math.sin(phi), 0.0, math.cos(phi)])
    phi_13 = math.sin(phi)
    tangent, normal = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    if strain == "linear":
        return float(d @ normal)
    if strain == "published":
        return float(d @ normal - phi_13 * (d @ tangent))
    return float(d @ np.array([-math.sin(phi), 0.0, math.cos(phi)]))


def rolled_energy(strain: str, t: float) -> float:
    """Bending energy of the rolled plate, J: B/2 kappa^2, integrated over its area."""
    case = catalog.named_case("rolled_plate")
    (length, width), theta = case.surface.domain.size, math.pi * t
    mean = quad(lambda x: seen_curvature(strain, theta * x) ** 2, 0, 1)[0]
    return 0.5 * case.material.bending_stiffness * (theta / length) ** 2 * length * width * mean


def path(states: Iterable[tuple[float, Mapping[str, float]]], iterations: int = 3) -> tuple[HistoryStep, ...]:
    return tuple(
        HistoryStep(
            iteration=i,
            seconds=0.5 * (i + 1),
            energy=-t,
            unknowns=1000,
            at=t,
            quantities=dict(quantities),
            phase="path",
            iterations=iterations + i % 2,
        )
        for i, (t, quantities) in enumerate(states)
    )


def solved(case: Case, value: float) -> tuple[HistoryStep, ...]:
    """Two refinements before the path."""
    return tuple(
        HistoryStep(
            iteration=i,
            seconds=0.1 * (i + 1),
            energy=-value,
            unknowns=500 * (i + 1),
            quantities={case.primary.name: value * (1 - 0.01 / 10**i)},
        )
        for i in range(2)
    )


def form_of(quantity: str) -> Callable[[float], float]:
    return {"shortening": shortening, "deflection": deflection}[quantity.partition("_")[0]]


def scaled(form: Callable[[float], float], factor: float) -> Callable[[float], float]:
    return lambda t: factor * form(t)


def cantilever(case: Case, upto: float = 1.0, factor: float = 1.0) -> tuple[tuple[HistoryStep, ...], dict[str, float]]:
    """Path and values as far as a load factor."""
    moved = {q.name: scaled(form_of(q.name), factor) for q in case.quantities if isinstance(q, DisplacementQuantity)}
    states = [(t, {name: form(t) for name, form in moved.items()}) for t in LOADS if t <= upto]
    values = {name: form(case.quantity(name).at) for name, form in moved.items() if case.quantity(name).at <= upto}
    energies = {"strain_energy": 3.0 * factor, "membrane_energy": 0.5 * factor, "bending_energy": 2.5 * factor}
    return path(states), values | (energies if upto == 1.0 else {})


def bent(case: Case, t: float) -> np.ndarray:
    """The cantilever as an arc of a circle."""
    xi = case.surface.domain.grid(GRID, GRID)
    angle = 1.5 * t
    u = np.zeros((GRID, GRID, 3))
    u[..., 0] = 10 * np.sin(angle * xi[..., 0] / 10) / angle - xi[..., 0]
    u[..., 2] = 10 * (1 - np.cos(angle * xi[..., 0] / 10)) / angle
    return u


def make_record(
    folder: Path,
    case: Case,
    solver: str,
    values: Mapping[str, float],
    history: tuple[HistoryStep, ...] = (),
    *,
    seed: int | None = None,
    settings: Mapping[str, object] | None = None,
    energies: tuple[StateEnergies, ...] = (),
    reason: str | None = None,
    marks: tuple[float, ...] = (),
) -> Record:
    tag = "".join(map(str, (settings or {}).values()))
    run_id = f"{case.name}-{solver}-{tag}-{seed}"
    fields_file = None
    if marks:
        fields_file = f"{run_id}.npz"
        xi = case.surface.domain.grid(GRID, GRID)
        np.savez_compressed(
            folder / fields_file,
            xi=xi,
            position=case.surface.position(xi),
            displacement=bent(case, marks[-1]),
            marks=np.array(marks),
            displacements=np.stack([bent(case, t) for t in marks]).astype(np.float32),
        )
    defaults = {"width": 600, "strain": "exact"}
    return keep(
        folder,
        run_id,
        case,
        identity(case, solver, defaults | dict(settings or {}), seed),
        defaults=defaults,
        status="ok" if reason is None else "failed",
        reason=reason,
        seconds=2.5 if seed is None else 4.0 + seed,
        peak_memory_bytes=321_000_000 + (seed or 0) * 1_000_000,
        idle_memory_bytes=200_000_000,
        parameters=1000,
        storage_bytes=8000,
        values={name: Measured(value=value) for name, value in values.items()},
        history=history,
        energies=energies,
        fields_file=fields_file,
    )


def judge(quantity: str, value: float, uncertainty: float = 1e-6) -> KnownValue:
    return known_value(quantity, value, uncertainty=uncertainty, theory=THEORY, origin="synthetic elastica")


def synthetic_known() -> dict[str, KnownValues]:
    beam, plate = catalog.named_case("cantilever_shear"), catalog.named_case("rolled_plate")
    displacements = [q for q in beam.quantities if isinstance(q, DisplacementQuantity)]
    book = {"theory": ELSEWHERE, "origin": "synthetic elements", "source": "book_1985"}
    loads, values = (0.3, 0.6, 1.0), (2.4, 4.8, 6.69)
    curve = KnownCurve(quantity="deflection_4", label="book", loads=loads, values=values, **book)
    tip = [judge(q.name, form_of(q.name)(q.at)) for q in displacements]
    tip.append(known_value("deflection_4", 6.69, "literature", **book))
    tip.append(judge("deflection_4", 6.0).model_copy(update={"theory": ELSEWHERE}))
    snapping = judge("limit_load", 2200.0, 1.0), judge("load_20", 1770.0, 1.0)
    return {
        "cantilever_shear": KnownValues(values=tuple(tip), curves=(curve,)),
        "hinged_roof_thick": KnownValues(values=snapping),
        "rolled_plate": KnownValues(
            values=tuple(judge(q.name, rolled_energy("exact", q.at), 0.0) for q in plate.quantities)
        ),
        "rigid_rotation": KnownValues(
            values=tuple(judge(f"strain_energy_{degrees}", 0.0, 0.0) for degrees in (90, 180))
        ),
    }


def make_nonlinear_store(folder: Path) -> Store:
    """Curves by three runs, one of them failed half way; a snapping roof; the ablation of strains."""
    folder.mkdir(parents=True, exist_ok=True)
    beam, roof, plate, turned = map(
        catalog.named_case, ("cantilever_shear", "hinged_roof_thick", "rolled_plate", "rigid_rotation")
    )
    runs: list[tuple[Record, dict[str, str]]] = []

    def keep(record: Record, suite: str, label: str = "") -> None:
        runs.append((record, {suite: label}))

    steps, values = cantilever(beam)
    first = solved(beam, values["deflection_4"])
    keep(make_record(folder, beam, "fem", values, first + steps, marks=(0.25, 0.5, 0.75, 1.0)), "nonlinear")
    steps, values = cantilever(beam, factor=1.0005)
    keep(make_record(folder, beam, "ndf", values, steps, seed=0), "nonlinear")
    steps, values = cantilever(beam, upto=REACHED)
    keep(make_record(folder, beam, "ndf", values, steps, seed=1, reason=REASON, marks=(0.25, 0.5)), "nonlinear")

    moved = np.linspace(1.0, 30.0, 30)
    steps = path((roof_load(w), {"deflection": w, "free_edge_deflection": 0.8 * w}) for w in moved)
    values = {
        "limit_load": 1000 * roof_load(FIRST),
        "limit_deflection": FIRST,
        "valley_load": 1000 * roof_load(SECOND),
        "load_20": 1000 * roof_load(20.0),
        "deflection": 30.0,
        "free_edge_deflection": 24.0,
    }
    keep(make_record(folder, roof, "fem", values, steps), "nonlinear")

    for strain in STRAINS:
        settings = {} if strain == "exact" else {"strain": strain}
        factor = {"exact": 1.0, "published": 0.92, "linear": 1.14}[strain]
        energies = tuple(StateEnergies(at=t, membrane=0.0, bending=rolled_energy(strain, t)) for t in plate.states)
        values = {q.name: rolled_energy(strain, q.at) for q in plate.quantities}
        rolled = make_record(folder, plate, "ndf-ritz", values, seed=0, settings=settings, energies=energies)
        keep(rolled, "strain_ablation", strain)
        turn = {"exact": (1e-12, 2e-12), "published": (3.25, 7.5), "linear": (4.0, 8.25)}[strain]
        values = dict(zip(("strain_energy_90", "strain_energy_180"), turn, strict=True))
        keep(make_record(folder, turned, "ndf-ritz", values, seed=0, settings=settings), "strain_ablation", strain)
        steps, values = cantilever(beam, factor=factor)
        keep(make_record(folder, beam, "ndf-ritz", values, steps, seed=0, settings=settings), "strain_ablation", strain)
    known = synthetic_known()
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(catalog, "known_values", lambda name: known[name])
        rows: list[Row] = []
        for record, declared in runs:
            overrides = {k: v for k, v in record.identity.settings.items() if record.defaults[k] != v}
            case = catalog.named_case(record.case_name)
            rows += [row_of(CurrentRun(record, case, overrides, declared), q) for q in case.quantities]
    return Store(folder, tuple(record for record, _ in runs), tuple(rows), known)
