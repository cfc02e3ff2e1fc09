"""Variations of the strains to any order, for geometry that may be complex.

The exact strains of the deformed midsurface x + u (see `shellbench.solvers.fem.mechanics.kinematics`),

    eps_ab = (x,a . u,b + x,b . u,a + u,a . u,b) / 2,    kappa_ab = -u,ab . n - x,ab . (n - N),

are evaluated on truncated Taylor series in two directions of the displacement, u = u0 + s v + r w. The coefficient of
s^i r^j is the mixed variation over i! j!. All are written a second time here, without the shortcuts of `kinematics`:
tests compare both.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.taylor import Taylor, one, square_root
from shellbench.solvers.fem.mechanics.kinematics import DERIVATIVES, SECOND, STRAINS
from shellbench.solvers.fem.mesh.basis import Derivative

Numbers = NDArray[Any]  # real or complex
Key = tuple[int, int]
REST: Key = (0, 0)


@dataclass(frozen=True)
class Strained:
    """Variations of the strains at n points.

    Attributes
    ----------
    area
        (n,) |a1 x a2| of the midsurface at rest.
    metric
        (3, n) contravariant components 11, 22, 12 at rest.
    strains
        By powers of s and r, (6, n): membrane strains 11, 22, 12, then bending strains. Absent ones are zero.
    """

    area: Numbers
    metric: Numbers
    strains: Mapping[Key, Numbers]

    def work(self, nu: Any, part: int, first: Key, second: Key) -> Numbers:
        """Return H^{abcd} e_ab f_cd (n,) of two variations of the membrane (part 0) or bending strains (part 1)."""
        # H e f = nu (a^ab e_ab) (a^cd f_cd) + (1 - nu) a^ac a^bd e_ab f_cd
        if first not in self.strains or second not in self.strains:
            return np.zeros(len(self.area))
        (m11, m22, m12), rows = self.metric, slice(3 * part, 3 * part + 3)
        (e11, e22, e12), (f11, f22, f12) = self.strains[first][rows], self.strains[second][rows]
        trace_e, trace_f = (m11 * a + m22 * b + 2 * m12 * c for a, b, c in ((e11, e22, e12), (f11, f22, f12)))
        up11, up22 = m11**2 * e11 + 2 * m11 * m12 * e12 + m12**2 * e22, m12**2 * e11 + m22**2 * e22
        up22 = up22 + 2 * m12 * m22 * e12
        up12 = m11 * m12 * e11 + (m11 * m22 + m12**2) * e12 + m12 * m22 * e22
        return np.asarray(nu * trace_e * trace_f + (1 - nu) * (up11 * f11 + up22 * f22 + 2 * up12 * f12))


def _each(series: Taylor, function: Callable[[Numbers], Numbers]) -> Taylor:
    return Taylor({key: function(term) for key, term in series.terms.items()}, series.order)


def _dot(first: Taylor, second: Taylor) -> Taylor:
    return _each(first * second, lambda term: term.sum(axis=0))


def _cross(first: Taylor, second: Taylor) -> Taylor:
    def rolled(series: Taylor, by: int) -> Taylor:
        return _each(series, lambda term: np.roll(term, by, axis=0))

    return rolled(first, -1) * rolled(second, -2) - rolled(first, -2) * rolled(second, -1)


def strained(x: Mapping[Derivative, Numbers], fields: Mapping[Key, Numbers], order: int) -> Strained:
    """Return the variations of the strains up to a total order.

    Parameters
    ----------
    x
        Derivatives (n, 3) of the midsurface, up to order 2.
    fields
        By powers of s and r: derivatives (n, 5, 3) of u0 at (0, 0), of v at (1, 0), of w at (0, 1), in the order of
        `DERIVATIVES`.
    """
    base = [Taylor({REST: np.ascontiguousarray(x[d].T)}, order) for d in ((1, 0), (0, 1))]
    second = [Taylor({REST: np.ascontiguousarray(x[d].T)}, order) for d in SECOND]
    by_key = {key: np.ascontiguousarray(np.moveaxis(values, 0, -1)) for key, values in fields.items()}
    u = [Taylor({key: values[d] for key, values in by_key.items()}, order) for d in range(len(DERIVATIVES))]
    at_rest = _cross(*base)
    area = square_root(_dot(at_rest, at_rest))
    growth = _cross(base[0] + u[0], base[1] + u[1])
    normal = growth * (one(growth) / square_root(_dot(growth, growth)))
    turned = normal - at_rest * (one(area) / area)
    if REST not in by_key:
        del turned.terms[REST]
    found = [
        (_dot(base[a], u[b]) + _dot(base[b], u[a]) + _dot(u[a], u[b])) * Taylor.constant(0.5, order) for a, b in STRAINS
    ]
    found += [-_dot(u[2 + row], normal) - _dot(second[row], turned) for row in range(3)]
    keys = sorted({key for series in found for key in series.terms})
    zero = np.zeros(len(area.value))
    a11, a22, a12 = (_dot(base[a], base[b]).value for a, b in STRAINS)
    return Strained(
        area.value,
        np.stack([a22, a11, -a12]) / area.value**2,
        {key: np.stack([series.terms.get(key, zero) for series in found]) for key in keys},
    )
