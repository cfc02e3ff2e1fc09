"""The passport of a solver: which stiffness it simulates, as a multiple of the material's that it was given.

Each figure of the suite `passport` answers to one stiffness. Of the swatch a displacement is inversely proportional
to it. Of the heavy cantilever the drop H and the reach W of its tip are, as H / W, a function of Gamma = q L^3 / B
alone (Romero et al. 2021): the Gamma at which the elastica has the solver's H / W tells its B. What a thin shell has
there in place of the elastica's H / W cancels, as the known values go through the same function.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from shellbench.bench import catalog
from shellbench.bench.row import Row

SUITE = "passport"
MESH = "cells"  # the setting of which a solver's finest value is its passport's
LEAST_LOG, GRAVITY = -60.0, 9.8
Quantities = Mapping[str, float]


@dataclass(frozen=True)
class Property:
    """One line of a passport.

    Attributes
    ----------
    name, words, unit
        What it is.
    case, quantities
        What it is measured by.
    nominal
        The material's own, from its case.
    ratio
        Effective over nominal, from the solver's figures and the known ones.
    """

    name: str
    words: str
    unit: str
    case: str
    quantities: tuple[str, ...]
    nominal: Callable[[Any], float]
    ratio: Callable[[Quantities, Quantities], float]


def _inverse(name: str) -> Callable[[Quantities, Quantities], float]:
    return lambda found, known: known[name] / found[name]


def _contraction(found: Quantities, known: Quantities) -> float:
    return (found["contraction"] / found["stretch"]) / (known["contraction"] / known["stretch"])


def _hanging(gamma: int) -> Callable[[Quantities, Quantities], float]:
    def weighed(values: Quantities) -> float:
        return gamma_of(values[f"drop_{gamma}"] / (1.0 - values[f"shortening_{gamma}"]))

    return lambda found, known: weighed(known) / weighed(found)


PROPERTIES = (
    Property("stretch", "Stretching stiffness E h", "N/m", "swatch", ("stretch",),
             lambda m: m.youngs_modulus * m.thickness, _inverse("stretch")),
    Property("poisson", "Poisson's ratio, stretched", "", "swatch", ("stretch", "contraction"),
             lambda m: m.poissons_ratio, _contraction),
    Property("shear", "Shear stiffness G h", "N/m", "swatch", ("shear",),
             lambda m: m.youngs_modulus * m.thickness / 2 / (1 + m.poissons_ratio), _inverse("shear")),
    Property("twist", "Twisting stiffness B (1 - nu)", "N m", "swatch", ("twist",),
             lambda m: m.bending_stiffness * (1 - m.poissons_ratio), _inverse("twist")),
    *(
        Property(f"bending_{gamma}", f"Bending stiffness B, hanging at Gamma = {gamma}", "N m", "heavy_cantilever",
                 (f"drop_{gamma}", f"shortening_{gamma}"), lambda m: m.bending_stiffness, _hanging(gamma))
        for gamma in (1, 10, 100, 1000)
    ),
    Property("fall", "Acceleration of a free fall", "m/s^2", "free_fall", ("fall_1000ms",),
             lambda m: GRAVITY, lambda found, known: found["fall_1000ms"] / known["fall_1000ms"]),
)  # fmt: skip


@dataclass(frozen=True)
class Entry:
    """What a passport says of one property.

    Attributes
    ----------
    ratio
        Effective over nominal, on the finest mesh; None where the solver has no figures.
    doubt
        Of the ratio: what the solver states, or else the change from the next coarser mesh; None if there is neither.
    others
        Ratios under other settings, by these.
    reason
        Why there is no ratio.
    """

    of: Property
    nominal: float
    ratio: float | None
    doubt: float | None
    others: Mapping[str, float]
    reason: str = ""


@dataclass(frozen=True)
class _Run:
    overrides: Mapping[str, Any]
    unknowns: int
    ratio: float
    stated: float | None


def passport(rows: Sequence[Row]) -> list[Entry]:
    """Return a solver's passport from the rows of its runs of the suite; one entry for each property."""
    return [_entry(one, [row for row in rows if row.case == one.case]) for one in PROPERTIES]


def _entry(one: Property, rows: Sequence[Row]) -> Entry:
    nominal = one.nominal(catalog.named_case(one.case).material)
    runs = sorted(_runs(one, rows), key=lambda run: run.unknowns)
    meshes = [run for run in runs if set(run.overrides) <= {MESH}]
    others = {_said(run.overrides): run.ratio for run in runs if run not in meshes}
    if not meshes:
        reasons = [row.reason for row in rows if row.reason]
        return Entry(one, nominal, None, None, others, reasons[0] if reasons else "it was not run")
    last = meshes[-1]
    before = [run.ratio for run in meshes if run.unknowns < last.unknowns]
    doubt = last.stated if last.stated is not None or not before else abs(last.ratio - before[-1])
    return Entry(one, nominal, last.ratio, doubt, others)


def _runs(one: Property, rows: Sequence[Row]) -> list[_Run]:
    found = []
    for run_id in dict.fromkeys(row.run_id for row in rows if row.value is not None):
        mine = {row.quantity: row for row in rows if row.run_id == run_id and row.value is not None}
        if not set(one.quantities) <= mine.keys():
            continue
        values = {name: float(mine[name].value or 0.0) for name in one.quantities}
        known = {name: float(mine[name].reference or 0.0) for name in one.quantities}
        ratio = _safe(one, values, known)
        if ratio is None:
            continue
        moved = [
            _safe(one, values | {name: values[name] + float(doubt)}, known)
            for name in one.quantities
            if (doubt := mine[name].uncertainty) is not None
        ]
        stated = None
        if moved and len(moved) == len(one.quantities) and None not in moved:
            stated = sum(abs(other - ratio) for other in moved if other is not None)
        first = next(iter(mine.values()))
        found.append(_Run(first.overrides, first.parameters or 0, ratio, stated))
    return found


def _safe(one: Property, found: Quantities, known: Quantities) -> float | None:
    """Return a ratio; None of figures that no stiffness has."""
    try:
        ratio = one.ratio(found, known)
    except (ValueError, ZeroDivisionError):
        return None
    return ratio if math.isfinite(ratio) else None


def _said(overrides: Mapping[str, Any]) -> str:
    return ", ".join(f"{name}={value}" for name, value in overrides.items())


def elastica(logarithm: float) -> tuple[float, float]:
    """Return Gamma and H / W of the hanging elastica whose tip is exp(`logarithm`) off the vertical, radians.

    With lengths in units of (B / q)^(1/3) and r from the tip, psi'' = r sin psi from rest at the tip to the wall at
    psi = pi / 2, and Gamma is the cube of the length.
    """
    from scipy.integrate import solve_ivp

    def along(r: float, state: np.ndarray) -> list[float]:
        return [state[1], r * np.sin(state[0]), np.cos(state[0]), np.sin(state[0])]

    def wall(r: float, state: np.ndarray) -> float:
        return float(state[0] - np.pi / 2)

    wall.terminal = True  # type: ignore[attr-defined]
    tip = math.exp(logarithm)
    tight = 1e-11 * np.array([tip, tip, 1.0, 1.0])
    found = solve_ivp(along, (0.0, 60.0), [tip, 0.0, 0.0, 0.0], "DOP853", events=wall, rtol=1e-11, atol=tight)
    (r,), ((_, _, drop, reach),) = found.t_events[0], found.y_events[0]
    return float(r**3), float(drop / reach)


def gamma_of(shape: float) -> float:
    """Return the Gamma at which the hanging elastica has this H / W.

    Raises
    ------
    ValueError
        If no strip under its own weight hangs so.
    """
    from scipy.optimize import brentq

    steepest = math.log(math.pi / 2 * (1 - 1e-9))
    root = brentq(lambda x: math.log(elastica(x)[1] / shape), LEAST_LOG, steepest, xtol=1e-12, rtol=1e-14)
    return elastica(float(root))[0]
