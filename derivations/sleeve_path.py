r"""The twisted sleeve beyond buckling: the branch with n-fold rotational symmetry, and its stability.

The branch is followed on one sector of angle 2 pi / n, in the subspace of deformations that are invariant under the
rotation by pi about a radial axis, (theta, y) -> (-theta, -y); this also fixes the phase of the waves. Every state is a
minimum of the energy in that subspace: Newton's method with K + s K0, K0 the stiffness at rest, s > 0 only where K is
not positive definite or the energy does not fall. Against perturbations without any symmetry it is then judged wave
number by wave number m = 0 .. n/2, each coupled to m + k n (Bloch's theorem).

The sleeve of h = 0.0012 m has eight waves (`thin_states`). They are stable to twice the critical twist at least, and
carry a nearly constant torque: 0.001164 N m at 0.0051 rad, 0.00116 N m at 0.007 rad, 0.00115 N m at 0.01 rad. There
seven waves are stable too, and carry 2.4 % less; nine carry 7 % more, and are not.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve, eigh

from .estimate import Estimate
from .sleeve import Rims, Sleeve, State
from .sleeve_buckling import THICK, THIN, axisymmetric, critical, softness, stiffness_at_rest, twist_estimates, twisting
from .sleeve_functions import Around, along
from .surface_strains import Array

NEWTON_STEPS = 200
DECREMENT = 1e-18
"""Promised decrease of the energy, as a fraction of it, at which a minimum is accepted."""
FIRST_SHIFT, LEAST_SHIFT = 1e-2, 1e-5
AMPLITUDE = 0.3
"""Amplitude of the mode that starts the buckled branch, in thicknesses."""


def turned_over(sleeve: Sleeve) -> NDArray[np.intp]:
    """Numbers of the coefficients that the rotation by pi about the radial axis at theta = y = 0 keeps.

    It takes (q_r, q_y, q_t) at (theta, y) to (q_r, -q_y, -q_t) at (-theta, -y).
    """
    component, around, along = np.indices(sleeve.shape)
    odd_around = (around % 2 == 0) & (around > 0)  # the functions are 1, cos, sin, cos, sin ...
    odd = odd_around ^ (along % 2 == 1)
    return np.flatnonzero(odd == (component > 0))


def minimum(sleeve: Sleeve, rims: Rims, start: Array) -> State:
    """Return the stable state, within the symmetric subspace, that lies downhill of the given coefficients.

    Raises
    ------
    ArithmeticError : no minimum is reached
    """
    kept = turned_over(sleeve)
    window = np.ix_(kept, kept)
    at_rest = sleeve.state(np.zeros(sleeve.size), Rims()).second_variation()[window]
    state = sleeve.state(start, rims)
    shift = 0.0
    for _ in range(NEWTON_STEPS):
        stiffness, residual = state.second_variation()[window], state.residual[kept]
        while True:
            try:
                factor = cho_factor(stiffness + shift * at_rest)
            except LinAlgError:
                shift = max(FIRST_SHIFT, 4 * shift)
                continue
            step = -cho_solve(factor, residual)
            promised = -residual @ step
            q = state.coefficients.copy()
            q[kept] += step
            moved = sleeve.state(q, rims)
            if promised <= DECREMENT * state.energy and shift == 0:
                return moved
            if moved.energy <= state.energy - 1e-4 * promised or promised <= 1e-12 * state.energy:
                break
            shift = max(FIRST_SHIFT, 4 * shift)
        state = moved
        shift = shift / 4 if shift > LEAST_SHIFT else 0.0
    raise ArithmeticError("no stable symmetric state found")


def perturbed(sleeve: Sleeve, rims: Rims) -> Array:
    """Coefficients of the axisymmetric state plus its softest symmetric mode with `fold` waves."""
    plain, single = replace(sleeve, fold=1, harmonics=0), replace(sleeve, harmonics=1)
    q = np.zeros(sleeve.shape)
    q[:, :1] = axisymmetric(plain, rims).coefficients.reshape(plain.shape)
    kept = turned_over(single)
    window = np.ix_(kept, kept)
    loaded = single.state(q[:, :3].ravel(), rims).second_variation()[window]
    at_rest = single.state(np.zeros(single.size), Rims()).second_variation()[window]
    mode = np.zeros(single.size)
    mode[kept] = eigh(loaded, at_rest, subset_by_index=[0, 0])[1][:, 0]
    shape = mode.reshape(single.shape)
    radial = np.einsum("tm,mn,yn->ty", single.around.values[0], shape[0], single.along[0, 0])
    q[:, :3] += AMPLITUDE * sleeve.thickness / np.abs(radial).max() * shape
    return q.ravel()


def buckled(sleeve: Sleeve, twists: Sequence[float]) -> Iterator[State]:
    """Yield the stable symmetric states at ascending twists, the first of them beyond the critical one."""
    q = perturbed(sleeve, twisting(twists[0]))
    for twist in twists:
        state = minimum(sleeve, twisting(twist), q)
        yield state
        q = state.coefficients


def margins(state: State) -> dict[int, float]:
    """Smallest mu of K v = mu K0 v for each Bloch number 0 .. fold / 2: the state is stable if none is negative.

    Number 0 has the rotation of the waves about the axis as a neutral mode, mu = 0.
    """
    sleeve = state.sleeve
    numbers = range(sleeve.fold // 2 + 1)
    return {m: softness(state, m, stiffness_at_rest(sleeve, m)) for m in numbers}


# --- estimates -----------------------------------------------------------------------------------

BEFORE, BEYOND = (0.05, 0.08), (0.1, 0.15, 0.2, 0.3, 0.5)
"""Twists at which values are given, rad."""
STEPS = (0.09, 0.1, 0.125, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5)
WAVES = 4
THIN_STEPS = (0.0051, 0.0055, 0.006, 0.007, 0.008, 0.009, 0.01)
"""Twists of the sleeve of h = 0.0012 m, rad: from where it buckles, 0.00494, to slightly beyond twice that."""
THIN_BEYOND = (0.006, 0.008, 0.01)
"""Those at which values are given."""
THIN_WAVES = 8
ROUNDING = 1e-9


@dataclass(frozen=True)
class Level:
    """Harmonics around a sector and polynomials along it."""

    harmonics: int
    functions: int


def narrowing(state: State) -> float:
    """Inward displacement, m, half way along at theta = 0.

    The rotation by pi about the radial axis there keeps that point on the axis. Before buckling it stands for the whole
    circle; beyond, the deepest of the `fold` dents is there, and no point of the sleeve moves farther.
    """
    sleeve = state.sleeve
    around = Around.real(np.zeros(1), sleeve.fold, sleeve.harmonics).values[0, 0]
    functions = along(sleeve.functions, True, np.zeros(1))[0, 0]
    return -float(around @ state.coefficients.reshape(sleeve.shape)[0] @ functions)


def states(level: Level) -> list[State]:
    """Return the states at the twists of `BEFORE` and `BEYOND`."""
    plain = Sleeve(THICK, functions=level.functions)
    waved = replace(plain, fold=WAVES, harmonics=level.harmonics)
    beyond = (state for state in buckled(waved, STEPS) if state.rims.twist in BEYOND)
    return [*(axisymmetric(plain, twisting(twist)) for twist in BEFORE), *beyond]


def thin_states(level: Level) -> list[State]:
    """Return the states of the thin sleeve at `THIN_STEPS`, on the branch of the eight waves into which it buckles."""
    sleeve = Sleeve(THIN, functions=level.functions, fold=THIN_WAVES, harmonics=level.harmonics)
    return list(buckled(sleeve, THIN_STEPS))


def _values(state: State) -> dict[str, tuple[float, str]]:
    membrane, bending = state.energies
    shape = "narrowing" if state.rims.twist in BEFORE else "largest_displacement"
    return {
        shape: (narrowing(state), "m"),
        "torque": (state.torque, "N m"),
        "strain_energy": (membrane + bending, "J"),
        "membrane_energy": (membrane, "J"),
        "bending_energy": (bending, "J"),
    }


def sleeve_twist() -> dict[str, Estimate]:
    """Known values of the twisted sleeve, h = 0.012 m, before and beyond buckling: sleeve_twist and sleeve_course."""
    fine, coarse = Level(8, 36), Level(6, 28)
    loads = (0.04, 0.07, 0.09)
    buckling = (critical(THICK, twisting, range(13), loads, level.functions) for level in (fine, coarse))
    estimates = twist_estimates(*buckling)
    for one, other in zip(states(fine), states(coarse), strict=True):
        values, others = _values(one), _values(other)
        for name, (value, unit) in values.items():
            key = f"{name}_{round(1000 * one.rims.twist)}mrad"
            estimates[key] = Estimate.between(value, others[name][0], unit, ROUNDING * abs(value))
    return estimates


def sleeve_twist_thin_buckled() -> dict[str, Estimate]:
    """Known values of the twisted sleeve of h = 0.0012 m beyond buckling, on the branch of eight waves."""
    estimates = {}
    for one, other in zip(thin_states(Level(6, 44)), thin_states(Level(4, 36)), strict=True):
        values, others = _values(one), _values(other)
        for name in ("torque", "strain_energy", "bending_energy") if one.rims.twist in THIN_BEYOND else ():
            value, unit = values[name]
            key = f"{name}_{round(1000 * one.rims.twist)}mrad"
            estimates[key] = Estimate.between(value, others[name][0], unit, ROUNDING * abs(value))
    return estimates
