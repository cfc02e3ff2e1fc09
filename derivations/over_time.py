"""Quantities of a motion by the names that a case gives them, and how far two computations of them agree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from .estimate import Estimate
from .surface_strains import Array

UNITS = {"energy": "J", "hinge": "N"}


def at_time(
    time: float, vectors: Mapping[str, Array], energies: Mapping[str, float], axes: str = "xyz"
) -> dict[str, float]:
    """Name components of vectors and energies: corner_x_200ms, kinetic_energy_200ms."""
    label = f"{1000 * time:.0f}ms"
    values: dict[str, float] = {}
    for place, vector in vectors.items():
        values |= {f"{place}_{axis}_{label}": float(x) for axis, x in zip(axes, vector, strict=False)}
    return values | {f"{kind}_energy_{label}": energy for kind, energy in energies.items()}


def _group(name: str) -> tuple[str, str]:
    words = name.split("_")
    return ("energy" if "energy" in words else words[0]), words[-1]


def between(fine: Mapping[str, float], coarse: Mapping[str, float], rounding: float) -> dict[str, Estimate]:
    """Values of the fine computation with their distances from a clearly coarser one as uncertainties.

    Components of one vector, and the energies, which trade with one another, share the largest distance at their
    time: a single number may agree by chance. The rounding is absolute, in m, N and J.
    """
    distances: dict[tuple[str, str], float] = {}
    for name, value in fine.items():
        distances[_group(name)] = max(abs(value - coarse[name]), distances.get(_group(name), 0.0))
    return {
        name: Estimate(value, distances[_group(name)] + rounding, UNITS.get(_group(name)[0], "m"))
        for name, value in fine.items()
    }


def _limit(longer: float, far: float, shorter: float, near: float) -> float:
    return near - shorter * (far - near) / (longer - shorter)


def extrapolated(meshes: Sequence[tuple[float, Mapping[str, float]]], rounding: float) -> dict[str, Estimate]:
    """Limits of values that are power series in a size, from three sizes with their values, falling.

    Neville's scheme: a straight line through two sizes each, and of these the parabola through all three. The
    uncertainty is the distance of the parabola's limit from that of the last line, shared as in `between`.
    """
    (long, coarse), (middle, medium), (short, fine) = meshes
    first = {name: _limit(long, coarse[name], middle, medium[name]) for name in fine}
    last = {name: _limit(middle, medium[name], short, value) for name, value in fine.items()}
    return between({name: _limit(long, first[name], short, last[name]) for name in fine}, last, rounding)
