"""Solve MacNeal & Harder's twisted beam with MYSTRAN, by a deck of its own: no code of shellbench.

    MYSTRAN=/path/to/mystran python beam.py CQUAD4K 12 24 48
    MYSTRAN=/path/to/mystran python beam.py CQUAD4 12 24 48 QUAD4TYP=MITC4+ snorm

The strip 12 x 1.1 is .32 thick and twisted by 90 degrees; one end is clamped. A force of 1 at the other end, along y,
is shared by its grid points. The end moves by 1.75092e-3 (thin) or 1.75325e-3 (with shear) along the force.
"""

import math
import sys

from shells import deflection

LENGTH, WIDTH, TWIST = 12.0, 1.1, math.pi / 2


def place(i, j, along, across):
    """Return a grid point and the surface's normal there."""
    x, s = LENGTH * i / along, WIDTH * (j / across - 0.5)
    turn, rate = TWIST * i / along, TWIST / LENGTH
    c, d = math.cos(turn), math.sin(turn)
    size = math.hypot(1.0, rate * s)
    return (x, s * c, s * d), (rate * s / size, -d / size, c / size)


def deck(element, along, parameters, snorm):
    """Return a deck with cells that are nearly square, and the grid point at the middle of the loaded end."""
    across = max(2, 2 * round(along * WIDTH / LENGTH / 2))
    number = {(i, j): 1 + i * (across + 1) + j for i in range(along + 1) for j in range(across + 1)}
    lines = ["SOL 1", "CEND", "DISPLACEMENT = ALL", "SPC = 1", "LOAD = 1", "BEGIN BULK"]
    lines += [f"PARAM   {name:<8}{value}" for name, value in parameters]
    lines += [f"MAT1    {1:8d}{'29.+6':>8}{'':8}{'.22':>8}"]
    lines += [f"PSHELL  {1:8d}{1:8d}{'.32':>8}{1:8d}{'':8}{'' if element.endswith('K') else 1:>8}"]
    for (i, j), at in number.items():
        (x, y, z), normal = place(i, j, along, across)
        lines += [f"GRID*   {at:16d}{'':16}{x:16.9E}{y:16.9E}", f"*       {z:16.9E}"]
        if snorm:
            lines.append(f"SNORM   {at:8d}{0:8d}" + "".join(f"{c:8.5f}" for c in normal))
        if i == 0:
            lines.append(f"SPC1    {1:8d}{123456:8d}{at:8d}")
        if i == along:
            share = (1.0 if 0 < j < across else 0.5) / across
            lines.append(f"FORCE   {1:8d}{at:8d}{0:8d}{share:8.6f}{'0.':>8}{'1.':>8}{'0.':>8}")
    cell = 0
    for i in range(along):
        for j in range(across):
            corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
            halves = [corners[:3], [corners[0], *corners[2:]]] if element.startswith("CTRIA") else [corners]
            for loop in halves:
                cell += 1
                lines.append(f"{element:8}{cell:8d}{1:8d}" + "".join(f"{number[ij]:8d}" for ij in loop))
    return "\n".join([*lines, "ENDDATA", ""]), number[along, across // 2]


if __name__ == "__main__":
    words = sys.argv[2:]
    parameters = [word.split("=") for word in words if "=" in word]
    for along in (int(word) for word in words if word.isdigit()):
        text, at = deck(sys.argv[1], along, parameters, "snorm" in words)
        value, seconds = deflection(text, at, 1)
        print(
            f"{' '.join(w for w in sys.argv[1:] if not w.isdigit())}, {along:3d} along: {-value:.6e}  {seconds:.2f} s"
        )
