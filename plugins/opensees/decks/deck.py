"""Solve the Scordelis-Lo roof or a square plate with a shell element of OpenSees: `python deck.py roof ShellDKGQ 16`.

The whole shell has n by n cells, n even. A cell's load is put on its corners in equal shares. Only openseespy is used,
nothing of shellbench. Prints how far the middle of the roof's edge, or of the plate, sinks. Further words are options
of the element: `python deck.py roof ASDShellQ4 16 -noeas`.
"""

import sys
from math import cos, pi, sin

import openseespy.opensees as ops

ROOF = {"young": 4.32e8, "thickness": 0.25, "load": 90.0, "area": 25 * 80 * pi / 180 * 50}  # radius 25, 80 degrees
PLATE = {"young": 1e7, "thickness": 1.0, "load": 1.0, "area": 100.0**2}


def deflection(shell, kind, n, *options):
    """Return the deflection on n by n cells."""
    roof, of = shell == "roof", ROOF if shell == "roof" else PLATE
    ops.wipe()
    ops.model("basic", "-ndm", 3, "-ndf", 6)
    number, angle = lambda i, j: i * (n + 1) + j + 1, lambda i: 40 * pi / 180 * (2 * i / n - 1)
    for i in range(n + 1):
        for j in range(n + 1):
            end, side, middle = j in (0, n), i in (0, n), 2 * i == 2 * j == n
            if roof:  # the ends hold x and z, and the middle y
                place, held = (25 * sin(angle(i)), 50 * j / n, 25 * cos(angle(i))), (end, middle, end)
            else:  # the rim holds z; the middle x and y, and the middle of a side x
                place, held = (100 * i / n, 100 * j / n, 0.0), (middle or (end and 2 * i == n), middle, end or side)
            ops.node(number(i, j), *place)
            ops.fix(number(i, j), *map(int, held), 0, 0, 0)
    ops.section("ElasticMembranePlateSection", 1, of["young"], 0.0, of["thickness"], 0.0)
    ops.timeSeries("Linear", 1)
    ops.pattern("Plain", 1, 1)
    tag = 0
    for i in range(n):
        for j in range(n):
            a, b, c, d = number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)
            parts = [(a, b, c), (a, c, d)] if kind[-1] in "T3" else [(a, b, c, d)]
            for corners in parts:
                tag += 1
                ops.element(kind, tag, *corners, 1, *options)
                for node in corners:
                    ops.load(node, 0, 0, -of["load"] * of["area"] / n**2 / len(parts) / len(corners), 0, 0, 0)
    ops.constraints("Plain")
    ops.numberer("RCM")
    ops.system("UmfPack")
    ops.integrator("LoadControl", 1.0)
    ops.algorithm("Linear")
    ops.analysis("Static")
    if ops.analyze(1):
        raise SystemExit("OpenSees finds no equilibrium")
    return -ops.nodeDisp(number(0 if roof else n // 2, n // 2), 3)


if __name__ == "__main__":
    print(deflection(sys.argv[1], sys.argv[2], int(sys.argv[3]), *sys.argv[4:]))
