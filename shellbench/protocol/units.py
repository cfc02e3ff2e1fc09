"""Units in files of other programs: their factors in SI units, their dimensions, and systems of them."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from shellbench.errors import InputError, without_middle

Powers = tuple[int, int, int, int]  # of length, force, time and angle
LENGTH: Powers = (1, 0, 0, 0)
FORCE: Powers = (0, 1, 0, 0)
STRESS: Powers = (-2, 1, 0, 0)
UNITS: dict[Powers, dict[str, float]] = {
    (0, 0, 0, 0): {"": 1.0, "1": 1.0, "-": 1.0, "%": 0.01},
    LENGTH: {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "km": 1e3, "in": 0.0254, "ft": 0.3048},
    FORCE: {"N": 1.0, "mN": 1e-3, "kN": 1e3, "MN": 1e6, "lbf": 4.4482216152605},
    STRESS: {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "psi": 4.4482216152605 / 0.0254**2},
    (1, 1, 0, 0): {"J": 1.0, "mJ": 1e-3, "kJ": 1e3},
    (0, 0, 1, 0): {"s": 1.0, "ms": 1e-3},
    (0, 0, -1, 0): {"Hz": 1.0, "kHz": 1e3},
    (0, 0, 0, 1): {"rad": 1.0, "deg": math.pi / 180},
    (-1, 1, 2, 0): {"kg": 1.0, "g": 1e-3, "t": 1e3},
}
KNOWN = {name: (factor, powers) for powers, names in UNITS.items() for name, factor in names.items()}
PART = re.compile(r"([A-Za-z]+)\^?(\d?)")


def unit_of(text: str) -> tuple[float, Powers]:
    """Return the factor of a unit such as "N mm" or "N/mm2" in SI units, and its dimension; InputError, as a clause."""
    if text.strip() in KNOWN:
        return KNOWN[text.strip()]
    factor, total = 1.0, [0, 0, 0, 0]
    for number, side in enumerate(text.replace("*", " ").replace("·", " ").split("/")):
        for word in side.split():
            part = PART.fullmatch(word)
            if word != "1" and (part is None or part[1] not in KNOWN):
                names = ", ".join(name for name in KNOWN if name.isalpha())
                raise InputError(f"found {without_middle(text)!r}, but units are made of {names}")
            if part is not None:
                size, powers = KNOWN[part[1]]
                times = int(part[2] or 1) * (-1 if number else 1)
                factor *= size**times
                total = [a + times * b for a, b in zip(total, powers, strict=True)]
    return factor, (total[0], total[1], total[2], total[3])


def factor_between(given: str, wanted: str) -> float:
    """Return the factor from one unit to another; InputError, as a clause, if they are of different dimensions."""
    if given.strip() == wanted:
        return 1.0
    (one, of), (other, asked) = unit_of(given), unit_of(wanted)
    if of != asked:
        raise InputError(f"found {without_middle(given)!r}, but the quantity is in {wanted or 'no unit'}")
    return one / other


@dataclass(frozen=True)
class System:
    """Names of the units of a system, such as mm-N-MPa: of length, force and stress."""

    length: str
    force: str
    stress: str

    @classmethod
    def read(cls, name: str) -> System:
        """Return the system of a name; InputError if it is no length, force and stress that fit together."""
        names = name.split("-")
        try:
            (length, one), (force, two), (stress, three) = map(unit_of, names)
            if (one, two, three) != (LENGTH, FORCE, STRESS) or not math.isclose(stress * length**2, force):
                raise ValueError
        except ValueError:
            raise InputError(f"--units: found {name!r}, but it must be such as m-N-Pa, mm-N-MPa or mm-kN-GPa") from None
        return cls(*names)

    def unit(self, length: int, force: int) -> str:
        """Return the unit of a dimension length**length force**force, such as "N mm"; neither is above 1."""
        over = f"/{self.length}" + (f"^{-length}" if length < -1 else "") if length < 0 else ""
        if not force:
            return f"1{over}" if over else self.length
        return self.stress if length == -2 else f"{self.force} {self.length}" if length > 0 else self.force + over


def length_of(words: str) -> str | None:
    """Return the unit of length of a case by the words for its units, such as "mm, t, s"; None if they name none."""
    return "m" if words == "SI" else next((w for w in re.findall(r"\w+", words) if w in UNITS[LENGTH]), None)
