"""Solve the Scordelis-Lo roof or a square plate with a shell element of CalculiX: `python deck.py roof S8R 16`.

The whole shell has n by n cells, n even. The load is *DLOAD GRAV of a heavy material, so that CalculiX lumps it. Only
NumPy and `ccx` are used, nothing of shellbench. Prints how far the middle of the roof's edge, or of the plate, sinks.
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOF = {"young": 4.32e8, "thickness": 0.25, "load": 90.0}  # radius 25, length 50, half angle 40 degrees, ends held
PLATE = {"young": 1e7, "thickness": 1.0, "load": 1.0}  # sides of 100, rim held


def elements(kind, n):
    """Return the nodes of each element on a lattice of 2n + 1 by 2n + 1 points, corners first."""
    number, found = lambda i, j: i * (2 * n + 1) + j + 1, []
    for i in range(0, 2 * n, 2):
        for j in range(0, 2 * n, 2):
            square = [(i, j), (i + 2, j), (i + 2, j + 2), (i, j + 2)]
            for corners in [square] if kind[1] in "48" else [square[:3], square[:1] + square[2:]]:
                middles = [
                    ((a + c) // 2, (b + d) // 2)
                    for (a, b), (c, d) in zip(corners, [*corners[1:], corners[0]], strict=True)
                ]
                found.append([number(a, b) for a, b in (corners + middles if kind[1] in "68" else corners)])
    return found


def deflection(shell, kind, n):
    """Return the deflection on n by n cells."""
    roof, of = shell == "roof", ROOF if shell == "roof" else PLATE
    i, j = (a.ravel() for a in np.indices((2 * n + 1, 2 * n + 1)))
    angle = np.radians(40) * (i / n - 1)
    x, y, z = (25 * np.sin(angle), 25.0 * j / n, 25 * np.cos(angle)) if roof else (50.0 * i / n, 50.0 * j / n, 0.0 * i)
    cells = elements(kind, n)
    used = np.unique(np.concatenate(cells)) - 1
    ends, sides, middle = j % (2 * n) == 0, i % (2 * n) == 0, (i == n) & (j == n)
    # The roof's ends hold x and z, its middle y. The plate's rim holds z, its middle x and y, the middle of a side x.
    on = (ends, middle, ends) if roof else (middle | (ends & (i == n)), middle, ends | sides)
    held = [(k, c) for k in used for c in (1, 2, 3) if on[c - 1][k]]
    asked = 1 + (n if roof else n * (2 * n + 1) + n)
    text = ["*NODE", *(f"{k + 1},{x[k]:.13g},{y[k]:.13g},{z[k]:.13g}" for k in used)]
    text += [f"*ELEMENT,TYPE={kind},ELSET=E", *(f"{e},{','.join(map(str, c))}" for e, c in enumerate(cells, 1))]
    text += ["*MATERIAL,NAME=M", "*ELASTIC", f"{of['young']},0", "*DENSITY", f"{of['load'] / of['thickness']}"]
    text += ["*SHELL SECTION,ELSET=E,MATERIAL=M", f"{of['thickness']}", "*NSET,NSET=P", f"{asked}"]
    text += ["*BOUNDARY", *(f"{k + 1},{c}" for k, c in held)]
    text += ["*STEP", "*STATIC", "*DLOAD", "E,GRAV,1.,0,0,-1", "*NODE PRINT,NSET=P", "U", "*END STEP", ""]
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "job.inp").write_text("\n".join(text))
        subprocess.run(["ccx", "-i", "job"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
        return -float(re.search(rf"^\s+{asked}\s.*?(\S+)$", Path(folder, "job.dat").read_text(), re.M).group(1))


if __name__ == "__main__":
    print(deflection(sys.argv[1], sys.argv[2], int(sys.argv[3])))
