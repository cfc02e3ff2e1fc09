"""Symmetry of a case: a square sheet over a ball or a torus at its middle has eight symmetries.

Then one eighth of the samples and of the coefficients is enough. A symmetric answer is stationary; tests check that it
is also the least among all answers.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix

from shellbench.problems.field.case import FieldCase
from shellbench.solvers.field.basis import Sparse

Array = NDArray[np.float64]
MIDDLE = (0.5, 0.5)
PROBES, ALIKE = 100, 1e-12  # places whose distances from a body tell its symmetries; m by which they may differ


def maps(case: FieldCase) -> list[tuple[bool, Array]]:
    """Return the maps that leave a case unchanged: True if u and v change places, and signs (2,) after that.

    Only cases with a body are examined; the identity alone is returned if there are no other maps.
    """
    cloth, body = case.cloth, case.body
    plain = cloth is not None and tuple(cloth.rest) == ("u", "v", 0.0) and not cloth.confined
    still = all(value == 0.0 for pin in case.pins for value in pin.displacement) and not any(p.on for p in case.pins)
    exact = body is not None and body.is_exact
    probes = np.random.default_rng(0).random((PROBES, 3)) - [0.0, 0.0, 0.5]  # about the sheet
    places = {tuple(np.round(point, 12)) for pin in case.pins for point in pin.at}

    def kept(swap: bool, signs: Array) -> bool:
        assert body is not None
        moved, images = np.array(sorted(places)).reshape(-1, 2), probes.copy()
        images[:, :2] = images_of(probes[:, :2], swap, signs)
        same = np.allclose(body.distance(images), body.distance(probes), rtol=0, atol=ALIKE)
        return same and {tuple(np.round(point, 12)) for point in images_of(moved, swap, signs)} == places

    everything = [(bool(swap), np.array(signs)) for swap, *signs in product((0, 1), (1.0, -1.0), (1.0, -1.0))]
    return [one for one in everything if kept(*one)] if plain and still and exact else everything[:1]


def images_of(points: Array, swap: bool, signs: Array) -> Array:
    """Return the images of points (n, 2) of the square."""
    turned = points[:, ::-1] if swap else points
    return np.asarray(MIDDLE + signs * (turned - MIDDLE))


def fold_orbits(points: Array, weights: Array, found: list[tuple[bool, Array]]) -> tuple[Array, Array]:
    """Return one point of each orbit, and the weights of all of it, of points whose weights share the symmetry."""
    images = np.stack([images_of(points, *one) for one in found]).round(12)
    ranks = images[..., 0] + 1e-6 * images[..., 1]  # coordinates differ by more, or not at all
    first = ranks[0] <= ranks.min(axis=0) + 1e-11
    size = np.array([len(np.unique(ranks[:, number].round(11))) for number in np.nonzero(first)[0]])
    return points[first], weights[first] * size


def span_of(side: int, axes: list[int], found: list[tuple[bool, Array]]) -> Sparse:
    """Return the sparse map from symmetric unknowns to coefficients (side^2), component by component."""
    count = side**2
    rows, columns = np.divmod(np.arange(count), side)
    numbers, signs = list[NDArray[np.int64]](), list[Array]()
    for swap, turned in found:
        places = [columns, rows] if swap else [rows, columns]
        i, j = (side - 1 - p if sign < 0 else p for p, sign in zip(places, turned, strict=True))
        component = [1, 0, 2] if swap else [0, 1, 2]  # that a component becomes
        sign = np.append(turned, 1.0)
        numbers.append(np.concatenate([axes.index(component[axis]) * count + i * side + j for axis in axes]))
        signs.append(np.concatenate([np.full(count, sign[component[axis]]) for axis in axes]))
    images, ones = np.stack(numbers), np.stack(signs)
    own = np.arange(len(axes) * count)
    none = np.any((images == own) & (ones < 0), axis=0)
    lead = images.argmin(axis=0)
    leader, sign = images[lead, own], ones[lead, own]
    _, column = np.unique(leader[~none], return_inverse=True)
    return coo_matrix((sign[~none], (own[~none], column)), shape=(len(own), int(column.max()) + 1)).tocsr()
