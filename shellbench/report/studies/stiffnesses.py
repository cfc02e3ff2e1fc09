"""The passport of a solver: which stiffness it simulates, as a multiple of the material's that it was given.

Each value of the suite `passport` depends on one stiffness. The displacement of a swatch is inversely proportional to
it. The drop H and the reach W of the tip of the heavy cantilever give H / W, a function of Gamma = q L^3 / B alone
(Romero et al. 2021). The Gamma at which the elastica has the solver's H / W gives B. The difference between a thin
shell and the elastica cancels, because the known values go through the same function. Solvers
that compute motions only are judged by half a period of a strip: the softer its bending, the slower its lowest mode.

Laboratories measure the overhang L of cloth whose chord falls by t = 41.5 degrees, and take B = q c^3 with the bending
length c^3 = L^3 cos(t/2) / (8 tan t) of Peirce (1930), The handle of cloth as a measurable quantity, Journal of the
Textile Institute 21. The elastica has c = .4999 L there, his formula .5093 L.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.passport import PROPERTIES, VIBRATION, Property
from shellbench.bench.judge.row import Row

MESH = "cells"  # the setting of which a solver's finest value is its passport's
LEAST_LOG = -60.0
MODES = 99  # of a strip that vibrates: the last one has 1e-10 of the deflection
FALL = math.radians(41.5)  # of the chord of Peirce's cantilever
SOFTEST, STIFFEST = 1e-3, 3.5  # bending over nominal: deflections fall with it, until a period is over
Values = Mapping[str, float]


def ratio_of(one: Property, found: Values, known: Values) -> float | None:
    """Return effective over nominal, from a solver's figures and the known ones; None of figures that no solid has."""
    try:
        ratio = _measure(one, found) / _measure(one, known)
    except (ValueError, ZeroDivisionError):
        return None
    if one.rule == "peirce":
        ratio *= peirce_excess()
    return ratio if math.isfinite(ratio) else None


def _measure(one: Property, values: Values) -> float:
    first = values[one.quantities[0]]
    match one.rule:
        case "inverse":
            return 1 / first
        case "proportional":
            return first
        case "quotient":
            return first / values[one.quantities[1]]
        case "hanging" | "peirce":
            return 1 / gamma_of(first / (1 - values[one.quantities[1]]))
        case "vibrating":
            return bending_in_motion(first)


@dataclass(frozen=True)
class Entry:
    """One property in a solver's stiffness passport.

    Attributes
    ----------
    ratio
        Effective over nominal, on the finest mesh; None where the solver has no figures.
    doubt
        Of the ratio: what the solver states, or else the change from the next coarser mesh; None if there is neither.
    others
        Ratios under other settings, by these.
    reason
        Why there is no ratio; nothing where nothing was run.
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
    case: Any = catalog.named_case(one.case)
    nominal = one.nominal(case.material)
    runs = sorted(_runs(one, rows), key=lambda run: run.unknowns)
    meshes = [run for run in runs if set(run.overrides) <= {MESH}]
    others = {_setting_words(run.overrides): run.ratio for run in runs if run not in meshes}  # the finest mesh of each
    if not meshes:
        reasons = [row.reason for row in rows if row.reason]
        return Entry(one, nominal, None, None, others, reasons[0] if reasons else "")
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
        ratio = ratio_of(one, values, known)
        if ratio is None:
            continue
        moved = [
            ratio_of(one, values | {name: values[name] + float(doubt)}, known)
            for name in one.quantities
            if (doubt := mine[name].uncertainty) is not None
        ]
        stated = None
        if moved and len(moved) == len(one.quantities) and None not in moved:
            stated = sum(abs(other - ratio) for other in moved if other is not None)
        first = next(iter(mine.values()))
        found.append(_Run(first.overrides, first.parameters or 0, ratio, stated))
    return found


def _setting_words(overrides: Mapping[str, Any]) -> str:
    return ", ".join(f"{name}={value}" for name, value in overrides.items() if name != MESH)


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


@cache
def peirce_excess() -> float:
    """Return the bending stiffness by Peirce's formula over that of the elastica, at his angle."""
    return gamma_of(math.tan(FALL)) * math.cos(FALL / 2) / (8 * math.tan(FALL))


def bending_in_motion(deflection: float) -> float:
    """Return the bending stiffness, N m, of a strip that vibrates with this deflection of its middle, m.

    Raises
    ------
    ValueError
        If none between `SOFTEST` and `STIFFEST` does.
    """
    from scipy.optimize import brentq

    m = np.arange(1, MODES, 2)

    def excess(ratio: float) -> float:
        squares = (m * np.pi) ** 4 * ratio * VIBRATION.bending
        moved = 4 * VIBRATION.pressure / (m * np.pi * squares) * (1 - np.cos(np.sqrt(squares) * VIBRATION.time))
        return float(np.sin(m * np.pi / 2) @ moved) - deflection

    return VIBRATION.bending * float(brentq(excess, SOFTEST, STIFFEST, xtol=1e-13))
