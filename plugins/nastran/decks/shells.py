"""Solve the Scordelis-Lo roof or a square plate with MYSTRAN, by a deck of its own: no code of shellbench.

    MYSTRAN=/path/to/mystran python shells.py roof CQUAD4K 8 16 32
    MYSTRAN=/path/to/mystran python shells.py roof CQUAD4 8 16 32 K6ROT=1e-4
    MYSTRAN=/path/to/mystran python shells.py plate CTRIA3 8 16 32 hard

The whole shell is meshed with n x n cells; for triangles they are cut along one diagonal. The corners of a cell get
equal shares of its exact load. `snorm` gives the surface's normals at the grid points, `held` holds the rotations about
them, and `hard` keeps normals from turning in the plane of a support. The roof's vertical deflection in the middle of a
free edge is .3005925 (thin), .301454 (with shear, hard) and .302025 (soft); the thin plate's centre sinks by .4874823.
"""

import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path


def roof(n):
    """Return E, nu, h, a map from the unit square, normals, supports, load and total area of the roof."""
    radius, length, half = 25.0, 50.0, math.radians(40)

    def place(s, t):
        angle = half * (2 * s - 1)
        return radius * math.sin(angle), radius * math.cos(angle), length * t

    def normal(s, t):
        angle = half * (2 * s - 1)
        return -math.sin(angle), -math.cos(angle), 0.0

    held = {(i, j): "12" for i in range(n + 1) for j in (0, n)}
    held[n // 2, n // 2] = "3"  # the axial rigid motion
    area = 2 * half * radius * length
    return 4.32e8, 0.0, 0.25, place, normal, held, "6", (0.0, -90.0, 0.0), area, (0, n // 2), 1


def plate(n):
    """Return the same of the simply supported plate, all of whose rim is held in x, y and z."""
    rim = {(i, j): "123" for i in range(n + 1) for j in range(n + 1) if {i, j} & {0, n}}
    return 1e7, 0.0, 1.0, lambda s, t: (100 * s, 100 * t, 0.0), lambda s, t: (0.0, 0.0, 1.0), rim, None, (
        0.0, 0.0, -1.0), 1e4, (n // 2, n // 2), 2  # fmt: skip


def deck(shell, element, n, hard, parameters, snorm, drilling):
    """Return the text of a deck, the number of the watched grid point, and its component."""
    youngs, nu, h, place, normal, held, turning, load, area, watched, component = shell(n)
    number = {(i, j): 1 + i * (n + 1) + j for i in range(n + 1) for j in range(n + 1)}
    thin, triangles = element.endswith("K"), element.startswith("CTRIA")
    lines = [
        "SOL 1",
        "CEND",
        "DISPLACEMENT = ALL",
        "SPC = 1",
        *(["MPC = 1"] if drilling else []),
        "LOAD = 1",
        "BEGIN BULK",
    ]
    lines += [f"PARAM   {name:<8}{value}" for name, value in parameters]
    lines += [f"MAT1*   {1:16d}{youngs:16.9E}{'':16}{nu:16.9E}", "*"]
    lines += [f"PSHELL* {1:16d}{1:16d}{h:16.9E}{1:16d}", f"*       {'':16}{'' if thin else 1:>16}"]
    force = dict.fromkeys(number, 0.0)
    cell = 0
    for i in range(n):
        for j in range(n):
            corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
            for loop in [corners[:3], [corners[0], *corners[2:]]] if triangles else [corners]:
                cell += 1
                lines.append(f"{element:8}{cell:8d}{1:8d}" + "".join(f"{number[ij]:8d}" for ij in loop))
                for ij in loop:
                    force[ij] += area / n**2 / (2 if triangles else 1) / len(loop)
    for (i, j), at in number.items():
        x, y, z = place(i / n, j / n)
        lines += [f"GRID*   {at:16d}{'':16}{x:16.9E}{y:16.9E}", f"*       {z:16.9E}"]
        if snorm:
            lines.append(f"SNORM   {at:8d}{0:8d}" + "".join(f"{c:8.5f}" for c in normal(i / n, j / n)))
        lines += [
            f"FORCE*  {1:16d}{at:16d}{0:16d}{force[i, j]:16.9E}",
            "*       " + "".join(f"{c:16.9E}" for c in load),
        ]
        components = held.get((i, j), "")
        if hard and turning and "1" in components:
            components += turning
        if hard and turning is None:  # the plate's rim: normals don't turn along it
            components += ("4" if i in (0, n) else "") + ("5" if j in (0, n) else "")
        if components:
            lines.append(f"SPC1    {1:8d}{components:>8}{at:8d}")
        if drilling:
            axis = normal(i / n, j / n)  # the rotation about the exact normal is held: one equation
            terms = sorted(((c, 4 + k) for k, c in enumerate(axis) if abs(c) > 1e-12), key=lambda term: -abs(term[0]))
            if len(terms) == 1:
                lines.append(f"SPC1    {1:8d}{terms[0][1]:8d}{at:8d}")
            else:
                (c1, d1), (c2, d2) = terms[:2]
                lines.append(f"MPC     {1:8d}{at:8d}{d1:8d}{c1:8.5f}{at:8d}{d2:8d}{c2:8.5f}")
    return "\n".join([*lines, "ENDDATA", ""]), number[watched], component


def deflection(text, at, component, program=None):
    """Return a displacement of a grid point, downward, from MYSTRAN's output F06, and the seconds it took."""
    with tempfile.TemporaryDirectory() as folder:
        job = Path(folder, "shell.bdf")
        job.write_text(text)
        begin = time.perf_counter()
        subprocess.run(
            [program or os.environ.get("MYSTRAN", "mystran"), job.name], cwd=folder, capture_output=True, check=True
        )
        seconds = time.perf_counter() - begin
        found = job.with_suffix(".F06").read_text()
    table = found.split("D I S P L A C E M E N T S", 1)[1].splitlines()
    row = next(words for words in map(str.split, table) if len(words) == 8 and words[0] == str(at))
    return -float(row[2 + component]), seconds


def main(shell, element, *words):
    """Print the deflection for each number of cells."""
    sizes = [int(word) for word in words if word.isdigit()]
    parameters = [word.split("=") for word in words if "=" in word]
    for n in sizes:
        text, at, component = deck(
            globals()[shell], element, n, "hard" in words, parameters, "snorm" in words, "held" in words
        )
        value, seconds = deflection(text, at, component)
        asked = " ".join(word for word in words if not word.isdigit())
        print(f"{shell} {element} {asked:24} n = {n:3d}: {value:.7f}  {seconds:.2f} s")


if __name__ == "__main__":
    main(*sys.argv[1:])
